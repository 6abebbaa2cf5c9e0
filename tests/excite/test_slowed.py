"""A motion at reduced speed."""

import json

import numpy as np
import pytest

from excite.exportable import Jumps, Swings, arm
from steelyard.excite.trajectories.exact_trajectories import (
    ExactTrajectory,
    SlowedMotion,
)
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import trajectory_from_dict


@pytest.mark.parametrize("motion", [Swings(), Jumps()])
def test_slow_motions_go_the_same_way(motion: ExactTrajectory) -> None:
    slow = SlowedMotion(motion, 0.2)
    assert slow.duration == pytest.approx(5.0 * motion.duration)
    t = np.linspace(0.0, slow.duration, 3001)
    got = slow.sample(t)
    np.testing.assert_allclose(got.q, motion.derivative(t / 5.0, 0), atol=1e-12)
    step = 1e-4
    inner = t[1:-1][np.abs(t[1:-1, None] - slow.breaks).min(axis=1) > 2 * step]
    for order in (1, 2, 3):
        lower = [slow.derivative(inner + s, order - 1) for s in (-step, step)]
        slope = (lower[1] - lower[0]) / (2 * step)
        np.testing.assert_allclose(slow.derivative(inner, order), slope, atol=1e-5)
    np.testing.assert_array_equal(got.dq, slow.derivative(t, 1))
    np.testing.assert_array_equal(got.ddq, slow.derivative(t, 2))


def test_extremes_and_breaks_are_those_of_the_slow_motion() -> None:
    slow = SlowedMotion(Jumps(), 0.25)
    np.testing.assert_allclose(slow.breaks, 4.0 * Jumps().breaks)
    t = np.linspace(0.0, slow.duration, 20001)
    for order in range(4):
        least, greatest = slow.extremes(order)
        values = slow.derivative(t, order)
        assert np.all(least <= values.min(axis=0)) and np.all(values.max(axis=0) <= greatest)
        assert np.all(greatest - least <= 1.05 * np.ptp(values, axis=0) + 1e-12)


def test_slow_motions_are_stored() -> None:
    slow = SlowedMotion(SlowedMotion(random_fourier(arm(2), seed=1), 0.5), 0.3)
    again = trajectory_from_dict(json.loads(json.dumps(slow.to_dict())))
    t = np.linspace(-1.0, slow.duration + 1.0, 101)
    np.testing.assert_array_equal(again.sample(t).q, slow.sample(t).q)
    assert again.to_dict() == slow.to_dict()


@pytest.mark.parametrize("factor", [0.0, -0.5, 1.01, float("nan")])
def test_factors_are_shares_of_the_speed(factor: float) -> None:
    with pytest.raises(ValueError, match="not a reduced speed"):
        SlowedMotion(Swings(), factor)
