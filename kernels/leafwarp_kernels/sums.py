"""Sums over a map in float64: each thread writes that of its segment of a row, and one thread adds these up."""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES

# Sums are taken in so many parts at once: more do not fit into a processor's registers beside the lanes.
SUM_PARTS = 8
Sum = wp.types.vector(SUM_PARTS, wp.float64)


@wp.func
def add_lanes(total: Sum, a: Any):
    """A sum in float64, in parts, with the lanes added."""
    for block in range(LANES // SUM_PARTS):
        for part in range(SUM_PARTS):
            total[part] = total[part] + wp.float64(a[block * SUM_PARTS + part])
    return total


@wp.func
def sum_parts(total: Sum):
    """All parts of a sum together."""
    whole = wp.float64(0.0)
    for part in range(SUM_PARTS):
        whole += total[part]
    return whole


@wp.func
def sum_rows(row_sum: wp.array3d[wp.float64], quantity: wp.int32):
    """Sum of one slot over all segments."""
    total = wp.float64(0.0)
    for row in range(row_sum.shape[2]):
        for segment in range(row_sum.shape[1]):
            total += row_sum[quantity, segment, row]
    return total
