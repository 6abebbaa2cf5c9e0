import numpy as np
import pytest

from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.planned.plans_from_tables import friction_sweeps, static_postures
from steelyard.excite.trajectories.exact_trajectories import PiecewiseMotion

LIMITS = MotionLimits(
    [-2.9, -0.3, 0.0, -0.05], [2.9, 0.3, 4.0, 0.4], [2.2, 2.2, 1.0, 0.2], [15.0, 7.5, 1.0, 0.5]
)
SEVEN = MotionLimits(-np.arange(1.0, 8.0), np.arange(2.0, 9.0), np.ones(7), np.full(7, 3.0))


def within(motion: PiecewiseMotion, limits: MotionLimits, fraction: float, speed: float) -> None:
    """The motion keeps its share of the limits at all times, and is smooth."""
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    least, greatest = motion.extremes(0)
    assert np.all(least >= middle - fraction * half - 1e-9)
    assert np.all(greatest <= middle + fraction * half + 1e-9)
    for order, bound in ((1, limits.velocity), (2, limits.acceleration)):
        assert np.all(np.abs(motion.extremes(order)) <= speed * bound)
    for order in range(3):
        before = motion.derivative(motion.breaks[1:-1] - 1e-10, order)
        after = motion.derivative(motion.breaks[1:-1], order)
        assert np.abs(after - before).max() < 1e-6
    for order in (1, 2):
        assert np.abs(motion.derivative([0.0, motion.duration], order)).max() < 1e-9


def steady_speeds(motion: PiecewiseMotion, joint: int) -> list[float]:
    """Speeds of the pieces that a joint goes along at constant speed."""
    middle = 0.5 * (motion.breaks[1:] + motion.breaks[:-1])
    ends = [motion.breaks[:-1] + 1e-9, middle, motion.breaks[1:] - 1e-9]
    speeds = np.array([motion.derivative(t, 1)[:, joint] for t in ends])
    steady = (np.ptp(speeds, axis=0) < 1e-7) & (np.abs(speeds[1]) > 1e-6)
    return [float(speed) for speed in speeds[1, steady]]


@pytest.mark.parametrize("fraction", [1.0, 0.9, 0.4])
@pytest.mark.parametrize("posture", [None, [0.9, 0.05, 1.5, 0.2]])
def test_sweeps_keep_the_limits(fraction: float, posture: list[float] | None) -> None:
    motion = friction_sweeps(LIMITS, posture, fraction=fraction)
    within(motion, LIMITS, fraction, fraction)
    stand = 0.5 * (LIMITS.lower + LIMITS.upper) if posture is None else posture
    ends = motion.derivative([0.0, motion.duration], 0)
    np.testing.assert_allclose(ends, [stand, stand], atol=1e-12)


def test_one_joint_moves_at_a_time() -> None:
    motion = friction_sweeps(LIMITS)
    moving = np.abs(motion.derivative(np.linspace(0.0, motion.duration, 5001), 1)) > 1e-12
    assert moving.sum(axis=1).max() == 1
    order = moving[moving.any(axis=1)].argmax(axis=1)
    assert np.all(np.diff(order) >= 0) and set(order) == {0, 1, 2, 3}


def test_speeds_are_spaced_geometrically_both_ways() -> None:
    motion = friction_sweeps(LIMITS, speeds=5, slowest=0.1, fraction=0.8)
    for joint in (0, 2, 3):
        speeds = steady_speeds(motion, joint)
        wanted = 0.8 * LIMITS.velocity[joint] * np.geomspace(0.1, 1.0, 5)
        np.testing.assert_allclose(speeds, np.repeat(wanted, 2) * np.tile([1, -1], 5), rtol=1e-6)


def test_a_short_range_lowers_the_speeds() -> None:
    speeds = steady_speeds(friction_sweeps(LIMITS, speeds=3, fraction=0.8), 1)
    top = np.sqrt(0.5 * 0.48 * 0.8 * 7.5 / 1.5)
    assert top < 0.8 * 2.2
    np.testing.assert_allclose(np.abs(speeds[-2:]), top, rtol=1e-6)


def test_no_speed_lasts_longer_than_requested() -> None:
    motion = friction_sweeps(SEVEN, speeds=1, longest_s=0.7)
    assert max(np.diff(motion.breaks)) < 5.0
    for joint in range(7):
        speeds = steady_speeds(motion, joint)
        np.testing.assert_allclose(np.abs(speeds), 0.9, rtol=1e-6)
    seconds = np.diff(motion.breaks)[1::7]
    assert len(motion.breaks) - 1 == 7 * 8
    assert seconds.max() < 5.0
    steady = np.diff(motion.breaks).reshape(7, 8)[:, [2, 5]]
    np.testing.assert_allclose(steady, 0.7, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 7, 16])
def test_postures_keep_the_limits_and_fill_the_ranges(count: int) -> None:
    motion = static_postures(LIMITS, count=count, seed=3, dwell_s=1.5, fraction=0.9)
    within(motion, LIMITS, 0.9, 0.5)
    assert len(motion.breaks) - 1 == 2 * (count + 1)
    dwells = np.diff(motion.breaks)[1::2]
    np.testing.assert_allclose(dwells, 1.5, rtol=1e-9)
    stands = motion.derivative(motion.breaks[1:-2:2] + 0.7, 0)
    share = (stands - LIMITS.lower) / (LIMITS.upper - LIMITS.lower)
    if count == 16:
        for low in np.arange(4) / 4:
            cell = (share - 0.05) / 0.9
            assert np.all(((cell >= low) & (cell < low + 0.25)).sum(axis=0) == 4)
    used = np.abs(motion.extremes(1)).max() / (0.5 * LIMITS.velocity)
    assert used.max() > 0.5


def test_same_seed_same_postures() -> None:
    one, same, other = (
        static_postures(LIMITS, count=4, seed=s, dwell_s=2.0).coefficients for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.01
