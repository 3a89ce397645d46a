"""The conjugate gradient iteration on a map, for any symmetric positive definite system.

The iteration's numbers stay on the device, so that no iteration waits for the host. Once the residual is
small enough the step along the search direction has length 0, and further iterations change nothing: how
often the host looks is of no consequence. Sums are taken in float64, each row by one thread and then over the
rows, always in the same order, so that two runs agree to the last bit. (Hestenes and Stiefel 1952.)
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Slots of the array ``solver``, shape [SLOT_COUNT].
RESIDUAL_SQUARED = wp.constant(0)
LIMIT_SQUARED = wp.constant(1)
PRECONDITIONED = wp.constant(2)
STEP_LENGTH = wp.constant(3)
IMPROVEMENT = wp.constant(4)
ITERATIONS = wp.constant(5)
SLOT_COUNT = 6


@wp.func
def sum_rows(row_sum: wp.array2d[wp.float64], quantity: wp.int32):
    """Sum of one slot over the rows."""
    total = wp.float64(0.0)
    for row in range(row_sum.shape[1]):
        total += row_sum[quantity, row]
    return total


@wp.kernel
def start_iteration(
    # inputs:
    row_sum: wp.array2d[wp.float64],
    tolerance: wp.float64,
    # outputs:
    solver_out: wp.array[wp.float64],
):
    """Set the solver's numbers (one thread).

    Args:
        row_sum: Sums of each row: slot 0 the squared residual, slot 1 the squared right side, shape [4, ny].
        tolerance: Norm of the residual to reach, over the norm of the right side.
        solver_out: Shape [SLOT_COUNT].
    """
    solver_out[RESIDUAL_SQUARED] = sum_rows(row_sum, 0)
    solver_out[LIMIT_SQUARED] = tolerance * tolerance * sum_rows(row_sum, 1)
    solver_out[PRECONDITIONED] = wp.float64(0.0)
    solver_out[ITERATIONS] = wp.float64(0.0)


@wp.kernel
def preconditioned_product(
    # inputs:
    residual: wp.array2d[wp.Float],
    row_solution: wp.array2d[wp.Float],
    column_solution: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    # outputs:
    row_sum_out: wp.array2d[wp.float64],
):
    """Scalar product of the residual and the preconditioned residual, a sum for each row.

    Args:
        residual: Shape [ny, nx].
        row_solution: ``T_x^-1 residual``, shape [ny, nx].
        column_solution: ``T_y^-1 residual``, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        row_sum_out: Slot 1, shape [4, ny].
    """
    row = wp.tid()
    total = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        preconditioned = row_solution[row, column] + column_solution[row, column]
        total += wp.float64(residual[row, column]) * wp.float64(preconditioned)
    row_sum_out[1, row] = total


@wp.kernel
def improve_direction(
    # inputs:
    row_sum: wp.array2d[wp.float64],
    # outputs:
    solver_out: wp.array[wp.float64],
):
    """Share of the last search direction in the next (one thread).

    Args:
        row_sum: Slot 1 from :func:`preconditioned_product`, shape [4, ny].
        solver_out: Shape [SLOT_COUNT].
    """
    before = solver_out[PRECONDITIONED]
    now = sum_rows(row_sum, 1)
    improvement = wp.float64(0.0)
    if before > wp.float64(0.0):
        improvement = now / before
    solver_out[PRECONDITIONED] = now
    solver_out[IMPROVEMENT] = improvement


@wp.kernel
def update_direction(
    # inputs:
    row_solution: wp.array2d[wp.Float],
    column_solution: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    solver: wp.array[wp.float64],
    # outputs:
    direction_out: wp.array2d[wp.Float],
):
    """The next search direction.

    Args:
        row_solution: ``T_x^-1 residual``, shape [ny, nx].
        column_solution: ``T_y^-1 residual``, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        solver: Shape [SLOT_COUNT].
        direction_out: Shape [ny, nx].
    """
    row = wp.tid()
    for column in range(span[row, 0], span[row, 1]):
        direction = direction_out[row, column]
        improvement = type(direction)(solver[IMPROVEMENT])
        preconditioned = row_solution[row, column] + column_solution[row, column]
        direction_out[row, column] = preconditioned + improvement * direction


@wp.kernel
def choose_step_length(
    # inputs:
    row_sum: wp.array2d[wp.float64],
    # outputs:
    solver_out: wp.array[wp.float64],
):
    """Length of the step along the direction: 0 once the residual is small enough (one thread).

    Args:
        row_sum: Slot 0 from :func:`apply_system`, shape [4, ny].
        solver_out: Shape [SLOT_COUNT].
    """
    curvature = sum_rows(row_sum, 0)
    step_length = wp.float64(0.0)
    if solver_out[RESIDUAL_SQUARED] > solver_out[LIMIT_SQUARED]:
        solver_out[ITERATIONS] += wp.float64(1.0)
        if curvature > wp.float64(0.0):
            step_length = solver_out[PRECONDITIONED] / curvature
    solver_out[STEP_LENGTH] = step_length


@wp.kernel
def update_solution(
    # inputs:
    direction: wp.array2d[wp.Float],
    image: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    solver: wp.array[wp.float64],
    # outputs:
    water_out: wp.array2d[wp.Float],
    residual_out: wp.array2d[wp.Float],
    row_sum_out: wp.array2d[wp.float64],
):
    """Step along the direction; the squared residual, a sum for each row.

    Args:
        direction: Shape [ny, nx].
        image: ``A direction``, shape [ny, nx].
        span: First leaf cell of each row and the one after its last, shape [ny, 2].
        solver: Shape [SLOT_COUNT].
        water_out: The solution, shape [ny, nx].
        residual_out: Shape [ny, nx].
        row_sum_out: Slot 0, shape [4, ny].
    """
    row = wp.tid()
    total = wp.float64(0.0)
    for column in range(span[row, 0], span[row, 1]):
        residual = residual_out[row, column]
        step_length = type(residual)(solver[STEP_LENGTH])
        residual -= step_length * image[row, column]
        residual_out[row, column] = residual
        # Not by +=, which is an atomic addition in every cell and drops subnormal numbers on a GPU.
        water_out[row, column] = water_out[row, column] + step_length * direction[row, column]
        total += wp.float64(residual) * wp.float64(residual)
    row_sum_out[0, row] = total


@wp.kernel
def measure_residual(
    # inputs:
    row_sum: wp.array2d[wp.float64],
    # outputs:
    solver_out: wp.array[wp.float64],
):
    """Squared norm of the residual (one thread).

    Args:
        row_sum: Slot 0 from :func:`update_solution`, shape [4, ny].
        solver_out: Shape [SLOT_COUNT].
    """
    solver_out[RESIDUAL_SQUARED] = sum_rows(row_sum, 0)
