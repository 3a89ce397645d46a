"""Diffusion along lines of cells: a tridiagonal solve a line (paper, Eq. 2, by the Thomas algorithm).

One implicit step along a line of cells solves, for the new contents ``y`` from the old ones ``f``,

    e_i y_i + beta_i (y_i - y_(i+1)) + beta_(i-1) (y_i - y_(i-1)) = e_i f_i,

with ``beta_i = conductance_i * dt`` of the face between cells i and i+1 (0 where water cannot pass) and
``e_i = 1``, or more where an excess of the diagonal is given. The textbook elimination computes its pivot as
a difference of numbers near ``1 + 2 beta``, which swallows the 1 once beta is large: water is lost, then
divided by zero. Here every pivot ``d`` is a sum of positive numbers, and every content a mean of two others:

    s_0 = e_0,    d_i = s_i + beta_i,    w_(i+1) = beta_i s_i / d_i,    s_i = e_i + w_i,
    z_i = f_i + (w_i / s_i) (z_(i-1) - f_i),    y_i = z_i + (beta_i / d_i) (y_(i+1) - z_i).

With ``e_i = 1`` this is the Thomas algorithm for ``z_i d_i / s_i``, rearranged. A constant field stays the
same to the last bit, rounding is proportional to differences between cells, and no content leaves the range
of the others, whatever beta is: each mean is held between the two contents that it is made of. The two weights
depend on beta alone: they are made once, in float64, and a step is two sweeps without a division.

A kernel treats line k of its arrays as line k of the map. For columns, pass transposed views. Weights lie block by
block (see :mod:`leafwarp_kernels.lanes`), shape [block, cell, lane]: line ``k`` in lane ``k % 32`` of block
``k // 32``.

:func:`solve_lines` is the plain solve, one line a thread, against which the others are tested. On a CPU
:func:`solve_adjacent_lines` and :func:`solve_distant_lines` take a block of lines a thread; on a GPU a line is
shared by many threads, see :mod:`leafwarp_kernels.tridiagonal_segments`.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes

wp.set_module_options({"enable_backward": False})


@wp.func
def mean_of(a: Any, b: Any, weight: Any):
    """``a + weight (b - a)``, never beyond ``a`` or ``b`` by rounding."""
    return wp.clamp(a + weight * (b - a), wp.min(a, b), wp.max(a, b))


@wp.func
def mean_of_lanes(a: Any, b: Any, weight: Any):
    """:func:`mean_of`, lane by lane."""
    return wp.min(wp.max(a + wp.cw_mul(weight, b - a), wp.min(a, b)), wp.max(a, b))


@wp.kernel
def eliminate_lines(
    # inputs:
    conductance: wp.array2d[wp.Float],
    excess_diagonal: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    time_step: wp.float64,
    # outputs:
    forward_weight_out: wp.array3d[wp.Float],
    backward_weight_out: wp.array3d[wp.Float],
):
    """The weights of each line's two sweeps.

    Args:
        conductance: Rate of exchange of each cell with the next one of its line [1/s], shape [line, cell].
        excess_diagonal: The ``e_i - 1``, shape [line, cell]; None for none.
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        time_step: [s].
        forward_weight_out: The ``w_i / s_i``, shape [block, cell, lane]; written within the span.
        backward_weight_out: The ``beta_i / d_i``, shape [block, cell, lane]; written within the span.
    """
    line = wp.tid()
    block = line / LANES
    lane = line % LANES
    carried = wp.float64(0.0)
    for cell in range(span[line, 0], span[line, 1]):
        diagonal = wp.float64(1.0)
        if excess_diagonal:
            diagonal += wp.float64(excess_diagonal[line, cell])
        remainder = diagonal + carried
        rate = conductance[line, cell]
        beta = wp.float64(rate) * time_step
        backward_weight = beta / (remainder + beta)
        forward_weight_out[block, cell, lane] = type(rate)(carried / remainder)
        backward_weight_out[block, cell, lane] = type(rate)(backward_weight)
        carried = remainder * backward_weight


@wp.kernel
def solve_lines(
    # inputs:
    forward_weight: wp.array3d[wp.Float],
    backward_weight: wp.array3d[wp.Float],
    span: wp.array2d[wp.int32],
    right_side: wp.array2d[wp.Float],
    # outputs:
    solution_out: wp.array2d[wp.Float],
):
    """Solve each line.

    Args:
        forward_weight: From :func:`eliminate_lines`.
        backward_weight: From :func:`eliminate_lines`.
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        right_side: The ``f_i``, shape [line, cell].
        solution_out: The ``y_i``, shape [line, cell]; written within the span. May be the array of the right
            side.
    """
    line = wp.tid()
    block = line / LANES
    lane = line % LANES
    first = span[line, 0]
    end = span[line, 1]
    content = right_side.dtype(0.0)
    for cell in range(first, end):
        # The first weight is 0.
        content = mean_of(right_side[line, cell], content, forward_weight[block, cell, lane])
        solution_out[line, cell] = content
    for back in range(end - first):
        cell = end - 1 - back
        eliminated = solution_out[line, cell]
        content = mean_of(eliminated, content, backward_weight[block, cell, lane])
        solution_out[line, cell] = content


@wp.kernel
def solve_adjacent_lines(
    # inputs:
    forward_weight: wp.array2d[Lanes],
    backward_weight: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    right_side: wp.array2d[Lanes],
    # outputs:
    solution_out: wp.array2d[Lanes],
):
    """Solve a block of lines whose cells lie side by side in memory, as those of columns do.

    Args:
        forward_weight: From :func:`eliminate_lines`, shape [block, cell].
        backward_weight: From :func:`eliminate_lines`, shape [block, cell].
        span: First leaf cell of each block and the one after its last, shape [block, 2].
        right_side: The ``f_i``, shape [block, cell].
        solution_out: The ``y_i``, shape [block, cell]; written within the span. May be the array of the right side.
    """
    block = wp.tid()
    first = span[block, 0]
    end = span[block, 1]
    content = forward_weight.dtype()
    for cell in range(first, end):
        # The first weight is 0.
        content = mean_of_lanes(right_side[block, cell], content, forward_weight[block, cell])
        solution_out[block, cell] = content
    for back in range(end - first):
        cell = end - 1 - back
        content = mean_of_lanes(solution_out[block, cell], content, backward_weight[block, cell])
        solution_out[block, cell] = content


@wp.kernel
def solve_distant_lines(
    # inputs:
    forward_weight: wp.array2d[Lanes],
    backward_weight: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    right_side: wp.array2d[wp.Float],
    # outputs:
    swept_out: wp.array2d[Lanes],
    solution_out: wp.array2d[wp.Float],
):
    """Solve a block of lines whose cells lie one after another in memory, as those of rows do.

    Args:
        forward_weight: From :func:`eliminate_lines`, shape [block, cell].
        backward_weight: From :func:`eliminate_lines`, shape [block, cell].
        span: First leaf cell of each block and the one after its last, shape [block, 2].
        right_side: The ``f_i``, shape [line, cell], whole blocks of lines.
        swept_out: Room for the ``z_i``, shape [room, cell]: as much as threads that may run at the same time.
        solution_out: The ``y_i``, shape [line, cell]; written within the span. May be the array of the right side.
    """
    block = wp.tid()
    first = span[block, 0]
    end = span[block, 1]
    line = block * LANES
    room = block % swept_out.shape[0]
    content = forward_weight.dtype()
    old = forward_weight.dtype()
    for cell in range(first, end):
        for lane in range(LANES):
            old[lane] = right_side[line + lane, cell]
        # The first weight is 0.
        content = mean_of_lanes(old, content, forward_weight[block, cell])
        swept_out[room, cell] = content
    for back in range(end - first):
        cell = end - 1 - back
        content = mean_of_lanes(swept_out[room, cell], content, backward_weight[block, cell])
        for lane in range(LANES):
            solution_out[line + lane, cell] = content[lane]
