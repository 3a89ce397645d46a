"""Diffusion along rows and columns at once: the accurate scheme, without the splitting error."""

from __future__ import annotations

from typing import NamedTuple

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.lines import LineSolves, diffusion_supply, line_arrays, upload_conductance
from leafwarp.sim.fluid.spans import line_spans
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
from leafwarp_kernels.unsplit import (
    apply_exchange,
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


class _Step(NamedTuple):
    """The launches of a step: at its start, in each iteration and at its end."""

    start: list[Command]
    iteration: list[Command]
    finish: list[Command]


class UnsplitDiffusion(Stage):
    """One implicit step along rows and columns at once, by conjugate gradients, all on the device.

    The residual is brought below ``fluid.tolerance`` times the norm of the contents (float64: its square),
    which bounds the relative error of the contents in the same norm. Without a source the content of the whole
    leaf is exact; while one is open, what is missing in it counts as added by the source.

    Attributes:
        iterations: Conjugate gradient iterations so far.
        most_iterations: The most that a step has taken.
    """

    name = "unsplit_diffusion"
    purpose = "water flows along veins and lamina: rows and columns at once"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        shape = leaf.mask.shape
        self.iterations = 0
        self.most_iterations = 0
        self.arrays = (
            *line_arrays(shape),
            ArraySpec("diagonal_x", shape, "real", "diagonal of the exchange along rows in a step"),
            ArraySpec("diagonal_y", shape, "real", "diagonal of the exchange along columns in a step"),
            ArraySpec("unsplit_residual", shape, "real", "residual of the step's system", padded=True),
            ArraySpec("unsplit_direction", shape, "real", "search direction"),
            ArraySpec(
                "unsplit_row_solution", shape, "real", "residual solved along rows; the system's image", padded=True
            ),
            ArraySpec("unsplit_column_solution", shape, "real", "residual solved along columns", padded=True),
            ArraySpec("unsplit_row_sum", (4, shape[0]), "float64", "sums of each row of cells"),
            ArraySpec("unsplit_solver", (SLOT_COUNT,), "float64", "numbers of the conjugate gradients"),
            ArraySpec("unsplit_shift", (1,), "float64", "error of the mean content"),
        )
        self._supply = diffusion_supply(scene, leaf, directions="x", lines_mix=True)
        if self._supply is not None:
            span = ArraySpec("source_span", (shape[0], 2), "int32", "first source cell of each row and after its last")
            self.purpose += ", fed at the petiole base"
            self.arrays += (*self._supply.arrays, span)

    def bind(self, state: State) -> None:
        time_step = FluidSteps.of(self.scene).length
        shape = self.leaf.mask.shape
        upload_conductance(self.scene, self.leaf, state, time_step)
        faces, diagonals = ["conductance_x", "conductance_y"], ["diagonal_x", "diagonal_y"]
        exchange = None
        if self._supply is not None:
            exchange = "source_exchange"
        self._diagonals = state.record(direction_diagonals, shape, [*faces, exchange, time_step], diagonals)
        self._diagonals.run()
        rows_solve = LineSolves(self, state, "x", time_step, "diagonal_y")
        columns_solve = LineSolves(self, state, "y", time_step, "diagonal_x")
        self._solves = (rows_solve, columns_solve)
        precondition = [
            *rows_solve.record("unsplit_residual", "unsplit_row_solution"),
            *columns_solve.record("unsplit_residual", "unsplit_column_solution"),
        ]
        start = self._record_start(state, [*faces, *diagonals, "row_span", time_step])
        search, advance = self._record_iteration(state, [*faces, "row_span", time_step])
        self._alone = _Step(start, [*precondition, *search, *advance], self._record_shift(state, diagonals))
        step = self._alone
        if self._supply is not None:
            fill, count = self._supply.record(self, state, "x")
            exchange = self._record_exchange(state)
            step = self._fed = _Step([fill, *start], [*precondition, *search, exchange, *advance], [count])
        self.commands = [*step.start, *step.iteration, *step.finish]
        self._solver = state["unsplit_solver"]
        self._iterations_per_look = ITERATIONS_PER_LOOK if state.device.is_cuda else 1

    def _record_start(self, state: State, system: list) -> list[Command]:
        rows, record = self.leaf.mask.shape[0], state.record
        outputs = ["unsplit_residual", "unsplit_direction", "unsplit_row_sum"]
        return [
            record(start_residual, rows, ["water", *system], outputs),
            record(start_iteration, 1, ["unsplit_row_sum", self.scene.residual_tolerance], ["unsplit_solver"]),
        ]

    def _record_iteration(self, state: State, system: list) -> tuple[list[Command], list[Command]]:
        """An iteration up to the image of the search direction, and the rest of it."""
        rows, record = self.leaf.mask.shape[0], state.record
        solved = ["unsplit_row_solution", "unsplit_column_solution"]
        image = "unsplit_row_solution"
        search = [
            record(preconditioned_product, rows, ["unsplit_residual", *solved, "row_span"], ["unsplit_row_sum"]),
            record(improve_direction, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
            record(update_direction, rows, [*solved, "row_span", "unsplit_solver"], ["unsplit_direction"]),
            record(apply_system, rows, ["unsplit_direction", *system], [image, "unsplit_row_sum"]),
        ]
        advance = [
            record(choose_step_length, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
            record(
                update_solution,
                rows,
                ["unsplit_direction", image, "row_span", "unsplit_solver"],
                ["water", "unsplit_residual", "unsplit_row_sum"],
            ),
            record(measure_residual, 1, ["unsplit_row_sum"], ["unsplit_solver"]),
        ]
        return search, advance

    def _record_exchange(self, state: State) -> Command:
        state.upload("source_span", line_spans(self._supply.is_source))
        inputs = ["unsplit_direction", "source_exchange", "source_span"]
        outputs = ["unsplit_row_solution", "unsplit_row_sum"]
        return state.record(apply_exchange, self.leaf.mask.shape[0], inputs, outputs)

    def _record_shift(self, state: State, diagonals: list[str]) -> list[Command]:
        rows, record = self.leaf.mask.shape[0], state.record
        return [
            record(sum_coupled_water, rows, ["water", *diagonals, "row_span"], ["unsplit_row_sum"]),
            record(choose_shift, 1, ["unsplit_row_sum"], ["unsplit_shift"]),
            record(shift_water, rows, [*diagonals, "row_span", "unsplit_shift"], ["water"]),
        ]

    def launches_of(self, interval: Interval | None = None) -> None:
        return None

    def run(self, interval: Interval | None = None) -> None:
        """Do one step.

        Raises:
            NotConverged: The residual is not below the tolerance after :data:`MAXIMUM_ITERATIONS`.
        """
        step = self._alone
        if self._supply is not None:
            if self._supply.opening.update(interval):
                self._factorise()
            if self._supply.opening.seconds > 0.0:
                step = self._fed
        for command in step.start:
            command.run()
        for _ in range(0, MAXIMUM_ITERATIONS, self._iterations_per_look):
            if not self._above_tolerance():
                break
            for command in step.iteration * self._iterations_per_look:
                command.run()
        self._check()
        for command in step.finish:
            command.run()

    def _factorise(self) -> None:
        """Make the preconditioner anew, after the source's exchange has changed."""
        self._diagonals.run()
        for solve in self._solves:
            solve.eliminate()

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
                "fluid.tolerance, solver.precision = 'float64', fluid.solver = 'factor' or fluid.scheme = 'split' "
                "would help"
            )
