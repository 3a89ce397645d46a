"""Water that leaves through the surface of the leaf."""

from __future__ import annotations

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.steps import FluidSteps
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.transpiration import transpire

# A rate above this empties any cell in any step that can be computed; float32 holds its product with a step.
MAXIMUM_RATE = 1e15


class Transpiration(Stage):
    """Water that leaves through the leaf's surface: a cuticular part everywhere, the rest through stomata.

    Raises:
        InputError: The scene has a stomatal part, but the map shows no stomata on the leaf.
    """

    name = "transpiration"
    purpose = "water lost through stomata and cuticle"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        rows = leaf.mask.shape[0]
        self._stomatal = scene.transpiration.rate > scene.transpiration.cuticle_rate
        self._step = FluidSteps.of(scene).length
        arrays = [ArraySpec("transpired_by_row", (rows,), "float64", "content transpired from each row of cells")]
        if self._stomatal:
            arrays.append(ArraySpec("stomatal_rate", leaf.mask.shape, "real", "loss through stomata [1/s]"))
            if not leaf.maps["stomata"][leaf.mask].sum() > 0.0:
                raise InputError(
                    "maps.stomata: the map is 0 on the whole leaf; accepted: a map with stomata, or "
                    f"transpiration.cuticle_rate = {scene.transpiration.rate:g} (the rate) for a leaf without"
                )
        self.arrays = tuple(arrays)

    def bind(self, state: State) -> None:
        table, mask = self.scene.transpiration, self.leaf.mask
        if self._stomatal:
            stomata = np.where(mask, self.leaf.maps["stomata"], 0.0)
            share = stomata / stomata[mask].mean()
            state.upload("stomatal_rate", np.minimum(share * (table.rate - table.cuticle_rate), MAXIMUM_RATE))
        inputs = [
            min(table.cuticle_rate, MAXIMUM_RATE),
            "stomatal_rate" if self._stomatal else None,
            self._step,
        ]
        self.commands = [state.record(transpire, mask.shape[0], inputs, ["water", "transpired_by_row"])]
