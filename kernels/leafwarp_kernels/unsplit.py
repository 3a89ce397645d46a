"""The system of a diffusion step along rows and columns at once (backward Euler, no splitting error).

The step solves ``A y = f`` with ``A = I + L``, where ``L`` couples each cell with its neighbours along rows and
columns with ``beta = conductance * dt``. A is a symmetric M-matrix with row sums 1, so the exact solution conserves
water and stays between the extremes of ``f``. No eigenvalue of A is below 1; hence the error of an approximate solution
is never larger than its residual, ``|y - y_exact| <= |f - A y|``.

It is solved for the change ``d = y - f`` by conjugate gradients (:mod:`leafwarp_kernels.conjugate_gradients`),
preconditioned with a multigrid cycle (:mod:`leafwarp_kernels.multigrid`). Three things are handed on from step to step:

- The last increment ``y - y_before``: the start is what another such increment would give. As long as increments stay
  much the same it is the mean with the one before, so that errors which are allowed do not build up in it.
- What rounding to the stored contents has cut off. With it the start is a smooth field. Without, the noise of the last
  bit, times beta, would be a residual far above what is accepted.
- The residual that is left. It is added to the right side of the next step (the change of ``f`` and this sum
  telescope), so that what a step leaves undone is made up for by the next, and errors do not add up over the steps.

The sum of the contents is an eigenvector of A with eigenvalue 1, so that the sum of ``d`` is 0 in exact arithmetic:
:func:`finish_step` takes its error off.

A source (:mod:`leafwarp_kernels.source`) makes the system ``(E + L) y = E f'`` with ``E = I + S``, whose residual is
``-E d - L (f' + d)``. Eigenvalues do not fall below 1, so the bound of the error holds; the sum of ``d`` is not 0.

Arrays are whole blocks of lanes (see :mod:`leafwarp_kernels.lanes`), 0 off the leaf; a thread takes some blocks of a
row, on a CPU all of them.
"""

import warp as wp

from leafwarp_kernels.conjugate_gradients import (
    ITERATIONS,
    LEAK,
    SUM_CHANGE,
    SUM_OUTFLOW,
    SUM_PRODUCT,
    SUM_RESIDUAL_SQUARED,
    SUM_RIGHT_SIDE_SQUARED,
    coupled_only,
)
from leafwarp_kernels.lanes import Lanes
from leafwarp_kernels.multigrid import held, outflow_at
from leafwarp_kernels.sums import Sum, add_lanes, sum_parts, sum_rows

wp.set_module_options({"enable_backward": False})

# A step with no more iterations has found the last one's increment again, but for the errors that both are allowed.
FEW_ITERATIONS = wp.constant(2)


@wp.kernel
def guess_change(
    # inputs:
    water: wp.array2d[Lanes],
    before: wp.array2d[Lanes],
    rounding: wp.array2d[Lanes],
    increment: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    # outputs:
    change_out: wp.array2d[Lanes],
):
    """The change after which the contents would have grown by the same increment as in the last steps.

    Args:
        water: Contents before the step, ``f``, shape [ny, block].
        before: Contents after the last step, shape [ny, block].
        rounding: What was cut off from them, shape [ny, block].
        increment: Increment of the last steps, shape [ny, block].
        inverse_diagonal: Of A, 0 where a cell exchanges water with no other, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        change_out: ``d``, shape [ny, block].
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        passed = before[row, block] - water[row, block]
        change = passed + (rounding[row, block] + increment[row, block])
        change_out[row, block] = coupled_only(inverse_diagonal[row, block], change)


@wp.kernel
def start_residual(
    # inputs:
    water: wp.array2d[Lanes],
    water_east: wp.array2d[Lanes],
    water_west: wp.array2d[Lanes],
    change: wp.array2d[Lanes],
    change_east: wp.array2d[Lanes],
    change_west: wp.array2d[Lanes],
    shift: wp.array[wp.float64],
    least_mass: wp.Float,
    mass: wp.array2d[Lanes],
    mass_span: wp.array2d[wp.int32],
    faces_x: wp.array2d[Lanes],
    faces_west: wp.array2d[Lanes],
    faces_y: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    omega: wp.Float,
    # outputs:
    residual_out: wp.array2d[Lanes],
    swept_out: wp.array2d[Lanes],
    row_sum_out: wp.array3d[wp.float64],
):
    """The residual at the start; sums of each segment.

    Args:
        water: Contents before the step, ``f``, shape [ny, block].
        water_east: The same of the cells' right neighbours.
        water_west: The same of their left ones.
        change: ``d``, shape [ny, block].
        change_east: The same of the cells' right neighbours.
        change_west: The same of their left ones.
        shift: What the change of coupled cells will be given at the end of the step, and more, shape [2].
        least_mass: The diagonal of ``E`` as far as all cells have it.
        mass: The rest of it, shape [ny, block].
        mass_span: First block of each row with such a rest and the one after its last, shape [ny, 2].
        faces_x: Conductance of each cell to its right neighbour, times the step, shape [ny, block].
        faces_west: The same to its left neighbour.
        faces_y: The same to its upper neighbour.
        inverse_diagonal: Of A, 0 where a cell exchanges water with no other, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        omega: Weight of the preconditioner's first sweep.
        residual_out: That of the last step, or 0; that of this one is added. Shape [ny, block].
        swept_out: The residual after the first sweep of the preconditioner, shape [ny, block].
        row_sum_out: Squared residual, squared content, change and outflow, shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    end = wp.min(span[row, 1], (segment + 1) * segment_length)
    residual_squared = Sum()
    content_squared = Sum()
    change_sum = Sum()
    outflow_sum = Sum()
    for block in range(first, end):
        outflow = outflow_at(water, water_east, water_west, faces_x, faces_west, faces_y, row, block)
        outflow += outflow_at(change, change_east, change_west, faces_x, faces_west, faces_y, row, block)
        content = water[row, block]
        here = change[row, block]
        inverse = inverse_diagonal[row, block]
        shifted = here + coupled_only(inverse, type(here)(type(here[0])(shift[0])))
        kept = held(shifted, least_mass, mass, mass_span, row, block)
        residual = residual_out[row, block] - kept - outflow
        residual_out[row, block] = residual
        swept_out[row, block] = omega * wp.cw_mul(inverse, residual)
        residual_squared = add_lanes(residual_squared, wp.cw_mul(residual, residual))
        content_squared = add_lanes(content_squared, wp.cw_mul(content, content))
        change_sum = add_lanes(change_sum, here)
        outflow_sum = add_lanes(outflow_sum, outflow)
    row_sum_out[SUM_RESIDUAL_SQUARED, segment, row] = sum_parts(residual_squared)
    row_sum_out[SUM_RIGHT_SIDE_SQUARED, segment, row] = sum_parts(content_squared)
    row_sum_out[SUM_CHANGE, segment, row] = sum_parts(change_sum)
    row_sum_out[SUM_OUTFLOW, segment, row] = sum_parts(outflow_sum)


@wp.kernel
def apply_system(
    # inputs:
    direction: wp.array2d[Lanes],
    east: wp.array2d[Lanes],
    west: wp.array2d[Lanes],
    least_mass: wp.Float,
    mass: wp.array2d[Lanes],
    mass_span: wp.array2d[wp.int32],
    faces_x: wp.array2d[Lanes],
    faces_west: wp.array2d[Lanes],
    faces_y: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    # outputs:
    image_out: wp.array2d[Lanes],
    row_sum_out: wp.array3d[wp.float64],
):
    """``A direction``; its product with the direction, and the outflow, a sum for each segment.

    Args:
        direction: Shape [ny, block].
        east: The same of the cells' right neighbours.
        west: The same of their left ones.
        least_mass: The diagonal of ``E`` as far as all cells have it.
        mass: The rest of it, shape [ny, block].
        mass_span: First block of each row with such a rest and the one after its last, shape [ny, 2].
        faces_x: Conductance of each cell to its right neighbour, times the step, shape [ny, block].
        faces_west: The same to its left neighbour.
        faces_y: The same to its upper neighbour.
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        image_out: Shape [ny, block].
        row_sum_out: Shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    end = wp.min(span[row, 1], (segment + 1) * segment_length)
    total = Sum()
    outflow_sum = Sum()
    for block in range(first, end):
        here = direction[row, block]
        outflow = outflow_at(direction, east, west, faces_x, faces_west, faces_y, row, block)
        image = held(here, least_mass, mass, mass_span, row, block) + outflow
        outflow_sum = add_lanes(outflow_sum, outflow)
        image_out[row, block] = image
        total = add_lanes(total, wp.cw_mul(here, image))
    row_sum_out[SUM_PRODUCT, segment, row] = sum_parts(total)
    row_sum_out[SUM_OUTFLOW, segment, row] = sum_parts(outflow_sum)


@wp.kernel
def sum_change(
    # inputs:
    change: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    # outputs:
    row_sum_out: wp.array3d[wp.float64],
):
    """Sum of the change over each segment.

    Args:
        change: ``d``, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        row_sum_out: Shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    total = Sum()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        total = add_lanes(total, change[row, block])
    row_sum_out[SUM_CHANGE, segment, row] = sum_parts(total)


@wp.kernel
def choose_shift(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    coupled_count: wp.float64,
    closed: wp.float64,
    # outputs:
    shift_out: wp.array[wp.float64],
):
    """What every coupled cell has to gain so that none of the content is lost or made (one thread).

    Done before the iterations, whose residual allows for it, and after them.

    Args:
        row_sum: Sums of the change, shape [SUM_COUNT, segment, ny].
        coupled_count: Number of coupled cells; 1 where there is none.
        closed: 1 where nothing enters or leaves, else 0.
        shift_out: That gain, and how much more it is than when it was chosen last, shape [2].
    """
    shift = -closed * sum_rows(row_sum, SUM_CHANGE) / coupled_count
    shift_out[1] = shift - shift_out[0]
    shift_out[0] = shift


@wp.kernel
def finish_step(
    # inputs:
    change: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    shift: wp.array[wp.float64],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    solver: wp.array[wp.float64],
    # outputs:
    water_out: wp.array2d[Lanes],
    before_out: wp.array2d[Lanes],
    rounding_out: wp.array2d[Lanes],
    increment_out: wp.array2d[Lanes],
    residual_out: wp.array2d[Lanes],
    added_out: wp.array2d[wp.float64],
):
    """The contents after the step, and what the next one starts from.

    Args:
        change: ``d``, shape [ny, block].
        inverse_diagonal: Of A, 0 where a cell exchanges water with no other, shape [ny, block].
        shift: Added to the change of coupled cells, and what of it the residual does not allow for, shape [2].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        solver: Numbers of the conjugate gradients, shape [SLOT_COUNT].
        water_out: Contents before and after the step, shape [ny, block].
        before_out: Contents after the last step and after this one, shape [ny, block].
        rounding_out: What was cut off from them, shape [ny, block].
        increment_out: Increment of the last steps, shape [ny, block].
        residual_out: Shape [ny, block]; less the leak, if it is still in it, and what the shift has made up for.
        added_out: Content added to each segment so far, shape [segment, ny]; None where none is counted.
    """
    segment, row = wp.tid()
    added = Sum()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        old = water_out[row, block]
        inverse = inverse_diagonal[row, block]
        shifted = coupled_only(inverse, type(old)(type(old[0])(shift[0])))
        unforeseen = coupled_only(inverse, type(old)(type(old[0])(shift[1])))
        leak = coupled_only(inverse, type(old)(type(old[0])(solver[LEAK])))
        change_here = change[row, block] + shifted
        new = old + change_here
        passed = before_out[row, block] - old
        newest = change_here - (passed + rounding_out[row, block])
        weight = type(old[0])(1.0)
        if solver[ITERATIONS] <= wp.float64(FEW_ITERATIONS):
            weight = type(old[0])(0.5)
        increment_out[row, block] = increment_out[row, block] + weight * (newest - increment_out[row, block])
        rounding_out[row, block] = change_here - (new - old)
        before_out[row, block] = new
        water_out[row, block] = new
        residual_out[row, block] = residual_out[row, block] + leak - unforeseen
        if added_out:
            added = add_lanes(add_lanes(added, new), -old)
    if added_out:
        added_out[segment, row] += sum_parts(added)
