"""The demo arm with its wrist fixed, three joints: a fit takes half of the time of six."""

from collections.abc import Callable, Sequence
from pathlib import Path

from steelyard.base.files import write_json
from steelyard.base.motion import run
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import write_motion
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.simulate import write_demo_arm
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

Write = Callable[[Path], LoadedRobot]

WRIST = ("forearm_roll", "wrist_bend", "flange_roll")


def without_wrist(folder: Path) -> LoadedRobot:
    """Write URDF and robot file to a folder; the robot they describe."""
    write_demo_arm(folder)
    fix_joints(folder / "demo_arm.urdf")
    return load_robot(folder / "demo_arm.toml")


def fix_joints(urdf: Path, joints: Sequence[str] = WRIST) -> None:
    """Fix joints of the demo arm."""
    text = urdf.read_text(encoding="utf-8")
    for joint in joints:
        text = text.replace(f'"{joint}" type="revolute"', f'"{joint}" type="fixed"')
    urdf.write_text(text, encoding="utf-8")


def short_logs(folder: Path, period: float = 2.0, write: Write = without_wrist) -> None:
    """Robot file, two logs of different motions and the truth; the first runs its period twice."""
    robot = write(folder).robot
    truth = random_truth(robot, 0)
    rig = VirtualRobot(robot, truth, customary_sensors(robot, truth), seed=0)
    for seed, (name, periods) in enumerate((("identification", 2), ("validation", 1))):
        motion = random_fourier(robot, seed=seed, period=period, periods=periods)
        run(rig, motion, folder / f"{name}.csv")
        write_motion(folder / f"{name}_motion.json", motion, robot)
    write_json(folder / "truth.json", truth.to_dict())
