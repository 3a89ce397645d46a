"""Newton's second law by symplectic Euler: ``v += dt F / m``, then ``x += dt v`` with the new speed."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def integrate(
    # inputs:
    force: wp.array[Any],
    mass: wp.array[wp.Float],
    pinned: wp.array[wp.bool],
    time_step: wp.array[wp.Float],
    # in and out:
    position: wp.array[Any],
    velocity: wp.array[Any],
):
    """Advance every vertex by one step; a pinned vertex stays exactly where it is, at rest."""
    vertex = wp.tid()
    if pinned[vertex]:
        velocity[vertex] = velocity.dtype()
        return
    step = time_step[0]
    speed = velocity[vertex] + (step / mass[vertex]) * force[vertex]
    velocity[vertex] = speed
    position[vertex] = position[vertex] + step * speed
