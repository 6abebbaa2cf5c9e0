"""What a log shows of what happened: sampling, resolution, noise, a clock that jitters."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.robot.robot import Robot

CONTROL_RATE = 1000.0
"""Ticks of the joint controller per second [1/s]."""


@dataclass(frozen=True, eq=False)
class TrueRun:
    """What happened at every tick of the controller, without sensors.

    Attributes:
        t: Time, shape `(N,)` [s].
        q: Positions, shape `(N, n)`.
        dq: Velocities, shape `(N, n)`.
        tau: Joint torques, shape `(N, n)`: the mean of the torque held before and after the tick,
            which is the torque at that time without the half-tick delay of the hold.
    """

    t: Array
    q: Array
    dq: Array
    tau: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", frozen(self.t, (None,)))
        for name in ("q", "dq", "tau"):
            object.__setattr__(self, name, frozen(getattr(self, name), (len(self.t), None)))


@dataclass(frozen=True, eq=False, init=False)
class Sensors:
    """How a run is logged. Per-joint values are a number for all joints or shape `(n,)`.

    Attributes:
        rate: Rows per second; divides the controller's 1000.
        resolution: Step of the encoders [rad; m]; 0 is perfect.
        position_noise: Standard deviation of white noise before the encoder's step [rad; m].
        velocity_noise: Standard deviation of white noise on velocities [rad/s; m/s].
        torque_noise: Standard deviation of white noise on torques [Nm; N].
        clock_jitter: Standard deviation of each time stamp [s]; a stamp is never wrong by more than
            0.45 of the distance of two rows, so time always advances.
        velocity: Whether the log has velocity columns.
        gains: Torque per ampere [Nm/A; N/A]; given, the log has motor currents and no torques.
    """

    rate: float
    resolution: Array
    position_noise: Array
    velocity_noise: Array
    torque_noise: Array
    clock_jitter: float
    velocity: bool
    gains: Array | None

    def __init__(
        self,
        *,
        rate: float = 250.0,
        resolution: ArrayLike = 0.0,
        position_noise: ArrayLike = 0.0,
        velocity_noise: ArrayLike = 0.0,
        torque_noise: ArrayLike = 0.0,
        clock_jitter: float = 0.0,
        velocity: bool = True,
        gains: ArrayLike | None = None,
    ) -> None:
        _check_rate(rate)
        object.__setattr__(self, "rate", float(rate))
        for name, values in (
            ("resolution", resolution),
            ("position_noise", position_noise),
            ("velocity_noise", velocity_noise),
            ("torque_noise", torque_noise),
            ("clock_jitter", clock_jitter),
        ):
            sizes = frozen(values)
            if not np.all(sizes >= 0.0):
                raise ValueError(f"{name} is negative")
            object.__setattr__(self, name, sizes)
        object.__setattr__(self, "clock_jitter", float(clock_jitter))
        object.__setattr__(self, "velocity", velocity)
        object.__setattr__(self, "gains", None if gains is None else frozen(gains))
        if self.gains is not None and not np.all(self.gains):
            raise ValueError("a gain is zero")

    def read(self, run: TrueRun, robot: Robot, rng: np.random.Generator) -> dict[str, Array]:
        """The columns of the log, by name.

        Args:
            run: What happened.
            robot: Gives the units.
            rng: Source of the noise.
        """
        rows = slice(None, None, round(CONTROL_RATE / self.rate))
        t, q, dq, tau = run.t[rows], run.q[rows], run.dq[rows], run.tau[rows]
        noise_t, noise_q, noise_dq, noise_tau = (
            rng.standard_normal(values.shape) for values in (t, q, dq, tau)
        )
        bound = 0.45 / self.rate
        time = t + np.clip(self.clock_jitter * noise_t, -bound, bound)
        position = _stepped(q + self.position_noise * noise_q, self.resolution)
        velocity = dq + self.velocity_noise * noise_dq
        effort = tau + self.torque_noise * noise_tau
        if self.gains is not None:
            effort = effort / self.gains
        columns = {"time_s": time}
        for j, joint in enumerate(robot.coordinates):
            columns[f"q{j + 1}_{joint.unit}"] = position[:, j]
        for j, joint in enumerate(robot.coordinates if self.velocity else ()):
            columns[f"dq{j + 1}_{joint.unit}_s"] = velocity[:, j]
        for j, joint in enumerate(robot.coordinates):
            name = f"tau{j + 1}_{joint.effort_unit}" if self.gains is None else f"current{j + 1}_A"
            columns[name] = effort[:, j]
        return columns


def _check_rate(rate: float) -> None:
    """Raise unless rows fall on ticks of the controller."""
    every = CONTROL_RATE / rate if rate > 0.0 else 0.0
    if every < 1.0 or abs(every - round(every)) > 1e-9:
        raise DataError(
            f"a log cannot have {rate:g} rows a second",
            where=f"sensors of the virtual robot, controlled at {CONTROL_RATE:g} Hz",
            mend="take a rate that divides it: 1000, 500, 250, 200, 125, 100, ...",
        )


def _stepped(q: Array, resolution: Array) -> Array:
    """Positions rounded to the encoders' steps."""
    step = np.broadcast_to(resolution, q.shape)
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(q / safe) * safe, q) + 0.0
