"""A multigrid cycle for ``(E + L) x = b`` on a map, ``L`` the exchange between neighbours and ``E`` a diagonal.

A cell of a coarser level is a block of 2 x 2 cells. With ``P`` constant on each block the system ``P^T (E + L) P`` of
the coarser level is of the same kind: diagonals and conductances of the faces between blocks add up, so that veins of
any direction are handed down, and a constant content stays one. Such a system is too stiff: what the coarser level
finds is taken times :data:`OVERCORRECTION` (Braess 1995, "Towards algebraic multigrid for elliptic problems of second
order"). The smoother is ``x + omega D^-1 (b - (E + L) x)`` with the diagonal ``D``, the ``omega`` of successive sweeps
being those of a Chebyshev polynomial. Sweeps before and after the correction are the same, so that the cycle is
symmetric and positive definite, as conjugate gradients need it.

The diagonal of ``E`` is stored as what all cells have in common and the rest, with the blocks of each row where there
is any: on the map itself it is 1 but for a few cells of a source.

Where there is no leaf, ``b``, ``D^-1`` and the conductances are 0. All arrays are whole blocks of lanes (see
:mod:`leafwarp_kernels.lanes`); a thread takes some blocks of a row, on a CPU all of them. The neighbours to the right
and left come as further views of the same arrays, displaced by a cell: to move the lanes of a block costs more than to
read it again. What such a view shows beyond the end of a row is multiplied by a conductance of 0.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.conjugate_gradients import SUM_PRODUCT
from leafwarp_kernels.lanes import LANES, Lanes
from leafwarp_kernels.sums import Sum, add_lanes, sum_parts

wp.set_module_options({"enable_backward": False})

HALF = LANES // 2


@wp.func
def outflow_at(
    values: wp.array2d[Any],
    east: wp.array2d[Any],
    west: wp.array2d[Any],
    faces_x: wp.array2d[Any],
    faces_west: wp.array2d[Any],
    faces_y: wp.array2d[Any],
    row: wp.int32,
    block: wp.int32,
):
    """``L x`` of a block: what each cell gives to its neighbours."""
    here = values[row, block]
    above = wp.min(row + 1, values.shape[0] - 1)
    below = wp.max(row - 1, 0)
    to_east = wp.cw_mul(faces_x[row, block], here - east[row, block])
    from_west = wp.cw_mul(faces_west[row, block], west[row, block] - here)
    across = wp.cw_mul(faces_y[row, block], here - values[above, block])
    across = across + wp.cw_mul(faces_y[below, block], here - values[below, block])
    return (to_east - from_west) + across


@wp.func
def held(
    values: Any,
    least_mass: Any,
    mass: wp.array2d[Any],
    mass_span: wp.array2d[wp.int32],
    row: wp.int32,
    block: wp.int32,
):
    """``E x`` of a block, ``x`` being its values."""
    product = least_mass * values
    if block >= mass_span[row, 0] and block < mass_span[row, 1]:
        product = product + wp.cw_mul(mass[row, block], values)
    return product


@wp.func
def residual_at(
    right_side: wp.array2d[Any],
    solution: wp.array2d[Any],
    east: wp.array2d[Any],
    west: wp.array2d[Any],
    least_mass: Any,
    mass: wp.array2d[Any],
    mass_span: wp.array2d[wp.int32],
    faces_x: wp.array2d[Any],
    faces_west: wp.array2d[Any],
    faces_y: wp.array2d[Any],
    row: wp.int32,
    block: wp.int32,
):
    """``b - (E + L) x`` of a block."""
    outflow = outflow_at(solution, east, west, faces_x, faces_west, faces_y, row, block)
    kept = held(solution[row, block], least_mass, mass, mass_span, row, block)
    return right_side[row, block] - kept - outflow


@wp.kernel
def begin_smoothing(
    # inputs:
    right_side: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    omega: wp.Float,
    # outputs:
    solution_out: wp.array2d[Lanes],
):
    """The first sweep, from a solution of 0.

    Args:
        right_side: ``b``, shape [ny, block].
        inverse_diagonal: ``D^-1``, 0 off the leaf, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        omega: Weight of the sweep.
        solution_out: Shape [ny, block].
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        solution_out[row, block] = omega * wp.cw_mul(inverse_diagonal[row, block], right_side[row, block])


@wp.kernel
def smooth(
    # inputs:
    right_side: wp.array2d[Lanes],
    solution: wp.array2d[Lanes],
    east: wp.array2d[Lanes],
    west: wp.array2d[Lanes],
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
    solution_out: wp.array2d[Lanes],
    row_sum_out: wp.array3d[wp.float64],
):
    """A sweep, and on the map itself the product that conjugate gradients ask for.

    Args:
        right_side: ``b``, shape [ny, block].
        solution: Before the sweep, shape [ny, block].
        east: The same of the cells' right neighbours.
        west: The same of their left ones.
        least_mass: The diagonal of ``E`` as far as all cells have it.
        mass: The rest of it, shape [ny, block].
        mass_span: First block of each row with such a rest and the one after its last, shape [ny, 2].
        faces_x: Conductance of each cell to its right neighbour, times the step, shape [ny, block].
        faces_west: The same to its left neighbour.
        faces_y: The same to its upper neighbour.
        inverse_diagonal: ``D^-1``, 0 off the leaf, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        omega: Weight of the sweep.
        solution_out: After the sweep, shape [ny, block]; another array than ``solution``.
        row_sum_out: Products of right side and solution, a sum for each segment, shape [SUM_COUNT, segment, ny]; None
            where none is taken.
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    end = wp.min(span[row, 1], (segment + 1) * segment_length)
    total = Sum()
    for block in range(first, end):
        residual = residual_at(
            right_side, solution, east, west, least_mass, mass, mass_span, faces_x, faces_west, faces_y, row, block
        )
        after = solution[row, block] + omega * wp.cw_mul(inverse_diagonal[row, block], residual)
        solution_out[row, block] = after
        if row_sum_out:
            total = add_lanes(total, wp.cw_mul(right_side[row, block], after))
    if row_sum_out:
        row_sum_out[SUM_PRODUCT, segment, row] = sum_parts(total)


@wp.kernel
def restrict_residual(
    # inputs:
    right_side: wp.array2d[Lanes],
    solution: wp.array2d[Lanes],
    east: wp.array2d[Lanes],
    west: wp.array2d[Lanes],
    least_mass: wp.Float,
    mass: wp.array2d[Lanes],
    mass_span: wp.array2d[wp.int32],
    faces_x: wp.array2d[Lanes],
    faces_west: wp.array2d[Lanes],
    faces_y: wp.array2d[Lanes],
    coarse_span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    # outputs:
    coarse_right_side_out: wp.array2d[Lanes],
):
    """The right side of the coarser level: the residuals of each 2 x 2 cells added up.

    Args:
        right_side: ``b``, shape [ny, block].
        solution: Shape [ny, block].
        east: The same of the cells' right neighbours.
        west: The same of their left ones.
        least_mass: The diagonal of ``E`` as far as all cells have it.
        mass: The rest of it, shape [ny, block].
        mass_span: First block of each row with such a rest and the one after its last, shape [ny, 2].
        faces_x: Conductance of each cell to its right neighbour, times the step, shape [ny, block].
        faces_west: The same to its left neighbour.
        faces_y: The same to its upper neighbour.
        coarse_span: First block of each coarse row with a leaf cell and the one after its last, shape [coarse ny, 2].
        segment_length: Coarse blocks of a thread.
        coarse_right_side_out: Shape [coarse ny, coarse block].
    """
    segment, coarse_row = wp.tid()
    first = wp.max(coarse_span[coarse_row, 0], segment * segment_length)
    row = 2 * coarse_row
    for coarse_block in range(first, wp.min(coarse_span[coarse_row, 1], (segment + 1) * segment_length)):
        coarse = coarse_right_side_out.dtype()
        for half in range(2):
            block = 2 * coarse_block + half
            if block < solution.shape[1]:
                both = coarse_right_side_out.dtype()
                for upper in range(2):
                    both += residual_at(
                        right_side,
                        solution,
                        east,
                        west,
                        least_mass,
                        mass,
                        mass_span,
                        faces_x,
                        faces_west,
                        faces_y,
                        row + upper,
                        block,
                    )
                for lane in range(HALF):
                    coarse[half * HALF + lane] = both[2 * lane] + both[2 * lane + 1]
        coarse_right_side_out[coarse_row, coarse_block] = coarse


@wp.kernel
def correct(
    # inputs:
    coarse_solution: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    overcorrection: wp.Float,
    # outputs:
    solution_out: wp.array2d[Lanes],
):
    """Add what the coarser level has found to each of its 2 x 2 cells.

    Args:
        coarse_solution: Shape [coarse ny, coarse block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        overcorrection: Factor of the correction.
        solution_out: Shape [ny, block]; added to.
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        coarse = coarse_solution[row / 2, block / 2]
        offset = (block % 2) * HALF
        found = solution_out.dtype()
        for lane in range(HALF):
            found[2 * lane] = coarse[offset + lane]
            found[2 * lane + 1] = coarse[offset + lane]
        solution_out[row, block] = solution_out[row, block] + overcorrection * found
