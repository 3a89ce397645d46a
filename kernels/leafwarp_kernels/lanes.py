"""Vectors whose components go through the same arithmetic side by side: the lanes of a CPU's vector unit.

On a CPU Warp runs a launch on one core, one thread after another, and what a thread does with scalars stays scalar.
What it does with a vector of this length is compiled to vector instructions: 32 lines, or springs, for little more than
the price of one or two. (Shorter vectors are unrolled too early to be found again, longer ones spill.) A GPU does the
same with neighbouring threads; the scalar kernels are for it.

A block is 32 neighbours. What is kept for each of them lies block by block, in an array of such vectors.
"""

from typing import Any

import warp as wp

LANES = 32

# Cells of a line that a thread of a GPU takes.
SEGMENT = 32

Lanes = wp.types.vector(length=LANES, dtype=wp.Float)


@wp.func
def lane_sqrt(a: Any):
    """Square root of each lane."""
    root = type(a)()
    for lane in range(LANES):
        root[lane] = wp.sqrt(a[lane])
    return root


@wp.func
def lane_dot(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any):
    """Scalar product of two 3-vectors in each lane."""
    return wp.cw_mul(ax, bx) + wp.cw_mul(ay, by) + wp.cw_mul(az, bz)


@wp.func
def lane_cross(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any):
    """Vector product of two 3-vectors in each lane."""
    x = wp.cw_mul(ay, bz) - wp.cw_mul(az, by)
    y = wp.cw_mul(az, bx) - wp.cw_mul(ax, bz)
    z = wp.cw_mul(ax, by) - wp.cw_mul(ay, bx)
    return x, y, z


@wp.func
def lane_scaled(factor: Any, x: Any, y: Any, z: Any):
    """A 3-vector times a factor in each lane."""
    return wp.cw_mul(factor, x), wp.cw_mul(factor, y), wp.cw_mul(factor, z)


@wp.func
def lane_gather(values: Any, places: wp.array2d[wp.int32], block: wp.int32, like: Any):
    """The numbers at a block's places, 0 where a place is -1; ``like`` is a lane vector, for its type."""
    found = type(like)()
    for lane in range(LANES):
        place = places[block, lane]
        if place >= 0:
            found[lane] = values[place]
    return found
