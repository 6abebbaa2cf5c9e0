"""Whether logged efforts can be those of the model: of its kind and robot, with its load."""

from collections.abc import Sequence
from math import floor

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.estimate.scores.residual_traces_and_band_calibration import ResidualTrace
from steelyard.robot.robot import BASE_COORDINATES

ABSENT = 0.6  # least share of a predicted part of the efforts that an absent part lacks
EXPLAINED = 0.5  # share of the squared residual that its absence must explain
LEAST_PART_STD = 2.0  # root mean square of a part that matters, in standard deviations
REVERSED = 1.5  # lacking share from which on a part has the opposite sign rather than being absent
OPPOSITE = 0.2  # relative distance from minus the predicted effort that a reversed sign has
REVERSED_SIGN_SHARE = 0.9  # share of a joint's residual variance that a reversed sign explains
CONSTANT = 1e-9  # relative change up to which an effort never changes
CHECKED = ("gravity", "friction")  # parts of a trace, by name

FIXES = (
    "the efforts seem to be gravity-compensated: log measured efforts instead, in the form that "
    "the model was identified from",
    "the efforts seem to be measured on the link side: log them in the form that the model was "
    "identified from, or identify a model from such logs",
)
"""What to do where efforts lack one of these parts."""

PARTLY = 0.9  # share up to which gravity may be lacking by other positions or mounting

OTHER_POSTURE = (
    "; or zeros of joint positions or the mounting differ from those of the fit: steelyard check "
    "names them"
)

SIGN_FIX = (
    "give efforts the sign that they had when the model was identified, or identify a model from "
    "such logs"
)

OPPOSITES = (
    ("the efforts have the reversed sign: they contain minus the predicted gravity", SIGN_FIX),
    (
        "the velocities have the reversed sign: efforts contain minus the predicted friction",
        "give velocities with the sign with which positions change; if they have it, give efforts "
        "the sign that they had when the model was identified",
    ),
)
"""What is wrong, and what to do, where efforts contain the opposite of one of these parts."""

LEAST_EXPLAINED = 0.25  # least share of a log's squared efforts that its robot's model explains
LEAST_FITTED = 0.9  # that with a payload and friction that were fitted to the log

LARGE_RESIDUAL = 5.0
"""Root mean square of the residual in standard deviations up to which it is never refused: friction
of a robot at rest is as large."""

PUSHES = 1.5  # the same in standard deviations of efforts that are expected from outside


def refuse_other_efforts(
    trace: ResidualTrace, sigma: Array, joints: Sequence[str], pushes: Array | None = None
) -> None:
    """The efforts of a log must be of the model's kind, and of its robot.

    Compared are medians over time: contact does not last. `sigma` is the standard deviation of the
    residual of the fit, `pushes` that of efforts that are expected from outside for as long as the
    log lasts, shape `(n,)` each [Nm; N].
    """
    refuse_without(trace, sigma, joints)
    std = sigma if pushes is None else np.hypot(sigma, PUSHES / LARGE_RESIDUAL * pushes)
    squares = (np.square(x / std[:, None]) for x in (trace.residual, trace.measured))
    residual, measured = (float(np.median(np.mean(x, axis=0))) for x in squares)
    refuse_unexplained(residual, measured, trace.run, LEAST_EXPLAINED)


def refuse_unexplained(
    residual: float, measured: float, run: str, least: float, beside: str = ""
) -> None:
    """A model explains most of the efforts of its robot; squares are in variances of the fit."""
    if residual > LARGE_RESIDUAL**2 and residual > (1.0 - least) * measured:
        share = max(0.0, 1.0 - residual / measured)
        raise LogError(
            f"the model{beside} explains {floor(1000.0 * share) / 10.0:g} % of the squared efforts "
            f"of this log, less than {100.0 * least:.0f} %",
            where=run,
            fix="give a log of the robot that the model is of, with the same signals, units, tool "
            "and payload; steelyard check names what differs",
        )


def refuse_without(trace: ResidualTrace, sigma: Array, joints: Sequence[str]) -> None:
    """Efforts must be measured, and contain gravity and friction with the model's sign.

    `sigma` is the standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
    """
    predicted = np.std(trace.measured - trace.residual, axis=1)
    constant = np.ptp(trace.measured, axis=1) <= CONSTANT * np.max(np.abs(trace.measured), axis=1)
    free = {coordinate.name for coordinate in BASE_COORDINATES}  # zero where nothing touches it
    constant &= [name not in free for name in joints]
    if names := _chosen(joints, constant & (predicted > LEAST_PART_STD * sigma)):
        raise LogError(
            f"the effort of {names} never changes: its column holds no measured effort",
            where=trace.run,
            fix="log measured efforts of all joints, with the columns of the logs that the model "
            "was identified from",
        )
    whitened = trace.residual / sigma[:, None]
    wrong = OPPOSITES[1]
    for part, name, fix, contrary in zip(trace.parts, CHECKED, FIXES, OPPOSITES, strict=True):
        own = part / sigma[:, None]
        size = float(np.sum(own * own))
        if not size > LEAST_PART_STD**2 * own.size:
            continue
        share = -float(np.sum(whitened * own)) / size
        explained = share**2 * size / float(np.sum(whitened * whitened))
        wrong = min(wrong, contrary, key=OPPOSITES.index) if share > REVERSED else wrong
        if not (share > ABSENT and explained > EXPLAINED):
            continue
        if share > REVERSED:
            raise LogError(wrong[0], where=trace.run, fix=wrong[1])
        raise LogError(
            f"the efforts lack {100.0 * min(share, 1.0):.0f} % of the {name} that the model "
            "predicts",
            where=trace.run,
            fix=f"{fix}{OTHER_POSTURE}" if name == "gravity" and share < PARTLY else fix,
        )
    large, opposite = _opposite(trace, sigma)
    if opposite.any():
        every = np.array_equal(large, opposite)
        which = "efforts have" if every else f"effort of {_chosen(joints, opposite)} has"
        raise LogError(
            f"the {which} the reversed sign: measured is minus predicted effort",
            where=trace.run,
            fix=SIGN_FIX,
        )


def _opposite(trace: ResidualTrace, sigma: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Joints whose efforts change enough to know their sign, and those with the opposite."""
    own, left = (
        (x - x.mean(axis=1, keepdims=True)) / sigma[:, None]
        for x in (trace.measured - trace.residual, trace.residual)
    )
    size, squares = np.sum(own * own, axis=1), np.sum(left * left, axis=1)
    large = size > LARGE_RESIDUAL**2 * own.shape[1]
    share = -np.sum(own * left, axis=1) / np.where(large, size, 1.0)
    opposite = large & (np.abs(share - 2.0) < 2.0 * OPPOSITE)
    return large, opposite & (share * share * size > REVERSED_SIGN_SHARE * squares)


def _chosen(joints: Sequence[str], which: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, chosen in zip(joints, which, strict=True) if chosen)
