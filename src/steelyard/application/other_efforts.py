"""Logs whose efforts are not those of the model: of another kind, of another robot, with a load."""

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.validation.residual_traces import ResidualTrace

ABSENT = 0.6
"""Share of a predicted part of the efforts that must be lacking for it to count as absent."""

EXPLAINED = 0.5
"""Share of the squared residual that its absence must explain."""

MATTERS = 2.0
"""Root mean square of the part in standard deviations of the residual from which on it matters."""


CHECKED = ("gravity", "friction")
"""Parts of a trace, by name."""

FIXES = (
    "the efforts seem to be gravity-compensated: log measured efforts instead, in the form that "
    "the model was identified from",
    "the efforts seem to be measured behind the gears: log them in the form that the model was "
    "identified from, or identify a model from such logs",
)
"""What to do where efforts lack one of these parts."""

LEAST_EXPLAINED = 0.25
"""Share of the squared efforts of a log that the model of its robot explains, at least."""

LEAST_FITTED = 0.9
"""That with a payload and friction that were fitted to the log."""

LARGE = 5.0
"""Root mean square of the residual in standard deviations up to which it is never refused: friction
of a robot at rest is as large."""


def refuse_other_efforts(trace: ResidualTrace, sigma: Array) -> None:
    """The efforts of a log must be of the model's kind, and of its robot.

    Compared are medians over time: contact does not last.

    Args:
        trace: Residuals of the log.
        sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].

    Raises:
        LogError: They lack gravity or friction, or the model does not explain them.
    """
    refuse_without(trace, sigma)
    squares = (np.square(x / sigma[:, None]) for x in (trace.residual, trace.measured))
    residual, measured = (float(np.median(np.mean(x, axis=0))) for x in squares)
    refuse_unexplained(residual, measured, trace.run, LEAST_EXPLAINED)


def refuse_unexplained(
    residual: float, measured: float, run: str, least: float, beside: str = ""
) -> None:
    """A model explains most of the efforts of its robot.

    Args:
        residual: Square of the efforts that are not explained, in variances of the fit.
        measured: That of all efforts.
        run: Name of the log.
        least: Share that must be explained.
        beside: What explains efforts beside the model, such as ` with any payload`.

    Raises:
        LogError: Less is explained, and the residual is large.
    """
    if residual > LARGE**2 and residual > (1.0 - least) * measured:
        share = max(0.0, 1.0 - residual / measured)
        raise LogError(
            f"the model{beside} explains {100.0 * share:.0f} % of the squared efforts of this log, "
            f"less than {100.0 * least:.0f} %",
            where=run,
            fix="give a log of the robot that the model is of, with the same signals, units, tool "
            "and payload; steelyard check names what differs",
        )


def refuse_without(trace: ResidualTrace, sigma: Array) -> None:
    """Efforts must contain gravity and friction as the model has them.

    Raises:
        LogError: The residual is minus the predicted gravity, or minus the predicted friction.
    """
    whitened = trace.residual / sigma[:, None]
    for part, name, fix in zip(trace.parts, CHECKED, FIXES, strict=True):
        own = part / sigma[:, None]
        size = float(np.sum(own * own))
        if not size > MATTERS**2 * own.size:
            continue
        share = -float(np.sum(whitened * own)) / size
        explained = share**2 * size / float(np.sum(whitened * whitened))
        if share > ABSENT and explained > EXPLAINED:
            raise LogError(
                f"the efforts lack {100.0 * share:.0f} % of the {name} that the model predicts",
                where=trace.run,
                fix=fix,
            )
