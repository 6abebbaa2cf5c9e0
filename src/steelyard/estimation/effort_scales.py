r"""A scale per joint of the logged efforts, estimated together with all parameters.

Sensors and published drive gains are off by some percent, those of wrists by more. Bodies are
shared by the rows of all joints, so rows whose scales differ contradict each other:
$y_j = s_j\,A_j\phi$. A Gauss-Newton step estimates $\phi$ and $w_j = \ln s_j$ together, at scales
$\bar s$ and parameters $\bar\phi$ that were reached, as a convex program over the efforts
$y_j / \bar s_j + \ln\bar s_j\,A_j\bar\phi$ with the column $A_j\bar\phi$ beside those of row $j$,
where $w_j$ has the standard deviation that is known of it before the data.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.estimation.consistent.consistent import Consistent, inverse_of
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.normal_equations import condition_of
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.parameters import Parameters
from steelyard.regression.information import Information
from steelyard.regression.predicted import with_predicted

DEVIATION = 0.1
"""Standard deviation of a scale's logarithm before the data."""

ROUNDS = 12
"""Most Gauss-Newton steps."""

LONGEST = 0.5
"""Longest step of a logarithm."""

TOLERANCE = 1e-3
"""Step of a logarithm at which the search has converged."""

LAW = "effort_scale"


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales and what they were found with.

    Attributes:
        values: Logged effort over that of the model, shape `(rows,)`.
        covariance: Of their logarithms, shape `(rows, rows)`.
        parameters: Of the information's columns, shape `(p,)`.
        gamma: Weight of the prior of the bodies.
        standard: All standard parameters, then the logarithms of the scales.
    """

    values: Array
    covariance: Array
    parameters: Array
    gamma: float
    standard: Array

    @property
    def std(self) -> Array:
        """Standard deviations of the logarithms, shape `(rows,)`."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def distance(self) -> float:
        """Squared distance of all logarithms from zero, in what is left open of them."""
        logs = np.log(self.values)
        return float(logs @ np.linalg.solve(self.covariance, logs))


@dataclass(frozen=True, eq=False)
class Scaled:
    """The consistent estimate with a scale of each row's efforts.

    Attributes:
        estimator: The estimate without.
        rows: Names of the rows.
        deviation: Standard deviation of a scale's logarithm before the data.
    """

    estimator: Consistent
    rows: tuple[str, ...]
    deviation: float = DEVIATION

    def unscaled(self, information: Information, gamma: float | None = None) -> Scales:
        """All scales 1, with a weight of the prior; of that which the estimate finds, if `None`.

        Raises:
            DataError: As of the estimate.
        """
        found, n = self.estimator.values(information, gamma), len(self.rows)
        standard = np.concatenate([found.standard, np.zeros(n)])
        return Scales(
            np.ones(n), self.deviation**2 * np.eye(n), found.values, found.gamma, standard
        )

    def step(self, information: Information, at: Scales, *, weigh: bool = False) -> Scales:
        """One Gauss-Newton step.

        Args:
            information: What the data say, efforts as logged.
            at: The scales and parameters that were reached.
            weigh: Whether the weight of the prior is found anew.

        Raises:
            DataError: As of the estimate.
        """
        wide, gamma = self._wide, at.gamma
        program = wide.program(whitened(self._extended(information, at), equal=wide.equal))
        if weigh:
            tried = wide.weighed(program).tried
            u, gamma = tried.u, tried.gamma
        else:
            u = wide.solve(program, gamma, program.unknowns.of_standard(at.standard))
        standard = program.unknowns.standard(u)
        logs, before = standard[-len(self.rows) :], np.log(at.values)
        logs = before + np.clip(logs - before, -LONGEST, LONGEST)
        precision = program.stated_precision(u, gamma)
        precision += program.unknowns.matrix.T @ program.unknowns.matrix
        n = len(self.rows)
        spread = self.deviation**2 * inverse_of(precision)[-n:, -n:]
        return Scales(
            np.exp(logs),
            spread,
            self._of_columns(information, self.estimator.base.lift @ standard[: -len(self.rows)]),
            gamma,
            standard,
        )

    def converged(self, information: Information, at: Scales, *, weigh: bool = False) -> Scales:
        """Steps until the scales stand still; arguments and errors as of `step`.

        The weight is found when they do, and once more when they do with it.
        """
        weighing = False
        for _ in range(ROUNDS):
            found = self.step(information, at, weigh=weighing)
            steady = np.abs(np.log(found.values / at.values)).max() < TOLERANCE
            at = found
            if steady and (weighing or not weigh):
                break
            weighing = weigh and steady
        return at

    def estimate(self, information: Information, scales: Scales) -> Estimate:
        """The estimate of efforts in the model's scale, as unsure as the scales make it.

        Condition numbers are those of the parameters, without the scales.

        Args:
            information: What the data say, efforts already divided by the scales.
            scales: The scales.

        Raises:
            DataError: As of the estimate without.
        """
        names = self._names
        logged = information.scaled(scales.values, information.signature.effort)
        found = _without(self._wide(self._extended(logged, scales)), names)
        own = whitened(information, equal=self.estimator.equal).fit.solution
        return replace(
            found,
            condition=condition_of(own.singular),
            condition_normalised=condition_of(own.singular_normalised),
        )

    def _extended(self, information: Information, at: Scales) -> Information:
        scaled = information.scaled(1.0 / at.values, information.signature.effort)
        return with_predicted(scaled, at.parameters, self._names, np.log(at.values))

    def _of_columns(self, information: Information, lifted: Array) -> Array:
        known = dict(zip(self.estimator.base.base_names, lifted.tolist(), strict=True))
        return np.array([known.get(name, 0.0) for name in information.layout.columns])

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"{LAW}.{row}" for row in self.rows)

    @cached_property
    def _wide(self) -> Consistent:
        """The estimator over the scales' logarithms beside all parameters."""
        base, known, names = self.estimator.base, self.estimator.knowledge, self._names
        n = len(names)
        knowledge = replace(
            known,
            names=(*known.names, *names),
            lower=np.append(known.lower, np.full(n, -np.inf)),
            upper=np.append(known.upper, np.full(n, np.inf)),
            deviations={**known.deviations, **dict.fromkeys(names, self.deviation)},
        )
        return replace(self.estimator, base=base.beside(names, ["1"] * n), knowledge=knowledge)


def _without(estimate: Estimate, names: tuple[str, ...]) -> Estimate:
    """The estimate without some of its parameters."""
    if estimate.standard is None or estimate.learned is None:
        raise ValueError("a consistent estimate has standard parameters")
    kept = [k for k, name in enumerate(estimate.parameters.names) if name not in names]
    whole = estimate.standard
    rest = [k for k, name in enumerate(whole.parameters.names) if name not in names]
    return replace(
        estimate,
        parameters=_some(estimate.parameters, kept),
        covariance=frozen(estimate.covariance[np.ix_(kept, kept)]),
        blind=tuple(blind for blind in estimate.blind if blind.name not in names),
        learned=frozen(estimate.learned[kept]),
        standard=replace(
            whole,
            parameters=_some(whole.parameters, rest),
            covariance=frozen(whole.covariance[np.ix_(rest, rest)]),
            learned=frozen(whole.learned[rest]),
        ),
    )


def _some(parameters: Parameters, kept: list[int]) -> Parameters:
    return Parameters(
        tuple(parameters.names[k] for k in kept),
        tuple(parameters.units[k] for k in kept),
        parameters.values[kept],
    )
