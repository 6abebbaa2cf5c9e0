"""A simulated arm, the logs that its sensors write, and what a planted mistake is.

The arm is the demo arm with an invented truth; a job is two logs to be fitted and one to be
predicted.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.simulate import write_demo_arm

RATE = 200.0
SECONDS = 20.0
RESOLUTION = 2.0 * np.pi / 2**17
NOISE = 0.01
COLUMNS = ("time_s", "q{}_rad", "dq{}_rad_s", "tau{}_Nm")


@dataclass(frozen=True, eq=False)
class Log:
    """Rows of a log.

    Attributes:
        t: Stamps, shape `(N,)` [s].
        q: Positions, shape `(N, n)` [rad].
        tau: Efforts, shape `(N, n)` [Nm].
        dq: Velocities, shape `(N, n)` [rad/s]; `None` where none are logged.
    """

    t: Array
    q: Array
    tau: Array
    dq: Array | None

    def rows(self, chosen: Any) -> "Log":
        """Some of the rows."""
        dq = None if self.dq is None else self.dq[chosen]
        return Log(self.t[chosen], self.q[chosen], self.tau[chosen], dq)

    def write(self, path: Path, names: tuple[str, str, str, str]) -> None:
        """As Parquet, with joints numbered from 1."""
        columns = {names[0]: self.t}
        for name, values in zip(names[1:], (self.q, self.dq, self.tau), strict=True):
            for j in range(0 if values is None else values.shape[1]):
                columns[name.format(j + 1)] = values[:, j] if values is not None else self.t
        pl.DataFrame(columns).write_parquet(path)


@dataclass(frozen=True, eq=False)
class Job:
    """What is handed to the commands.

    Attributes:
        fitted: Logs to identify from.
        unseen: The log to be predicted.
        robot_file: TOML; empty: the commands get the URDF alone.
        urdf: The model file.
        columns: Names of time, positions, velocities and efforts.
    """

    fitted: tuple[Log, ...]
    unseen: Log
    robot_file: str
    urdf: str
    columns: tuple[str, str, str, str] = COLUMNS

    def every(self, change: Callable[[Log], Log]) -> "Job":
        """The job with all logs changed."""
        fitted = tuple(change(log) for log in self.fitted)
        return replace(self, fitted=fitted, unseen=change(self.unseen))

    def toml(self, old: str, new: str) -> "Job":
        """The job with other words in its robot file."""
        if old not in self.robot_file:
            raise ValueError(f"the robot file has no '{old}'")
        return replace(self, robot_file=self.robot_file.replace(old, new))


@dataclass(frozen=True, eq=False)
class Arm:
    """The demo arm as it really is.

    Attributes:
        seed: Of truth, motions and noise.
        robot: The robot as its model file describes it.
        truth: Its hidden values.
        robot_file: What the demo's robot file says.
        urdf: Its model file.
    """

    seed: int
    robot: Robot
    truth: Truth
    robot_file: str
    urdf: str

    @classmethod
    def drawn(cls, seed: int, folder: Path) -> "Arm":
        """An arm with another truth for every seed; the demo's files are written to a folder."""
        loaded = write_demo_arm(folder)
        text, urdf = ((folder / f"demo_arm.{kind}").read_text() for kind in ("toml", "urdf"))
        return cls(seed, loaded.robot, random_truth(loaded.robot, seed), text, urdf)

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the noise on efforts, shape `(n,)` [Nm]."""
        return np.asarray(NOISE * np.std(self.torque(self.motion(9)), axis=0))

    def motion(self, number: int, seconds: float = SECONDS, rate: float = RATE) -> Motion:
        """A motion of its own for every number."""
        path = random_fourier(
            self.robot, seed=100 * self.seed + number, period=seconds, harmonics=12
        )
        return path.sample(np.arange(0.0, seconds, 1.0 / rate))

    def torque(self, motion: Motion, truth: Truth | None = None) -> Array:
        """Joint torques of the truth, shape `(N, n)` [Nm]."""
        truth = self.truth if truth is None else truth
        return truth.model.at(truth.values).torque(motion)

    def log(self, motion: Motion, number: int, tau: Array | None = None) -> Log:
        """What the arm's encoders and torque sensors read along a motion.

        Args:
            motion: The motion.
            number: Of the noise.
            tau: The true torque, where it is not that of `truth`.
        """
        rng = np.random.default_rng([self.seed, number])
        tau = self.torque(motion) if tau is None else tau
        return Log(
            motion.t,
            np.round(motion.q / RESOLUTION) * RESOLUTION,
            tau + self.noise * rng.standard_normal(tau.shape),
            motion.dq + 1e-3 * rng.standard_normal(motion.dq.shape),
        )

    def plain(self, **motion: float) -> Job:
        """Three clean logs and the robot file."""
        logs = [self.log(self.motion(k, **motion), k) for k in range(3)]
        return Job((logs[0], logs[1]), logs[2], self.robot_file, self.urdf)

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """All joints but the first, in an order of its own for every seed."""
        own = (2, 1, 4, 3)
        rng = np.random.default_rng(self.seed)
        return own if self.seed == 1 else tuple(int(k) for k in rng.permutation(own))

    def joint(self, k: int) -> int:
        """Number of a joint: -1 is the first, -2 the last, others count `joints`."""
        return {-1: 0, -2: self.robot.n - 1}.get(k, self.joints[k])

    def loaded(self, mass: float) -> Truth:
        """The truth with a load at its last link."""
        ten = Inertia.about_com(mass, [0.02, -0.01, 0.08], np.eye(3) * 0.0025 * mass).ten
        names = [p.name for p in RigidBody().parameters(self.robot)][-10:]
        own = self.truth.inertial[-1]
        return self.truth.changed(**dict(zip(names, (own + ten).tolist(), strict=True)))


@dataclass(frozen=True, eq=False)
class Mistake:
    """One mistake, and what must be reported of it.

    Attributes:
        name: In a few words.
        plant: Makes the job of an arm.
        says: A pattern that one of `mistake_outcome.Outcome.sentences` must match; empty: nothing
            is wrong, and no finding, refusal or poor headline may say so.
        beside: Another check that may be called wrong too.
        error: True error [%] up to which nothing need be reported: then it was handled.
        untold: Why it cannot be detected from logs; empty where it can.
    """

    name: str
    plant: Callable[[Arm], Job]
    says: str = ""
    beside: str = ""
    error: float = 0.0
    untold: str = ""
