"""A step of second order from steps of first order (Richardson), and how far off they are.

Let ``S(h)`` be a step of first order. Two steps of half the length leave half of its error, so that

    e = S(h/2) S(h/2) y - S(h) y

is, to leading order, the error of the two halves, and ``S(h/2) S(h/2) y + e`` one of second order: whatever the step is
made of (loss, supply, rows and columns), its errors of first order cancel. All is linear in the contents, so that what
the three steps have in their accounts adds up in the same way, and no water is made or lost.

The sum may leave the bounds that each step keeps. A cell that it would leave with less than nothing has transpired what
is missing too much, and one with more than the supply has taken up too much: they are held at the bound, and what is
held back is counted. Where that is much of ``e``, or there is nothing that could be counted less, the step is no longer
in the range of its order, and the two halves stand. Cells that hold nothing in both are left alone: those off the leaf.

Between the ends of a step the water is taken to change linearly. How far the first half is from the mean of both ends
tells what that is worth: where a leaf is cut within a step, little, though both ends may be right.

Arrays are whole blocks of lanes (see :mod:`leafwarp_kernels.lanes`), 0 off the leaf; a thread takes some blocks of a
row, on a CPU all of them.
"""

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes
from leafwarp_kernels.sums import sum_rows

wp.set_module_options({"enable_backward": False})

# Sums over the cells.
DIFFERENCE_SQUARED = wp.constant(0)
CONTENT_SQUARED = wp.constant(1)
DIFFERENCE = wp.constant(2)
BELOW = wp.constant(3)
ABOVE = wp.constant(4)
BEND_SQUARED = wp.constant(5)
BEFORE_SQUARED = wp.constant(6)
SUM_COUNT = 7

# What is told of a step.
WEIGHT = wp.constant(0)
ERROR = wp.constant(1)
TOLD_COUNT = 2


@wp.kernel
def compare_halves(
    # inputs:
    whole: wp.array2d[Lanes],
    halves: wp.array2d[Lanes],
    segment_length: wp.int32,
    least: wp.float64,
    most: wp.float64,
    # outputs:
    row_sum_out: wp.array3d[wp.float64],
):
    """Sums over each segment of the rows: of ``e``, and of what would be beyond the bounds.

    Args:
        whole: Contents after one step, shape [ny, block].
        halves: Contents after two steps of half the length, shape [ny, block].
        segment_length: Blocks of a thread.
        least: Least content that a cell can hold.
        most: Greatest content that a cell can hold.
        row_sum_out: Written but for what :func:`compare_middle` writes, shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    # Each a variable of its own: one that two names share would not be added to.
    difference_squared, content_squared = wp.float64(0.0), wp.float64(0.0)
    difference_sum, below, above = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    for block in range(segment * segment_length, wp.min((segment + 1) * segment_length, whole.shape[1])):
        after, once = halves[row, block], whole[row, block]
        for lane in range(LANES):
            content = wp.float64(after[lane])
            difference = content - wp.float64(once[lane])
            difference_squared += difference * difference
            content_squared += content * content
            difference_sum += wp.abs(difference)
            if content != wp.float64(0.0) or difference != wp.float64(0.0):
                below += wp.max(wp.float64(0.0), least - (content + difference))
                above += wp.max(wp.float64(0.0), content + difference - most)
    row_sum_out[DIFFERENCE_SQUARED, segment, row] = difference_squared
    row_sum_out[CONTENT_SQUARED, segment, row] = content_squared
    row_sum_out[DIFFERENCE, segment, row] = difference_sum
    row_sum_out[BELOW, segment, row] = below
    row_sum_out[ABOVE, segment, row] = above


@wp.kernel
def compare_middle(
    # inputs:
    before: wp.array2d[Lanes],
    middle: wp.array2d[Lanes],
    halves: wp.array2d[Lanes],
    segment_length: wp.int32,
    # outputs:
    row_sum_out: wp.array3d[wp.float64],
):
    """Sums over each segment of the rows: how far the middle of a step is from a straight line, and of the start.

    Args:
        before: Contents before the step, shape [ny, block].
        middle: After half of it, shape [ny, block].
        halves: After both halves, shape [ny, block].
        segment_length: Blocks of a thread.
        row_sum_out: Written at :data:`BEND_SQUARED` and :data:`BEFORE_SQUARED`, shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    bend_squared, before_squared = wp.float64(0.0), wp.float64(0.0)
    for block in range(segment * segment_length, wp.min((segment + 1) * segment_length, before.shape[1])):
        first, second, third = before[row, block], middle[row, block], halves[row, block]
        for lane in range(LANES):
            bend = wp.float64(second[lane]) - wp.float64(0.5) * (wp.float64(first[lane]) + wp.float64(third[lane]))
            bend_squared += bend * bend
            before_squared += wp.float64(first[lane]) * wp.float64(first[lane])
    row_sum_out[BEND_SQUARED, segment, row] = bend_squared
    row_sum_out[BEFORE_SQUARED, segment, row] = before_squared


@wp.kernel
def judge_step(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    share_below: wp.float64,
    share_above: wp.float64,
    # outputs:
    told_out: wp.array[wp.float64],
):
    """How far off the two halves are, and whether ``e`` is added to them.

    Args:
        row_sum: Of :func:`compare_halves`, shape [SUM_COUNT, segment, ny].
        share_below: How much may be held at the least content, over the sum of ``|e|``.
        share_above: How much may be held at the greatest content, likewise.
        told_out: 1 or 0, and the norm of ``e``, or that of the bend if it is larger, over that of the contents after
            the step, or before it if that is larger, shape [TOLD_COUNT].
    """
    difference = sum_rows(row_sum, DIFFERENCE)
    weight = wp.float64(0.0)
    if sum_rows(row_sum, BELOW) <= share_below * difference and sum_rows(row_sum, ABOVE) <= share_above * difference:
        weight = wp.float64(1.0)
    told_out[WEIGHT] = weight
    told_out[ERROR] = wp.float64(0.0)
    content = wp.max(sum_rows(row_sum, CONTENT_SQUARED), sum_rows(row_sum, BEFORE_SQUARED))
    if content > wp.float64(0.0):
        error_squared = wp.max(sum_rows(row_sum, DIFFERENCE_SQUARED), sum_rows(row_sum, BEND_SQUARED))
        told_out[ERROR] = wp.sqrt(error_squared / content)


@wp.kernel
def extrapolate_water(
    # inputs:
    halves: wp.array2d[Lanes],
    told: wp.array[wp.float64],
    segment_length: wp.int32,
    least: wp.float64,
    most: wp.float64,
    # outputs:
    water_out: wp.array2d[Lanes],
    held_at_least_out: wp.array2d[wp.float64],
    held_at_most_out: wp.array2d[wp.float64],
):
    """The contents after the step.

    Args:
        halves: Contents after two steps of half the length, shape [ny, block].
        told: Of :func:`judge_step`, shape [TOLD_COUNT].
        segment_length: Blocks of a thread.
        least: Least content that a cell can hold.
        most: Greatest content that a cell can hold.
        water_out: Contents after one step and, then, after the step of second order, shape [ny, block].
        held_at_least_out: What cells were kept from losing so far, shape [segment, ny]; added to.
        held_at_most_out: What cells were kept from taking up so far, shape [segment, ny]; added to.
    """
    segment, row = wp.tid()
    below, above = wp.float64(0.0), wp.float64(0.0)
    for block in range(segment * segment_length, wp.min((segment + 1) * segment_length, water_out.shape[1])):
        after = halves[row, block]
        if told[WEIGHT] > wp.float64(0.0):
            once = water_out[row, block]
            for lane in range(LANES):
                content = wp.float64(after[lane])
                difference = content - wp.float64(once[lane])
                if content != wp.float64(0.0) or difference != wp.float64(0.0):
                    sought = content + difference
                    held = wp.clamp(sought, least, most)
                    below += wp.max(held - sought, wp.float64(0.0))
                    above += wp.max(sought - held, wp.float64(0.0))
                    after[lane] = type(after[lane])(held)
        water_out[row, block] = after
    held_at_least_out[segment, row] += below
    held_at_most_out[segment, row] += above


@wp.kernel
def extrapolate_account(
    # inputs:
    halves: wp.array2d[wp.float64],
    told: wp.array[wp.float64],
    # outputs:
    account_out: wp.array2d[wp.float64],
):
    """What has been counted up to the end of the step.

    Args:
        halves: After two steps of half the length, shape [segment, line].
        told: Of :func:`judge_step`, shape [TOLD_COUNT].
        account_out: After one step and, then, after the step of second order, shape [segment, line].
    """
    segment, line = wp.tid()
    counted = halves[segment, line]
    if told[WEIGHT] > wp.float64(0.0):
        counted += counted - account_out[segment, line]
    account_out[segment, line] = counted
