r"""The consistent estimate by Gauss–Newton in log-Cholesky coordinates [Rucker2022].

The same criterion as the convex estimate's, in coordinates in which every choice is a body that can
exist, with the convex estimate's margin: no cones. The data are far sharper than the prior, so that
steps straight in the coordinates creep along narrow curved valleys [Transtrum2012]; each therefore
ends where the bodies themselves would be after a straight step, and priors count with their exact
curvature. A barrier that fades keeps coordinates finite where the margin holds.
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.consistent.consistency_penalties import Entropic
from steelyard.estimation.consistent.consistent import Consistent
from steelyard.estimation.consistent.gauss_newton import GaussNewtonResult, bounded_gauss_newton
from steelyard.estimation.consistent.infeasibility import refuse_contradictions
from steelyard.estimation.consistent.log_cholesky_criterion import Criterion, bounds_of
from steelyard.estimation.consistent.program import Program
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.knowledge import Knowledge, Row
from steelyard.parameters import Parameters
from steelyard.regression.information import Information
from steelyard.robot.inertia import INERTIAL_NAMES

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
