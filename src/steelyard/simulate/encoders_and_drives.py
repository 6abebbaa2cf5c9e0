"""What lies between a joint controller and the joints: encoders, dead time, lag, saturation."""

from collections import deque
from dataclasses import dataclass
from math import exp, inf, pi

import numpy as np

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.robot.robot import Robot


@dataclass(frozen=True, eq=False, kw_only=True)
class Drives:
    """Encoders that the controller reads and torque loops that it commands; perfect by default."""

    # step of the positions that the controller sees, one for all joints or shape `(n,)` [rad; m]; 0
    # is perfect
    resolution: Array | float = 0.0
    # time constant of the low-pass behind the differences of these positions [s], which are then
    # the velocities that the controller sees; `None` for true velocities
    speed_filter: float | None = None
    delay: float = 0.0  # age of the values that the controller sees [s], rounded to whole ticks
    lag: float = 0.0  # time constant of the first-order response of the torque [s]
    limits: Array | float = inf  # largest torque of each joint [Nm; N]

    def __post_init__(self) -> None:
        set_fields(self, resolution=frozen(self.resolution), limits=frozen(self.limits))
        times = (self.delay, self.lag, self.speed_filter or 0.0)
        if min(times) < 0.0 or not np.all(self.resolution >= 0.0) or not np.all(self.limits > 0.0):
            raise ModelError(
                "a time or an encoder's step is negative, or a limit of torque is not above zero",
                where="drives of the virtual robot",
                fix="give times and steps of 0 or more, and limits above 0",
            )

    @property
    def dead_time(self) -> float:
        """Delay, lag and filter together [s]."""
        return self.delay + self.lag + (self.speed_filter or 0.0)

    def seen(self, motion: Motion) -> Motion:
        """A motion, sampled at every tick, as the controller would see it with perfect encoders."""
        tick = float(motion.t[1] - motion.t[0])
        q, dq = motion.q, motion.dq
        if self.speed_filter is not None:
            from scipy.signal import lfilter

            share = _lag_share(tick, self.speed_filter)
            steps = np.diff(q, axis=0, prepend=q[:1]) / tick
            dq = lfilter([share], [1.0, share - 1.0], steps, axis=0)
        rows = np.maximum(np.arange(len(motion)) - round(self.delay / tick), 0)
        return Motion(motion.t, q[rows], dq[rows], motion.ddq[rows])


def customary_drives(robot: Robot, lag: float = 0.002) -> Drives:
    """Drives as those of a usual industrial arm.

    Encoders of 20 bits a turn (prismatic joints: 1 µm), velocities from their differences behind a
    low-pass of 1 ms, a delay of one tick, a time constant `lag` [s], and torques up to the limits
    of the joints, where a model file gives one above zero.
    """
    steps = {"revolute": 2.0 * pi / 2**20, "prismatic": 1e-6}
    return Drives(
        resolution=np.array([steps[c.kind] for c in robot.coordinates]),
        speed_filter=1e-3,
        delay=1e-3,
        lag=lag,
        limits=np.array([c.limits.effort or inf for c in robot.coordinates]),
    )


class DrivesInUse:
    """Drives in one simulation, of a robot that starts at rest at `q`, shape `(n,)`.

    Attributes:
        command: Torque that was commanded last, within the limits, shape `(n,)` [Nm; N].
    """

    def __init__(self, drives: Drives, tick: float, q: Array) -> None:
        self._drives, self._tick = drives, tick
        self.command = np.zeros_like(q)
        self._torque = np.zeros_like(q)
        self._limits = -drives.limits, drives.limits
        step = np.broadcast_to(drives.resolution, q.shape)
        rounded = step > 0.0
        self._rounding = (np.where(rounded, step, 1.0), rounded) if rounded.any() else None
        late = round(drives.delay / tick)
        seen = self._rounded(q)
        self._seen, self._speed = seen, np.zeros_like(q)
        self._queue = deque([(seen, self._speed)] * late)
        self._perfect = not (late or np.any(drives.resolution) or drives.speed_filter is not None)

    def sense(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Positions and velocities that the controller sees at a tick, each `(n,)`."""
        if self._perfect:
            return q, dq
        seen = self._rounded(q)
        speed = dq
        if self._drives.speed_filter is not None:
            share = _lag_share(self._tick, self._drives.speed_filter)
            speed = self._speed + share * ((seen - self._seen) / self._tick - self._speed)
        self._seen, self._speed = seen, speed
        self._queue.append((seen, speed))
        return self._queue.popleft()

    def actuate(self, command: Array) -> Array:
        """Torque over the next tick, shape `(n,)`: the mean of the response to a command."""
        lag, (least, most) = self._drives.lag, self._limits
        self.command = np.minimum(np.maximum(command, least), most)
        if lag == 0.0:
            return self.command
        share = _lag_share(self._tick, lag)
        rest = self._torque - self.command
        self._torque = self.command + (1.0 - share) * rest
        return np.asarray(self.command + (lag / self._tick) * share * rest)

    def _rounded(self, q: Array) -> Array:
        if self._rounding is None:
            return q
        step, rounded = self._rounding
        return np.where(rounded, np.rint(q / step) * step, q)


def _lag_share(tick: float, constant: float) -> float:
    """Share of a step that a first-order response takes within a tick."""
    return 1.0 - exp(-tick / constant) if constant > 0.0 else 1.0
