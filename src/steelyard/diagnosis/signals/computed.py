"""Are efforts measured, or computed from the motion?"""

from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Severity, percent_of
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.diagnosis.signal_overview import look, with_rows
from steelyard.diagnosis.signals.other_efforts import with_others
from steelyard.diagnosis.signals.smoothness import noise_levels
from steelyard.diagnosis.signals.units import driven, reading
from steelyard.errors import SteelyardError
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor

NOISE_FREE = 5e-4
"""Noise over all that varies, below which an effort has none. Least of the joints' largest on nine
real robots, those behind a filter aside: 9e-3; of efforts computed from a real motion: 4e-6."""
MEASURED = 1e-6
"""Noise or rounding of positions, over their variation, from which on they were measured."""
EXPLAINED = 0.005
"""Residual of a fit over the effort, below which the model explains all of it. Fits of the nine
real robots leave 0.007 to 0.36."""
MEASURE = Fix(
    "log the measured torque or the motor current, not the controller's feedforward or model torque"
)
ROWS = 20_000
"""Rows that are looked at."""
SPEED_TIME, SLOW = 0.02, 0.05
"""Time over which a speed is taken [s], and the share of the fastest below which a joint rests."""


@dataclass(frozen=True)
class ComputedEfforts:
    """Efforts without measurement noise that a rigid-body model explains entirely."""

    name: ClassVar[str] = "computed efforts"
    question: ClassVar[str] = "Are efforts measured, or computed from the motion?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves."""
        logs = [e for e in with_rows(case) if look(case, e).moves]
        return tuple(_found(case, evidence) for evidence in logs)


def _found(case: Case, evidence: Evidence) -> Finding:
    effort, position = noise_shares(case, evidence)
    if not np.isfinite(effort).any():
        says = "the noise of efforts is below their resolution, or nothing moves for long enough"
        return Finding(ComputedEfforts.name, evidence.name, Severity.OK, says, "", answered=False)
    worst = float(np.nanmax(effort))
    figure = (
        f"noise in motion {percent_of(worst)} of the effort's variation in the noisiest joint, at "
        f"least {percent_of(NOISE_FREE)} required"
    )
    if worst > NOISE_FREE:
        says = "efforts have measurement noise"
        return Finding(ComputedEfforts.name, evidence.name, Severity.OK, says, figure)
    measured = bool(np.nanmax(position, initial=0.0) > MEASURED)
    residual = _unexplained(case, evidence)
    if residual is not None:
        figure += (
            f"; residual of a fit {percent_of(residual)} of the effort, at least "
            f"{percent_of(EXPLAINED)} required"
        )
    if residual is None or residual > EXPLAINED:
        return _smooth(evidence, figure, measured)
    return _computed(evidence, figure, measured)


def _smooth(evidence: Evidence, figure: str, measured: bool) -> Finding:
    """The finding on efforts without noise that hold more than the model; doubtful if alone so."""
    says = "efforts have no measurement noise"
    says += (
        ", positions have: efforts were computed, or low-passed before they were logged"
        if measured
        else " and positions have none: both were low-passed before they were logged, or computed"
    )
    return Finding(
        ComputedEfforts.name,
        evidence.name,
        Severity.DOUBTFUL if measured else Severity.OK,
        says,
        figure,
        fix=with_others(MEASURE, evidence) if measured else None,
        answered=measured,
    )


def _computed(evidence: Evidence, figure: str, measured: bool) -> Finding:
    """The finding on efforts that are computed; all is, in a simulation without noise."""
    says = "efforts have no measurement noise, and the rigid-body model explains all of them: "
    says += (
        "they were computed from the motion, not measured, so a fit returns the parameters they "
        "were computed with, not the robot's"
        if measured
        else "as positions have no noise either, the log is a simulation or a computed command; a "
        "fit finds the parameters of that computation"
    )
    severity = Severity.WRONG if measured else Severity.DOUBTFUL
    return Finding(
        ComputedEfforts.name,
        evidence.name,
        severity,
        says,
        figure,
        fix=with_others(MEASURE, evidence),
    )


def noise_shares(case: Case, evidence: Evidence) -> tuple[Array, Array]:
    """Noise of efforts and positions over their variation, NaN where unknown, each `(n,)`."""
    overview = look(case, evidence)
    t, q, effort = overview.t[:ROWS], overview.q[:ROWS], overview.effort[:ROWS]
    moving = _moving(q, overview.step * reading(case, evidence).second) & driven(case, evidence)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (
            noise_levels(t, effort, moving) / effort.std(axis=0),
            noise_levels(t, q, moving) / q.std(axis=0),
        )


def _moving(q: Array, step: float) -> NDArray[np.bool_]:
    """Whether each joint moves at each row, shape `(N, n)`."""
    reach = max(1, round(0.5 * SPEED_TIME / max(step, 1e-9)))
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    far = np.abs(padded[2 * reach :] - padded[: -2 * reach])
    fast: NDArray[np.bool_] = far > SLOW * np.quantile(far, 0.98, axis=0)
    return fast


def _unexplained(case: Case, evidence: Evidence) -> float | None:
    """Residual of least squares over the effort, all joints together; `None` if there is none."""
    try:
        runs = clean_runs(replace(case, logs=(evidence,)))
        regressor = base_regressor(customary_model(case))
        information = reduce(add, [gather(regressor, run) for run in runs])
        fit = WeightedLeastSquares().fit(information)
    except (SteelyardError, TypeError):
        return None
    left = information.residual_squares(fit.solution.values)
    return float(np.sqrt(left.sum() / information.effort_squares().sum()))
