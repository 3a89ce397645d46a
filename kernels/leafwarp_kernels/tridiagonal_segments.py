"""Line solves with many threads a line, for a GPU: 1,024 lines of one thread each would leave it idle.

A line is cut into segments of :data:`SEGMENT` cells, a thread each. Both sweeps of :mod:`leafwarp_kernels.tridiagonal`
take a mean with what comes from the cell before, so that what leaves a segment is linear in what enters it:

    end(c) = end(g) + A (c - g),        A = product of the segment's weights,

for any guess ``g``. A first kernel sweeps all segments from a guess of their own (the content of their first cell:
where the contents are the same everywhere the guess is right, and nothing is rounded). A second one works out what
enters each segment from the ends of those before it, sweeps again from there, and at once sweeps back from a guess; a
third finishes the way back. What enters a segment is held between the extremes of the cells that it is a mean of.

Neighbouring threads take neighbouring lines, so that weights and the contents of columns are read side by side; those
of rows come from each line's own 128 bytes.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES, SEGMENT
from leafwarp_kernels.tridiagonal import mean_of

wp.set_module_options({"enable_backward": False})

# What is kept of a sweep over a segment: its guess, where that leads, and the extremes of the cells.
GUESS = wp.constant(0)
END = wp.constant(1)
LOW = wp.constant(2)
HIGH = wp.constant(3)
KEPT = 4


@wp.func
def carry(entering: Any, product: Any, segment: wp.int32, line: wp.int32, kept: wp.array3d[Any]):
    """What leaves a segment, from what enters it."""
    leaving = kept[END, segment, line] + product * (entering - kept[GUESS, segment, line])
    low = wp.min(entering, kept[LOW, segment, line])
    return wp.clamp(leaving, low, wp.max(entering, kept[HIGH, segment, line]))


@wp.kernel
def segment_products(
    # inputs:
    forward_weight: wp.array3d[wp.Float],
    backward_weight: wp.array3d[wp.Float],
    span: wp.array2d[wp.int32],
    # outputs:
    forward_product_out: wp.array2d[wp.Float],
    backward_product_out: wp.array2d[wp.Float],
):
    """Product of the weights of each segment; 1 for one without a leaf cell.

    Args:
        forward_weight: Shape [block, cell, lane].
        backward_weight: Shape [block, cell, lane].
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        forward_product_out: Shape [segment, line].
        backward_product_out: Shape [segment, line].
    """
    segment, line = wp.tid()
    block = line / LANES
    lane = line % LANES
    forward = wp.float64(1.0)
    backward = wp.float64(1.0)
    first = wp.max(span[line, 0], segment * SEGMENT)
    for cell in range(first, wp.min(span[line, 1], (segment + 1) * SEGMENT)):
        forward *= wp.float64(forward_weight[block, cell, lane])
        backward *= wp.float64(backward_weight[block, cell, lane])
    forward_product_out[segment, line] = forward_product_out.dtype(forward)
    backward_product_out[segment, line] = backward_product_out.dtype(backward)


@wp.kernel
def guess_forward(
    # inputs:
    forward_weight: wp.array3d[wp.Float],
    span: wp.array2d[wp.int32],
    right_side: wp.array2d[wp.Float],
    # outputs:
    forward_out: wp.array3d[wp.Float],
):
    """Sweep each segment from a guess.

    Args:
        forward_weight: Shape [block, cell, lane].
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        right_side: The ``f_i``, shape [line, cell].
        forward_out: What is kept of the sweep, shape [KEPT, segment, line].
    """
    segment, line = wp.tid()
    block = line / LANES
    lane = line % LANES
    first = wp.max(span[line, 0], segment * SEGMENT)
    end = wp.min(span[line, 1], (segment + 1) * SEGMENT)
    guess = right_side.dtype(0.0)
    if first < end:
        guess = right_side[line, first]
    content = guess
    low = guess
    high = guess
    for cell in range(first, end):
        old = right_side[line, cell]
        low = wp.min(low, old)
        high = wp.max(high, old)
        content = mean_of(old, content, forward_weight[block, cell, lane])
    forward_out[GUESS, segment, line] = guess
    forward_out[END, segment, line] = content
    forward_out[LOW, segment, line] = low
    forward_out[HIGH, segment, line] = high


@wp.kernel
def sweep_forward(
    # inputs:
    forward_weight: wp.array3d[wp.Float],
    backward_weight: wp.array3d[wp.Float],
    span: wp.array2d[wp.int32],
    forward_product: wp.array2d[wp.Float],
    forward: wp.array3d[wp.Float],
    right_side: wp.array2d[wp.Float],
    # outputs:
    backward_out: wp.array3d[wp.Float],
    swept_out: wp.array2d[wp.Float],
):
    """Sweep each segment from what enters it, and back from a guess.

    Args:
        forward_weight: Shape [block, cell, lane].
        backward_weight: Shape [block, cell, lane].
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        forward_product: From :func:`segment_products`.
        forward: From :func:`guess_forward`.
        right_side: As for :func:`guess_forward`.
        backward_out: What is kept of the sweep back, shape [KEPT, segment, line].
        swept_out: The ``z_i``, shape [line, cell]. May be the array of the right side.
    """
    segment, line = wp.tid()
    block = line / LANES
    lane = line % LANES
    first = wp.max(span[line, 0], segment * SEGMENT)
    end = wp.min(span[line, 1], (segment + 1) * SEGMENT)
    content = forward[GUESS, 0, line]
    for before in range(segment):
        content = carry(content, forward_product[before, line], before, line, forward)
    for cell in range(first, end):
        content = mean_of(right_side[line, cell], content, forward_weight[block, cell, lane])
        swept_out[line, cell] = content
    guess = right_side.dtype(0.0)
    if first < end:
        guess = content
    content = guess
    low = guess
    high = guess
    for back in range(end - first):
        cell = end - 1 - back
        eliminated = swept_out[line, cell]
        low = wp.min(low, eliminated)
        high = wp.max(high, eliminated)
        content = mean_of(eliminated, content, backward_weight[block, cell, lane])
    backward_out[GUESS, segment, line] = guess
    backward_out[END, segment, line] = content
    backward_out[LOW, segment, line] = low
    backward_out[HIGH, segment, line] = high


@wp.kernel
def sweep_backward(
    # inputs:
    backward_weight: wp.array3d[wp.Float],
    span: wp.array2d[wp.int32],
    backward_product: wp.array2d[wp.Float],
    backward: wp.array3d[wp.Float],
    # in and out:
    solution: wp.array2d[wp.Float],
):
    """Sweep each segment back from what enters it.

    Args:
        backward_weight: Shape [block, cell, lane].
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        backward_product: From :func:`segment_products`.
        backward: From :func:`sweep_forward`.
        solution: The ``z_i`` before and the ``y_i`` after, shape [line, cell]; written within the span.
    """
    segment, line = wp.tid()
    block = line / LANES
    lane = line % LANES
    last = backward.shape[1] - 1
    first = wp.max(span[line, 0], segment * SEGMENT)
    end = wp.min(span[line, 1], (segment + 1) * SEGMENT)
    content = backward[GUESS, last, line]
    for beyond in range(last - segment):
        content = carry(content, backward_product[last - beyond, line], last - beyond, line, backward)
    for back in range(end - first):
        cell = end - 1 - back
        content = mean_of(solution[line, cell], content, backward_weight[block, cell, lane])
        solution[line, cell] = content
