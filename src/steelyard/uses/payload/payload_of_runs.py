"""The payload of a robot from loaded runs, and payloads that the model does not have."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.errors import DataError, SteelyardError
from steelyard.estimate.estimate import Z95
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.load_case import LoadCase, carrier, load_case, refuse_foreign
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.robot.file.efforts import MOTOR_KINDS
from steelyard.uses.other_efforts import LEAST_FITTED, refuse_unexplained
from steelyard.uses.payload.payload_body import PayloadKnowledge
from steelyard.uses.payload.weighing import CaseFit, fitted_case, weighed

FRICTION_DRIFT = 0.5
"""Drift of friction and offset from run to run, relative to the effort they make in each joint."""

GAIN_RELATIVE_STD = 0.02
"""Relative standard deviation of the gains of motors' efforts that are given without one."""


def identify_payload(
    identified: IdentifiedModel,
    loaded: Sequence[Information],
    frame: str | None = None,
    *,
    unloaded: Sequence[Information] = (),
    drift: float = FRICTION_DRIFT,
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
        gain: Relative standard deviation of each gain of the efforts; if `None`,
            `GAIN_RELATIVE_STD` where efforts are currents, or nothing beside scales that were
            identified with the model.
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
    runs = information.runs
    refuse_unexplained(residual, measured, runs, LEAST_FITTED, " with any payload")


def gain_share(identified: IdentifiedModel, stated: float | None) -> float:
    """Relative standard deviation of each gain.

    Efforts of motors are currents times a constant, whatever their unit.
    """
    if stated is not None:
        return stated
    of_motors = identified.signals.effort_kind in MOTOR_KINDS
    return GAIN_RELATIVE_STD if of_motors and identified.effort_scales is None else 0.0


def _refuse_unanswerable(loaded: Sequence[Information], drift: float, gain: float) -> None:
    if not loaded:
        raise DataError(
            "there is no run with the payload",
            where="identification of a payload",
            fix="give at least one log of the loaded robot",
        )
    refuse_uncertainties(drift, gain)


def refuse_uncertainties(drift: float, gain: float) -> None:
    """Relative uncertainties of friction and gains are not negative."""
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


CERTAIN_PAYLOAD_STD = 3.0
"""Standard deviations of its mass from which on there is one."""

LEAST_PAYLOAD_SHARE = 0.02
"""Least mass that is reported, over that of the moving links."""


def unknown_payload(identified: IdentifiedModel, run: Information) -> PayloadEstimate | None:
    """What a run carries beyond doubt; `None` if there is nothing, or no way to know.

    Args:
        identified: The robot without it.
        run: What the run says, efforts as logged.
    """
    if identified.signals.effort_kind == "gravity_compensated_torque":
        return None
    try:
        found = identify_payload(identified, [run])
    except SteelyardError:
        return None
    least = LEAST_PAYLOAD_SHARE * sum(body.inertia.mass for body in identified.model.robot.bodies)
    heavy = found.mass > max(least, CERTAIN_PAYLOAD_STD / Z95 * float(found.half_width[0]))
    return found if heavy else None


def payload_words(found: PayloadEstimate, run: str) -> str:
    """What to say of it."""
    return (
        f"the efforts of {run} are those with a payload of {found.mass:.2f} ± "
        f"{found.half_width[0]:.2f} kg on '{found.body}' that the model does not have, or with "
        "other drive gains: see steelyard payload"
    )
