r"""Constraints that contradict each other or the data, their costs, and the weight of the prior.

The weight of the prior: stated, $\gamma = 1/s^2$ with the prior's relative uncertainty $s$.
Otherwise the $\gamma$ under which the data are likeliest, all parameters integrated out (Laplace)
[MacKay1992], and never so large that the weighted squares rise over those of least squares by more
than the rank of the data: as much as noise alone moves them. It takes residuals to be noise, and
all directions to be as far from the prior as those that torques show; masses may be off by more. So
a prior of less than 32 % must prove better on parts of the data that are left out: the widest is
taken that is not worse there than the likeliest by more than chance.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    ONE,
    Block,
    Conic,
    Unsolved,
    apart,
    scale_of,
    solved,
)
from steelyard.estimate.consistent.convex_program_and_newton_refinement import (
    ConicConstraints,
    Program,
    scaled_rows,
)
from steelyard.estimate.prior.body_priors import Knowledge, Row, in_words
from steelyard.estimate.scores.cross_validation import chance_of

LEAST_PRIOR_WEIGHT, MOST_PRIOR_WEIGHT = 1e-3, 1e4  # uncertainties of 3000 % and 1 %
FIRST_PRIOR_WEIGHT = 10.0  # weight that is tried first, and that more have to prove better: 32 %
PRIOR_WEIGHT_STEP = 6.0  # factor between weights until the likeliest is between two
REFINED = 2  # times that a parabola through three weights gives a better one
SOLVES = 15  # most solutions of a search
PARTS = 8  # stretches of the data that are left out in turn
LOSS_PROBABILITY = 0.9  # with which a smaller weight's loss over them must be one


@dataclass(frozen=True, eq=False)
class Tried:
    """The solution with one weight."""

    gamma: float  # the weight
    u: Array
    rise: float  # rise of the weighted squares over those of least squares
    evidence: float  # logarithm of the data's likelihood, but for a constant
    solves: int = 1  # solutions that the search for the weight took


def weighed(
    attempt: Callable[[float, Array | None], Tried], left_out: Callable[[Tried], Array], rank: int
) -> Tried:
    """Search the likeliest weight whose rise is allowed, up to `rank`, or a less one as good.

    `attempt` solves with a weight, from unknowns nearby; `left_out` are squares of left-out parts.
    """
    search = _Search(attempt)
    best = search.likeliest()
    if search.at(best).rise > rank:
        least = search.at(LEAST_PRIOR_WEIGHT).rise
        best = search.largest(best, rank + (least if least > rank else 0.0))
    if best > FIRST_PRIOR_WEIGHT:
        with suppress(DataError):  # nothing can be left out
            errors, steps = left_out(search.at(best)), PRIOR_WEIGHT_STEP ** np.arange(5)
            less = (g for g in (FIRST_PRIOR_WEIGHT * steps).tolist() if g < best)
            losses = ((g, left_out(search.at(g)) - errors) for g in less)
            fair = (g for g, loss in losses if loss.mean() <= chance_of(loss, LOSS_PROBABILITY))
            best = next(fair, best)
    return replace(search.at(best), solves=len(search.found))


@dataclass(frozen=True, eq=False)
class _Search:
    """Weights that were tried; each is solved once."""

    attempt: Callable[[float, Array | None], Tried]
    found: dict[float, Tried] = field(default_factory=dict)

    def at(self, gamma: float) -> Tried:
        if gamma not in self.found:
            apart = {abs(np.log(gamma / known)): tried.u for known, tried in self.found.items()}
            self.found[gamma] = self.attempt(gamma, apart[min(apart)] if apart else None)
        return self.found[gamma]

    def likeliest(self) -> float:
        """The weight of most evidence, at an end of the range or between its neighbours."""
        best = FIRST_PRIOR_WEIGHT
        for factor in (PRIOR_WEIGHT_STEP, 1.0 / PRIOR_WEIGHT_STEP):
            while LEAST_PRIOR_WEIGHT < best < MOST_PRIOR_WEIGHT:
                further = float(np.clip(best * factor, LEAST_PRIOR_WEIGHT, MOST_PRIOR_WEIGHT))
                if self.at(further).evidence <= self.at(best).evidence:
                    break
                best = further
        for _ in range(REFINED):
            below = max((g for g in self.found if g < best), default=None)
            above = min((g for g in self.found if g > best), default=None)
            if below is None or above is None:
                break
            # top of the parabola through three weights, in their logarithm, kept between them
            x = np.log([below, best, above])
            y = [self.at(g).evidence for g in (below, best, above)]
            curve = np.polyfit(x - x[1], y, 2)
            top = -curve[1] / (2.0 * curve[0]) if curve[0] < 0.0 else 0.0
            away = np.clip(top, 0.8 * (x[0] - x[1]), 0.8 * (x[2] - x[1]))
            best = max(best, float(np.exp(x[1] + away)), key=lambda g: self.at(g).evidence)
        return best

    def largest(self, high: float, allowed: float) -> float:
        """The largest weight below `high` whose rise is allowed, to a few percent."""
        lower = (g for g, t in self.found.items() if g <= high and t.rise <= allowed)
        low = max(lower, default=LEAST_PRIOR_WEIGHT)
        high = min((g for g, t in self.found.items() if t.rise > allowed), default=high)
        while len(self.found) < SOLVES and high > 1.1 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.at(middle).rise <= allowed else (low, middle)
        return low


MARGIN = 1e-4  # least eigenvalue of a body's pseudo-inertia in the scale of its prior

_NEARLY = 1e-6


def refuse_contradictions(knowledge: Knowledge) -> None:
    """Stop at constraints that cannot hold together, with a set of which all are needed."""
    labels = contradictions(knowledge)
    if not labels:
        return
    if len(labels) == 1:
        wrong, fix = f"no physical body satisfies this: {labels[0]}", "correct it, or leave it out"
    else:
        wrong = f"these constraints are infeasible together: {'; '.join(labels)}"
        fix = "correct one of them, or leave it out"
    raise DataError(wrong, where="prior constraints", fix=fix)


def contradictions(knowledge: Knowledge) -> tuple[str, ...]:
    """Labels of constraints and bounds of which all but one, but not all, can hold together.

    Bounds of the parameters of bodies are left out.
    """
    allowed = partial(_allowed, knowledge)
    ends = zip(knowledge.names, knowledge.lower.tolist(), knowledge.upper.tolist(), strict=True)
    bounds = (
        Row(f"'{name}' is {in_words((low, high))} by its law", {name: 1.0}, low, high)
        for (name, low, high), of_body in zip(ends, knowledge.of_bodies, strict=True)
        if not of_body and (np.isfinite(low) or np.isfinite(high))
    )
    rows = (*bounds, *knowledge.rows)
    if not knowledge.rows or allowed(rows):
        return ()
    return tuple(dict.fromkeys(row.label for row in irreducible(rows, allowed)))


def irreducible(
    rows: Sequence[Row], feasible: Callable[[tuple[Row, ...]], bool]
) -> tuple[Row, ...]:
    """Rows that cannot hold together, but can if any one label's are left out [Chinneck1991].

    Rows with one label are one constraint and stay together. Many are left out at once, and a half
    of them where that is too many; earlier ones first. `feasible`, whether rows can hold, is called
    about `2 k log2(n / k)` times for `k` of `n` labels. Empty if not even no row can hold.
    """
    kept, parts = tuple(rows), [tuple(dict.fromkeys(row.label for row in rows))]
    while parts:
        part = parts.pop()
        others = tuple(row for row in kept if row.label not in part)
        if not feasible(others):
            kept = others
        elif len(part) > 1:
            half = len(part) // 2
            parts += [part[half:], part[:half]]
    return kept


def _allowed(knowledge: Knowledge, rows: tuple[Row, ...]) -> bool:
    r"""Whether physically consistent bodies allow rows: all hold with next to no slack.

    Each row, in units of its length, may fail by $s$, and so may $X \succeq \delta 1$ of every
    body's pseudo-inertia $L X L^T$ in the scale $L$ of its prior. Such values always exist, so the
    solver never has to prove that there are none.
    """
    if not rows:
        return True
    found = scaled_rows(rows, knowledge.names, scale_of(knowledge)[0])
    count = found.matrix.shape[1]
    above, below = np.isfinite(found.lower), np.isfinite(found.upper)
    planes = np.vstack([-found.matrix[above], found.matrix[below], np.zeros(count)])
    planes = np.column_stack([planes, -np.ones(len(planes))])
    ends = np.concatenate([-found.lower[above], found.upper[below], [1.0]])
    body = apart(MARGIN)
    matrix = np.column_stack([body.matrix, -ONE])
    bodies = (
        replace(body, columns=np.append(10 * k + np.arange(10), count), matrix=matrix)
        for k in range(len(knowledge.bodies))
    )
    slack = Block("nonnegative", np.arange(count + 1), planes, ends)  # none is below -1
    least = Conic(np.zeros(count + 1), np.eye(count + 1)[count], (slack, *bodies))
    try:
        return bool(solved(least, "prior constraints")[count] < _NEARLY)
    except Unsolved:
        return True


DISTANCE_TO_BOUND, DISTANCE_BEYOND_BOUND = 1e-3, 1e-3
"""Distance to a bound, and distance beyond it at the data's optimum, in standard deviations, at
which it counts as active."""

FAR = 1e3  # size of a constraint to be checked, in units of a body's prior or of the whole effort
MOST_NAMED = 3  # constraints that are named at most


def active_bounds(program: Program, u: Array, covariance: Array) -> tuple[Array, tuple[str, ...]]:
    """Unknowns with those that a bound of their own holds put onto it, and their names.

    Those that are not identifiable are zero. Given are the optimum `(m,)` and the covariance of the
    unknowns, `(m, m)`.
    """
    known, constraints = program.unknowns, program.constraints
    slope = known.matrix.T @ (known.matrix @ u - known.vector) + known.weak * u
    own = (np.count_nonzero(constraints.matrix, axis=1) == 1) & ~constraints.equal
    first = 10 * len(known.priors)
    at, names = u.copy(), []
    for number in np.flatnonzero(own):
        k = int(np.argmax(np.abs(constraints.matrix[number])))
        if k < first:
            continue
        sign, std = constraints.matrix[number, k], float(np.sqrt(max(covariance[k, k], 0.0)))
        for bound, outward in ((constraints.lower[number], 1.0), (constraints.upper[number], -1.0)):
            slack = outward * (sign * u[k] - bound)
            beyond = outward * sign * slope[k] * std
            if slack <= DISTANCE_TO_BOUND * std and beyond >= DISTANCE_BEYOND_BOUND:
                at[k] = sign * bound
                names.append(known.names[known.terms[k - first]])
    several = constraints.matrix[np.count_nonzero(constraints.matrix, axis=1) > 1]
    identified = np.any(known.matrix != 0.0, axis=0) | np.any(several != 0.0, axis=0)
    for k in (first + np.flatnonzero(~identified[first:])).tolist():
        alone = constraints.matrix[:, k] != 0.0
        both = np.array([constraints.lower[alone], constraints.upper[alone]])
        edges = np.sort(both / constraints.matrix[alone, k], axis=0)
        at[k] = np.clip(0.0, edges[0].max(initial=-np.inf), edges[1].min(initial=np.inf))
    return at, tuple(dict.fromkeys(names))


def far_constraints(constraints: ConicConstraints) -> tuple[str, ...]:
    """Constraints of sizes that hardly any parameter has, for messages."""
    ends = np.abs([constraints.lower, constraints.upper])
    sizes = np.where(np.isfinite(ends), ends, 0.0).max(axis=0)
    found = [row.label for row, size in zip(constraints.rows, sizes, strict=True) if size > FAR]
    return tuple(dict.fromkeys(found))[:MOST_NAMED]
