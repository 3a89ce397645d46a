"""Diffusion along rows and columns at once: the accurate scheme, without the splitting error."""

from __future__ import annotations

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.lines import LineSolves, line_arrays, upload_conductance
from leafwarp.sim.fluid.steps import FluidSteps, NotConverged
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.conjugate_gradients import (
    ITERATIONS,
    LIMIT_SQUARED,
    RESIDUAL_SQUARED,
    SLOT_COUNT,
    choose_step_length,
    improve_direction,
    measure_residual,
    preconditioned_product,
    start_iteration,
    update_direction,
    update_solution,
)
from leafwarp_kernels.tridiagonal import eliminate_lines, solve_lines
from leafwarp_kernels.unsplit import (
    apply_system,
    choose_shift,
    direction_diagonals,
    shift_water,
    start_residual,
    sum_coupled_water,
)

MAXIMUM_ITERATIONS = 5000
# Iterations between two looks at the residual from the host, which stall a GPU.
ITERATIONS_PER_LOOK = 8


class UnsplitDiffusion(Stage):
    """One implicit step along rows and columns at once, by conjugate gradients.

    The residual is brought below ``fluid.tolerance`` times the norm of the contents (float64: its square),
    which bounds the relative error of the contents in the same norm.

    Attributes:
        iterations: Conjugate gradient iterations so far.
        most_iterations: The most that a step has taken.
    """

    name = "unsplit_diffusion"
    purpose = "water flows along veins and lamina: rows and columns at once"
    rate = "fluid step"
    kernels = (
        direction_diagonals,
        eliminate_lines,
        start_residual,
        start_iteration,
        solve_lines,
        preconditioned_product,
        improve_direction,
        update_direction,
        apply_system,
        choose_step_length,
        update_solution,
        measure_residual,
        sum_coupled_water,
        choose_shift,
        shift_water,
    )
    writes = ("water",)
    # With a single iteration; each further one launches nine kernels more.
    launches = 14

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        shape = leaf.mask.shape
        self.iterations = 0
        self.most_iterations = 0
        tolerance = scene.fluid.tolerance
        self._tolerance = tolerance if scene.solver.precision == "float32" else tolerance**2
        self.arrays = (
            *line_arrays(shape),
            ArraySpec("diagonal_x", shape, "real", "diagonal of the exchange along rows in a step"),
            ArraySpec("diagonal_y", shape, "real", "diagonal of the exchange along columns in a step"),
            ArraySpec("unsplit_residual", shape, "real", "residual of the step's system"),
            ArraySpec("unsplit_direction", shape, "real", "search direction"),
            ArraySpec("unsplit_row_solution", shape, "real", "residual solved along rows; then the system's image"),
            ArraySpec("unsplit_column_solution", shape, "real", "residual solved along columns"),
            ArraySpec("unsplit_row_sum", (4, shape[0]), "float64", "sums of each row of cells"),
            ArraySpec("unsplit_solver", (SLOT_COUNT,), "float64", "numbers of the conjugate gradients"),
            ArraySpec("unsplit_shift", (1,), "float64", "error of the mean content"),
        )

    def bind(self, state: State) -> None:
        time_step = FluidSteps.of(self.scene).length
        shape = self.leaf.mask.shape
        upload_conductance(self.scene, self.leaf, state, time_step)
        faces, diagonals = ["conductance_x", "conductance_y"], ["diagonal_x", "diagonal_y"]
        state.record(direction_diagonals, shape, [*faces, time_step], diagonals).run()
        rows_solve = LineSolves(state, "x", time_step, "diagonal_y")
        columns_solve = LineSolves(state, "y", time_step, "diagonal_x")
        rows, record = shape[0], state.record
        self._solver = state["unsplit_solver"]
        self._iterations_per_look = ITERATIONS_PER_LOOK if state.device.is_cuda else 1
        self._start = [
            record(
                start_residual,
                rows,
                ["water", *faces, *diagonals, "row_span", time_step],
                ["unsplit_residual", "unsplit_direction", "unsplit_row_sum"],
            ),
            record(start_iteration, 1, ["unsplit_row_sum", self._tolerance], ["unsplit_solver"]),
        ]
        precondition = [
            rows_solve.record("unsplit_residual", "unsplit_row_solution"),
            columns_solve.record("unsplit_residual", "unsplit_column_solution"),
        ]
        self._iteration = precondition + self._record_iteration(state, [*faces, "row_span", time_step])
        self._finish = [
            record(sum_coupled_water, rows, ["water", *diagonals, "row_span"], ["unsplit_row_sum"]),
            record(choose_shift, 1, ["unsplit_row_sum"], ["unsplit_shift"]),
            record(shift_water, rows, [*diagonals, "row_span", "unsplit_shift"], ["water"]),
        ]
        self.commands = [*self._start, *self._iteration, *self._finish]

    def _record_iteration(self, state: State, system: list) -> list[Command]:
        rows, record = self.leaf.mask.shape[0], state.record
        solved = ["unsplit_row_solution", "unsplit_column_solution"]
        image = "unsplit_row_solution"
        return [
            record(preconditioned_product, rows, ["unsplit_residual", *solved, "row_span"], ["unsplit_row_sum"]),
            record(improve_direction, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
            record(update_direction, rows, [*solved, "row_span", "unsplit_solver"], ["unsplit_direction"]),
            record(apply_system, rows, ["unsplit_direction", *system], [image, "unsplit_row_sum"]),
            record(choose_step_length, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
            record(
                update_solution,
                rows,
                ["unsplit_direction", image, "row_span", "unsplit_solver"],
                ["water", "unsplit_residual", "unsplit_row_sum"],
            ),
            record(measure_residual, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
        ]

    def run(self, interval: Interval | None = None) -> None:
        """Do one step.

        Raises:
            NotConverged: The residual is not below the tolerance after :data:`MAXIMUM_ITERATIONS`.
        """
        for command in self._start:
            command.run()
        for _ in range(0, MAXIMUM_ITERATIONS, self._iterations_per_look):
            if not self._above_tolerance():
                break
            for command in self._iteration * self._iterations_per_look:
                command.run()
        self._check()
        for command in self._finish:
            command.run()

    def _above_tolerance(self) -> bool:
        numbers = self._solver.numpy()
        return bool(numbers[RESIDUAL_SQUARED] > numbers[LIMIT_SQUARED])

    def _check(self) -> None:
        numbers = self._solver.numpy()
        count = int(numbers[ITERATIONS])
        self.iterations += count
        self.most_iterations = max(self.most_iterations, count)
        if not numbers[RESIDUAL_SQUARED] <= numbers[LIMIT_SQUARED]:
            short = (numbers[RESIDUAL_SQUARED] / numbers[LIMIT_SQUARED]) ** 0.5
            raise NotConverged(
                f"after {count} iterations the unsplit scheme's residual is {short:.3g} times what "
                f"fluid.tolerance = {self.scene.fluid.tolerance:g} accepts; a shorter fluid.step, a larger "
                "fluid.tolerance, solver.precision = 'float64' or fluid.scheme = 'split' would help"
            )
