r"""The consistent estimate by Gauss–Newton in log-Cholesky coordinates [Rucker2022].

The same criterion as the convex estimate's with its entropic prior, in coordinates in which every
body can exist: no cone and no margin. It is no longer convex, and without a prior it creeps along
flat valleys towards bodies of no mass; it then says that it did not arrive. What it is for are
models that are not linear in all of their parameters, see `log_cholesky_fields`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.consistent import Consistent
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.gauss_newton import bounded_gauss_newton
from steelyard.estimation.knowledge import Knowledge, Row
from steelyard.estimation.log_cholesky_body import divergence, entries
from steelyard.estimation.physics import Entropic
from steelyard.estimation.program import Program
from steelyard.estimation.unknowns import Unknowns
from steelyard.estimation.whitened import whitened
from steelyard.parameters import Parameters
from steelyard.regression.information import Information

Indices = NDArray[np.intp]

BROKEN = 1e-6
"""By how much a wish may be missed, relative to what it adds up."""


@dataclass(frozen=True, eq=False)
class LogCholesky(Consistent):
    """The consistent estimate in coordinates that need no cones.

    Bounds of friction and its like are kept. Wishes about bodies, and rows, are not looked at:
    the notes name those that the result breaks.

    Attributes:
        steps: After which the solver gives up.
    """

    steps: int = 500

    def __post_init__(self) -> None:
        if not isinstance(self.form, Entropic):
            raise ValueError("in log-Cholesky coordinates the prior is the entropic one")

    def __call__(self, information: Information) -> Estimate:
        """Estimate all standard parameters.

        Raises:
            DataError: The data are too few, or the solver stopped before the optimum.
        """
        estimate = super().__call__(information)
        notes = (*estimate.notes, *_broken(self.knowledge, estimate.values))
        return replace(estimate, estimator="log-Cholesky Gauss-Newton", notes=notes)

    def weight(self, information: Information) -> float:
        """The weight of the prior that is given, stated or found for these data."""
        data = whitened(information, self.per_run, equal=self.equal)
        return self.weighed(self.program(data)).tried.gamma

    def solve(self, program: Program, gamma: float) -> Array:
        """The unknowns at the optimum with a weight of the prior.

        Raises:
            DataError: The solver stopped before the optimum.
        """
        problem = _Residuals.of(program, self.knowledge.lower, self.knowledge.upper, gamma)
        found = bounded_gauss_newton(
            problem.at, problem.start, problem.lower, problem.upper, self.steps
        )
        if not found.settled:
            raise DataError(
                f"log-Cholesky Gauss-Newton did not reach the optimum in {self.steps} steps: "
                f"a further one promises {found.promise:.2g} of {found.cost:.4g}",
                where=", ".join(self.knowledge.bodies),
                mend="give every body a prior, or the prior less uncertainty; "
                "or take the convex consistent estimate",
            )
        return problem.unknowns_at(found.x)[0]


@dataclass(frozen=True, eq=False)
class _Residuals:
    """The criterion as a sum of squares over log-Cholesky coordinates, then other parameters.

    Attributes:
        known: The unknowns of the convex program, and the data.
        root: Root of twice the prior's weight, per body; zero without prior.
        free: Indices of the other unknowns that are not given.
        given: All unknowns with those that are given, the others zero.
        lower: Of the coordinates and of the free others.
        upper: Likewise.
    """

    known: Unknowns
    root: Array
    free: Indices
    given: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, program: Program, lower: Array, upper: Array, gamma: float) -> "_Residuals":
        known = program.unknowns
        bodies, terms = 10 * len(known.priors), list(known.terms)
        scale = known.scale[terms, bodies + np.arange(len(terms))]
        ends = np.array([lower[terms], upper[terms]]) / scale
        free = np.flatnonzero(ends[0] < ends[1])
        given = np.zeros(len(known.weak))
        fixed = np.flatnonzero(ends[0] >= ends[1])
        given[bodies + fixed] = ends[0][fixed]
        open_ended = np.full(bodies, np.inf)
        return cls(
            known,
            np.sqrt(2.0 * gamma) * np.array(known.priors, dtype=np.float64),
            bodies + free,
            given,
            np.concatenate([-open_ended, ends[0][free]]),
            np.concatenate([open_ended, ends[1][free]]),
        )

    @property
    def start(self) -> Array:
        """The priors, and whatever bounds leave nearest to nothing."""
        return np.clip(np.zeros(len(self.lower)), self.lower, self.upper)

    def unknowns_at(self, x: Array) -> tuple[Array, Array]:
        """The unknowns `(m,)`, and their derivatives by the coordinates `(m, len(x))`."""
        u, slopes = self.given.copy(), np.zeros((len(self.given), len(x)))
        bodies = 10 * len(self.known.priors)
        for k in range(0, bodies, 10):
            part = slice(k, k + 10)
            u[part], slopes[part, part] = entries(x[part])
        u[self.free] = x[bodies:]
        slopes[self.free, np.arange(bodies, len(x))] = 1.0
        return u, slopes

    def at(self, x: Array) -> tuple[Array, Array]:
        """Residuals of the data, of the priors and of what is kept near zero; their derivatives."""
        u, slopes = self.unknowns_at(x)
        bodies = 10 * len(self.root)
        weak = np.sqrt(self.known.weak[self.free])
        far, each = np.zeros(bodies), np.zeros(bodies)
        for k, root in enumerate(self.root):
            part = slice(10 * k, 10 * k + 10)
            far[part], each[part] = (root * values for values in divergence(x[part]))
        residuals = [self.known.matrix @ u - self.known.vector, far, weak * u[self.free]]
        own = np.diag(np.concatenate([each, weak]))
        return np.concatenate(residuals), np.vstack([self.known.matrix @ slopes, own])


def _broken(knowledge: Knowledge, values: Parameters) -> tuple[str, ...]:
    """Wishes that were not looked at and do not hold."""
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
    return (f"wishes that this estimate does not keep: {'; '.join(labels)}",) if labels else ()
