import numpy as np
import pytest

from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.robot import Body, Coordinate, Limits, Robot

LIMITS = (
    Limits(-2.0, 1.0, 1.5, 50.0),
    Limits(),
    Limits(velocity=0.8),
    Limits(-0.05, 0.4, 0.2, 500.0),
    Limits(lower=0.5),
    Limits(upper=0.5),
)


@pytest.fixture
def robot() -> Robot:
    kinds = ["revolute", "revolute", "revolute", "prismatic", "revolute", "prismatic"]
    joints = tuple(
        Coordinate(f"j{k}", "prismatic" if kind == "prismatic" else "revolute", limits)
        for k, (kind, limits) in enumerate(zip(kinds, LIMITS, strict=True))
    )
    bodies = tuple(
        Body(f"b{k}", c.name, c.kind, k - 1, np.eye(3), np.zeros(3), np.array([0.0, 0, 1]), k)
        for k, c in enumerate(joints)
    )
    return Robot("mixed", bodies, joints)


@pytest.mark.parametrize("fraction", [1.0, 0.9, 0.3])
@pytest.mark.parametrize("seed", range(5))
def test_limits_hold_and_one_is_used(robot: Robot, seed: int, fraction: float) -> None:
    motion = random_fourier(robot, seed=seed, limits_fraction=fraction, harmonics=7)
    dense = motion.sample(np.linspace(0.0, motion.duration, 50_001))
    limits = motion_limits(robot)
    centre, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    use = np.max(
        [
            np.abs(dense.q - centre).max(axis=0) / half,
            np.abs(dense.dq).max(axis=0) / limits.velocity,
            np.abs(dense.ddq).max(axis=0) / limits.acceleration,
        ],
        axis=0,
    )
    assert np.all(use <= fraction)
    assert np.all(use >= 0.995 * fraction)


def test_same_seed_same_motion(robot: Robot) -> None:
    one, same, other = (random_fourier(robot, seed=s).sine for s in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.01


def test_unstated_limits_are_noted(robot: Robot) -> None:
    limits = motion_limits(robot)
    assert limits.notes == (
        "without a complete range, moved within -1.5 .. 1.5 rad: j1, j2",
        "without a complete range, moved within 0.5 .. 3.5 rad: j4",
        "without a complete range, moved within 0.1 .. 0.5 m: j5",
        "without a speed limit, moved at 1.5 rad/s at most: j1, j4",
        "without a speed limit, moved at 0.3 m/s at most: j5",
    )
    np.testing.assert_array_equal(limits.acceleration, [5, 5, 5, 1, 5, 1])
