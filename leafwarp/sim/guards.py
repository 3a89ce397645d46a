"""What the arrays of the structure must hold, and what is wrong with them once a motion has come upon it.

The kernels that bound the step of explicit motion and those that prepare a step of the others turn a value that cannot
be into one that is not a number, which the host cannot miss. Only then are the arrays themselves looked through.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.sim.launch import State


@dataclass(frozen=True)
class Guard:
    """What an array must hold, beside finite numbers.

    Attributes:
        array: Its name in the state.
        quantity: What it holds of each element.
        unit: Its unit.
        element: What an element of it belongs to.
        lowest: No number is less than this; None: all are accepted.
        may_be_lowest: Whether that itself is accepted.
        remedy: What decides it.
    """

    array: str
    quantity: str
    unit: str
    element: str
    lowest: float | None
    may_be_lowest: bool
    remedy: str

    @property
    def accepted(self) -> str:
        """What is accepted, for a message."""
        if self.lowest is None:
            return "a finite number"
        return f"a finite number {'from' if self.may_be_lowest else 'above'} {self.lowest:g}"

    def first_fault(self, values: np.ndarray) -> int | None:
        """Index of the first element that is not accepted."""
        sound = np.isfinite(values)
        if self.lowest is not None:
            sound &= values >= self.lowest if self.may_be_lowest else values > self.lowest
        wrong = np.flatnonzero(~(sound if sound.ndim == 1 else sound.all(axis=1)))
        return int(wrong[0]) if len(wrong) else None


_SHAPE = "lower the load, the curl or the stiffness"
# In the order in which one makes the next one wrong.
GUARDS = (
    Guard("mass", "mass", "kg", "vertex", 0.0, False, "structure.dry_mass and structure.water_mass decide it"),
    Guard("edge_rest_length", "rest length", "m", "edge", 0.0, True, "shrink.curve and shrink.along_veins decide it"),
    Guard("edge_stiffness", "stiffness", "N/m", "edge", 0.0, True,
          "structure.membrane_stiffness, structure.vein_stiffness and structure.stiffness decide it"),
    Guard("hinge_rest_angle", "rest angle", "rad", "hinge", None, True, "curl.mismatch and curl.thickness decide it"),
    Guard("hinge_stiffness", "stiffness", "N m/rad", "hinge", 0.0, True,
          "structure.bending_stiffness, structure.vein_bending_stiffness and structure.stiffness decide it"),
    Guard("position", "position", "m", "vertex", None, True, _SHAPE),
    Guard("velocity", "velocity", "m/s", "vertex", None, True, _SHAPE),
    Guard("hinge_angle", "angle", "rad", "hinge", None, True, _SHAPE),
)  # fmt: skip


def find_fault(state: State) -> str | None:
    """The first thing that is wrong with the structure, and what helps; None where nothing is."""
    for guard in GUARDS:
        if guard.array not in state:
            continue
        values = state[guard.array].numpy()
        index = guard.first_fault(values)
        if index is not None:
            found = np.array2string(values[index], precision=6, separator=", ")
            return (
                f"the {guard.quantity} of {guard.element} {index} is {found} {guard.unit}; accepted: "
                f"{guard.accepted}; {guard.remedy}"
            )
    return None
