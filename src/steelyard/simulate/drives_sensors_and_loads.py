"""What a log shows by its sensors; drives; loads, and outside wrenches on frames."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, inf, pi
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import DataError, LogError, ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.external.wrench_methods_and_observer_step import moved_frame
from steelyard.logs.formats import open_log
from steelyard.robot.file.sections import EffortKind
from steelyard.robot.file.signals import ROW, Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

_STEEL = 7800.0  # density [kg/m³]


@dataclass(frozen=True)
class Payload:
    """A body that is fixed to a frame of the robot between two times."""

    inertia: Inertia  # its ten numbers, about the frame's origin and along its axes
    frame: str
    attach: float = 0.0  # when it is taken [s], from the start of the log
    release: float = float("inf")  # when it is let go [s]

    def __post_init__(self) -> None:
        flaw = self.inertia.flaw()
        if flaw is not None or not 0.0 <= self.attach < self.release:
            times = f"attached at {self.attach:g} s, released at {self.release:g} s"
            raise ModelError(
                "the payload is "
                + (times if flaw is None else f"not physically consistent: {flaw}"),
                where=f"payload on '{self.frame}'",
                fix="give mass properties of a real body, and times 0 <= attach < release",
            )

    @classmethod
    def ball(
        cls, mass: float, frame: str, attach: float = 0.0, release: float = float("inf")
    ) -> "Payload":
        """A steel ball of a mass [kg] around the frame's origin."""
        radius = (mass / (_STEEL * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
        moments = 0.4 * mass * radius**2 * np.eye(3)
        return cls(Inertia.about_com(mass, np.zeros(3), moments), frame, attach, release)

    def carried(self, t: Array) -> Array:
        """Whether it is carried at times `t`, as booleans."""
        return np.asarray((t >= self.attach) & (t < self.release))

    def added(self, robot: Robot, inertial: Array) -> Array:
        """The bodies' ten numbers, `(n_bodies, 10)`, with the payload on them."""
        frame = moved_frame(robot, self.frame)
        loaded = inertial.copy()
        loaded[frame.body] += self.inertia.moved(frame.rotation, frame.position).ten
        return loaded


WRENCH_COLUMNS = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")  # in files and in logs

Axes = Literal["base", "frame"]


@dataclass(frozen=True, eq=False)
class AppliedWrench:
    """Forces and torques that act on a robot at the origin of a frame."""

    frame: str
    t: Array  # times from the start of the log, increasing, shape `(K,)` [s]
    # force and torque from each time until the next one, shape `(K, 6)` [N, Nm]; zero before the
    # first time, the last row stays
    values: Array
    axes: Axes = "base"  # whether they are along the axes of the base or of the frame

    def __post_init__(self) -> None:
        set_fields(self, t=frozen(self.t, (None,)), values=frozen(self.values, (len(self.t), 6)))
        finite = np.isfinite(self.t).all() and np.isfinite(self.values).all()
        if not len(self.t) or not finite or not np.all(np.diff(self.t) > 0.0):
            raise DataError(
                "times do not increase, or a value is no finite number",
                where=f"wrench on '{self.frame}'",
                fix="give rows with increasing times and six finite numbers each",
            )

    def at(self, t: Array) -> Array:
        """Force and torque at times `t`, shape `(N,)`: shape `(N, 6)`."""
        rows = np.searchsorted(self.t, t, side="right")
        return np.concatenate([np.zeros((1, 6)), self.values])[rows]


def read_wrench(path: Path, frame: str, axes: Axes = "base") -> AppliedWrench:
    """The wrench in a table with the columns `time_s`, `fx_N` to `fz_N`, `tx_Nm` to `tz_Nm`."""
    names = ("time_s", *WRENCH_COLUMNS)
    try:
        table = open_log(path)
        missing = [name for name in names if name not in table.columns]
        rows = None if missing else np.concatenate([np.zeros((0, 7)), *table.parts(names)])
    except LogError as error:
        raise DataError(error.wrong, where=error.where, fix=error.fix) from error
    if rows is None:
        raise DataError(
            f"the wrench has no column '{missing[0]}'",
            where=str(path),
            fix=f"give the columns {', '.join(names)}",
        )
    return AppliedWrench(frame, rows[:, 0], rows[:, 1:], axes)


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
        late = round(drives.delay / tick)
        seen = _stepped(q, self._drives.resolution)
        self._seen, self._speed = seen, np.zeros_like(q)
        self._queue = deque([(seen, self._speed)] * late)
        self._perfect = not (late or np.any(drives.resolution) or drives.speed_filter is not None)

    def sense(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Positions and velocities that the controller sees at a tick, each `(n,)`."""
        if self._perfect:
            return q, dq
        seen = _stepped(q, self._drives.resolution)
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


def _lag_share(tick: float, constant: float) -> float:
    """Share of a step that a first-order response takes within a tick."""
    return 1.0 - exp(-tick / constant) if constant > 0.0 else 1.0


CONTROL_RATE = 1000.0  # ticks of the joint controller per second [1/s]

ERRORS = ("resolution", "position_noise", "velocity_noise", "torque_noise", "wrench_noise")


@dataclass(frozen=True, eq=False)
class TrueRun:
    """What happened at every tick of the controller, without sensors."""

    t: Array
    q: Array
    dq: Array
    # joint torques, shape `(N, n)`: the mean of the torque held before and after the tick, which is
    # the torque at that time without the half-tick delay of the hold
    tau: Array
    motor_side: Array  # the part of it that rotors and friction of motors take, shape `(N, n)`
    gravity: Array  # the part of it that holds the bodies, without payload, shape `(N, n)`
    commanded: Array  # desired positions and velocities and commanded torques, shape `(3, N, n)`
    wrench: Array | None  # outside, on a frame along its axes, shape `(N, 6)` [N, Nm]

    def __post_init__(self) -> None:
        given = {name: x for name, x in vars(self).items() if x is not None}
        set_fields(self, **{name: frozen(x) for name, x in given.items()})

    def effort(self, kind: EffortKind) -> Array:
        """The effort that a sensor of a kind feels, as joint torques, shape `(N, n)`."""
        if kind == "link_torque":
            return np.asarray(self.tau - self.motor_side)
        if kind == "gravity_compensated_torque":
            return np.asarray(self.tau - self.gravity)
        return self.tau


@dataclass(frozen=True, eq=False)
class Reading:
    """What sensors say of a run, of the joints and in SI units; rows of the log."""

    t: Array
    q: Array
    dq: Array
    effort: Array
    commanded: Array  # as of `TrueRun`
    # what a force and torque sensor says, shape `(N, 6)` [N, Nm]; `None` without one
    wrench: Array | None

    def further(self, robot: Robot) -> dict[str, Array]:
        """Columns that no robot file declares: of the controller, and of the wrench."""
        columns = {}
        joints = robot.coordinates if self.commanded.size else ()
        names = ("q_cmd{0}_{1.unit}", "dq_cmd{0}_{1.unit}_s", "tau_cmd{0}_{1.effort_unit}")
        for name, values in zip(names, self.commanded, strict=True):
            for j, joint in enumerate(joints):
                columns[name.format(j + 1, joint)] = values[:, j]
        if self.wrench is not None:
            columns |= dict(zip(WRENCH_COLUMNS, self.wrench.T, strict=True))
        return columns


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensors:
    """How a run is logged. Per-joint values are a number for all joints or shape `(n,)`.

    `dataclasses.replace` changes some of it.
    """

    # rows per second, at most the controller's 1000; between its ticks values are interpolated
    rate: float = 250.0
    resolution: Array | float = 0.0  # step of the encoders [rad; m]; 0 is perfect
    position_noise: Array | float = 0.0  # standard deviation of white noise [rad; m]
    velocity_noise: Array | float = 0.0  # standard deviation of white noise [rad/s; m/s]
    torque_noise: Array | float = 0.0  # standard deviation of white noise on torques [Nm; N]
    # standard deviation of each time stamp [s]; a stamp is never wrong by more than 0.45 of the
    # distance of two rows, so time always advances
    clock_jitter: float = 0.0
    # standard deviation of white noise on an outside wrench, one for all or shape `(6,)` [N, Nm]
    wrench_noise: Array | float = 0.0
    commanded: bool = False  # whether the log has the desired motion and commanded torques
    velocity: bool = True  # whether the log has velocity columns
    # torque per ampere [Nm/A; N/A]; given, the log has motor currents and no torques, unless a
    # robot file says what it has
    gains: Array | None = None
    # kind of effort that is logged; motor torques go through the robot's transmission
    effort: EffortKind = "joint_torque"

    def __post_init__(self) -> None:
        if not 0.0 < self.rate <= CONTROL_RATE:
            raise DataError(
                f"a log cannot have {self.rate:g} rows a second",
                where=f"sensors of the virtual robot, controlled at {CONTROL_RATE:g} Hz",
                fix=f"give a rate above 0 and at most {CONTROL_RATE:g}",
            )
        for name in (*ERRORS, "clock_jitter"):
            if not np.all(np.asarray(getattr(self, name)) >= 0.0):
                raise ValueError(f"{name} is negative")
        set_fields(self, **{name: frozen(getattr(self, name)) for name in ERRORS})
        if self.gains is not None:
            set_fields(self, gains=frozen(self.gains))
            if not np.all(self.gains):
                raise ValueError("a gain is zero")

    def measure(
        self, run: TrueRun, rng: np.random.Generator, kind: EffortKind | None = None
    ) -> Reading:
        """What the sensors say, of the kind of effort that is theirs if `None`."""
        effort = run.effort(self.effort if kind is None else kind)
        t, q, dq, effort = map(self._sampled, (run.t, run.q, run.dq, effort))
        noise_t, noise_q, noise_dq, noise_tau = (
            rng.standard_normal(values.shape) for values in (t, q, dq, effort)
        )
        wrench = None if run.wrench is None else self._sampled(run.wrench)
        if wrench is not None:
            wrench = wrench + self.wrench_noise * rng.standard_normal(wrench.shape)
        bound = 0.45 / self.rate
        return Reading(
            t + np.clip(self.clock_jitter * noise_t, -bound, bound),
            _stepped(q + self.position_noise * noise_q, self.resolution),
            dq + self.velocity_noise * noise_dq,
            effort + self.torque_noise * noise_tau,
            np.array([self._sampled(x) if self.commanded else x[:0] for x in run.commanded]),
            wrench,
        )

    def _sampled(self, values: Array) -> Array:
        """Values at the controller's ticks, `(N, ...)`, linearly interpolated at those of rows."""
        every, last = CONTROL_RATE / self.rate, len(values) - 1
        every = round(every) if abs(every - round(every)) < 1e-9 else every
        places = every * np.arange(int(last / every + 1e-9) + 1)
        before = np.minimum(places.astype(np.intp), last)
        share = (places - before).reshape(-1, *(1,) * (values.ndim - 1))
        after = values[np.minimum(before + 1, last)]
        return np.where(share > 0.0, values[before] * (1.0 - share) + after * share, values[before])

    def read(self, run: TrueRun, robot: Robot, rng: np.random.Generator) -> dict[str, Array]:
        """The columns of the log under customary names."""
        reading = self.measure(run, rng)
        columns = {"time_s": reading.t}
        for j, joint in enumerate(robot.coordinates):
            columns[f"q{j + 1}_{joint.unit}"] = reading.q[:, j]
        for j, joint in enumerate(robot.coordinates if self.velocity else ()):
            columns[f"dq{j + 1}_{joint.unit}_s"] = reading.dq[:, j]
        return columns | self._efforts(reading.effort, robot) | reading.further(robot)

    def _efforts(self, effort: Array, robot: Robot) -> dict[str, Array]:
        if self.gains is not None:
            effort = effort / self.gains
            return {f"current{j + 1}_A": column for j, column in enumerate(effort.T)}
        if self.effort != "motor_torque":
            names = [f"tau{j + 1}_{c.effort_unit}" for j, c in enumerate(robot.coordinates)]
            return dict(zip(names, effort.T, strict=True))
        if robot.transmission is None:
            raise ModelError(
                "motor torques are to be logged, but the robot has no transmission",
                where=f"robot '{robot.name}'",
                fix="give the robot a transmission, or log joint torques",
            )
        motors = np.linalg.solve(robot.transmission.matrix.T, effort.T)
        return {f"motor_tau{j + 1}_Nm": column for j, column in enumerate(motors)}


def _stepped(q: Array, resolution: Array | float) -> Array:
    """Positions rounded to the encoders' steps."""
    step = np.broadcast_to(resolution, q.shape)
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(q / safe) * safe, q) + 0.0


def as_declared(
    reading: Reading, signals: Signals, *, velocity: bool = True, gains: ArrayLike | None = None
) -> dict[str, Array]:
    """The columns of a log under the names, in the units and on the side that a file declares.

    Drive gains that the file leaves to be identified are the true `gains`, or 1 without.
    """
    named = {} if signals.time == ROW else {signals.time: reading.t / signals.time_scale}
    offset = 0.0 if signals.position_offset is None else signals.position_offset
    mapped = signals.position_map

    def columns(names: Sequence[str], values: Array, scales: Array) -> dict[str, Array]:
        before = values if mapped is None else np.linalg.solve(mapped, values.T).T
        return dict(zip(names, (before / scales).T, strict=True))

    named |= columns(signals.position, reading.q - offset, signals.position_scale)
    if signals.velocity is not None and signals.velocity_scale is not None and velocity:
        named |= columns(signals.velocity, reading.dq, signals.velocity_scale)
    true = signals.gains
    if any(signals.unknown_gains) and gains is not None:
        true = np.where(signals.unknown_gains, gains, true)
    effort = replace(signals, gains=true).logged_efforts(reading.effort)
    return named | dict(zip(signals.effort, effort.T, strict=True))
