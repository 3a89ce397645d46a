"""Water that leaves through the surface of the leaf."""

from __future__ import annotations

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.specimen import once_a_photo
from leafwarp.scene import Scene
from leafwarp.sim.fluid.spans import line_spans, thread_segments
from leafwarp.sim.fluid.steps import FluidSteps
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.lanes import LANES
from leafwarp_kernels.transpiration import transpire, transpire_lanes, transpire_with_closure

# A rate above this empties any cell in any step that can be computed; float32 holds its product with a step.
MAXIMUM_RATE = 1e15


class Transpiration(Stage):
    """Water that leaves through the leaf's surface: a cuticular part everywhere, the rest through stomata.

    Where the stomata close as the leaf dries, a step takes what the differential equation says, however long it is.

    Raises:
        InputError: The scene has a stomatal part, but the map shows no stomata on the leaf.
    """

    name = "transpiration"
    purpose = "water lost through stomata and cuticle"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self._stomatal = scene.transpiration.rate > scene.transpiration.cuticle_rate
        self._closure = scene.transpiration.closure if scene.transpiration.stomata_close else None
        self._step = FluidSteps.of(scene).length
        arrays = []
        if self._stomatal:
            arrays.append(ArraySpec("stomatal_rate", leaf.mask.shape, "real", "loss by stomata [1/s]", padded=True))
            self._share = leaf.tile(once_a_photo(self._stomatal_share))
        if self._closure is not None:
            self.purpose += ", which close as the leaf dries"
            count = len(self._closure)
            arrays += [
                ArraySpec("closure_water", (count,), "float64", "water contents of the response curve of the stomata"),
                ArraySpec("closure_opening", (count,), "float64", "opening of the stomata there, 0 to 1"),
            ]
        self.arrays = tuple(arrays)

    def _stomatal_share(self, leaf: Leaf) -> np.ndarray:
        """Density of stomata over its mean on the leaf, shape [ny, nx]."""
        stomata = np.where(leaf.mask, leaf.maps["stomata"], 0.0)
        if not stomata.sum() > 0.0:
            raise InputError(
                "maps.stomata: the map is 0 on the whole leaf; accepted: a map with stomata, or "
                f"transpiration.cuticle_rate = {self.scene.transpiration.rate:g} (the rate) for a leaf without"
            )
        return stomata / stomata[leaf.mask].mean()

    def bind(self, state: State) -> None:
        table = self.scene.transpiration
        if self._stomatal:
            rate = self._share * (table.rate - table.cuticle_rate)
            state.upload("stomatal_rate", np.minimum(rate, MAXIMUM_RATE))
        self.commands = [self._record(state)]

        self._real = state.real

    def set_time_step(self, seconds: float) -> None:
        self.commands[0].launch.set_param_by_name("time_step", self._real(seconds))

    def _record(self, state: State) -> Command:
        mask, cuticle = self.leaf.mask, min(self.scene.transpiration.cuticle_rate, MAXIMUM_RATE)
        cells, segments = thread_segments(mask.shape[1], state)
        dim = (segments, mask.shape[0])
        self.add_array(state, ArraySpec("transpired", dim, "float64", "content transpired from segments of the rows"))
        outputs = ["water", "transpired"]
        if self._closure is not None:
            contents, openings = np.array(self._closure).T
            state.upload("closure_water", contents)
            state.upload("closure_opening", openings)
            inputs = [cuticle, "stomatal_rate", "closure_water", "closure_opening", self._step, cells]
            return state.record(transpire_with_closure, dim, inputs, outputs)
        stomatal = "stomatal_rate" if self._stomatal else None
        if state.many_threads:
            return state.record(transpire, dim, [cuticle, stomatal, self._step, cells], outputs)
        span = line_spans(mask)
        self.add_array(state, ArraySpec("transpiring_span", span.shape, "int32", "blocks of cells of each row"))
        state.upload("transpiring_span", np.stack([span[:, 0] // LANES, -(-span[:, 1] // LANES)], axis=1))
        inputs = [cuticle, stomatal and state.lanes(stomatal), "transpiring_span", self._step]
        return state.record(transpire_lanes, mask.shape[0], inputs, [state.lanes("water"), "transpired"])
