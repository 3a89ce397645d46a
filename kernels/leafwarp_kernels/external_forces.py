"""Forces from outside: gravity, and the drag of air that stands still or blows."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def add_gravity(
    # inputs:
    mass: wp.array[wp.Float],
    gravity: Any,
    # in and out:
    force: wp.array[Any],
):
    """Add the weight ``m g``."""
    vertex = wp.tid()
    force[vertex] = force[vertex] + mass[vertex] * gravity


@wp.kernel
def add_air_drag(
    # inputs:
    velocity: wp.array[Any],
    mass: wp.array[wp.Float],
    wind: Any,
    drag: wp.Float,
    # in and out:
    force: wp.array[Any],
):
    """Add ``-drag m (v - wind)``: the air takes up a leaf's speed at the rate ``drag`` [1/s], whatever its mass."""
    vertex = wp.tid()
    force[vertex] = force[vertex] - (drag * mass[vertex]) * (velocity[vertex] - wind)
