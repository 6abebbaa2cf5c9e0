r"""The consistent estimate in log-Cholesky coordinates by bounded Gauss-Newton steps [Rucker2022].

A step minimises $\|J d + r\|^2$ within the bounds by an active set [Stark1995], and is shortened
until the criterion falls by a fair part of what was promised. How a step is taken is the problem's
own business: along a straight line, or along a curve that begins like it.

The same criterion as the convex estimate's, in coordinates in which every choice is a body that can
exist, with the convex estimate's margin: no cones. The data are far sharper than the prior, so that
steps straight in the coordinates creep along narrow curved valleys [Transtrum2012]; each therefore
ends where the bodies themselves would be after a straight step, and priors count with their exact
curvature. A barrier that fades keeps coordinates finite where the margin holds.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.consistent import Consistent
from steelyard.estimate.consistent.contradictions import refuse_contradictions
from steelyard.estimate.consistent.log_cholesky_criterion import Criterion, bounds_of
from steelyard.estimate.consistent.penalties import Entropic
from steelyard.estimate.consistent.program import Program
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.information import Information
from steelyard.estimate.prior.prior import Knowledge, Row
from steelyard.robot.rigid_body import INERTIAL_NAMES

STUCK = 1e-8
"""Gain, relative to the criterion or to 1, that rounding may hide: no step gains anything."""

FAIR = 1e-4
"""Part of the promise that a step has to keep."""

SHORTER = 0.5
"""Factor by which a step that keeps less is shortened."""

SHORTENED = 60
"""How often at most."""


class Problem(Protocol):
    """A criterion that looks like a sum of squares from near by."""

    def cost(self, x: Array) -> float:
        """The criterion; infinite where there is none."""
        ...

    def near(self, x: Array) -> tuple[Array, Array]:
        """Residuals `(r,)` and derivatives `(r, k)`.

        Half their squares have the criterion's slope, and its curvature or about that.
        """
        ...

    def moved(self, x: Array, step: Array, part: float) -> Array | None:
        """The place after a part of a step; `None` if there is none."""
        ...


@dataclass(frozen=True, eq=False)
class GaussNewtonResult:
    """Where it ended.

    Attributes:
        x: The unknowns.
        cost: The criterion.
        promise: What a further step would gain, as far as the linear problem knows.
        converged: Whether that is small enough.
        steps: Steps that it took.
    """

    x: Array
    cost: float
    promise: float
    converged: bool
    steps: int


def bounded_gauss_newton(
    problem: Problem,
    start: Array,
    lower: Array,
    upper: Array,
    steps: int,
    tolerance: float,
) -> GaussNewtonResult:
    """Minimise a criterion.

    Args:
        problem: The criterion.
        start: Within the bounds, shape `(k,)`.
        lower: Shape `(k,)`.
        upper: Shape `(k,)`.
        steps: Most steps.
        tolerance: Gain that is not worth a step.
    """
    x, cost, promise = start, problem.cost(start), np.inf
    for number in range(steps):
        residuals, slopes = problem.near(x)
        step = bounded_step(residuals, slopes, lower - x, upper - x)
        change = slopes @ step
        promise = -float((residuals + 0.5 * change) @ change)
        if promise <= tolerance:
            return GaussNewtonResult(x, cost, promise, True, number)
        found = _taken(problem, x, cost, step, promise)
        if found is None:
            return GaussNewtonResult(
                x, cost, promise, promise <= STUCK * max(1.0, abs(cost)), number
            )
        x, cost = np.clip(found[0], lower, upper), found[1]
    return GaussNewtonResult(x, cost, promise, False, steps)


def _taken(
    problem: Problem, x: Array, cost: float, step: Array, promise: float
) -> tuple[Array, float] | None:
    """The place after as much of a step as keeps a fair part of its promise, and the cost there."""
    part = 1.0
    for _ in range(SHORTENED):
        trial = problem.moved(x, step, part)
        reached = np.inf if trial is None else problem.cost(trial)
        if trial is not None and reached < cost - FAIR * part * promise:
            return trial, reached
        part *= SHORTER
    return None


def bounded_step(residuals: Array, slopes: Array, low: Array, high: Array) -> Array:
    """The step `(k,)` of least squares for residuals `(r,)` and slopes `(r, k)` within bounds.

    Only what has bounds takes part in the search for those that hold.
    """
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


BROKEN = 1e-6
"""By how much a constraint may be violated, relative to what it adds up."""

BARRIERS = (1.0, 1e-2, 1e-4, 1e-6, 1e-8)
"""Weights of the barrier, one after the other; four of the last per body is what it may cost."""

CENTRED = 0.1
"""What a step still promises, relative to the barrier's weight, where the next barrier begins."""


@dataclass(frozen=True, eq=False)
class LogCholesky(Consistent):
    """The consistent estimate in coordinates that need no cones.

    Bounds of friction and its like are kept, and constraints on a single one of them. Those about
    bodies, and ties, are not looked at: notes count them, and name those that the result breaks.

    Attributes:
        steps: After which the solver gives up.
    """

    steps: int = 500

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.form, Entropic):
            raise ValueError("log-Cholesky supports only the entropic prior")

    def __call__(self, information: Information) -> Estimate:
        """Estimate all standard parameters.

        Raises:
            DataError: The data are too few, or the solver stopped before the optimum.
        """
        kept = replace(self, knowledge=_kept(self.knowledge))
        estimate = super(LogCholesky, kept).__call__(information)
        unheard = _unheard(self.knowledge)
        notes = (*estimate.notes, *unheard, *_broken(self.knowledge, estimate.values))
        return replace(estimate, estimator="log-Cholesky Gauss-Newton", notes=notes)

    def _from_nearby(self, program: Program, gamma: float, near: Array) -> Array | None:
        """Nothing: the search in these coordinates begins at the prior."""
        return None

    def _optimum(self, program: Program, gamma: float) -> Array:
        lower, upper = bounds_of(program)
        if np.any(lower > upper):
            refuse_contradictions(self.knowledge)
        criterion = Criterion.of(program, gamma)
        x, left = criterion.start, self.steps
        for size in BARRIERS:
            barrier = size * max(1.0, criterion.plain(x)) if size < 1.0 else 1.0
            found = bounded_gauss_newton(
                replace(criterion, barrier=barrier),
                x,
                criterion.lower,
                criterion.upper,
                left,
                CENTRED * barrier,
            )
            x, left = found.x, left - found.steps
            if not found.converged:
                raise self._not_converged(found)
        return criterion.unknowns_at(x)[0]

    def _not_converged(self, found: GaussNewtonResult) -> DataError:
        return DataError(
            f"log-Cholesky Gauss-Newton did not reach the optimum in {self.steps} steps: "
            f"a further one predicts a decrease of {found.promise:.2g} of {found.cost:.4g}",
            where=", ".join(self.knowledge.bodies),
            fix="use the convex consistent estimate, which minimises the same criterion",
        )


def _kept(knowledge: Knowledge) -> Knowledge:
    """What is known, without what is not looked at."""
    bodies = [k for body in range(len(knowledge.bodies)) for k in knowledge.tens(body)]
    lower, upper = knowledge.lower.copy(), knowledge.upper.copy()
    lower[bodies], upper[bodies] = -np.inf, np.inf
    return replace(knowledge, lower=lower, upper=upper, rows=tuple(filter(_single, knowledge.rows)))


def _single(row: Row) -> bool:
    """Whether a row is about one parameter that is not a body's."""
    kinds = {name.split(".")[0] for name in row.coefficients}
    return len(row.coefficients) == 1 and not kinds & set(INERTIAL_NAMES)


def _unheard(knowledge: Knowledge) -> tuple[str, ...]:
    """How many prior constraints are not used."""
    labels = {row.label for row in knowledge.rows if not _single(row)}
    if not labels:
        return ()
    one = len(labels) == 1
    count, verb = ("1 entry", "is") if one else (f"{len(labels)} entries", "are")
    return (f"{count} of [[knowledge]] about links or ties {verb} ignored by this estimator",)


def _broken(knowledge: Knowledge, values: Parameters) -> tuple[str, ...]:
    """Constraints that were ignored and do not hold."""
    found = values.as_dict()
    rows = [
        Row(f"{name} between {low:g} and {high:g}", {name: 1.0}, low, high)
        for name, low, high in zip(
            knowledge.names, knowledge.lower.tolist(), knowledge.upper.tolist(), strict=True
        )
    ]
    labels = []
    for row in (*rows, *knowledge.rows):
        parts = [x * found[name] for name, x in row.coefficients.items()]
        slack = BROKEN * sum(abs(part) for part in parts)
        if not row.lower - slack <= sum(parts) <= row.upper + slack:
            labels.append(row.label)
    return (f"constraints that this estimate violates: {'; '.join(labels)}",) if labels else ()
