"""The system of a diffusion step along rows and columns at once (backward Euler, no splitting error).

The step solves ``A y = f`` with ``A = I + L_x + L_y``, where ``L_x`` and ``L_y`` couple each cell with its
neighbours along rows and columns with ``beta = conductance * dt``. A is a symmetric M-matrix with row sums 1,
so the exact solution conserves water and stays between the extremes of ``f``. No eigenvalue of A is below 1;
hence the error of an approximate solution is never larger than its residual, ``|y - y_exact| <= |f - A y|``.

It is solved by conjugate gradients (:mod:`leafwarp_kernels.conjugate_gradients`) from ``y = f``,
preconditioned with the sum of two line solves (:mod:`leafwarp_kernels.tridiagonal`), which is symmetric and
positive definite:

    P^-1 = T_x^-1 + T_y^-1,    T_x = I + L_x + diag(L_y),    T_y = I + L_y + diag(L_x).

The mean content is an eigenvector of A with eigenvalue 1, so its error after the iteration is known exactly:
:func:`shift_water` removes it.

A source (:mod:`leafwarp_kernels.source`) makes the system ``(E + L_x + L_y) y = E f'`` with ``E = I + S``. From
``y = f'`` its residual is ``-(L_x + L_y) f'``, as without a source; S is added to A (:func:`apply_exchange`) and to
both matrices of the preconditioner. Eigenvalues do not fall below 1, so the bound of the error holds. The mean
content is no eigenvector any more: there is no shift while the source is open.
"""

import warp as wp

from leafwarp_kernels.conjugate_gradients import sum_rows

wp.set_module_options({"enable_backward": False})


@wp.func
def outflow(
    values: wp.array2d[wp.Float],
    conductance_x: wp.array2d[wp.Float],
    conductance_y: wp.array2d[wp.Float],
    row: wp.int32,
    column: wp.int32,
    time_step: wp.Float,
):
    """``((L_x + L_y) values)`` at one cell, in float64: the fluxes may cancel to a small part of each."""
    here = wp.float64(values[row, column])
    total = wp.float64(0.0)
    east = conductance_x[row, column]
    if east > type(time_step)(0.0):
        total += wp.float64(east) * (here - wp.float64(values[row, column + 1]))
    north = conductance_y[row, column]
    if north > type(time_step)(0.0):
        total += wp.float64(north) * (here - wp.float64(values[row + 1, column]))
    if column > 0:
        total += wp.float64(conductance_x[row, column - 1]) * (here - wp.float64(values[row, column - 1]))
    if row > 0:
        total += wp.float64(conductance_y[row - 1, column]) * (here - wp.float64(values[row - 1, column]))
    return total * wp.float64(time_step)


@wp.kernel
def direction_diagonals(
    # inputs:
    conductance_x: wp.array2d[wp.Float],
    conductance_y: wp.array2d[wp.Float],
    exchange: wp.array2d[wp.Float],
    time_step: wp.Float,
    # outputs:
    diagonal_x_out: wp.array2d[wp.Float],
    diagonal_y_out: wp.array2d[wp.Float],
):
    """The diagonals of ``L_x`` and ``L_y``, each with ``S`` of a source added, shape [ny, nx].

    Args:
        conductance_x: Rate of exchange of each cell with its right neighbour [1/s], shape [ny, nx].
        conductance_y: The same with its upper neighbour.
        exchange: ``S``, shape [ny, nx]; None for none.
        time_step: [s].
        diagonal_x_out: Shape [ny, nx].
        diagonal_y_out: Shape [ny, nx].
    """
    row, column = wp.tid()
    along_x = conductance_x[row, column] * time_step
    along_y = conductance_y[row, column] * time_step
    if column > 0:
        along_x += conductance_x[row, column - 1] * time_step
    if row > 0:
        along_y += conductance_y[row - 1, column] * time_step
    if exchange:
        along_x += exchange[row, column]
        along_y += exchange[row, column]
    diagonal_x_out[row, column] = along_x
    diagonal_y_out[row, column] = along_y


@wp.kernel
def start_residual(
    # inputs:
    water: wp.array2d[wp.Float],
    conductance_x: wp.array2d[wp.Float],
    conductance_y: wp.array2d[wp.Float],
    diagonal_x: wp.array2d[wp.Float],
    diagonal_y: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    time_step: wp.Float,
    # outputs:
    residual_out: wp.array2d[wp.Float],
    direction_out: wp.array2d[wp.Float],
    row_sum_out: wp.array2d[wp.float64],
):
    """The residual of ``y = f``, which is ``-(L_x + L_y) f``; a search direction of 0; sums of each row.

    Args:
        water: Contents before the step, ``f``, shape [ny, nx].
        conductance_x: Rate of exchange of each cell with its right neighbour [1/s], shape [ny, nx].
        conductance_y: The same with its upper neighbour.
        diagonal_x: From :func:`direction_diagonals`, shape [ny, nx].
        diagonal_y: From :func:`direction_diagonals`, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        time_step: [s].
        residual_out: Shape [ny, nx].
        direction_out: Shape [ny, nx].
        row_sum_out: Squared residual, squared content, content of coupled cells and their count, shape [4,
            ny].
    """
    row = wp.tid()
    residual_squared = wp.float64(0.0)
    content_squared = wp.float64(0.0)
    content_sum = wp.float64(0.0)
    coupled_count = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        content = wp.float64(water[row, column])
        residual = type(time_step)(-outflow(water, conductance_x, conductance_y, row, column, time_step))
        residual_out[row, column] = residual
        direction_out[row, column] = type(time_step)(0.0)
        residual_squared += wp.float64(residual) * wp.float64(residual)
        content_squared += content * content
        if diagonal_x[row, column] + diagonal_y[row, column] > type(time_step)(0.0):
            content_sum += content
            coupled_count += wp.float64(1.0)
    row_sum_out[0, row] = residual_squared
    row_sum_out[1, row] = content_squared
    row_sum_out[2, row] = content_sum
    row_sum_out[3, row] = coupled_count


@wp.kernel
def apply_system(
    # inputs:
    direction: wp.array2d[wp.Float],
    conductance_x: wp.array2d[wp.Float],
    conductance_y: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    time_step: wp.Float,
    # outputs:
    image_out: wp.array2d[wp.Float],
    row_sum_out: wp.array2d[wp.float64],
):
    """``A direction``, and its scalar product with the direction, a sum for each row.

    Args:
        direction: Shape [ny, nx].
        conductance_x: Rate of exchange of each cell with its right neighbour [1/s], shape [ny, nx].
        conductance_y: The same with its upper neighbour.
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        time_step: [s].
        image_out: Shape [ny, nx].
        row_sum_out: Slot 0, shape [4, ny].
    """
    row = wp.tid()
    total = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        here = wp.float64(direction[row, column])
        image = here + outflow(direction, conductance_x, conductance_y, row, column, time_step)
        image_out[row, column] = type(time_step)(image)
        total += here * image
    row_sum_out[0, row] = total


@wp.kernel
def apply_exchange(
    # inputs:
    direction: wp.array2d[wp.Float],
    exchange: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    # outputs:
    image_out: wp.array2d[wp.Float],
    row_sum_out: wp.array2d[wp.float64],
):
    """Add a source's ``S direction`` to what :func:`apply_system` has made of the direction.

    Args:
        direction: Shape [ny, nx].
        exchange: ``S``, shape [ny, nx].
        span: First source cell of each row and the one after its last, shape [ny, 2].
        image_out: Shape [ny, nx]; added to.
        row_sum_out: Slot 0, shape [4, ny]; added to.
    """
    row = wp.tid()
    total = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        here = direction[row, column]
        exchanged = wp.float64(exchange[row, column]) * wp.float64(here)
        image_out[row, column] = type(here)(wp.float64(image_out[row, column]) + exchanged)
        total += wp.float64(here) * exchanged
    row_sum_out[0, row] += total


@wp.kernel
def sum_coupled_water(
    # inputs:
    water: wp.array2d[wp.Float],
    diagonal_x: wp.array2d[wp.Float],
    diagonal_y: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    # outputs:
    row_sum_out: wp.array2d[wp.float64],
):
    """Content of the cells that exchange water, a sum for each row.

    Args:
        water: Shape [ny, nx].
        diagonal_x: From :func:`direction_diagonals`, shape [ny, nx].
        diagonal_y: From :func:`direction_diagonals`, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        row_sum_out: Slot 0, shape [4, ny].
    """
    row = wp.tid()
    total = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        content = water[row, column]
        if diagonal_x[row, column] + diagonal_y[row, column] > type(content)(0.0):
            total += wp.float64(content)
    row_sum_out[0, row] = total


@wp.kernel
def choose_shift(
    # inputs:
    row_sum: wp.array2d[wp.float64],
    # outputs:
    shift_out: wp.array[wp.float64],
):
    """Error of the mean content of the cells that exchange water (one thread).

    Args:
        row_sum: Slot 0 from :func:`sum_coupled_water`, slots 2 and 3 from :func:`start_residual`, shape [4,
            ny].
        shift_out: Shape [1].
    """
    coupled_count = wp.max(sum_rows(row_sum, 3), wp.float64(1.0))
    shift_out[0] = (sum_rows(row_sum, 2) - sum_rows(row_sum, 0)) / coupled_count


@wp.kernel
def shift_water(
    # inputs:
    diagonal_x: wp.array2d[wp.Float],
    diagonal_y: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    shift: wp.array[wp.float64],
    # outputs:
    water_out: wp.array2d[wp.Float],
):
    """Give the cells that exchange water the mean content that they had before the step.

    Args:
        diagonal_x: From :func:`direction_diagonals`, shape [ny, nx].
        diagonal_y: From :func:`direction_diagonals`, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        shift: From :func:`choose_shift`, shape [1].
        water_out: Shape [ny, nx].
    """
    row = wp.tid()
    for column in range(span[row, 0], span[row, 1]):
        content = water_out[row, column]
        if diagonal_x[row, column] + diagonal_y[row, column] > type(content)(0.0):
            water_out[row, column] = type(content)(wp.float64(content) + shift[0])
