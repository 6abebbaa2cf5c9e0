r"""Bodies that can exist and fields that are not linear, found together by Gauss–Newton.

Every pass gathers the columns with the fields' present values $v$ and, by central differences, how
they change with $\log v$. Around the present friction $\varphi_k$ the model is then linear in all
but the bodies' coordinates, with one more column $\varphi_k\,\partial a_k/\partial \log v$ per
field, and `LogCholesky` solves it; the next pass begins where that ended. `fields.find_fields`
searches from many starts and without a prior; here there is one start, but bodies, friction and
fields are at their joint optimum, and their intervals know of each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import frozen
from steelyard.errors import DataError
from steelyard.estimation.consistent.log_cholesky import LogCholesky
from steelyard.estimation.consistent.log_cholesky_passes import Joint, with_fields
from steelyard.estimation.estimate import Z95, Estimate, Standard
from steelyard.estimation.fields.fields import Finding
from steelyard.estimation.fields.passes import Said, Unknown, bounds_of, unknowns_of, value_of
from steelyard.estimation.knowledge import Knowledge
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.model import Model
from steelyard.parameters import Parameters
from steelyard.progress import Progress, silent, tell

FARTHEST = 0.7
"""Longest step of a field in one pass: about a factor of two."""

STILL = 1e-4
"""Relative change of all fields at which they stand still."""

WORSE = 4.0
"""Rise of minus twice the log likelihood at which a step was too long."""

SHORTER = 0.25
"""How much shorter the next one is."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """What was found.

    Attributes:
        model: The model with numbers in its fields.
        findings: The fields; intervals are those of a quadratic in their logarithms.
        estimate: All standard parameters.
        passes: Passes over the data that it took.
    """

    model: Model
    findings: tuple[Finding, ...]
    estimate: Estimate
    passes: int


def fit_jointly(
    model: Model,
    said: Said,
    knowledge: Knowledge,
    *,
    gamma: float | None = None,
    per_run: tuple[str, ...] = (),
    start: Mapping[Unknown, float] | None = None,
    passes: int = 40,
    progress: Progress = silent,
) -> JointFit:
    """Fit consistent bodies, all other parameters and the fields that stand as `Find`.

    Args:
        model: The model.
        said: What the data say about a regressor, see `fields.said_by`.
        knowledge: Priors of all bodies, and bounds.
        gamma: Weight of the prior; of its stated uncertainty, or found from the data, if `None`.
        per_run: Columns whose parameters every run has for itself.
        start: Fields to begin with; the middle of their bounds where not named.
        passes: Most passes over the data.
        progress: Told about every pass.

    Raises:
        DataError: The fields do not stand still, or the data are too few.
        Stopped: `progress` asked to stop.
    """
    joint = Joint.of(model, unknowns_of(model), said)
    solver = LogCholesky(joint.base, knowledge, gamma=gamma, per_run=per_run)
    given = {u: float(np.log(x)) for u, x in (start or {}).items()}
    here = {u: given.get(u, float(np.mean(bounds_of(u)))) for u in joint.unknowns}
    search = _Search(joint, solver, here)
    for number in range(passes):
        tell(progress, "finding fields and bodies", number, passes)
        if (estimate := search.passed()) is not None:
            tell(progress, "finding fields and bodies", passes, passes)
            return _result(joint, search.here, estimate, number + 1)
    raise DataError(
        f"fields and bodies do not stand still after {passes} passes over the data",
        where=", ".join(search.moving) or f"robot '{model.robot.name}'",
        mend="search the fields with find_fields, or give them values",
    )


class _Search:
    """Where the fields are, and how far they may go at once.

    The prior's weight is found once for the way and again where the fields first stand still.
    """

    def __init__(self, joint: Joint, solver: LogCholesky, here: dict[Unknown, float]) -> None:
        self.joint, self.here = joint, here
        self.moving: tuple[str, ...] = ()
        self._solver, self._wanted = solver, solver.gamma
        self._before, self._cost, self._farthest = here, np.inf, FARTHEST
        self._values: Mapping[str, float] = {}
        self._near = False

    def passed(self) -> Estimate | None:
        """One pass over the data; the estimate once nothing moves."""
        joint = self.joint
        information = joint.pass_at(self.here)
        plain = joint.mapped(information, {})
        alone = WeightedLeastSquares(per_run=self._solver.per_run)(plain)
        cost = float(2.0 * alone.n_samples @ np.log(alone.sigma))
        if cost > self._cost + WORSE and self._farthest > STILL:
            self._farthest *= SHORTER
            self.here = {u: b + SHORTER * (self.here[u] - b) for u, b in self._before.items()}
            return None
        if not self._values:
            self._values = alone.values.as_dict()
            self._solver = replace(self._solver, gamma=self._solver.weight(plain))
        wider = joint.extended(self._solver, self.here, self._farthest)
        estimate = wider(joint.mapped(information, self._values))
        self._values = estimate.values.as_dict()
        steps = {u: self._values[joint.name(u)] for u in joint.unknowns}
        self.moving = tuple(joint.name(u) for u, step in steps.items() if abs(step) >= STILL)
        if not self.moving:
            if self._near:
                return estimate
            self._near, self._solver = True, replace(self._solver, gamma=self._wanted)
        self._before, self._cost = self.here, cost
        self.here = {u: x + steps[u] for u, x in self.here.items()}
        return None


def _result(
    joint: Joint, here: Mapping[Unknown, float], estimate: Estimate, passes: int
) -> JointFit:
    """The model with its fields, and the estimate without them."""
    names = {joint.name(u) for u in joint.unknowns}
    std = dict(zip(estimate.values.names, _all(estimate).std, strict=True))
    seen = set(estimate.parameters.names)
    findings = tuple(
        _finding(joint, u, here[u], std[joint.name(u)] if joint.name(u) in seen else np.inf)
        for u in joint.unknowns
    )
    whole = _all(estimate)
    kept = [k for k, name in enumerate(whole.parameters.names) if name not in names]
    base = [k for k, name in enumerate(estimate.parameters.names) if name not in names]
    learned = np.ones(len(seen)) if estimate.learned is None else estimate.learned
    bare = replace(
        estimate,
        estimator="log-Cholesky Gauss-Newton with fields",
        parameters=_some(estimate.parameters, base),
        covariance=frozen(estimate.covariance[np.ix_(base, base)]),
        blind=tuple(b for b in estimate.blind if b.name not in names),
        learned=frozen(learned[base]),
        standard=Standard(
            _some(whole.parameters, kept),
            frozen(whole.covariance[np.ix_(kept, kept)]),
            frozen(whole.learned[kept]),
        ),
    )
    return JointFit(with_fields(joint.model, joint.unknowns, here), findings, bare, passes)


def _finding(joint: Joint, unknown: Unknown, log: float, std: float) -> Finding:
    low, high = log - Z95 * std, log + Z95 * std
    return Finding(
        term=joint.model.terms[unknown.term].law,
        field=unknown.field,
        joint=unknown.axis,
        value=value_of(unknown, log),
        interval=(value_of(unknown, low), value_of(unknown, high)),
        bounds=(unknown.find.lower, unknown.find.upper),
    )


def _all(estimate: Estimate) -> Standard:
    if estimate.standard is None:
        raise ValueError("an estimate without standard parameters")
    return estimate.standard


def _some(parameters: Parameters, places: Sequence[int]) -> Parameters:
    return Parameters(
        [parameters.names[k] for k in places],
        [parameters.units[k] for k in places],
        parameters.values[list(places)],
    )
