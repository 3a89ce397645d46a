"""The map of the water, and the water at the moment of a frame."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.launch import ArraySpec, State
from leafwarp.sim.stage import Stage
from leafwarp_kernels.interpolation import CHANGED, SIGN_COUNT, WRONG, interpolate_water

# By how much rounding may take the water out of its bounds, in units of the last place of their greatest.
ROUNDING = 1000.0
# Accounts of the water by rows, where a stage keeps them.
ACCOUNTS = ("transpired", "added_by_source_x")


def start_content(leaf: Leaf) -> np.ndarray:
    """Relative water content at the start, shape [ny, nx]."""
    return np.where(leaf.mask, np.clip(leaf.maps["water"], 0.0, 1.0), 0.0)


def content_bounds(scene: Scene, leaf: Leaf) -> tuple[float, float]:
    """The least and the most that a cell can come to hold: from what start, supply and losses leave it."""
    start = start_content(leaf)[leaf.mask]
    found = [float(start.min()), float(start.max())] if len(start) > 0 else [0.0]
    if scene.source is not None and scene.source.conductance > 0.0:
        found.append(scene.source.supply)
    if scene.transpiration is not None and scene.transpiration.rate > 0.0:
        found.append(0.0)
    return min(found), max(found)


class Water(Stage):
    """Owns the map of the relative water content; blends it to the moment of a frame, and sees that it is sound.

    ``water`` is the state after the last fluid step, ``water_before`` the one before it, ``water_now`` the
    linear blend at the frame's plant time: exactly ``water`` where the frame falls on the end of a step.

    No water is less than 0, or more than the start or the supply had, but for rounding and what an unsplit step's
    tolerance may leave in a single cell. Nor does anything enter or leave that is not a number.

    Attributes:
        looks: How often it has been blended.
    """

    name = "water"
    purpose = "water map at the frame's plant time, between the last two fluid steps; check of it"
    rate = "frame"
    host_reads = ("water", "water_sign")
    host_writes = ("water_before",)

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        self.looks = 0
        shape = leaf.mask.shape
        self.arrays = (
            ArraySpec("water", shape, "real", "relative water content after the last fluid step", padded=True),
            ArraySpec("water_before", shape, "real", "relative water content before the last fluid step", padded=True),
            ArraySpec("water_now", shape, "real", "relative water content at the frame", padded=True),
            ArraySpec("water_sign", (SIGN_COUNT,), "int32", "last look at which it was wrong, or had changed"),
        )

    def bind(self, state: State) -> None:
        content = start_content(self.leaf)
        for name in ("water", "water_before", "water_now"):
            state.upload(name, content)
        self._state = state
        self._bounds = self._find_bounds(content_bounds(self.scene, self.leaf)[1])
        before, water, now = (state.lanes(name) for name in ("water_before", "water", "water_now"))
        accounts = [name if name in state else None for name in ACCOUNTS]
        inputs = [before, water, 1.0, *self._bounds, *accounts, 0]
        self.commands = [state.record(interpolate_water, now.shape, inputs, [now, "water_sign"])]

    def _find_bounds(self, most: float) -> tuple[float, float]:
        """The least and the most that a cell may hold, but for rounding and tolerances."""
        scene = self.scene
        slack = ROUNDING * float(np.finfo(self._state.precision).eps)
        if scene.water_flows and scene.fluid.scheme == "unsplit":
            slack += scene.residual_tolerance * math.sqrt(self.leaf.mask.sum())
        return -slack * most, most + slack * most

    def keep(self) -> None:
        """Remember the water before the next step."""
        wp.copy(self._state.whole("water_before"), self._state.whole("water"))

    def blend(self, share: float) -> None:
        """Set ``water_now`` to the moment when this share of the last step has passed."""
        self.looks += 1
        for command in self.commands:
            command.launch.set_param_by_name("share", self._state.real(share))
            command.launch.set_param_by_name("look", self.looks)
        self.run()

    def last_signs(self) -> tuple[int, int]:
        """The last looks at which the water was wrong, and at which the last step had changed it; 0: none.

        Waits for the device.
        """
        signs = self._state["water_sign"].numpy()
        return int(signs[WRONG]), int(signs[CHANGED])

    def fault(self, name: str = "water_now") -> str | None:
        """What is wrong with the water, and what would help; None where nothing is.

        Args:
            name: Which of the maps to look at.
        """
        values = self._state[name].numpy()
        least, most = self._bounds
        rows, columns = np.nonzero(~((values >= least) & (values <= most)))
        if len(rows) > 0:
            row, column = int(rows[0]), int(columns[0])
            what = f"the water of cell {column} of row {row} of the map is {values[row, column]:.6g}"
            return f"{what}; accepted: {least:.3g} to {most:.6g}; {self._remedy()} would help"
        for account in ACCOUNTS:
            if account not in self._state:
                continue
            rows = np.flatnonzero(~np.isfinite(self._state[account].numpy().sum(axis=0)))
            if len(rows) > 0:
                what = f"water of row {rows[0]} of the map that is no finite number was {account.partition('_')[0]}"
                return f"{what}; accepted: {least:.3g} to {most:.6g}; {self._remedy()} would help"
        return None

    def _remedy(self) -> str:
        remedies = ["a shorter fluid.step"]
        if self.scene.water_flows and self.scene.fluid.scheme == "unsplit":
            remedies += ["a smaller fluid.tolerance", "fluid.scheme = 'split'"]
        if self.scene.solver.precision == "float32":
            remedies.append("solver.precision = 'float64'")
        return ", ".join(remedies[:-1]) + f" or {remedies[-1]}" if len(remedies) > 1 else remedies[0]
