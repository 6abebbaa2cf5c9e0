"""A simulated run, from a robot and a motion to a folder of files."""

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from steelyard.control.protocol import Control
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.files import write_motion
from steelyard.files import whole_folder, write_json
from steelyard.motion import Rig, run
from steelyard.progress import Progress, silent
from steelyard.robot.robot import Robot
from steelyard.robot_file.signals import Signals
from steelyard.virtual.drives import Drives
from steelyard.virtual.mujoco_model import build
from steelyard.virtual.payload import Payload
from steelyard.virtual.robot import VirtualRobot
from steelyard.virtual.scales import typical_torque
from steelyard.virtual.sensors import Sensors
from steelyard.virtual.truth import Truth
from steelyard.virtual.wrench import AppliedWrench


@dataclass(frozen=True)
class SimulatedFiles:
    """What a simulation left.

    Attributes:
        log: The log, like a real controller's.
        truth: What the robot really is, JSON.
        trajectory: The requested motion, JSON.
    """

    log: Path
    truth: Path
    trajectory: Path


def customary_sensors(robot: Robot, truth: Truth, noise: float = 1.0) -> Sensors:
    """Sensors as good as those of a usual arm, at 250 rows a second.

    Encoders of 17 bits a turn (prismatic joints: 10 µm), white noise of 1 % of the typical torque
    and of 1 mrad/s (1 mm/s) on velocities, of 0.2 N and 0.01 Nm on an outside wrench, a clock that
    jitters by 50 µs.

    Args:
        robot: The robot.
        truth: What it really is; gives the size of its torques.
        noise: Factor on all of it; 0 is perfect.
    """
    torque = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    steps = {"revolute": 2.0 * pi / 2**17, "prismatic": 1e-5}
    return Sensors(
        resolution=[noise * steps[c.kind] for c in robot.coordinates],
        velocity_noise=noise * 1e-3,
        torque_noise=noise * 0.01 * torque,
        wrench_noise=noise * np.repeat([0.2, 0.01], 3),
        clock_jitter=noise * 5e-5,
    )


def simulate(
    robot: Robot,
    truth: Truth,
    trajectory: ExactTrajectory,
    sensors: Sensors,
    folder: Path,
    *,
    seed: int = 0,
    signals: Signals | None = None,
    payload: Payload | None = None,
    control: Control | None = None,
    drives: Drives | None = None,
    wrench: AppliedWrench | None = None,
    progress: Progress = silent,
) -> SimulatedFiles:
    """Send the virtual robot along a trajectory and write its log, its truth and the motion.

    The folder appears whole, when all is done, or not at all.

    Args:
        robot: The robot.
        truth: What it really is.
        trajectory: The motion.
        sensors: How the log is written.
        folder: Folder to make; it may not exist, unless it is empty.
        seed: Seed of the noise.
        signals: Names, units and gains of the log's columns; customary ones if `None`.
        payload: What the robot carries for a while, if anything.
        control: The joint controller; that of `VirtualRobot` if `None`.
        drives: What lies between controller and joints; perfect if `None`.
        wrench: What acts on the robot from outside, if anything.
        progress: Told how far the simulation is.

    Raises:
        OutputError: The folder cannot be written.
        Stopped: `progress` requested a stop.
    """
    with whole_folder(folder) as part:
        rig: Rig = VirtualRobot(
            robot,
            truth,
            sensors,
            seed=seed,
            signals=signals,
            payload=payload,
            control=control,
            drives=drives,
            wrench=wrench,
            progress=progress,
        )
        run(rig, trajectory, part / "log.csv")
        hidden = truth.to_dict()
        if signals is not None and any(signals.unknown_gains) and sensors.gains is not None:
            hidden["drive_gains"] = dict(
                zip(robot.joint_names, sensors.gains.tolist(), strict=True)
            )
        write_json(part / "truth.json", hidden)
        write_motion(part / "trajectory.json", trajectory, robot)
    return SimulatedFiles(folder / "log.csv", folder / "truth.json", folder / "trajectory.json")
