"""Scores on a run that was not fitted: how far the predicted effort is from the measured one.

Per joint `100 ‖measured - predicted‖ / ‖measured‖`, from first to last motion, both sides through
one zero-phase fourth-order Butterworth low-pass; once over all samples, once over those where the
joint moves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.lowpass import zero_phase
from steelyard.measurement.open_loops import closed_only
from steelyard.measurement.run import Run, RunData
from steelyard.model import ValuedModel
from steelyard.motion import Motion


@dataclass(frozen=True)
class JointScore:
    """Errors of one joint, in the unit of its logged effort.

    Attributes:
        joint: The joint.
        unit: `A`, `Nm` or `N`.
        relative_percent: Error relative to the measured effort, all samples [%].
        relative_percent_moving: The same where the joint moves; `None` if it never does.
        rmse: Root mean square error.
        predict_zero: RMSE of predicting zero: the measured effort's own root mean square.
        prior_rmse: RMSE of the nominal model of the robot's file; `None` if there is none.
    """

    joint: str
    unit: str
    relative_percent: float
    relative_percent_moving: float | None
    rmse: float
    predict_zero: float
    prior_rmse: float | None


@dataclass(frozen=True, eq=False)
class Traces:
    """Filtered effort along a run, in its logged unit: `t` is `(N,)`, the others `(N, n)`."""

    t: Array
    measured: Array
    predicted: Array
    moving: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RunScore:
    """Scores of one run.

    Attributes:
        run: The run's name.
        cutoff: Cut-off of the low-pass on both sides [Hz].
        joints: One score per joint.
        pooled_percent: Norms taken over all joints together [%]; `None` if units differ.
        pooled_percent_moving: The same where each joint moves.
        traces: The compared signals.
    """

    run: str
    cutoff: float
    joints: tuple[JointScore, ...]
    pooled_percent: float | None
    pooled_percent_moving: float | None
    traces: Traces

    @property
    def mean_percent(self) -> float:
        """Mean over joints of the relative error [%]."""
        return float(np.mean([j.relative_percent for j in self.joints]))

    @property
    def mean_percent_moving(self) -> float | None:
        """Mean over joints that move of the relative error where they move [%]."""
        moving = [j.relative_percent_moving for j in self.joints]
        known = [x for x in moving if x is not None]
        return float(np.mean(known)) if known else None

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the traces; an error without a finite percentage is `None`."""
        figures = {
            "run": self.run,
            "cutoff": self.cutoff,
            "mean_percent": self.mean_percent,
            "mean_percent_moving": self.mean_percent_moving,
            "pooled_percent": self.pooled_percent,
            "pooled_percent_moving": self.pooled_percent_moving,
        }
        return _finite(figures) | {"joints": [_finite(vars(joint)) for joint in self.joints]}


def score(
    valued: ValuedModel,
    run: Run,
    gains: Array,
    cutoff: float,
    prior: ValuedModel | None = None,
) -> RunScore:
    """Compare a model with a run.

    Args:
        valued: The model.
        run: A run that was not fitted.
        gains: Joint effort per logged unit, shape `(n,)`.
        cutoff: Cut-off of the low-pass on both sides [Hz].
        prior: Nominal model, to be scored beside it.

    Raises:
        LogError: The cut-off is too high for the run's rate.
    """
    data = closed_only(run.whole(), valued.model.robot)
    moving = data.moving

    def filtered(effort: Array) -> Array:
        result = np.empty_like(effort)
        for segment in np.unique(data.segment):
            inside = data.segment == segment
            result[inside] = zero_phase(effort[inside], cutoff, run.rate)
        return result

    measured = filtered(data.effort)
    predicted = filtered(_torque(valued, data) / gains)
    nominal = None if prior is None else filtered(_torque(prior, data) / gains)
    error = measured - predicted
    joints = []
    for j, coordinate in enumerate(valued.model.robot.coordinates):
        mask = moving[:, j]
        joints.append(
            JointScore(
                joint=coordinate.name,
                unit=run.effort_units[j],
                relative_percent=_percent(error[:, j], measured[:, j]),
                relative_percent_moving=(
                    _percent(error[mask, j], measured[mask, j]) if mask.any() else None
                ),
                rmse=_rms(error[:, j]),
                predict_zero=_rms(measured[:, j]),
                prior_rmse=None if nominal is None else _rms(measured[:, j] - nominal[:, j]),
            )
        )
    comparable = len(set(run.effort_units)) == 1
    return RunScore(
        run=run.name,
        cutoff=cutoff,
        joints=tuple(joints),
        pooled_percent=_percent(error, measured) if comparable else None,
        pooled_percent_moving=(
            _percent(error[moving], measured[moving]) if comparable and moving.any() else None
        ),
        traces=Traces(data.t, measured, predicted, moving),
    )


def _torque(valued: ValuedModel, data: RunData) -> Array:
    """Predicted efforts, shape `(N, n)`; what a model remembers ends with a segment."""
    result = np.empty_like(data.effort)
    for segment in np.unique(data.segment):
        inside = data.segment == segment
        m = data.motion
        part = Motion(m.t[inside], m.q[inside], m.dq[inside], m.ddq[inside])
        result[inside] = valued.torque(part)
    return result


def _finite(figures: Mapping[str, Any]) -> dict[str, Any]:
    """JSON knows no infinity."""
    return {
        name: None if isinstance(value, float) and not isfinite(value) else value
        for name, value in figures.items()
    }


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x)))


def _percent(error: Array, reference: Array) -> float:
    """A joint that draws no effort at all has no relative error: any error is then infinite."""
    size = float(np.linalg.norm(reference))
    wrong = float(np.linalg.norm(error))
    if size == 0.0:
        return 0.0 if wrong == 0.0 else float("inf")
    return 100.0 * wrong / size
