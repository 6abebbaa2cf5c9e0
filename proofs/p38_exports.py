"""Programs for ROS 2 and UR, replayed by independent interpreters, against the motions themselves.

The interpreters stand in `tests/excitation/interpreters.py`: joint_trajectory_controller's splines
of degree five between points, at every millisecond and at 20 000 random times, and URScript's
`servoj` at its control rate. The worst of 20 random motions within a real robot's limits.
"""

import sys
from pathlib import Path

import numpy as np
from claims import Claim, data_folder, main_of

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from excitation.interpreters import Follower, URController, moments
from steelyard.excitation.exact import ExactTrajectory
from steelyard.excitation.export import exported
from steelyard.excitation.random_fourier import random_fourier
from steelyard.excitation.slowed import SlowedMotion
from steelyard.robot.robot import Robot
from steelyard.robot.robot_file import load_robot

BOUND = 1e-6
DRAWS = 20
EXAMPLES = Path(__file__).parent.parent / "examples"


def followed(motion: ExactTrajectory, robot: Robot) -> float:
    """Greatest distance of the splines from the motion [rad]."""
    follower = Follower(exported(motion, robot, "ros2"))
    t = moments(motion.duration)
    return float(np.abs(follower.at(t + follower.start) - motion.derivative(t, 0)).max())


def served(motion: ExactTrajectory, robot: Robot, rate: float) -> float:
    """Greatest distance of the set points from the motion at their times [rad]."""
    away = motion.derivative([0.0], 0)[0] + 0.5
    controller = URController(exported(motion, robot, "urscript", rate), away, 1.0 / rate)
    t = np.array([time for time, _ in controller.set_points])
    wanted = motion.derivative(np.minimum(t - t[0], motion.duration), 0)
    return float(np.abs(np.array([q for _, q in controller.set_points]) - wanted).max())


def motions(robot: Robot) -> list[ExactTrajectory]:
    """Random motions of odd lengths, every second one slowed."""
    drawn: list[ExactTrajectory] = []
    for seed in range(DRAWS):
        motion = random_fourier(robot, seed=seed, period=3.0 + 0.3137 * seed)
        drawn.append(SlowedMotion(motion, 0.35) if seed % 2 else motion)
    return drawn


def main() -> list[Claim]:
    """The worst over all motions."""
    data_folder()
    ur, panda = (load_robot(EXAMPLES / f"{name}.toml").robot for name in ("ur10e", "panda"))
    worst = {
        "JointTrajectory, Panda, all times": max(followed(m, panda) for m in motions(panda)),
        "JointTrajectory, UR10e, all times": max(followed(m, ur) for m in motions(ur)),
        "URScript, UR10e, 125 Hz": max(served(m, ur, 125.0) for m in motions(ur)),
        "URScript, UR10e, 500 Hz": max(served(m, ur, 500.0) for m in motions(ur)),
    }
    return [
        Claim(name, f"{error:.1e} rad", f"< {BOUND:g} rad", error < BOUND)
        for name, error in worst.items()
    ]


if __name__ == "__main__":
    main_of(main)
