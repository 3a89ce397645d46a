"""The conjugate gradient iteration on a map, for any symmetric positive definite system.

The iteration's numbers stay on the device, so that no iteration waits for the host. Once the error is
small enough the step along the search direction has length 0, and further iterations change nothing: how
often the host looks is of no consequence. Sums are taken in float64, each segment of a row by one thread and then over
all, always in the same order, so that two runs agree to the last bit. (Hestenes and Stiefel 1952.)

Where no eigenvalue of ``A`` is below 1 the residual ``r`` bounds the error ``e``, ``|e| <= |r|``, but where some are
large it is far above it. Sharper is the energy: with the preconditioner ``B`` and the least and largest eigenvalues
``mu`` and ``nu`` of ``B A``,

    |e|^2 <= e^T A e = r^T A^-1 r <= r^T B r / mu,

and ``r^T B r`` is at hand. An iteration makes it smaller at least by the factor ``((nu - mu) / (nu + mu))^2``, as a
step of steepest descent would, so that its end need not wait for another ``B r``. Estimates of both eigenvalues, from
within, follow from the lengths of the steps and the shares of the last directions in the next, which are kept
(Lanczos; Golub and Van Loan, "Matrix Computations", 10.2). An iteration ends where either bound is small enough.

To find ``B r`` only to see that it is not needed would take a third of the time of a step with one iteration. What the
energy bound is of each square of the residual, after as many iterations, changes little from one time step to the next
(within a factor of two, mostly by some hundredths). It is kept, and an iteration ends by its residual and that alone,
seven times of eight (:data:`UNSEEN`), after which it is looked at again. A residual that was worth more than that is no
loss: what is left of it goes into the next time step.

What the cells of a map give to each other, the outflow, adds up to 0. The sum that rounding leaves, the leak, is taken
off the residual, where it would grow to a constant of any size.

Arrays are whole blocks of lanes (see :mod:`leafwarp_kernels.lanes`); a thread takes some blocks of a row, on a CPU all
of them.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes
from leafwarp_kernels.sums import Sum, add_lanes, sum_parts, sum_rows

wp.set_module_options({"enable_backward": False})

# Slots of the array ``solver``, shape [SLOT_COUNT].
RESIDUAL_SQUARED = wp.constant(0)
LIMIT_SQUARED = wp.constant(1)
PRECONDITIONED = wp.constant(2)
STEP_LENGTH = wp.constant(3)
IMPROVEMENT = wp.constant(4)
ITERATIONS = wp.constant(5)
LEAK = wp.constant(6)
ENERGY = wp.constant(7)
ERROR_SQUARED = wp.constant(8)
SLOT_COUNT = 9

# Rows of the array ``worth``, shape [WORTH_ROWS, WORTH_COUNT]: energy of each square of the residual after so many
# iterations, 0 where it is not known; how often it was taken for that since it was looked at.
WORTH_ENERGY = wp.constant(0)
WORTH_UNSEEN = wp.constant(1)
WORTH_ROWS, WORTH_COUNT = 2, 8
UNSEEN = wp.constant(wp.float64(7.0))

# Slots of the array ``bounds``, shape [BOUND_COUNT]: 1 / mu, 0 where it is not known, and the factor of an iteration.
BOUND_ENERGY = wp.constant(0)
BOUND_CONTRACTION = wp.constant(1)
BOUND_COUNT = 2

# Slots of the sums of segments, shape [SUM_COUNT, segment, ny].
SUM_RESIDUAL_SQUARED = wp.constant(0)
SUM_PRODUCT = wp.constant(1)
SUM_RIGHT_SIDE_SQUARED = wp.constant(2)
SUM_CHANGE = wp.constant(3)
SUM_OUTFLOW = wp.constant(4)
SUM_COUNT = 5

# Rows of the array ``history``, shape [HISTORY_COUNT, iteration].
HISTORY_STEP_LENGTH = wp.constant(0)
HISTORY_IMPROVEMENT = wp.constant(1)
HISTORY_COUNT = 2


@wp.func
def coupled_only(inverse_diagonal: Any, values: Any):
    """Values of the cells that the system couples with others, of which the inverse diagonal is not 0; else 0."""
    kept = type(values)()
    none = type(values[0])(0.0)
    for lane in range(LANES):
        kept[lane] = wp.where(inverse_diagonal[lane] > none, values[lane], none)
    return kept


@wp.func
def accept_by_worth(solver: wp.array[wp.float64], worth: wp.array2d[wp.float64]):
    """Take what the residual is worth in energy for the error, where that is small enough, and was seen lately."""
    iteration = int(solver[ITERATIONS])
    if iteration < worth.shape[1] and solver[ERROR_SQUARED] > solver[LIMIT_SQUARED]:
        energy = worth[WORTH_ENERGY, iteration] * solver[RESIDUAL_SQUARED]
        is_small = energy > wp.float64(0.0) and energy <= solver[LIMIT_SQUARED]
        if is_small and worth[WORTH_UNSEEN, iteration] < UNSEEN:
            solver[ERROR_SQUARED] = energy
            worth[WORTH_UNSEEN, iteration] += wp.float64(1.0)


@wp.kernel
def start_iteration(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    tolerance: wp.float64,
    coupled_count: wp.float64,
    # outputs:
    solver_out: wp.array[wp.float64],
    worth_out: wp.array2d[wp.float64],
):
    """Set the solver's numbers (one thread).

    Args:
        row_sum: Squared residual, squared right side and outflow, shape [SUM_COUNT, segment, ny].
        tolerance: Norm of the error to reach, over the norm of the right side.
        coupled_count: Number of cells that the system couples with others; 1 where there is none.
        solver_out: Shape [SLOT_COUNT].
        worth_out: Shape [WORTH_ROWS, WORTH_COUNT].
    """
    residual_squared = sum_rows(row_sum, SUM_RESIDUAL_SQUARED)
    solver_out[RESIDUAL_SQUARED] = residual_squared
    solver_out[ERROR_SQUARED] = residual_squared
    solver_out[LIMIT_SQUARED] = tolerance * tolerance * sum_rows(row_sum, SUM_RIGHT_SIDE_SQUARED)
    solver_out[PRECONDITIONED] = wp.float64(0.0)
    solver_out[ENERGY] = wp.float64(0.0)
    solver_out[STEP_LENGTH] = wp.float64(0.0)
    solver_out[ITERATIONS] = wp.float64(0.0)
    solver_out[LEAK] = sum_rows(row_sum, SUM_OUTFLOW) / coupled_count
    accept_by_worth(solver_out, worth_out)


@wp.kernel
def improve_direction(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    bounds: wp.array[wp.float64],
    # outputs:
    solver_out: wp.array[wp.float64],
    worth_out: wp.array2d[wp.float64],
):
    """Share of the last search direction in the next, and the bound of the error (one thread).

    Args:
        row_sum: Products of the residual and the preconditioned residual, shape [SUM_COUNT, segment, ny].
        bounds: Shape [BOUND_COUNT].
        solver_out: Shape [SLOT_COUNT].
        worth_out: Shape [WORTH_ROWS, WORTH_COUNT].
    """
    before = solver_out[PRECONDITIONED]
    now = sum_rows(row_sum, SUM_PRODUCT)
    improvement = wp.float64(0.0)
    if before > wp.float64(0.0):
        improvement = now / before
    solver_out[PRECONDITIONED] = now
    solver_out[IMPROVEMENT] = improvement
    energy = bounds[BOUND_ENERGY] * now
    solver_out[ENERGY] = energy
    # What was accepted once stays accepted: how often the host looks is of no consequence.
    if energy > wp.float64(0.0) and solver_out[ERROR_SQUARED] > solver_out[LIMIT_SQUARED]:
        residual_squared = solver_out[RESIDUAL_SQUARED]
        solver_out[ERROR_SQUARED] = wp.min(residual_squared, energy)
        iteration = int(solver_out[ITERATIONS])
        if iteration < worth_out.shape[1]:
            newest = energy / residual_squared
            # More is believed at once, less by halves.
            worth = wp.max(newest, wp.float64(0.5) * (newest + worth_out[WORTH_ENERGY, iteration]))
            worth_out[WORTH_ENERGY, iteration] = worth
            worth_out[WORTH_UNSEEN, iteration] = wp.float64(0.0)


@wp.kernel
def update_direction(
    # inputs:
    preconditioned: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    solver: wp.array[wp.float64],
    # outputs:
    direction_out: wp.array2d[Lanes],
):
    """The next search direction.

    Args:
        preconditioned: The preconditioned residual, shape [ny, block].
        inverse_diagonal: Of A, 0 where it couples a cell with no other: such cells are left alone. Shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        solver: Shape [SLOT_COUNT].
        direction_out: Shape [ny, block].
    """
    segment, row = wp.tid()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        before = direction_out[row, block]
        improvement = type(before[0])(solver[IMPROVEMENT])
        direction = preconditioned[row, block] + improvement * before
        direction_out[row, block] = coupled_only(inverse_diagonal[row, block], direction)


@wp.kernel
def choose_step_length(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    coupled_count: wp.float64,
    # outputs:
    solver_out: wp.array[wp.float64],
    history_out: wp.array2d[wp.float64],
):
    """Length of the step along the direction: 0 once the error is small enough (one thread).

    Args:
        row_sum: Product of the direction and its image, and outflow, shape [SUM_COUNT, segment, ny].
        coupled_count: Number of cells that the system couples with others; 1 where there is none.
        solver_out: Shape [SLOT_COUNT].
        history_out: Numbers of the first iterations, shape [HISTORY_COUNT, iteration].
    """
    curvature = sum_rows(row_sum, SUM_PRODUCT)
    step_length = wp.float64(0.0)
    if solver_out[ERROR_SQUARED] > solver_out[LIMIT_SQUARED]:
        if curvature > wp.float64(0.0):
            step_length = solver_out[PRECONDITIONED] / curvature
        iteration = int(solver_out[ITERATIONS])
        if iteration < history_out.shape[1]:
            history_out[HISTORY_STEP_LENGTH, iteration] = step_length
            history_out[HISTORY_IMPROVEMENT, iteration] = solver_out[IMPROVEMENT]
        solver_out[ITERATIONS] = wp.float64(iteration + 1)
    solver_out[STEP_LENGTH] = step_length
    solver_out[LEAK] += step_length * sum_rows(row_sum, SUM_OUTFLOW) / coupled_count


@wp.kernel
def advance_solution(
    # inputs:
    direction: wp.array2d[Lanes],
    image: wp.array2d[Lanes],
    inverse_diagonal: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    omega: wp.Float,
    solver: wp.array[wp.float64],
    # outputs:
    change_out: wp.array2d[Lanes],
    residual_out: wp.array2d[Lanes],
    swept_out: wp.array2d[Lanes],
    row_sum_out: wp.array3d[wp.float64],
):
    """Step along the direction; the preconditioner's first sweep; sums of each segment.

    Args:
        direction: Shape [ny, block].
        image: ``A direction``, shape [ny, block].
        inverse_diagonal: Of A, 0 where it couples a cell with no other, shape [ny, block].
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        segment_length: Blocks of a thread.
        omega: Weight of the preconditioner's first sweep.
        solver: Shape [SLOT_COUNT].
        change_out: The solution, shape [ny, block].
        residual_out: Shape [ny, block].
        swept_out: The new residual after the first sweep of the preconditioner, shape [ny, block]; it may be the array
            of the image.
        row_sum_out: Squared residual and change, shape [SUM_COUNT, segment, ny].
    """
    segment, row = wp.tid()
    residual_squared = Sum()
    change_sum = Sum()
    first = wp.max(span[row, 0], segment * segment_length)
    for block in range(first, wp.min(span[row, 1], (segment + 1) * segment_length)):
        residual = residual_out[row, block]
        step_length = type(residual[0])(solver[STEP_LENGTH])
        inverse = inverse_diagonal[row, block]
        leak = coupled_only(inverse, type(residual)(type(residual[0])(solver[LEAK])))
        residual = residual - step_length * image[row, block] + leak
        change = change_out[row, block] + step_length * direction[row, block]
        residual_out[row, block] = residual
        change_out[row, block] = change
        swept_out[row, block] = omega * wp.cw_mul(inverse, residual)
        residual_squared = add_lanes(residual_squared, wp.cw_mul(residual, residual))
        change_sum = add_lanes(change_sum, change)
    row_sum_out[SUM_RESIDUAL_SQUARED, segment, row] = sum_parts(residual_squared)
    row_sum_out[SUM_CHANGE, segment, row] = sum_parts(change_sum)


@wp.kernel
def measure_residual(
    # inputs:
    row_sum: wp.array3d[wp.float64],
    bounds: wp.array[wp.float64],
    # outputs:
    solver_out: wp.array[wp.float64],
    worth_out: wp.array2d[wp.float64],
):
    """Squared norm of the residual, from which the leak is taken off, and the bound of the error (one thread).

    Args:
        row_sum: From :func:`advance_solution`, shape [SUM_COUNT, segment, ny].
        bounds: Shape [BOUND_COUNT].
        solver_out: Shape [SLOT_COUNT].
        worth_out: Shape [WORTH_ROWS, WORTH_COUNT].
    """
    residual_squared = sum_rows(row_sum, SUM_RESIDUAL_SQUARED)
    solver_out[RESIDUAL_SQUARED] = residual_squared
    if solver_out[ERROR_SQUARED] > solver_out[LIMIT_SQUARED]:
        energy = bounds[BOUND_CONTRACTION] * solver_out[ENERGY]
        if energy > wp.float64(0.0) and solver_out[STEP_LENGTH] > wp.float64(0.0):
            residual_squared = wp.min(residual_squared, energy)
        solver_out[ERROR_SQUARED] = residual_squared
        accept_by_worth(solver_out, worth_out)
    solver_out[LEAK] = wp.float64(0.0)
