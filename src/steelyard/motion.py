"""Motion of the joints in time, and what can make it: trajectories, plants and rigs."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of joint position, velocity and acceleration.

    Attributes:
        t: Time, shape `(N,)` [s].
        q: Positions, shape `(N, n)` [rad; m for prismatic joints].
        dq: Velocities, shape `(N, n)` [rad/s; m/s].
        ddq: Accelerations, shape `(N, n)` [rad/s²; m/s²].

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
        object.__setattr__(self, "t", frozen(t, (None,)))
        for name, values in (("q", q), ("dq", dq), ("ddq", ddq)):
            object.__setattr__(self, name, frozen(values, (len(self.t), None)))
        if not self.q.shape == self.dq.shape == self.ddq.shape:
            raise ValueError(
                f"q, dq, ddq differ in shape: {self.q.shape}, {self.dq.shape}, {self.ddq.shape}"
            )
        for name in ("t", "q", "dq", "ddq"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} holds a value that is not finite")

    def __len__(self) -> int:
        return len(self.t)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])


class Trajectory(Protocol):
    """A motion that is known at every time."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        ...

    def sample(self, t: ArrayLike) -> Motion:
        """Position, velocity and acceleration at times `t`, shape `(N,)` [s]."""
        ...


class Rig(Protocol):
    """A robot, real or virtual, that follows trajectories and writes logs of it."""

    def send(self, trajectory: Trajectory) -> None:
        """Follow `trajectory`; return when it is done."""
        ...

    def record(self, log: Path) -> AbstractContextManager[object]:
        """Write what is measured while the block runs to `log`."""
        ...


def run(rig: Rig, trajectory: Trajectory, log: Path) -> None:
    """Send a rig along `trajectory` and write what it measures to `log`."""
    with rig.record(log):
        rig.send(trajectory)
