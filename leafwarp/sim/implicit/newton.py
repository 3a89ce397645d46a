"""Newton's method for the potential of a thin, stiff sheet.

Three things make it work where a membrane is a million times stiffer than bending:

- The tensions are unknowns of their own, eliminated from the linear system (:mod:`leafwarp_kernels.edge_hessian`).
- A step is corrected to second order: a straight step stretches all that it turns, which the line search would allow
  only for tiny angles. What the edges are then longer than they should be is taken back, with the same Hessian.
- The system is solved by conjugate gradients, preconditioned by a factor of the Hessian, which is made anew only when
  the mesh has moved too far from it, or it serves badly. With the factor of the very Hessian one solve is exact.

The line search makes sure that the potential falls. Where the Hessian is not positive definite, one takes its place
that has the positive part of each spring's alone. Whether to factorise anew is decided from counts and distances,
never from time, so that two runs are the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.factor import Factor
from leafwarp.sim.implicit.potential import Evaluation, Potential
from leafwarp.stopwatch import Stopwatch

MOST_ITERATIONS = 120
# Steps and distances as shares of the leaf's length.
LONGEST_STEP = 0.5
# Beyond this a step is corrected to second order, so many times.
CURVED_STEP = 1e-3
CORRECTIONS = 3
CORRECTED = 1e-4
# Steps by the positive part alone crawl past a saddle when they are shorter than this, or so many.
CRAWL = 1e-3
MOST_CRAWLED = 3
# The factor is made anew once a vertex has gone this far since, or when a solve took so many iterations.
FACTOR_REACH = 0.002
MOST_LINEAR_ITERATIONS = 10
# A step by an old factor of which the line search leaves less than this is taken anew with a new one.
LEAST_SHARE = 0.1
# Reduction of the residual in a solve.
FORCING = 0.02
CORRECTION_FORCING = 0.05
# Armijo's share of the first-order decrease, and the shortest share of a step.
SUFFICIENT = 1e-4
SHORTEST = 1e-5
# Least and most that a step is shortened by at a time.
SHORTEN = (0.2, 0.5)
# Relative rounding of a sum of energies, of a position, and of a force over its stiffness.
ENERGY_ROUNDING = 1e-14
POSITION_ROUNDING = 2e-16
STRETCH_ROUNDING = 1e-15


@dataclass(frozen=True)
class Accuracy:
    """When a minimum counts as found: both must hold, after a full step.

    Attributes:
        force: Largest force left on a vertex, over the mean of load and inertia on a vertex and a hundredth of its
            bending force. (The tensions of a stiff membrane would hide whole weights of vertices.)
        step: Way of a vertex in the last step, over the leaf's length.
    """

    force: float
    step: float


@dataclass
class Effort:
    """What was done so far.

    Attributes:
        iterations: Newton steps.
        linear_iterations: Iterations of conjugate gradients and solves with the factor alone.
        factorisations: Factors made.
        seconds: Wall time by kind of work.
    """

    iterations: int = 0
    linear_iterations: int = 0
    factorisations: int = 0
    watch: Stopwatch = field(default_factory=Stopwatch)


class _BendsAway(Exception):
    """A direction along which the potential does not bend upward, and the Hessian times it."""

    def __init__(self, along: np.ndarray, product: np.ndarray):
        super().__init__()
        self.along, self.product = along.copy(), product


@dataclass(frozen=True)
class Memory:
    """What Newton's method takes along from one minimum to the next.

    Attributes:
        tensions: Of the edges, as the Hessian has them [N], shape [edge_count].
        factor: The factor at hand.
        moved: How far vertices have gone since it was made [m]; infinite where it is not to be used.
        crawled: Steps by the positive part alone, in a row.
    """

    tensions: np.ndarray
    factor: Any
    moved: float
    crawled: int


class Newton:
    """Minimises a potential.

    Args:
        potential: The potential, bound.
        pinned: Vertices that are held, shape [vertex_count], bool.
        length: Size of the mesh [m].

    Attributes:
        effort: What was done so far.
    """

    def __init__(self, potential: Potential, pinned: np.ndarray, length: float):
        self._potential = potential
        self._length = length
        self._factor = Factor(potential.pattern, np.flatnonzero(~pinned), potential.vertex_count)
        # How far vertices have gone since the factor was made; infinite where there is none to be used.
        self._moved = np.inf
        self._is_new = False
        self._crawled = 0
        self.effort = Effort()

    @property
    def byte_count(self) -> int:
        """Memory of a factor [byte]."""
        return self._factor.byte_count

    def forget(self) -> None:
        """Make the factor anew at the next step."""
        self._moved = np.inf

    def memory(self) -> Memory:
        """What is taken along to the next minimum."""
        return Memory(self._potential.tensions(), self._factor.values, self._moved, self._crawled)

    def recall(self, memory: Memory) -> None:
        """Go on as if nothing had been done since."""
        self._potential.put_tensions(memory.tensions)
        self._factor.values, self._moved, self._crawled = memory.factor, memory.moved, memory.crawled

    def carried(self, way: float) -> None:
        """Tell how far vertices were moved at most, all as a whole, since the last step [m]."""
        self._moved += way

    def inertia_changed(self) -> None:
        """Tell that the inertia was set anew: the factor at hand may still serve, but no longer exactly."""
        self._is_new = False

    def minimise(self, start: np.ndarray, accuracy: Accuracy) -> Evaluation:
        """The potential at a minimum, downhill from positions [m], shape [vertex_count, 3].

        Raises:
            NotConverged: None was found.
        """
        here = self.start(start)
        for _ in range(MOST_ITERATIONS):
            way, share, here = self.step(here)
            if share == 1.0 and way <= accuracy.step * self._length and self.is_balanced(here, accuracy):
                return here
        raise NotConverged(
            f"after {MOST_ITERATIONS} Newton steps a force of {here.residual:.3g} N is left on a vertex, where "
            f"{here.mean_action:.3g} N act on one, and the last step went {way:.3g} m"
        )

    def start(self, positions: np.ndarray) -> Evaluation:
        """The potential where the first step begins."""
        here = self._evaluate(positions)
        self._potential.accept()
        self._is_new = False
        return here

    def is_balanced(self, here: Evaluation, accuracy: Accuracy) -> bool:
        """Whether the forces left are small enough, the rounding of positions allowed for."""
        return here.residual <= accuracy.force * here.mean_action + self._rounding()

    def is_at_rest(self, here: Evaluation) -> bool:
        """Whether nothing but the rounding of positions pulls."""
        return here.residual <= self._rounding()

    def _rounding(self) -> float:
        return STRETCH_ROUNDING * self._length * self._potential.largest_stiffness()

    def step(self, here: Evaluation) -> tuple[float, float, Evaluation]:
        """One step from where the potential was last accepted.

        Returns:
            The longest way of a vertex [m], the share of the step that was taken, and the potential after it.

        Raises:
            NotConverged: Nothing that is finite and lower was found.
        """
        if not (np.isfinite(here.energy) and np.isfinite(here.gradient).all()):
            raise NotConverged("a position or a force is not a finite number")
        self.effort.iterations += 1
        found = None
        if self._moved <= FACTOR_REACH * self._length:
            step = self._solve(here.gradient, FORCING)
            found = None if step is None else self._search(here, step)
        if found is None or found[2] < LEAST_SHARE:
            fresh = self._search(here, self._fresh_step(here.gradient))
            if fresh is None and found is not None:
                self._evaluate(found[0].positions)  # what is accepted is what was evaluated last
            found = fresh or found
        if found is None or (found[2] < 1.0 and np.array_equal(found[0].positions, here.positions)):
            raise NotConverged(f"no step lowers the potential; a force of {here.residual:.3g} N is left on a vertex")
        if self._crawled > 0 and self._is_new:
            found = self._lengthened(here, found)
        after, step, share = found
        self._potential.expect_tensions(step)
        self._potential.accept()
        self._is_new = False
        way = _longest(after.positions - here.positions)
        self._moved += way
        return way, share, after

    def _fresh_step(self, gradient: np.ndarray) -> np.ndarray:
        """The step by a new factor.

        Where the Hessian is not positive definite, that of its positive part crawls past a saddle. There a step along
        what bends away is taken.
        """
        is_whole = self._factorise()
        step = self._factor.solve(-gradient)
        self._crawled = 0 if is_whole else self._crawled + 1
        if is_whole or (_longest(step) > CRAWL * self._length and self._crawled <= MOST_CRAWLED):
            return step
        with self.effort.watch("solve"):
            along = self._conjugate_gradients(gradient, FORCING, leaves_saddle=True)
        return step if along is None else along

    def _search(self, here: Evaluation, step: np.ndarray) -> tuple[Evaluation, np.ndarray, float] | None:
        """A share of a step, corrected to second order, that lowers the potential enough.

        Returns:
            The potential there, the share of the step, to first order, and how large it is; None if there is none.
        """
        slope, longest = float(np.vdot(here.gradient, step)), _longest(step)
        if not slope <= 0.0:
            return None
        share = min(1.0, LONGEST_STEP * self._length / longest) if longest > 0.0 else 1.0
        # Of the sum, and of positions against all forces.
        work = POSITION_ROUNDING * self._length * here.mean_force * len(step)
        rounding = ENERGY_ROUNDING * here.energy_size + work
        while share >= SHORTEST:
            part = share * step
            after = self._evaluate(here.positions + self._curved(here.positions, part, share * longest))
            rise = after.energy - here.energy
            if rise <= SUFFICIENT * share * slope + rounding:
                return after, part, share
            # The lowest point of the parabola through what is known; not a number where the energy is not.
            lowest = -0.5 * slope * share * share / (rise - slope * share)
            share = min(max(lowest, SHORTEN[0] * share), SHORTEN[1] * share) if np.isfinite(lowest) else 0.1 * share
        return None

    def _lengthened(
        self, here: Evaluation, found: tuple[Evaluation, np.ndarray, float]
    ) -> tuple[Evaluation, np.ndarray, float]:
        """A full step by the positive part, doubled as long as that leads lower: past a saddle it is far too short."""
        after, step, share = found
        while share == 1.0:
            longer = 2.0 * step
            longest = _longest(longer)
            if longest > LONGEST_STEP * self._length:
                break
            beyond = self._evaluate(here.positions + self._curved(here.positions, longer, longest))
            if not beyond.energy < after.energy - ENERGY_ROUNDING * here.energy_size:
                break
            after, step = beyond, longer
        # The potential holds what was evaluated last.
        return self._evaluate(after.positions), step, share

    def _curved(self, start: np.ndarray, step: np.ndarray, longest: float) -> np.ndarray:
        """A step with its second-order correction."""
        corrected = step
        if longest > CURVED_STEP * self._length:
            for _ in range(CORRECTIONS):
                with self.effort.watch("evaluate"):
                    excess = self._potential.excess(step, start + corrected)
                correction = self._solve(excess, CORRECTION_FORCING)
                if correction is None:
                    break
                corrected = corrected + correction
                if _longest(correction) <= CORRECTED * self._length:
                    break
        return corrected

    def _solve(self, gradient: np.ndarray, reduction: float) -> np.ndarray | None:
        """The step that takes a gradient away; None where the factor at hand does not lead to it.

        Args:
            gradient: [N], shape [vertex_count, 3].
            reduction: Of the residual.
        """
        with self.effort.watch("solve"):
            if self._is_new:
                self.effort.linear_iterations += 1
                return self._factor.solve(-gradient)
            return self._conjugate_gradients(gradient, reduction)

    def _conjugate_gradients(
        self, gradient: np.ndarray, reduction: float, *, leaves_saddle: bool = False
    ) -> np.ndarray | None:
        """The step by conjugate gradients, preconditioned by the factor at hand.

        Args:
            gradient: [N], shape [vertex_count, 3].
            reduction: Of the residual.
            leaves_saddle: Whether to go along the first direction in which the potential bends away.

        Returns:
            None where the iterations do not suffice or, unless the saddle is to be left, the potential bends away.
        """
        shape, size = gradient.shape, gradient.size
        reached = np.zeros(size)

        def multiply(along: np.ndarray) -> np.ndarray:
            self.effort.linear_iterations += 1
            product = self._potential.product(along.reshape(shape)).reshape(-1)
            if not along @ product > 0.0:
                raise _BendsAway(along, product)
            return product

        def keep(step: np.ndarray) -> None:
            reached[:] = step

        hessian = LinearOperator((size, size), multiply, dtype=np.float64)
        inverse = LinearOperator((size, size), lambda right: self._factor.solve(right.reshape(shape)), dtype=np.float64)
        try:
            step, unfinished = cg(
                hessian, -gradient.reshape(-1), rtol=reduction, maxiter=MOST_LINEAR_ITERATIONS, M=inverse, callback=keep
            )
        except _BendsAway as found:
            curvature = float(found.along @ found.product)
            if not leaves_saddle or not curvature < 0.0:
                return None
            # As far as a bowl of the same curvature would let it go.
            left = gradient + self._potential.product(reached.reshape(shape))
            step = reached + (float(left.reshape(-1) @ found.along) / curvature) * found.along
            return step.reshape(shape)
        return None if unfinished else step.reshape(shape)

    def _factorise(self) -> bool:
        """Make the factor of the Hessian, or of its positive part.

        Returns:
            Whether it is that of the whole Hessian.

        Raises:
            NotConverged: Not even that has one.
        """
        with self.effort.watch("factor"):
            for convex in (False, True):
                self.effort.factorisations += 1
                if self._factor.factorise(self._potential.blocks(convex)):
                    self._is_new, self._moved = True, 0.0
                    return not convex
        self._moved = np.inf
        raise NotConverged("the stiffness matrix has no factor in float64: something is neither held nor heavy")

    def _evaluate(self, positions: np.ndarray) -> Evaluation:
        with self.effort.watch("evaluate"):
            return self._potential.evaluate(positions)


def _longest(way: np.ndarray) -> float:
    """Longest of some vectors, shape [count, 3]."""
    return float(np.sqrt(np.square(way).sum(axis=1).max(initial=0.0)))
