"""The virtual robot: sent along a trajectory, it writes logs like those of a real controller."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import DataError, ModelError
from steelyard.base.files import whole_folder, write_json
from steelyard.base.motion import Motion, Trajectory, run
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import joint_inertia, tuned_pd
from steelyard.estimate.external.wrench_methods_and_observer_step import moved_frame
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.trajectory_files import write_motion
from steelyard.logs.formats import write_table
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Frame, Robot
from steelyard.simulate.drives_sensors_and_loads import (
    CONTROL_RATE,
    AppliedWrench,
    Drives,
    DrivesInUse,
    Payload,
    Sensors,
    TrueRun,
    as_declared,
)
from steelyard.simulate.ground_truth import Truth
from steelyard.simulate.laws_beside_mujoco import Laws, LawsInUse, stable_timestep
from steelyard.simulate.mujoco_model import (
    ADVANCE,
    MujocoModel,
    build,
    new_data,
    push,
)
from steelyard.simulate.typical_torques_and_masses import closed, typical_masses, typical_torque
from steelyard.uses.control.joint_controllers import PD, Control, ControlTask

_UNREACHED_SIZE = 1e4  # size of positions and of velocities, as vectors, that no robot reaches


class MujocoPlant:
    r"""A robot in MuJoCo.

    MuJoCo steps $v' = v + h\,a(x, v)$, $x' = x + h\,v'$. Read as $x = q + \tfrac h2 \dot q$ this
    is the position Verlet scheme: torques act exactly while they are held, and the error in
    gravity and inertia is of second order in `h`; read as $x = q$ the motion would lead the torque
    by half a step. Coulomb friction by the plain sign is implicit: within a step it stops a joint
    that it can stop. The other laws are evaluated at every step, and the memory of friction takes
    the same exact steps as along a log. The step is 0.125 ms, 0.1 ms for friction with memory, and
    finer where a law is so stiff for its inertia that such a step would not be stable.

    Attributes:
        model: The MuJoCo model, with the truth's inertias.
        timestep: Step of the integration [s].
        loaded: Whether it carries the payload; motion goes on from the same velocities.
    """

    def __init__(self, robot: Robot, truth: Truth, payload: Payload | None = None) -> None:
        _check_robot(robot, truth)
        self.model: MujocoModel = build(robot, truth.inertial, truth.rotors, truth.brakes)
        self._laws = Laws(robot, truth.laws, truth.law_values, truth.smoothing, self.model)
        self.timestep = stable_timestep(self._laws)
        self._compiled = [self.model.compiled]
        if payload is not None:
            loaded = payload.added(robot, truth.inertial)
            self._compiled.append(build(robot, loaded, truth.rotors, truth.brakes).compiled)
        for compiled in self._compiled:
            compiled.opt.timestep = self.timestep
        self._robot, self.loaded = robot, False
        self._behind = np.reshape(
            [b.motor * np.array(b.row[: robot.n]) for b in truth.brakes if b.level > 0.0],
            (-1, robot.n),
        )
        self._carriers = np.array(self.model.carriers[: robot.n])
        self._ratios = self.model.map[self._carriers, np.arange(robot.n)]
        self._starts = self.model.offset[self._carriers]
        self.place(robot.assembly[: robot.n])

    def place(self, q: ArrayLike) -> None:
        """Put the robot at rest at posture `q`, shape `(n,)`; passive joints close the loops."""
        wanted = frozen(q, (self._robot.n,))
        full = closed(self._robot, wanted)
        if full is None:
            raise DataError(
                "the loops cannot close at positions " + " ".join(f"{x:.4g}" for x in wanted),
                where=f"robot '{self._robot.name}'",
                fix="start from a posture that the robot can take",
            )
        self._data = data = new_data(self.model)
        data.qpos[:] = self.model.map @ full + self.model.offset
        self._x, self._v, self._forces = data.qpos, data.qvel, data.qfrc_applied
        self._used = LawsInUse(self._laws, self._x, self._v, data.qacc)

    def push(self, frame: Frame, wrench: Array, in_base: bool) -> Array:
        """Let a wrench act at a frame's origin until the next call, see `mujoco_model.push`."""
        compiled = self._compiled[self.loaded]
        return push(compiled, self._data, self._robot, frame, wrench, in_base)

    def state(self) -> tuple[Array, Array]:
        """Position and velocity of the independent joints, each `(n,)`."""
        dq = self._v[self._carriers] / self._ratios
        ahead = (self._x[self._carriers] - self._starts) / self._ratios
        return ahead - 0.5 * self.timestep * dq, dq

    def motor_friction(self) -> Array:
        """Torque of the terms that act on motors, at the last step, shape `(n,)`."""
        friction = self._data.efc_force[self._data.ne :][: self._data.nf]
        return np.asarray(self._used.brakes() - friction @ self._behind)

    def step(self, tau: Array, duration: float) -> tuple[Array, Array]:
        """Hold joint torques `tau`, shape `(n,)`, for a multiple of the time step."""
        count = round(duration / self.timestep)
        if count < 1 or abs(count * self.timestep - duration) > 1e-9:
            raise ValueError(f"{duration} s is not a multiple of the step of {self.timestep} s")
        compiled, data, used = self._compiled[self.loaded], self._data, self._used
        used.applied[:] = tau
        forces, dofs, advance = self._forces, used.dofs, ADVANCE
        for _ in range(count):
            forces[dofs] = used.step()
            advance(compiled, data)
        q, dq = self.state()
        if not (q @ q < _UNREACHED_SIZE**2 and dq @ dq < _UNREACHED_SIZE**2):
            raise DataError(
                "the simulation diverged",
                where=f"robot '{self._robot.name}'",
                fix="give smaller torques, or a true robot with more inertia",
            )
        return q, dq


def _check_robot(robot: Robot, truth: Truth) -> None:
    got, wanted = (
        ([b.name for b in r.bodies], [c.name for c in r.joints]) for r in (truth.robot, robot)
    )
    if got != wanted:
        raise ModelError(
            f"the truth has {len(got[0])} links and {len(got[1])} joints, the robot "
            f"{len(wanted[0])} and {len(wanted[1])}, or they differ in names",
            where=f"truth for robot '{robot.name}'",
            fix="take the truth that was made for this robot",
        )


_TICK = 1.0 / CONTROL_RATE
_SETTLING = 0.5
_PHASE = 0.25  # phase that dead time may take at the natural frequency of a joint's error [rad]

_TICKS_PER_EVENT = 250
_TICKS_PER_CLOSURE = 20


class VirtualRobot:
    """A simulated robot: implements `Rig`.

    A controller at 1 kHz follows the motion; the robot stands still for `rest` seconds before and
    after it. By default that is joint PD control from true positions and velocities, without
    feedforward: it sags under gravity by some milliradians, as a soft controller does.

    Attributes:
        robot: The robot; its nominal inertias play no part.
        rest: Standstill before and after a motion [s].
        signals: Names, units, sides, kinds and gains of the log's columns; customary ones if
            `None`.
        payload: What it carries for a while, if anything.
        wrench: What acts on it from outside, if anything.
        tuned: Gains of the default controller.
    """

    def __init__(
        self,
        robot: Robot,
        truth: Truth,
        sensors: Sensors | None = None,
        *,
        seed: int = 0,
        rest: float = 1.0,
        signals: Signals | None = None,
        payload: Payload | None = None,
        control: Control | None = None,
        drives: Drives | None = None,
        wrench: AppliedWrench | None = None,
        progress: Progress = silent,
    ) -> None:
        self.robot, self.truth, self.rest, self.signals = robot, truth, rest, signals
        self.sensors = Sensors() if sensors is None else sensors
        self.payload = payload
        self._plant = MujocoPlant(robot, truth, payload)
        self.control: Control = PD() if control is None else control
        self.drives, self.wrench = Drives() if drives is None else drives, wrench
        self._frame = None if wrench is None else moved_frame(robot, wrench.frame)
        self._masses = typical_masses(robot, self._plant.model)
        self.tuned = tuned_pd(self._masses)
        self._noise = np.random.default_rng(seed)
        self._progress = progress
        self._recorded: list[TrueRun] | None = None

    def send(self, trajectory: Trajectory) -> None:
        """Follow `trajectory`; it is put into the log that is being recorded, if any."""
        if self._recorded:
            raise DataError(
                "a log of the virtual robot holds one motion, and this is a second one",
                where=f"robot '{self.robot.name}'",
                fix="record a log for each motion, or send them chained",
            )
        run = self.follow(trajectory)
        if self._recorded is not None:
            self._recorded.append(run)

    @contextmanager
    def record(self, log: Path) -> Iterator[None]:
        """Write the motion that is sent within the block; noise goes on from log to log.

        Args:
            log: File to write, `.parquet` or `.csv`; not written if the block raises.
        """
        self._recorded = []
        try:
            yield
            runs = self._recorded
        finally:
            self._recorded = None
        if not runs:
            raise DataError(
                "no motion was sent while the virtual robot recorded",
                where=str(log),
                fix="send a motion within the block",
            )
        sensors = self.sensors
        if self.signals is None:
            write_table(log, sensors.read(runs[0], self.robot, self._noise))
            return
        reading = sensors.measure(runs[0], self._noise, self.signals.effort_kind)
        columns = as_declared(reading, self.signals, velocity=sensors.velocity, gains=sensors.gains)
        write_table(log, columns | reading.further(self.robot))

    def ticks(self, trajectory: Trajectory) -> int:
        """Ticks of the controller along a trajectory, rests included."""
        return round((trajectory.duration + 2.0 * self.rest) * CONTROL_RATE) + 1

    def follow(self, trajectory: Trajectory, felt: ArrayLike = 0.0) -> TrueRun:
        """Follow `trajectory`; what happened at every tick, without sensors.

        Args:
            trajectory: The motion.
            felt: Errors of the positions that the controller feels, shape `(ticks, n)` [rad; m].
        """
        ticks = self.ticks(trajectory)
        t = frozen(np.arange(ticks) * _TICK)
        goal = self.wanted(trajectory, t)
        self._check_loops(t, goal.q)
        loaded = np.zeros(ticks, bool) if self.payload is None else self.payload.carried(t)
        if self.payload is not None and not loaded.any():
            raise DataError(
                f"the payload is attached at {self.payload.attach:g} s, "
                f"but the log ends at {t[-1]:g} s",
                where=f"payload on '{self.payload.frame}'",
                fix="attach it earlier, or make the motion longer",
            )
        self._plant.loaded = bool(loaded[0])
        self._plant.place(goal.q[0])
        felt = np.broadcast_to(felt, goal.q.shape)
        pushed = None if self.wrench is None else self.wrench.at(t)
        settling = round(_SETTLING * CONTROL_RATE)
        loop = self.control.start(self._task(goal, settling))
        q, dq, held, friction, command = (np.zeros_like(goal.q) for _ in range(5))
        q[0], dq[0] = self._plant.state()
        drives = DrivesInUse(self.drives, _TICK, q[0])
        before = tau = np.zeros(self.robot.n)
        for k in range(settling):
            before = tau = drives.actuate(loop(k, *drives.sense(q[0], dq[0])))
            q[0], dq[0] = self._plant.step(tau, _TICK)
        for k in range(ticks):
            if k % _TICKS_PER_EVENT == 0:
                report_progress(self._progress, "simulation", t[k], float(t[-1]))
            seen, speed = drives.sense(q[k] + felt[k], dq[k])
            held[k] = tau = drives.actuate(loop(settling + k, seen, speed))
            command[k] = drives.command
            friction[k] = self._plant.motor_friction()
            if pushed is not None and self._frame is not None and self.wrench is not None:
                pushed[k] = self._plant.push(self._frame, pushed[k], self.wrench.axes == "base")
            if k + 1 < ticks:
                self._plant.loaded = bool(loaded[k])
                q[k + 1], dq[k + 1] = self._plant.step(tau, _TICK)
        report_progress(self._progress, "simulation", t[-1], t[-1])
        tau = 0.5 * (np.concatenate([before[None], held[:-1]]) + held)
        motors, commanded = friction + self._rotors(dq), np.array([goal.q, goal.dq, command])
        return TrueRun(t, q, dq, tau, motors, self._gravity(t, q), commanded, pushed)

    def _task(self, goal: Motion, settling: int) -> ControlTask:
        """Rest at the first posture for some ticks, and the motion."""
        before = np.repeat(goal.q[:1], settling, axis=0)
        still = np.zeros_like(before)
        t = np.concatenate([goal.t[0] - _TICK * np.arange(settling, 0, -1), goal.t])
        parts = (before, goal.q), (still, goal.dq), (still, goal.ddq)
        motion = Motion(t, *map(np.concatenate, parts))
        inertia, fastest = joint_inertia(self._masses, CONTROL_RATE)
        if self.drives.dead_time > 0.0:
            fastest = min(fastest, _PHASE / self.drives.dead_time)
        limits = np.broadcast_to(self.drives.limits, inertia.shape)
        return ControlTask(motion, self.drives.seen(motion), _TICK, inertia, fastest, limits)

    def wanted(self, trajectory: Trajectory, t: Array) -> Motion:
        """The controller's setpoints at times `t` of the log [s], shape `(N,)`."""
        goal = trajectory.sample(np.clip(t - self.rest, 0.0, trajectory.duration))
        moving = ((t >= self.rest) & (t <= self.rest + trajectory.duration))[:, None]
        return Motion(t, goal.q, np.where(moving, goal.dq, 0.0), np.where(moving, goal.ddq, 0.0))

    def _rotors(self, dq: Array) -> Array:
        """Torque of the rotors that turn with the independent joints, shape `(N, n)`.

        Their acceleration is the mean over the ticks before and after, as the torque is.
        """
        ddq = np.gradient(dq, _TICK, axis=0)
        rows = [(np.array(r.row[: self.robot.n]), r.inertia) for r in self.truth.rotors]
        parts = [inertia * np.outer(ddq @ row, row) for row, inertia in rows]
        return np.asarray(sum(parts, np.zeros_like(ddq)))

    def _gravity(self, t: Array, q: Array) -> Array:
        """Torque that holds the bodies against gravity, shape `(N, n)`."""
        bodies = Model(self.robot, (RigidBody(),))
        values = Parameters(bodies.names, bodies.units, self.truth.inertial.ravel())
        still = np.zeros_like(q)
        return bodies.at(values).torque(Motion(t, q, still, still))

    def _check_loops(self, t: Array, goal: Array) -> None:
        """Raise where the robot could not follow because its loops would not close."""
        near = None
        for k in range(0, len(t) if self.robot.loops else 0, _TICKS_PER_CLOSURE):
            near = closed(self.robot, goal[k], near)
            if near is None:
                raise DataError(
                    f"the loops cannot close at {max(t[k] - self.rest, 0.0):.2f} s of the motion",
                    where=f"motion of robot '{self.robot.name}'",
                    fix="give a motion, or limits of the joints, within which the loops close",
                )


@dataclass(frozen=True)
class SimulatedFiles:
    """What a simulation left: a log, what the robot really is (JSON), the motion (JSON)."""

    log: Path
    truth: Path
    trajectory: Path


def customary_sensors(robot: Robot, truth: Truth, noise: float = 1.0) -> Sensors:
    """Sensors as good as those of a usual arm, at 250 rows a second.

    Encoders of 17 bits a turn (prismatic joints: 10 µm), white noise of 1 % of the typical torque
    and of 1 mrad/s (1 mm/s) on velocities, of 0.2 N and 0.01 Nm on an outside wrench, a clock that
    jitters by 50 µs; `noise` is a factor on all of it.
    """
    torque = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    steps = {"revolute": 2.0 * pi / 2**17, "prismatic": 1e-5}
    return Sensors(
        resolution=noise * np.array([steps[c.kind] for c in robot.coordinates]),
        velocity_noise=noise * 1e-3,
        torque_noise=noise * 0.01 * torque,
        wrench_noise=noise * np.repeat([0.2, 0.01], 3),
        clock_jitter=noise * 5e-5,
    )


def write_run(rig: VirtualRobot, trajectory: ExactTrajectory, folder: Path) -> SimulatedFiles:
    """Send a virtual robot along a trajectory and write its log, its truth and the motion.

    The folder appears whole, when all is done, or not at all; it may not exist, unless it is empty.
    """
    signals, gains = rig.signals, rig.sensors.gains
    with whole_folder(folder) as part:
        run(rig, trajectory, part / "log.csv")
        hidden = rig.truth.to_dict()
        if signals is not None and any(signals.unknown_gains) and gains is not None:
            hidden["drive_gains"] = dict(zip(rig.robot.joint_names, gains.tolist(), strict=True))
        write_json(part / "truth.json", hidden)
        write_motion(part / "trajectory.json", trajectory, rig.robot)
    return SimulatedFiles(folder / "log.csv", folder / "truth.json", folder / "trajectory.json")
