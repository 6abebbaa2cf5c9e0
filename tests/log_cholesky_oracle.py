r"""An oracle of the consistent estimate: log-Cholesky coordinates, Gauss-Newton [Rucker2022].

A pseudo-inertia in the scale of its prior is $X = U U^T$ with a lower triangular $U$ whose diagonal
is $e^{a_i}$: every choice of the ten coordinates is a body, and zero is the prior. The criterion is
the convex estimate's, with its margin: no cones. The data are far sharper than the prior, so that
steps straight in the coordinates creep along narrow curved valleys [Transtrum2012]; each therefore
ends where the bodies themselves would be after a straight step. Along the curves on which bodies go
straight the data are linear and the priors convex, so that the curvature is exact, and a step that
is short enough always gains. A barrier that fades keeps coordinates finite where the margin holds.

A step minimises $\|J d + r\|^2$ within the bounds by an active set [Stark1995], and is shortened
until the criterion falls by a fair part of what was promised.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    BASIS,
    COLUMNS,
    ENTRIES,
    FAINT,
    ONE,
    ORDER,
    ROWS,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.convex_program_and_newton_refinement import Program

BARRIERS = (1.0, 1e-2, 1e-4, 1e-6, 1e-8)
"""Weights of the barrier, one after the other; four of the last per body is what it may cost."""

CENTRED = 0.1  # promise of a step over the barrier's weight at which the next barrier begins


@dataclass(frozen=True, eq=False)
class LogCholesky(Consistent):
    """The consistent estimate in coordinates that need no cones, in at most so many steps.

    Of constraints it keeps bounds of friction and its like alone.
    """

    steps: int = 500

    def _polished(self, program: Program, near: Array, gamma: float) -> Array | None:
        """Nothing: the search in these coordinates begins at the prior."""

    def _optimum(self, program: Program, gamma: float) -> Array:
        criterion = Criterion.of(program, gamma)
        x, left = criterion.start, self.steps
        for size in BARRIERS:
            barrier = size * max(1.0, criterion.plain(x)) if size < 1.0 else 1.0
            near = replace(criterion, barrier=barrier)
            found = bounded_gauss_newton(
                near, x, criterion.lower, criterion.upper, left, CENTRED * barrier
            )
            assert found.converged, f"a further step predicts a decrease of {found.promise:.2g}"
            x, left = found.x, left - found.steps
        return criterion.unknowns_at(x)[0]


@dataclass(frozen=True, eq=False)
class Criterion:
    r"""The criterion over log-Cholesky coordinates, then other parameters.

    $\tfrac12\|A u - z\|^2 + \sum_i P_i(X_i) - \beta \log\det S_i$ with $X_i = \delta 1 + S_i$.
    """

    program: Program
    gamma: float  # weight of the prior
    barrier: float  # $\beta$, which keeps coordinates from running off where the margin holds
    free: NDArray[np.intp]  # indices of the other unknowns that are not given
    given: Array  # all unknowns with those that are given, the others zero
    lower: Array  # of the coordinates and of the free others; likewise `upper`
    upper: Array

    @classmethod
    def of(cls, program: Program, gamma: float) -> "Criterion":
        """The criterion with a weight of the prior, and no barrier."""
        known = program.unknowns
        bodies, (low, high) = 10 * len(known.priors), _bounds_of_terms(program)
        free, fixed = np.flatnonzero(low < high), np.flatnonzero(low >= high)
        given = np.zeros(len(known.weak))
        given[:bodies] = np.tile(program.form.margin * ONE, len(known.priors))
        given[bodies + fixed] = low[fixed]
        lower = np.concatenate([np.full(bodies, -np.inf), low[free]])
        upper = np.concatenate([np.full(bodies, np.inf), high[free]])
        return cls(program, gamma, 0.0, bodies + free, given, lower, upper)

    @property
    def start(self) -> Array:
        """The priors, and whatever bounds leave nearest to nothing."""
        return np.clip(np.zeros(len(self.lower)), self.lower, self.upper)

    @property
    def bodies(self) -> list[slice]:
        """Coordinates of every body, which are also the places of its unknowns."""
        return [slice(10 * k, 10 * k + 10) for k in range(len(self.program.unknowns.priors))]

    def unknowns_at(self, x: Array) -> tuple[Array, Array]:
        """The unknowns `(m,)`, and their derivatives by the coordinates `(m, len(x))`."""
        u, slopes = self.given.copy(), np.zeros((len(self.given), len(x)))
        for part in self.bodies:
            numbers, slopes[part, part] = entries(x[part])
            u[part] += numbers
        count = 10 * len(self.bodies)
        u[self.free] = x[count:]
        slopes[self.free, np.arange(count, len(x))] = 1.0
        return u, slopes

    def plain(self, x: Array) -> float:
        """The criterion without the barrier."""
        return self.program.cost(self.unknowns_at(x)[0], self.gamma)

    def cost(self, x: Array) -> float:
        """The criterion."""
        with np.errstate(over="ignore", invalid="ignore"):
            volume = sum(2.0 * float(x[part] @ ONE) for part in self.bodies)
            total = self.plain(x) - self.barrier * volume
        return total if np.isfinite(total) else np.inf

    def near(self, x: Array) -> tuple[Array, Array]:
        """Residuals with the slope and the curvature of the criterion along `moved`."""
        known = self.program.unknowns
        u, slopes = self.unknowns_at(x)
        weak = np.sqrt(known.weak)
        residuals = [known.matrix @ u - known.vector, weak * u]
        rows = [known.matrix @ slopes, weak[:, None] * slopes]
        for part, prior in zip(self.bodies, known.priors, strict=True):
            turned = _matrices(slopes[part, part].T)
            for weight, factor, value in self._parts(u[part], x[part], prior):
                inverse = np.linalg.inv(factor)
                each = np.sqrt(weight) * _numbers(inverse @ turned @ inverse.T).T
                block = np.zeros((len(each), len(x)))
                block[:, part] = each
                residuals.append(np.sqrt(weight) * _numbers(value))
                rows.append(block)
        return np.concatenate(residuals), np.vstack(rows)

    def _parts(self, numbers: Array, place: Array, prior: bool) -> list[tuple[float, Array, Array]]:
        r"""Penalties of a body to second order, $\tfrac w2\|F^{-1}\,dX\,F^{-T} + V\|^2$."""
        body, one = _matrices(numbers), np.eye(ORDER)
        parts = [(self.barrier, _triangle(place), -one)]
        if prior:
            outer = np.asarray(np.linalg.cholesky(body), dtype=np.float64)
            return [*parts, (self.gamma, outer, outer.T @ outer - one)]
        return [*parts, (FAINT, one, body)]

    def moved(self, x: Array, step: Array, part: float) -> Array | None:
        """Where the unknowns, and so the data, go straight; `None` if a body stops to exist."""
        there = x + part * step
        for place in self.bodies:
            numbers, slopes = entries(x[place])
            try:
                factor = np.linalg.cholesky(_matrices(numbers + part * slopes @ step[place]))
            except np.linalg.LinAlgError:
                return None
            there[place] = np.where(_ON, np.log(np.diag(factor))[COLUMNS], factor[COLUMNS, ROWS])
        return there


def _bounds_of_terms(program: Program) -> Array:
    """Bounds `(2, terms)` of the unknowns that are no body's, by constraints on one alone."""
    constraints, first = program.constraints, 10 * len(program.unknowns.priors)
    ends = np.tile([[-np.inf], [np.inf]], len(program.unknowns.terms))
    for row, low, high in zip(
        constraints.matrix, constraints.lower, constraints.upper, strict=True
    ):
        seen = np.flatnonzero(row)
        if len(seen) == 1 and seen[0] >= first:
            k, size = seen[0] - first, row[seen[0]]
            edges = sorted((low / size, high / size))
            ends[:, k] = max(ends[0, k], edges[0]), min(ends[1, k], edges[1])
    return ends


_ON = ROWS == COLUMNS  # entries on the diagonal; those of `U` are the entries of `X`, transposed


def entries(coordinates: Array) -> tuple[Array, Array]:
    """Entries `(10,)` of `X` at coordinates `(10,)`, and their derivatives `(10, 10)`."""
    triangle = _triangle(coordinates)
    slopes = np.empty((len(ENTRIES), len(ENTRIES)))
    for k, (column, row) in enumerate(ENTRIES):
        change = np.zeros((ORDER, ORDER))
        change[row] = (triangle[row, row] if row == column else 1.0) * triangle[:, column]
        slopes[:, k] = (change + change.T)[ROWS, COLUMNS]
    return (triangle @ triangle.T)[ROWS, COLUMNS], slopes


def _triangle(coordinates: Array) -> Array:
    """The lower triangle with positive diagonal at log-Cholesky coordinates `(10,)`."""
    triangle = np.zeros((ORDER, ORDER))
    diagonal = np.exp(np.where(_ON, coordinates, 0.0))
    triangle[COLUMNS, ROWS] = np.where(_ON, diagonal, coordinates)
    return triangle


def _matrices(numbers: Array) -> Array:
    """Symmetric matrices `(..., 4, 4)` with these entries `(..., 10)`."""
    return np.tensordot(numbers, BASIS, axes=1)


def _numbers(matrices: Array) -> Array:
    """Ten numbers `(..., 10)` whose squares sum up to a symmetric matrix's."""
    return np.asarray(np.where(_ON, 1.0, np.sqrt(2.0)) * matrices[..., ROWS, COLUMNS])


STUCK = 1e-8  # gain, relative to the criterion or to 1, that rounding may hide
FAIR = 1e-4  # part of the promise that a step has to keep
SHORTER = 0.5  # factor by which a step that keeps less is shortened
SHORTENED = 60  # how often at most


class GaussNewtonResult(NamedTuple):
    """Where it ended after how many steps, the criterion there, and what a further one promises."""

    x: Array
    cost: float
    promise: float
    converged: bool
    steps: int


def bounded_gauss_newton(
    problem: Criterion, start: Array, lower: Array, upper: Array, steps: int, tolerance: float
) -> GaussNewtonResult:
    """Minimise a criterion within bounds `(k,)`, until a step gains less than the tolerance."""
    x, cost, promise = start, problem.cost(start), np.inf
    for number in range(steps):
        residuals, slopes = problem.near(x)
        step = bounded_step(residuals, slopes, lower - x, upper - x)
        change = slopes @ step
        promise = -float((residuals + 0.5 * change) @ change)
        if promise <= tolerance:
            return GaussNewtonResult(x, cost, promise, True, number)
        for shortened in range(SHORTENED):
            part = SHORTER**shortened
            trial = problem.moved(x, step, part)
            reached = np.inf if trial is None else problem.cost(trial)
            if trial is not None and reached < cost - FAIR * part * promise:
                break
        else:
            stuck = promise <= STUCK * max(1.0, abs(cost))
            return GaussNewtonResult(x, cost, promise, stuck, number)
        x, cost = np.clip(trial, lower, upper), reached
    return GaussNewtonResult(x, cost, promise, False, steps)


def bounded_step(residuals: Array, slopes: Array, low: Array, high: Array) -> Array:
    """The step `(k,)` of least squares for residuals `(r,)` and slopes `(r, k)` within bounds."""
    from scipy.optimize import lsq_linear

    bounded = np.isfinite(low) | np.isfinite(high)
    order = np.argsort(bounded, kind="stable")
    count = int(np.sum(~bounded))
    lengths = np.maximum(np.linalg.norm(slopes[:, order], axis=0), 1e-150)
    basis, triangle = np.linalg.qr(slopes[:, order] / lengths)
    right = -basis.T @ residuals
    step = np.linalg.solve(triangle, right)
    ends = [end[order][count:] * lengths[count:] for end in (low, high)]
    ends = [np.minimum(ends[0], 0.0), np.maximum(ends[1], 0.0)]
    if np.any((step[count:] < ends[0]) | (step[count:] > ends[1])):
        wide = np.minimum(ends[0], -1e-300), np.maximum(ends[1], 1e-300)
        part, rest = triangle[count:, count:], right[count:]
        found = lsq_linear(part, rest, wide, method="bvls", tol=1e-14, max_iter=10 * len(rest))
        step[count:] = np.clip(found.x, *ends)
        top = right[:count] - triangle[:count, count:] @ step[count:]
        step[:count] = np.linalg.solve(triangle[:count, :count], top)
    placed = np.empty(len(step))
    placed[order] = step / lengths
    return placed
