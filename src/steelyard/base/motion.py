"""Motion of the joints in time, and what can make it: trajectories, plants and rigs."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import DataError


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of joint position, velocity and acceleration.

    Of a robot with a floating base, `Motion.floating` puts the motion of its base before that of
    its joints.

    Attributes:
        t: Time, shape `(N,)` [s].
        q: Positions, shape `(N, n)` [rad; m for prismatic joints].
        dq: Velocities, shape `(N, n)` [rad/s; m/s].
        ddq: Accelerations, shape `(N, n)` [rad/s²; m/s²].

    Raises:
        DataError: An array has another shape, or holds what is no finite number.

    Example:
        >>> rest = [[0.0, 0.0], [0.0, 0.0]]
        >>> motion = Motion(t=[0.0, 0.1], q=[[0.1, 0.2], [0.1, 0.2]], dq=rest, ddq=rest)
        >>> motion.n_joints
        2
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array

    def __init__(self, t: ArrayLike, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> None:
        set_fields(self, t=numbers("t", t, [(None,)]))
        set_fields(self, q=numbers("q", q, [(len(self.t), None)]))
        shapes = [self.q.shape]
        set_fields(self, dq=numbers("dq", dq, shapes), ddq=numbers("ddq", ddq, shapes))

    @classmethod
    def floating(
        cls,
        t: ArrayLike,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        proper_acceleration: ArrayLike,
        angular_velocity: ArrayLike,
        angular_acceleration: ArrayLike,
        velocity: ArrayLike | None = None,
    ) -> "Motion":
        """Samples of a robot with a floating base: its base before its joints.

        Args:
            t: Time, shape `(N,)` [s].
            q: Positions of the joints, shape `(N, n)` [rad; m].
            dq: Velocities, shape `(N, n)` [rad/s; m/s].
            ddq: Accelerations, shape `(N, n)` [rad/s²; m/s²].
            proper_acceleration: Of the base frame's origin, minus gravity, as an accelerometer
                there measures it, shape `(N, 3)` [m/s²]; like all of the base, along its axes.
            angular_velocity: Of the base, shape `(N, 3)` [rad/s].
            angular_acceleration: Of the base, shape `(N, 3)` [rad/s²].
            velocity: Of the base frame's origin, shape `(N, 3)` [m/s]; only the momentum depends
                on it.

        Raises:
            DataError: An array has another shape, or holds what is no finite number.
        """
        times = numbers("t", t, [(None,)])
        joints = {
            name: numbers(name, x, [(len(times), None)])
            for name, x in (("q", q), ("dq", dq), ("ddq", ddq))
        }
        still = np.zeros((len(times), 3))
        base = {
            "proper_acceleration": proper_acceleration,
            "angular_velocity": angular_velocity,
            "angular_acceleration": angular_acceleration,
            "velocity": still if velocity is None else velocity,
        }
        given = {name: numbers(name, x, [(len(times), 3)]) for name, x in base.items()}
        return cls(
            times,
            np.hstack([still, still, joints["q"]]),
            np.hstack([given["velocity"], given["angular_velocity"], joints["dq"]]),
            np.hstack([given["proper_acceleration"], given["angular_acceleration"], joints["ddq"]]),
        )

    def __len__(self) -> int:
        return len(self.t)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])


def numbers(name: str, values: ArrayLike, shapes: Sequence[tuple[int | None, ...]]) -> Array:
    """A read-only array of finite numbers of one of the shapes, whose `None` entries are free.

    `name` is for messages; a `DataError` if it has none of the shapes, or is not finite.
    """
    array = frozen(shaped(name, values, shapes))
    check_finite(name, array)
    return array


def shaped(name: str, values: ArrayLike, shapes: Sequence[tuple[int | None, ...]]) -> Array:
    """As `numbers`, of any numbers, and no copy of what is an array of them already."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(
            f"'{name}' is no array of numbers: {error}",
            where="samples of a motion",
            fix="give a NumPy array or lists of equal lengths",
        ) from None
    if not any(
        len(shape) == array.ndim
        and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
        for shape in shapes
    ):
        letters = [
            [free if size is None else str(size) for free, size in zip("Nn", shape, strict=False)]
            for shape in shapes
        ]
        listed = [", ".join(shape) + "," * (len(shape) == 1) for shape in letters]
        accepted = " or ".join(f"({shape})" for shape in listed)
        raise DataError(
            f"'{name}' has shape {array.shape}, expected: {accepted}",
            where="samples of a motion",
            fix="give one sample as a vector, or N samples as rows with one column per joint"
            if any(len(shape) < 2 for shape in shapes)
            else "give N samples as rows with one column per joint",
        )
    return array


def check_finite(name: str, array: Array) -> None:
    """Refuse NaN and infinity in samples of a motion."""
    if not np.isfinite(array).all():
        wrong = f"'{name}' holds a value that is not finite"
        fix = "leave out samples without a number"
        raise DataError(wrong, where="samples of a motion", fix=fix)


class Trajectory(Protocol):
    """A motion that is known at every time.

    Example:
        >>> motion = read_trajectory("fit/trajectory.json", "arm.toml")
        >>> motion.sample([0.0, motion.duration]).q.shape
        (2, 2)
    """

    @property
    def duration(self) -> float:
        """Length in time [s]."""

    def sample(self, t: ArrayLike) -> Motion:
        """Position, velocity and acceleration at times `t`, shape `(N,)` or one number [s].

        Raises:
            DataError: The times are no list of finite numbers.
        """


@runtime_checkable
class Rig(Protocol):
    """A robot, real or virtual, that follows trajectories and writes logs of it."""

    def send(self, trajectory: Trajectory) -> None:
        """Follow `trajectory`; return when it is done."""

    def record(self, log: Path) -> AbstractContextManager[object]:
        """Write what is measured while the block runs to `log`."""


def run(rig: Rig, trajectory: Trajectory, log: Path) -> None:
    """Send a rig along `trajectory` and write what it measures to `log`."""
    with rig.record(log):
        rig.send(trajectory)
