"""Diffusion along rows and columns at once: the accurate scheme, without the splitting error.

Where ``fluid.solver`` is left open, a step that the conjugate gradients do not solve, and all after it, are solved by
the sparse factor of :mod:`leafwarp.sim.fluid.exchange`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.sim.fluid.conductance import leaf_conductance
from leafwarp.sim.fluid.lines import diffusion_supply
from leafwarp.sim.fluid.multigrid import Multigrid, System, with_neighbours
from leafwarp.sim.fluid.spans import thread_blocks
from leafwarp.sim.fluid.steps import FluidSteps, NotConverged
from leafwarp.sim.launch import ArraySpec, Command, State
from leafwarp.sim.stage import Interval, Stage
from leafwarp_kernels.conjugate_gradients import (
    BOUND_CONTRACTION,
    BOUND_COUNT,
    BOUND_ENERGY,
    ERROR_SQUARED,
    HISTORY_COUNT,
    ITERATIONS,
    LIMIT_SQUARED,
    RESIDUAL_SQUARED,
    SLOT_COUNT,
    SUM_COUNT,
    WORTH_COUNT,
    WORTH_ROWS,
    advance_solution,
    choose_step_length,
    improve_direction,
    measure_residual,
    start_iteration,
    update_direction,
)
from leafwarp_kernels.unsplit import apply_system, choose_shift, finish_step, guess_change, start_residual, sum_change

if TYPE_CHECKING:
    from leafwarp.sim.fluid.exchange import ExchangeSystem

MAXIMUM_ITERATIONS = 5000
# The same where a factor may take over, which costs as much as some hundreds of them; and the most cells that it is
# made of, beyond which it takes minutes and gigabytes.
ITERATIONS_BEFORE_FACTOR = 300
MOST_CELLS_OF_FACTOR = 1 << 20
# Solves of a step, each for what the one before it has left, where one would lose too much to rounding.
MAXIMUM_PASSES = 6
# Share of a residual that rounding may leave, in units of the last place.
ROUNDING = 10.0
# What iterations have shown of the preconditioned system's least and largest eigenvalue is taken times these.
LEAST_SAFETY, LARGEST_SAFETY = 0.9, 1.05
# They are shown by a solve of noise, which excites all modes: until so little of it is left, or so many iterations.
LEAST_NOISE = 1e-6
LONGEST_HISTORY = 32
# They hold for shorter steps too, whose systems have less to precondition. With longer ones, or another source, the
# least may fall, with veins that change from cell to cell nearly as the step grows: they are shown anew, after a step
# that those known before still serve.
LONGER_STEP = 1.05
# Iterations of a step from which on they may tell more.
TELLING_ITERATIONS = 3
# Iterations between two looks at the error from the host, which stall a GPU.
ITERATIONS_PER_LOOK = 4


REMEDY = (
    "a shorter fluid.step, a larger fluid.tolerance, solver.precision = 'float64', fluid.solver = 'factor' or "
    "fluid.scheme = 'split' would help"
)


class _Step(NamedTuple):
    """The launches of a step: before its iterations, in the two parts of each of them and at its end.

    ``total`` sums a change that is given, where nothing enters or leaves. ``guess`` is ``start`` from what the last
    steps tell. ``settle`` takes the mean off a residual that rounding has given one, before it is iterated on.
    """

    total: list[Command]
    guess: list[Command]
    start: list[Command]
    settle: list[Command]
    precondition: list[Command]
    advance: list[Command]
    finish: list[Command]


class UnsplitDiffusion(Stage):
    """One implicit step along rows and columns at once, by conjugate gradients, all on the device.

    The error of the contents is brought below ``fluid.tolerance`` times their norm (float64: its square), as the bounds
    of :mod:`leafwarp_kernels.conjugate_gradients` tell it, in most steps by what they told lately. Without a source the
    content of the whole leaf is exact; while one is open, what is missing in it counts as added by the source.

    Attributes:
        iterations: Conjugate gradient iterations so far.
        most_iterations: The most that a step has taken.
        system: The factorised system that has taken over; None as long as none has.
    """

    name = "unsplit_diffusion"
    purpose = "water flows along veins and lamina: rows and columns at once"
    rate = "fluid step"

    def __init__(self, scene: Scene, leaf: Leaf):
        super().__init__(scene, leaf)
        shape = leaf.mask.shape
        self.iterations = 0
        self.most_iterations = 0
        self.system: ExchangeSystem | None = None
        is_open = "solver" not in scene.fluid.model_fields_set
        self._may_factor = is_open and np.count_nonzero(leaf.mask) <= MOST_CELLS_OF_FACTOR
        self._supply = diffusion_supply(scene, leaf, directions="x")
        names = (f"unsplit_{name}" for name in ("residual", "swept", "preconditioned", "sum"))
        self._cycle = Multigrid(shape, *names, has_source=self._supply is not None)
        maps = {
            "before": "contents after the last step",
            "rounding": "what was cut off from them",
            "increment": "increment of the last step",
            "change": "change of the contents by the step",
            "residual": "residual of the step's system",
            "swept": "the same after the first sweep of the preconditioner; the system's image of the direction",
            "preconditioned": "preconditioned residual",
            "direction": "search direction",
        }
        self.arrays = (
            *(ArraySpec(f"unsplit_{name}", shape, "real", meaning, padded=True) for name, meaning in maps.items()),
            *self._cycle.arrays,
            ArraySpec("unsplit_solver", (SLOT_COUNT,), "float64", "numbers of the conjugate gradients"),
            ArraySpec("unsplit_history", (HISTORY_COUNT, LONGEST_HISTORY), "float64", "the same of each iteration"),
            ArraySpec("unsplit_bounds", (BOUND_COUNT,), "float64", "what bounds the error by the energy; 0: not known"),
            ArraySpec("unsplit_worth", (WORTH_ROWS, WORTH_COUNT), "float64", "energy of each square of the residual"),
            ArraySpec("unsplit_shift", (2,), "float64", "error of the mean content, and its change by the iterations"),
        )
        if self._supply is not None:
            self.purpose += ", fed at the petiole base"
            self.host_reads = ("source_exchange",)
            self.arrays += self._supply.arrays

    @property
    def host_bytes(self) -> int:
        return self.system.byte_count if self.system is not None else 0

    def bind(self, state: State) -> None:
        self._state = state
        mask = self.leaf.mask
        self._time_step = FluidSteps.of(self.scene).length
        self._conductance = leaf_conductance(self.scene, self.leaf, self._time_step)
        system = self._upload_faces()
        self._cycle.upload_mass(state)
        length, segments = thread_blocks(state.lanes("water").shape[1], state)
        self._dim = (segments, mask.shape[0])
        self._threads = ["level_0_span", length]
        spec = ArraySpec("unsplit_sum", (SUM_COUNT, *self._dim), "float64", "sums of each segment of the rows")
        self.add_array(state, spec)
        self._record_step(state, float(np.count_nonzero(system.exchange)))
        parts = (self._alone.guess, *self._alone[3:])
        self.commands = [command for part in parts for command in part]
        self._solver = state["unsplit_solver"]
        # Looked at many times a step: where the device's memory is the host's, without asking for it each time.
        seen = self._solver.numpy()
        self._seen = seen if np.shares_memory(seen, self._solver.numpy()) else None
        self._iterations_per_look = ITERATIONS_PER_LOOK if state.device.is_cuda else 1
        self._reach = 1.0 / (ROUNDING * np.finfo(state.precision).eps)
        self._graphs: dict[int, wp.Graph] = {}
        self._is_begun = False
        self._forget()

    def _upload_faces(self) -> System:
        """Fill what the cells exchange in a step."""
        beta_x, beta_y = (self._time_step * faces for faces in (self._conductance.x, self._conductance.y))
        system = System(self.leaf.mask.astype(np.float64), beta_x, beta_y)
        self._cycle.upload_faces(self._state, system)
        return system

    def set_time_step(self, seconds: float) -> None:
        self._time_step = seconds
        self._is_begun = False
        self._state["unsplit_worth"].zero_()
        if self.system is None:
            self._upload_faces()
            if seconds > LONGER_STEP * self._probed_step:
                self._probed_step = 0.0
        else:
            self.system = self.system.of_step(self.scene, self.leaf, seconds)
        if self._supply is not None:
            self._supply.opening.set_time_step(seconds)  # the next step makes the rest of the system
        elif self.system is None:
            self._cycle.upload_mass(self._state)

    def _record_step(self, state: State, coupled_count: float) -> None:
        dim, threads, record, lanes = self._dim, self._threads, state.record, state.lanes
        omega = self._cycle.first_weight
        system, inverse_diagonal = self._cycle.system(state), lanes("level_0_inverse_diagonal")
        names = "before rounding increment change residual swept preconditioned direction"
        before, rounding, increment, change, residual, swept, preconditioned, direction = (
            lanes(f"unsplit_{name}") for name in names.split()
        )
        water, sums, solver, shift = lanes("water"), "unsplit_sum", "unsplit_solver", "unsplit_shift"
        kept = [before, rounding, increment]
        guess = record(guess_change, dim, [water, *kept, inverse_diagonal, *threads], [change])
        residual_at_start = record(
            start_residual,
            dim,
            [
                *with_neighbours(state, "water"),
                *with_neighbours(state, "unsplit_change"),
                shift,
                *system,
                inverse_diagonal,
                *threads,
                omega,
            ],
            [residual, swept, sums],
        )
        precondition = [
            *self._cycle.record(state),
            record(improve_direction, 1, [sums, "unsplit_bounds"], [solver, "unsplit_worth"]),
        ]
        image_of_direction = [
            record(update_direction, dim, [preconditioned, inverse_diagonal, *threads, solver], [direction]),
            record(
                apply_system,
                dim,
                [*with_neighbours(state, "unsplit_direction"), *system, *threads],
                [swept, sums],
            ),
        ]
        advance = record(
            advance_solution,
            dim,
            [direction, swept, inverse_diagonal, *threads, omega, solver],
            [change, residual, swept, sums],
        )
        count, tolerance = max(coupled_count, 1.0), self.scene.residual_tolerance

        def step(closed: float, added: str | None) -> _Step:
            written = [water, *kept, residual, added]
            finish = record(finish_step, dim, [change, inverse_diagonal, shift, *threads, solver], written)
            total = [record(sum_change, dim, [change, *threads], [sums])] if closed else []
            start = [
                *total,
                record(choose_shift, 1, [sums, count, closed], [shift]),
                residual_at_start,
                record(start_iteration, 1, [sums, tolerance, count], [solver, "unsplit_worth"]),
            ]
            length = record(choose_step_length, 1, [sums, count], [solver, "unsplit_history"])
            measure = record(measure_residual, 1, [sums, "unsplit_bounds"], [solver, "unsplit_worth"])
            last = record(choose_shift, 1, [sums, count, closed], [shift])
            go_on = [*image_of_direction, length, advance, measure]
            return _Step(total, [guess, *start], start, [advance, measure], precondition, go_on, [last, finish])

        self._alone = step(1.0, None)
        if self._supply is not None:
            # What fills the source cells is counted at once, and by the last launch what flows on from there.
            self._fill = list(self._supply.record(self, state, "x"))
            spec = ArraySpec("added_by_source_y", dim, "float64", "content added to each segment of the rows by flow")
            self.add_array(state, spec)
            self._fed = step(0.0, spec.name)

    def launches_of(self, interval: Interval | None = None) -> None:
        return None

    def run(self, interval: Interval | None = None) -> None:
        """Do one step.

        Raises:
            NotConverged: The error is not known to be below the tolerance after :data:`MAXIMUM_ITERATIONS`, and no
                factor may take over.
        """
        step, is_new = self._alone, not self._is_begun
        if self._supply is not None:
            if self._supply.opening.update(interval):
                self._change_source()
                is_new = True
            if self._supply.opening.seconds > 0.0:
                step = self._fed
        if not self._is_begun:
            wp.copy(self._state.whole("unsplit_before"), self._state.whole("water"))
            self._is_begun = True
        if step is not self._alone:
            self._replay(self._fill)
        if self.system is None:
            try:
                self._solve(step, is_new)
            except NotConverged:
                if not self._may_factor:
                    raise
                self._take_factor()
        if self.system is not None:
            self._solve_by_factor(step)
        self._replay(step.finish)

    def _solve(self, step: _Step, is_new: bool) -> None:
        if not is_new:
            self._replay(step.guess)
        if is_new or self._error_over_limit() > self._reach:
            # What the last steps did says nothing about this one.
            self._zero("change", "rounding", "residual")
            self._replay(step.start)
        if self._error_over_limit() > self._reach:
            self._iterate_repeatedly(step)
            return
        # The first step of all, often the one that moves the most, ends by the residual.
        if self._error_over_limit() > 1.0 and not is_new and not self._probed_step:
            self._probe(step)
        self._iterate(step)
        if self._probed_step:
            self._learn()

    def _zero(self, *names: str) -> None:
        for name in names:
            self._state.whole(f"unsplit_{name}").zero_()

    def _probe(self, step: _Step) -> None:
        """Learn the extreme eigenvalues from a solve of noise, and come back to the start of the step."""
        kept = {name: self._state[name].numpy().copy() for name in ("unsplit_change", "unsplit_residual")}
        numbers = self._numbers().copy()
        is_coupled = self._state["level_0_inverse_diagonal"].numpy() > 0.0
        noise = np.where(is_coupled, np.random.default_rng(0).standard_normal(is_coupled.shape), 0.0)
        squared = float(np.sum(noise**2))
        limits = {ERROR_SQUARED: squared, RESIDUAL_SQUARED: squared, LIMIT_SQUARED: LEAST_NOISE**2 * squared}
        self._state.upload("unsplit_residual", noise)
        self._state.upload("unsplit_solver", np.array([limits.get(slot, 0.0) for slot in range(SLOT_COUNT)]))
        _run(step.settle)
        for _ in range(LONGEST_HISTORY):
            self._replay(step.precondition)
            self._replay(step.advance)
            if not self._error_over_limit() > 1.0:
                break
        self._learn()
        self._probed_step = self._time_step
        for name, values in kept.items():
            self._state.upload(name, values)
        self._state.upload("unsplit_solver", numbers)
        self._state["unsplit_worth"].zero_()  # noise is worth more than what a step leaves
        _run(step.settle)

    def _take_factor(self) -> None:
        """Solve this step and all after it by the factor."""
        from leafwarp.sim.fluid.exchange import ExchangeSystem

        self.system = ExchangeSystem.of(self.scene, self.leaf, self._time_step)
        self._factorise()
        # Where they have run over, they have left no numbers beside the map either, nor sums.
        self._zero("change", "rounding", "residual", "sum")

    def _factorise(self) -> None:
        excess = self._supply and self.system.on_cells(self._state["source_exchange"].numpy())
        self.system.factorise(excess)

    def _solve_by_factor(self, step: _Step) -> None:
        content = self.system.on_cells(self._state["water"].numpy()).astype(np.float64)
        change = np.zeros(self.leaf.mask.shape)
        change.reshape(-1)[self.system.cells] = self.system.step(content, self.scene.residual_tolerance) - content
        self._state.upload("unsplit_change", change)
        _run(step.total)

    def _iterate_repeatedly(self, step: _Step) -> None:
        """Solve again for what is left, until that changes the contents by no more than the tolerance.

        Rounding in the first iterations, when the residual is that large, may be far more than what is accepted, and
        the residual as the iteration knows it does not tell, nor does the energy that follows from it.
        """
        self._state["unsplit_bounds"].zero_()
        rounding = ROUNDING * float(np.finfo(self._state.precision).eps)
        limit = math.sqrt(float(self._numbers()[LIMIT_SQUARED]))
        limit *= max(1.0, rounding / self.scene.residual_tolerance)
        found = self._state["unsplit_change"].numpy().copy()
        for _ in range(MAXIMUM_PASSES):
            _run(step.settle)
            self._iterate(step)
            before, found = found, self._state["unsplit_change"].numpy().copy()
            # Not by a norm of BLAS, whose threads would wait for each other longer than this takes.
            off = math.sqrt(float(np.square(found.astype(np.float64) - before).sum()))
            if off <= limit:
                self._upload_bounds()
                return
            self._zero("residual")
            self._replay(step.start)
        raise NotConverged(
            f"after {MAXIMUM_PASSES} solves rounding still changes the contents by {off / limit:.3g} "
            f"times what fluid.tolerance = {self.scene.fluid.tolerance:g} accepts; {REMEDY}"
        )

    def _iterate(self, step: _Step) -> None:
        most = ITERATIONS_BEFORE_FACTOR if self._may_factor else MAXIMUM_ITERATIONS
        for _ in range(0, most, self._iterations_per_look):
            if not self._error_over_limit() > 1.0:
                break
            for number in range(self._iterations_per_look):
                self._replay(step.precondition)
                if number == 0 and not self._error_over_limit() > 1.0:
                    break
                self._replay(step.advance)
        self._check()

    def _replay(self, commands: list[Command]) -> None:
        """Run a part of a step as a graph, captured when it is first asked for."""
        if id(commands) not in self._graphs:
            counted = self._state.launch_count
            with wp.ScopedCapture(device=self._state.device, force_module_load=False) as capture:
                _run(commands)
            self._state.launch_count = counted
            self._graphs[id(commands)] = capture.graph
        wp.capture_launch(self._graphs[id(commands)])
        self._state.launch_count += len(commands)

    def _change_source(self) -> None:
        """Make the system anew, after the source's exchange has changed."""
        if self.system is not None:
            self._factorise()
            return
        self._probed_step = 0.0
        self._state["unsplit_worth"].zero_()
        exchange = self._state["source_exchange"].numpy().astype(np.float64)
        self._cycle.upload_mass(self._state, exchange)

    def _numbers(self) -> np.ndarray:
        """Numbers of the conjugate gradients, shape [SLOT_COUNT]."""
        return self._solver.numpy() if self._seen is None else self._seen

    def _error_over_limit(self) -> float:
        numbers = self._numbers()
        squared, limit = float(numbers[ERROR_SQUARED]), float(numbers[LIMIT_SQUARED])
        return math.sqrt(squared / limit) if limit > 0.0 else 0.0 if squared == 0.0 else math.inf

    def _check(self) -> None:
        count = int(self._numbers()[ITERATIONS])
        self.iterations += count
        self.most_iterations = max(self.most_iterations, count)
        short = self._error_over_limit()
        if not short <= 1.0:
            raise NotConverged(
                f"after {count} iterations the unsplit scheme's error may still be {short:.3g} times what "
                f"fluid.tolerance = {self.scene.fluid.tolerance:g} accepts; {REMEDY}"
            )

    def _forget(self) -> None:
        """Bound the error by the residual alone, until the system is probed."""
        self._probed_step = 0.0
        self._least_eigenvalue, self._largest_eigenvalue = math.inf, 0.0
        self._upload_bounds()

    def _learn(self) -> None:
        """Bound the error by the energy, too, from what the iterations have shown of the preconditioned system."""
        count = int(self._numbers()[ITERATIONS])
        if count < TELLING_ITERATIONS:
            return
        least, largest = extreme_eigenvalues(*self._state["unsplit_history"].numpy()[:, : min(count, LONGEST_HISTORY)])
        if least < self._least_eigenvalue or largest > self._largest_eigenvalue:
            self._least_eigenvalue = min(least, self._least_eigenvalue)
            self._largest_eigenvalue = max(largest, self._largest_eigenvalue)
            self._upload_bounds()

    def _upload_bounds(self) -> None:
        least, largest = LEAST_SAFETY * self._least_eigenvalue, LARGEST_SAFETY * self._largest_eigenvalue
        bounds = np.zeros(BOUND_COUNT)
        if 0.0 < least < math.inf and largest < math.inf:
            bounds[BOUND_ENERGY] = 1.0 / least
            bounds[BOUND_CONTRACTION] = ((largest - least) / (largest + least)) ** 2
        self._state.upload("unsplit_bounds", bounds)


def extreme_eigenvalues(step_length: np.ndarray, improvement: np.ndarray) -> tuple[float, float]:
    """The extreme eigenvalues of Lanczos' tridiagonal matrix, which lie between those of the preconditioned system.

    Args:
        step_length: Of each iteration of conjugate gradients, shape [count].
        improvement: Share of the direction before in that of each iteration, shape [count].

    Returns:
        The least and the largest; 0 and infinity where an iteration has gone astray.
    """
    if not ((step_length > 0.0).all() and (improvement >= 0.0).all()):
        return 0.0, math.inf
    diagonal = 1.0 / step_length
    diagonal[1:] += improvement[1:] / step_length[:-1]
    beside = np.sqrt(improvement[1:]) / step_length[:-1]
    values = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    return float(values[0]), float(values[-1])


def _run(commands: list[Command]) -> None:
    for command in commands:
        command.run()
