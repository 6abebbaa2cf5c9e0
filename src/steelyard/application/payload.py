"""The payload of a robot from loaded runs and an identified model."""

from collections.abc import Sequence

import numpy as np

from steelyard.application.other_efforts import LEAST_FITTED, refuse_unexplained
from steelyard.errors import DataError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.payload.consistent_body import PayloadKnowledge
from steelyard.estimation.payload.load import PayloadEstimate
from steelyard.estimation.payload.load_case import LoadCase, carrier, load_case, refuse_foreign
from steelyard.estimation.payload.weighing import CaseFit, fitted_case, weighed
from steelyard.regression.information import Information
from steelyard.robot_file.efforts import MOTOR_KINDS

DRIFT = 0.5
"""Drift of friction and offset from run to run, relative to the effort they make in each joint."""

GAIN = 0.02
"""Relative standard deviation of the gains of motors' efforts that are given without one."""


def identify_payload(
    identified: IdentifiedModel,
    loaded: Sequence[Information],
    frame: str | None = None,
    *,
    unloaded: Sequence[Information] = (),
    drift: float = DRIFT,
    gain: float | None = None,
    known: PayloadKnowledge | None = None,
) -> PayloadEstimate:
    """Weigh what a robot carries: a physically consistent body.

    Args:
        identified: The robot without the payload. Its covariance says how far its parameters may
            move; with unloaded runs they are found from the runs alone.
        loaded: What runs with the payload say, one by one, efforts as logged.
        frame: The frame to give the numbers in; that of the last link if `None`.
        unloaded: What runs without the payload say, one by one.
        drift: Standard deviation of each run's friction and offset, relative to the effort that
            they make together in a joint; with 0 they are those of the model.
        gain: Relative standard deviation of each gain of the efforts; if `None`, `GAIN` where
            efforts are currents, or nothing beside scales that were identified with the model.
        known: What is known of the payload beside.

    Raises:
        ModelError: There is no such frame, or it does not move.
        DataError: The runs were gathered with another model, or see nothing of the payload.
    """
    share = gain_share(identified, gain)
    _refuse_unanswerable(loaded, drift, share)
    refuse_foreign(identified.model, (*unloaded, *loaded))
    carries = carrier(identified.model.robot, frame)
    gains, units = identified.signals.gains, identified.model.robot.effort_units
    case = load_case(
        identified.model,
        identified.base,
        carries,
        [run.scaled(gains, units) for run in unloaded],
        [run.scaled(gains, units) for run in loaded],
        first_deviates=True,
        drifts=drift > 0.0,
        zero={one.name for one in identified.estimate.removed},
    )
    fit = fitted_case(identified, case, bool(unloaded), drift)
    if not unloaded:
        refuse_unexplained_case(identified, case, fit)
    some = PayloadKnowledge() if known is None else known
    return weighed(identified, case, fit, case.payload, carries, bool(unloaded), drift, share, some)


def refuse_unexplained_case(identified: IdentifiedModel, case: LoadCase, fit: CaseFit) -> None:
    """The model and what the arm carries explain most of the efforts.

    Args:
        identified: The robot without payload.
        case: The runs.
        fit: The fit of them.

    Raises:
        LogError: They do not.
    """
    information, values = case.information, fit.values.copy()
    known = identified.estimate.parameters.as_dict()
    for k, name in enumerate(information.layout.columns[: case.n_arm]):
        values[k] = known.get(name, values[k])
    variances = np.square(identified.estimate.sigma)
    left = information.residual_squares(values)
    count = float(information.n_samples.sum())
    residual, measured = (
        float(np.sum(squares / variances)) / count
        for squares in (left, information.effort_squares())
    )
    runs = ", ".join(dict.fromkeys(window.run for window in information.windows))
    refuse_unexplained(residual, measured, runs, LEAST_FITTED, " with any payload")


def gain_share(identified: IdentifiedModel, stated: float | None) -> float:
    """Relative standard deviation of each gain.

    Efforts of motors are currents times a constant, whatever their unit.
    """
    if stated is not None:
        return stated
    of_motors = identified.signals.effort_kind in MOTOR_KINDS
    return GAIN if of_motors and identified.effort_scales is None else 0.0


def _refuse_unanswerable(loaded: Sequence[Information], drift: float, gain: float) -> None:
    if not loaded:
        raise DataError(
            "there is no run with the payload",
            where="identification of a payload",
            fix="give at least one log of the loaded robot",
        )
    refuse_uncertainties(drift, gain)


def refuse_uncertainties(drift: float, gain: float) -> None:
    """Relative uncertainties of friction and gains are not negative.

    Raises:
        DataError: One is, or is out of range.
    """
    if not drift >= 0.0:
        raise DataError(
            f"the drift of friction is {drift:g}",
            where="identification of a payload",
            fix="give 0 for the model's friction, or a relative change such as 0.5",
        )
    if not 0.0 <= gain < 1.0:
        raise DataError(
            f"the relative uncertainty of the drive gains is {gain:g}",
            where="identification of a payload",
            fix="give 0 for exact gains, or a share such as 0.02",
        )
