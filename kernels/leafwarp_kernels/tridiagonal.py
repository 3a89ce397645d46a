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
of the others by more than rounding, whatever beta is. The two weights depend on beta alone: they are made
once, in float64, and a step is two sweeps in place without a division.

A kernel treats line k of its arrays as line k of the map. For columns, pass transposed views.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def eliminate_lines(
    # inputs:
    conductance: wp.array2d[wp.Float],
    excess_diagonal: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    time_step: wp.float64,
    # outputs:
    forward_weight_out: wp.array2d[wp.Float],
    backward_weight_out: wp.array2d[wp.Float],
):
    """The weights of each line's two sweeps.

    Args:
        conductance: Rate of exchange of each cell with the next one of its line [1/s], shape [line, cell].
        excess_diagonal: The ``e_i - 1``, shape [line, cell]; None for none.
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        time_step: [s].
        forward_weight_out: The ``w_i / s_i``, shape [line, cell]; written within the span.
        backward_weight_out: The ``beta_i / d_i``, shape [line, cell]; written within the span.
    """
    line = wp.tid()
    carried = wp.float64(0.0)
    for cell in range(span[line, 0], span[line, 1]):
        diagonal = wp.float64(1.0)
        if excess_diagonal:
            diagonal += wp.float64(excess_diagonal[line, cell])
        remainder = diagonal + carried
        rate = conductance[line, cell]
        beta = wp.float64(rate) * time_step
        backward_weight = beta / (remainder + beta)
        forward_weight_out[line, cell] = type(rate)(carried / remainder)
        backward_weight_out[line, cell] = type(rate)(backward_weight)
        carried = remainder * backward_weight


@wp.kernel
def solve_lines(
    # inputs:
    forward_weight: wp.array2d[wp.Float],
    backward_weight: wp.array2d[wp.Float],
    excess_diagonal: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    right_side: wp.array2d[wp.Float],
    # outputs:
    solution_out: wp.array2d[wp.Float],
):
    """Solve each line.

    Args:
        forward_weight: From :func:`eliminate_lines`.
        backward_weight: From :func:`eliminate_lines`.
        excess_diagonal: The ``e_i - 1``, shape [line, cell]; None for a right side that holds the ``f_i``.
        span: First leaf cell of each line and the one after its last, shape [line, 2].
        right_side: The ``e_i f_i``, or the ``f_i``, shape [line, cell].
        solution_out: The ``y_i``, shape [line, cell]; written within the span. May be the array of the right
            side.
    """
    line = wp.tid()
    first = span[line, 0]
    end = span[line, 1]
    if first == end:
        return
    content = right_side[line, first]
    one = type(content)(1.0)
    for cell in range(first, end):
        old = right_side[line, cell]
        if excess_diagonal:
            old = old / (one + excess_diagonal[line, cell])
        content = old + forward_weight[line, cell] * (content - old)
        solution_out[line, cell] = content
    for back in range(end - first):
        cell = end - 1 - back
        eliminated = solution_out[line, cell]
        content = eliminated + backward_weight[line, cell] * (content - eliminated)
        solution_out[line, cell] = content
