"""The virtual robot: sent along a trajectory, it writes a log like a real controller's."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.files import write_table
from steelyard.motion import Trajectory
from steelyard.progress import Progress, silent, tell
from steelyard.robot.robot import Robot
from steelyard.robot.signals import Signals
from steelyard.virtual.controller import tuned_pd
from steelyard.virtual.naming import as_declared
from steelyard.virtual.plant import MujocoPlant
from steelyard.virtual.scales import typical_masses
from steelyard.virtual.sensors import CONTROL_RATE, Sensors, TrueRun
from steelyard.virtual.truth import Truth

_TICK = 1.0 / CONTROL_RATE
_SETTLING = 0.5
_TICKS_PER_EVENT = 250


class VirtualRobot:
    """A simulated robot: implements `Plant` and `Rig`.

    A joint PD controller at 1 kHz follows the motion from true positions and velocities, without
    feedforward: it sags under gravity by some milliradians, as a soft controller does. The robot
    stands still for `rest` seconds before and after the motion.

    Attributes:
        robot: The robot; its nominal inertias play no part.
        truth: What it really is.
        sensors: How its log is written.
        rest: Standstill before and after a motion [s].
        signals: Names, units and gains of the log's columns; customary ones if `None`.
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
        progress: Progress = silent,
    ) -> None:
        self.robot, self.truth, self.rest, self.signals = robot, truth, rest, signals
        self.sensors = Sensors() if sensors is None else sensors
        self._plant = MujocoPlant(robot, truth)
        self._control = tuned_pd(typical_masses(robot, self._plant.model))
        self._noise = np.random.default_rng(seed)
        self._progress = progress

    def place(self, q: ArrayLike) -> None:
        """Put the robot at rest at posture `q`, shape `(n,)`."""
        self._plant.place(q)

    def step(self, tau: Array, duration: float) -> tuple[Array, Array]:
        """Hold joint torques `tau`, shape `(n,)`, for `duration` [s]; the new `q` and `dq`."""
        return self._plant.step(tau, duration)

    def run(self, trajectory: Trajectory, log: Path) -> None:
        """Follow `trajectory` and write the log; noise goes on from run to run.

        Args:
            trajectory: The motion.
            log: File to write, `.parquet` or `.csv`.

        Raises:
            Stopped: The watcher asked to stop; no file is written.
        """
        columns = self.sensors.read(self.follow(trajectory), self.robot, self._noise)
        write_table(log, columns if self.signals is None else as_declared(columns, self.signals))

    def follow(self, trajectory: Trajectory) -> TrueRun:
        """Follow `trajectory`; what happened at every tick, without sensors."""
        ticks = round((trajectory.duration + 2.0 * self.rest) * CONTROL_RATE) + 1
        t = frozen(np.arange(ticks) * _TICK)
        wanted = trajectory.sample(np.clip(t - self.rest, 0.0, trajectory.duration))
        moving = ((t >= self.rest) & (t <= self.rest + trajectory.duration))[:, None]
        goal, speed = wanted.q, np.where(moving, wanted.dq, 0.0)
        self.place(goal[0])
        tau = self._settle(goal[0])
        q, dq, effort = np.empty_like(goal), np.empty_like(goal), np.empty_like(goal)
        q[0], dq[0] = self._plant.state()
        for k in range(ticks):
            if k % _TICKS_PER_EVENT == 0:
                tell(self._progress, "simulation", t[k], float(t[-1]))
            before = tau
            tau = self._control.torque(goal[k] - q[k], speed[k] - dq[k])
            effort[k] = 0.5 * (before + tau)
            if k + 1 < ticks:
                q[k + 1], dq[k + 1] = self._plant.step(tau, _TICK)
        tell(self._progress, "simulation", t[-1], t[-1])
        return TrueRun(t, q, dq, effort)

    def _settle(self, goal: Array) -> Array:
        """Hold a posture until it sags no more; the last torque, shape `(n,)`."""
        q, dq = self._plant.state()
        tau = np.zeros(self.robot.n)
        for _ in range(round(_SETTLING * CONTROL_RATE)):
            tau = self._control.torque(goal - q, -dq)
            q, dq = self._plant.step(tau, _TICK)
        return tau
