"""Programs for ROS 2 and UR, replayed by independent interpreters, against the motions themselves.

The interpreters stand in `tests/excite/interpreters.py`: joint_trajectory_controller's splines
of degree five between points, at every millisecond and at 20 000 random times, and URScript's
`servoj` at its control rate. The worst of 20 random motions within a real robot's limits:
series from rest to rest, every second one slowed; and of 4 of each kind of motions of pieces, whose
breaks lie off all grids and where acceleration or jerk jumps.
"""

import sys
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from excite.interpreters import Follower, URController, moments
from steelyard.excite.controller_file_formats import exported
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    SlowedMotion,
)
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.motion_families import (
    Basis,
    blended_fourier,
    ramped_fourier,
    reaching,
    splines,
)
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot

BOUND = 1e-6
DRAWS = 20
DRAWS_OF_A_KIND = 4
EXAMPLES = Path(__file__).parents[2] / "examples"


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


def bases(joints: int, seconds: float) -> dict[str, Basis]:
    """Kinds of motions made of pieces, from rest to rest."""
    return {
        "blended": blended_fourier(joints, seconds, 4, 2, 0.2713 * seconds),
        "ramped": ramped_fourier(joints, seconds, 4, 2, 0.3137 * seconds),
        "splines of degree 3": splines(joints, 2.0 * seconds, 13, 3),
        "splines of degree 5": splines(joints, 2.0 * seconds, 13, 5),
        "reaching": reaching(joints, 4, 0.37 * seconds, 0.0731 * seconds),
    }


def shrunk(basis: Basis, robot: Robot, rng: np.random.Generator) -> ExactTrajectory:
    """Random coefficients, shrunk about the middle posture until range and speeds are kept."""
    limits = [c.limits for c in robot.coordinates]
    lower, upper = np.array([(max(own.lower, -3.0), min(own.upper, 3.0)) for own in limits]).T
    middle = basis.still(0.5 * (lower + upper))
    away = rng.standard_normal(middle.shape)
    for _ in range(60):
        motion = basis.motion(middle + away)
        least, greatest = motion.extremes(0)
        speed = np.abs(motion.extremes(1)).max(axis=0)
        beyond = (least < lower) | (greatest > upper) | (speed > [own.velocity for own in limits])
        if not beyond.any():
            return motion
        away[beyond] *= 0.8
    raise RuntimeError("no shrinking brought the motion into its limits")


def pieced(robot: Robot) -> dict[str, list[ExactTrajectory]]:
    """Random motions of pieces by kind."""
    drawn: dict[str, list[ExactTrajectory]] = {}
    rng = np.random.default_rng(0)
    for seed in range(DRAWS_OF_A_KIND):
        for kind, basis in bases(robot.n, 3.0 + 0.3137 * seed).items():
            drawn.setdefault(kind, []).append(shrunk(basis, robot, rng))
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
    for kind, drawn in pieced(panda).items():
        worst[f"JointTrajectory, Panda, {kind}"] = max(followed(m, panda) for m in drawn)
    for kind, drawn in pieced(ur).items():
        worst[f"URScript, UR10e, 125 Hz, {kind}"] = max(served(m, ur, 125.0) for m in drawn)
    return [
        Claim(name, f"{error:.1e} rad", f"< {BOUND:g} rad", error < BOUND)
        for name, error in worst.items()
    ]


if __name__ == "__main__":
    main_of(main)
