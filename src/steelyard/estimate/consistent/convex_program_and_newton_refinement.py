r"""The convex program of consistent parameters, and its refinement by Newton's method.

$\min \tfrac12\|y\|^2 + \gamma \sum_i D(X_i) + \tfrac12\sum_k w_k u_k^2$ with $y = Au - z$ as an
equation: with $A^T A$ in the cost, solvers call points solved that are not.

An interior-point solver comes near the optimum in a dozen steps and needs as many again for the
digits that the weighted squares show; it cannot begin at the solution of a similar problem. Within
consistent bodies the objective is smooth: with the bounds that hold as equations, a few Newton
steps, shortened while they gain nothing, end at rounding. The problem is convex, so a point with
no slope, bounds that hold pulling outward, is the optimum; where that cannot be confirmed, or a
body lies at the margin of physical consistency, nothing is returned.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    Block,
    Conic,
    Form,
    Free,
    Unknowns,
)
from steelyard.estimate.prior.body_priors import Knowledge, Row
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

UNREACHED_BOUND = 1e6  # bound never reached, in units of a body's prior or of the whole effort


@dataclass(frozen=True, eq=False)
class ConicConstraints:
    r"""Bounds and rows over the unknowns, each scaled to unit length: $l \le a\,u \le h$."""

    rows: tuple[Row, ...]  # as they were given
    matrix: Array  # `(rows, m)`
    lower: Array
    upper: Array

    @property
    def free(self) -> Array:
        """Directions that the equations leave, shape `(m, free)`, orthonormal."""
        _, sizes, turned = np.linalg.svd(self.matrix[self.equal], full_matrices=True)
        return np.asarray(turned[int(np.sum(sizes > 1e-10)) :].T)

    @property
    def equal(self) -> NDArray[np.bool_]:
        """Those that are equations, as a mask."""
        return np.asarray(self.lower == self.upper)

    @property
    def planes(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Rows, equations first, each at most an end if it is finite; and which are equations."""
        equal = self.equal
        low, high = (np.isfinite(side) & ~equal for side in (self.lower, self.upper))
        rows = np.vstack([self.matrix[equal], -self.matrix[low], self.matrix[high]])
        ends = np.concatenate([self.upper[equal], -self.lower[low], self.upper[high]])
        return rows, ends, np.arange(len(rows)) < int(equal.sum())


def conic_constraints(unknowns: Unknowns, knowledge: Knowledge) -> ConicConstraints:
    """Bounds of the parameters and the user's rows; those that hold for any body are left out."""
    bodies = {name for name in unknowns.names if name.split(".")[0] in INERTIAL_NAMES}
    bounds = []
    for k, name in enumerate(unknowns.names):
        low, high = float(knowledge.lower[k]), float(knowledge.upper[k])
        low = -np.inf if name in knowledge.shaped or (name in bodies and low == 0.0) else low
        if np.isfinite(low) or np.isfinite(high):
            bounds.append(Row(f"{name} between {low:g} and {high:g}", {name: 1.0}, low, high))
    rows = (*bounds, *knowledge.curves, *knowledge.rows)
    found = scaled_rows(rows, unknowns.names, unknowns.scale)
    lower, upper, equal = found.lower, found.upper, found.equal
    lower = np.where((lower < -UNREACHED_BOUND) & ~equal, -np.inf, lower)
    upper = np.where((upper > UNREACHED_BOUND) & ~equal, np.inf, upper)
    return replace(found, lower=lower, upper=upper)


def scaled_rows(rows: tuple[Row, ...], names: Sequence[str], scale: Array) -> ConicConstraints:
    r"""Rows over named parameters as constraints of the unknowns, $\phi = T u$ with a scale $T$."""
    coefficients = np.array([[row.coefficients.get(name, 0.0) for name in names] for row in rows])
    matrix = coefficients.reshape(len(rows), len(names)) @ scale
    sizes = np.linalg.norm(matrix, axis=1)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    lower, upper = np.reshape([(row.lower, row.upper) for row in rows], (-1, 2)).T / sizes
    return ConicConstraints(rows, matrix / sizes[:, None], lower, upper)


@dataclass(frozen=True, eq=False)
class Program:
    """The program but for the weight of the prior, so that many weights share it."""

    unknowns: Unknowns
    constraints: ConicConstraints
    form: Form  # penalty of bodies that have a prior

    @property
    def smooth(self) -> bool:
        """Whether every body is penalised, so that Newton's method finds the optimum."""
        return self.form.penalises and all(self.unknowns.priors)

    def conic(self, gamma: float, *, unit: float = 1.0) -> Conic:
        """The program with a weight of the prior.

        The optimum does not depend on the unit of the squares, which is in that of the noise.
        """
        known = self.unknowns
        m, rank = len(known.weak), len(known.vector)
        square, linear = [known.weak.copy(), np.ones(rank)], [np.zeros(m), np.zeros(rank)]
        matrix = np.hstack([known.matrix / np.sqrt(unit), -np.eye(rank)])
        blocks = [Block("zero", np.arange(m + rank), matrix, known.vector / np.sqrt(unit))]
        rows, ends, equal = self.constraints.planes
        sides = (
            Block("zero", np.arange(m), rows[equal], ends[equal]),
            Block("nonnegative", np.arange(m), rows[~equal], ends[~equal]),
        )
        blocks += [block for block in sides if len(block.offset)]
        total = m + rank
        for place, weight, form in self._penalties(gamma):
            part = form.part(weight)
            helpers = len(part.linear) - 10
            columns = np.concatenate([np.arange(m)[place], total + np.arange(helpers)])
            square[0][place] += part.square[:10]
            linear[0][place] += part.linear[:10]
            square.append(part.square[10:])
            linear.append(part.linear[10:])
            blocks += [replace(block, columns=columns[block.columns]) for block in part.blocks]
            total += helpers
        square[:1] = [square[0] / unit]
        square[2:], linear = [x / unit for x in square[2:]], [x / unit for x in linear]
        return Conic(np.concatenate(square), np.concatenate(linear), tuple(blocks))

    def _penalties(self, gamma: float) -> Iterator[tuple[slice, float, Form]]:
        """Per body the place of its unknowns, the weight and the form of its penalty."""
        for body, prior in enumerate(self.unknowns.priors):
            weight = gamma if prior and self.form.penalises else 1.0
            form = self.form if prior else Free(self.form.margin)
            yield slice(10 * body, 10 * body + 10), weight, form

    def cost(self, u: Array, gamma: float) -> float:
        """The objective."""
        known = self.unknowns
        total = 0.5 * (known.chi_squared(u) + float(known.weak @ np.square(u)))
        for x, (_, weight, form) in zip(known.pseudo(u), self._penalties(gamma), strict=True):
            total += weight * form.cost(x)
        return total

    def evidence(self, u: Array, gamma: float) -> float:
        r"""Logarithm of the data's likelihood at a weight of the prior, but for a constant.

        Laplace's approximation at the optimum,
        $-f(u) + \tfrac12 \log\det P - \tfrac12 \log\det(P + A^T A)$ with the prior's precision $P$,
        within the constraints' equations.
        """
        free = self.constraints.free
        before = free.T @ self.precision(u, gamma) @ free
        data = self.unknowns.matrix @ free
        before, after = np.linalg.slogdet(before)[1], np.linalg.slogdet(before + data.T @ data)[1]
        return -self.cost(u, gamma) + 0.5 * float(before - after)

    def slope(self, u: Array, gamma: float) -> Array:
        """Derivative of the objective, shape `(m,)`."""
        known = self.unknowns
        slope = known.matrix.T @ (known.matrix @ u - known.vector) + known.weak * u
        for x, (part, weight, form) in zip(known.pseudo(u), self._penalties(gamma), strict=True):
            slope[part] += weight * form.slope(x)
        return slope

    def precision(self, u: Array, gamma: float) -> Array:
        """Second derivative of the objective without the data, shape `(m, m)`."""
        return self._precision(self.unknowns.pseudo(u), gamma)

    def stated_precision(self, u: Array, gamma: float) -> Array:
        r"""The same without what is gained by being near the edge of consistent bodies.

        Where an eigenvalue $\lambda$ of $X$ nears zero, the penalty's curvature grows with
        $\lambda^{-2}$: it keeps the body possible, but knows the parameters no better. There the
        curvature at $\lambda = 1$ counts, the prior's own.
        """
        values, vectors = np.linalg.eigh(self.unknowns.pseudo(u))
        lifted = (vectors * np.maximum(values, 1.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
        return self._precision(lifted, gamma)

    def _precision(self, bodies: Array, gamma: float) -> Array:
        """Second derivative of the objective without the data, at bodies `X`, `(bodies, 4, 4)`."""
        matrix = np.diag(self.unknowns.weak)
        for x, (part, weight, form) in zip(bodies, self._penalties(gamma), strict=True):
            matrix[part, part] += weight * form.curvature(x)
        return matrix


ROUNDS = 30  # most Newton steps and changes of the bounds that hold
NEAR = 1e-6  # slack of a bound that is taken to hold at first, the row in unit length
SMALL = 1e-20  # decrement, relative to the cost, at which there is nothing left to gain
ROUNDING = 1e-12  # rise of the cost, relative to it, that is rounding
HALVINGS = 6  # most times that a step is halved


def polished(program: Program, u: Array, gamma: float) -> Array | None:
    """The optimum from a point near it, `(m,)`; `None` where it cannot be confirmed."""
    if not _inside(program, u):
        return None
    rows, ends, equal = program.constraints.planes
    slack = ends - rows @ u
    if slack.min(initial=0.0) < -NEAR or np.abs(slack[equal]).max(initial=0.0) > NEAR:
        return None
    holds = equal | (slack <= NEAR)
    data = program.unknowns.matrix.T @ program.unknowns.matrix
    for _ in range(ROUNDS):
        curved = program.precision(u, gamma) + data
        off = (ends - rows @ u)[holds]
        try:
            step, pulls = _newton(curved, program.slope(u, gamma), rows[holds], off)
        except np.linalg.LinAlgError:
            return None
        wrong = (pulls < 0.0) & ~equal[holds]
        if wrong.any():
            holds[np.flatnonzero(holds)[int(np.argmin(np.where(wrong, pulls, 0.0)))]] = False
            continue
        room, first = _share(rows, ends, holds, u, step)
        share = _gaining(program, gamma, u, room * step, float(np.abs(pulls) @ np.abs(off)))
        if share is None:
            return None
        u = u + share * room * step
        if share < 1.0:
            continue
        if room < 1.0:
            holds[first] = True
        elif step @ curved @ step <= SMALL * max(1.0, program.cost(u, gamma)):
            return u
    return None


def _newton(curved: Array, slope: Array, rows: Array, ends: Array) -> tuple[Array, Array]:
    """The step to the optimum of the model on the rows, and how hard each row is pulled."""
    m, count = len(slope), len(rows)
    scale = 1.0 / np.sqrt(np.diag(curved))
    matrix = np.zeros((m + count, m + count))
    matrix[:m, :m] = curved * scale[:, None] * scale
    matrix[:m, m:] = (rows * scale).T
    matrix[m:, :m] = rows * scale
    found = np.linalg.solve(matrix, np.concatenate([-slope * scale, ends]))
    return found[:m] * scale, found[m:]


def _share(
    rows: Array, ends: Array, holds: NDArray[np.bool_], u: Array, step: Array
) -> tuple[float, int]:
    """How much of a step the other bounds leave, and which is reached first."""
    ahead = rows @ step
    slack = np.maximum(ends - rows @ u, 0.0)
    free = ~holds & (ahead > 0.0)
    shares = np.where(free, slack / np.where(free, ahead, 1.0), np.inf)
    first = int(np.argmin(shares)) if len(shares) else 0
    return min(1.0, float(shares.min(initial=np.inf))), first


def _gaining(program: Program, gamma: float, u: Array, step: Array, allowed: float) -> float | None:
    """Share of a step with bodies inside that gains; it may cost `allowed` to fulfil the rows."""
    most = program.cost(u, gamma)
    most += allowed + ROUNDING * max(1.0, most)
    for halvings in range(HALVINGS + 1):
        share = 0.5**halvings
        end = u + share * step
        if _inside(program, end) and program.cost(end, gamma) <= most:
            return share
    return None


def _inside(program: Program, u: Array) -> bool:
    """Whether every body is well within the margin."""
    least = np.linalg.eigvalsh(program.unknowns.pseudo(u))[:, 0].min(initial=np.inf)
    return bool(least > 1.01 * program.form.margin)
