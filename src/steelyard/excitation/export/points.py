"""What exports of motions share: times, units, digits, and what a controller cannot start from."""

from math import ceil, floor

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import OutputError
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.robot.robot import Robot

MOST_POINTS = 2_000_000
"""Rows or commands that a file may hold."""

AT_REST = 1e-7
"""Speed below which a motion counts as at rest [rad/s; m/s]."""

_FRACTION = 1e-9
"""Share of a step that counts as rounding."""


def grid_times(duration: float, rate: float) -> Array:
    """Times `k / rate` from 0 on, and the end, shape `(N,)` [s].

    Raises:
        OutputError: There are too many.
    """
    _refuse_many(duration, rate)
    times = np.arange(floor(duration * rate + _FRACTION) + 1) / rate
    beyond = duration - times[-1] > _FRACTION / rate
    return np.append(times, duration) if beyond else np.minimum(times, duration)


def even_times(duration: float, rate: float) -> Array:
    """Times from 0 to the duration in equal steps, at least `rate` a second, shape `(N,)` [s].

    Raises:
        OutputError: There are too many.
    """
    _refuse_many(duration, rate)
    return np.linspace(0.0, duration, max(1, ceil(duration * rate - _FRACTION)) + 1)


def _refuse_many(duration: float, rate: float) -> None:
    if duration * rate > MOST_POINTS:
        raise OutputError(
            f"{duration:g} s at {rate:g} points per second are more than {MOST_POINTS} points",
            where="rate of the export",
            fix=f"give at most {MOST_POINTS / duration:.3g} points per second",
        )


def orders_at(trajectory: ExactTrajectory, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration at times within the motion, each `(N, n)`."""
    return trajectory.derivative(t, 0), trajectory.derivative(t, 1), trajectory.derivative(t, 2)


def refuse_moving_ends(trajectory: ExactTrajectory, robot: Robot, what: str) -> None:
    """A controller begins and ends at rest, whatever the motion states.

    Raises:
        OutputError: The motion begins or ends with a speed.
    """
    for end, time in (("begins", 0.0), ("ends", trajectory.duration)):
        speed = trajectory.derivative([time], 1)[0]
        worst = int(np.argmax(np.abs(speed)))
        if abs(speed[worst]) > AT_REST:
            joint = robot.coordinates[worst]
            raise OutputError(
                f"the motion {end} with {speed[worst]:.3g} {joint.unit}/s, "
                f"but {what} begins and ends at rest",
                where=f"joint '{joint.name}'",
                fix="design the motion from rest to rest, or with ramps",
            )


def fixed(value: float, decimals: int) -> str:
    """A number without exponent, which every controller reads as one; zero has no sign."""
    text = f"{value:.{decimals}f}"
    return text[1:] if not text.strip("-0.") and text[0] == "-" else text


def row(values: Array, decimals: int) -> str:
    """Numbers with commas between them."""
    return ", ".join(fixed(value, decimals) for value in values)


def degrees_and_millimetres(robot: Robot) -> Array:
    """Factors from rad to degrees and from m to mm, shape `(n,)`."""
    return np.array([1e3 if c.kind == "prismatic" else 180.0 / np.pi for c in robot.coordinates])


def head(trajectory: ExactTrajectory, robot: Robot, mark: str, *lines: str) -> list[str]:
    """Comment lines: what the file is, and `lines`; plain ASCII, as old controllers want it."""
    joints = ", ".join(robot.joint_names)
    title = f"Motion of robot '{robot.name}', {trajectory.duration:g} s, written by steelyard."
    texts = (title, f"Joints in this order: {joints}.", *lines)
    return [f"{mark} {_plain(text)}" for text in texts]


def _plain(text: str) -> str:
    """Text on one line of ASCII, without what ends a comment in XML."""
    return " ".join(text.encode("ascii", "replace").decode().split()).replace("--", "- -")
