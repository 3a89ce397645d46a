"""What every motion is judged by, and what no leaf does: signs that a motion went wrong."""

from __future__ import annotations

# Where a scene has no gravity of its own to compare forces and swings with.
STANDARD_GRAVITY = 9.80665  # [m/s^2]
# A leaf swings about its base within twice its length. A vertex that goes further than this many lengths in
# one frame has been thrown.
FARTHEST_TRAVEL = 4.0
# A membrane that bending or a load has torn out to this many times its rest length, and goes on stretching, is no leaf
# any more.
MOST_STRETCH = 3.0
TORN_REMEDY = (
    "the membrane does not hold: raise structure.membrane_stiffness, or lower structure.bending_stiffness, the curl or "
    "the load"
)


def thrown(travel: float, length: float) -> str:
    """What is wrong with a vertex that moved so far [m] in a frame, on a leaf of a length [m]."""
    return f"a vertex moved {travel:.3g} m, on a leaf of {length:.3g} m"


def torn(stretch: float) -> str:
    """What is wrong with a mesh of which an edge is so many times its rest length."""
    return f"an edge was stretched to {stretch:.3g} times its rest length"
