import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steelyard.base.motion import Trajectory
from steelyard.excite.trajectories.fourier import FourierMotion, rest_basis
from steelyard.excite.trajectories.trajectory_files import trajectory_from_dict


def some_motion(harmonics: int = 4, periods: int = 2, seed: int = 0) -> FourierMotion:
    free = np.random.default_rng(seed).standard_normal((3, 2 * harmonics - 2))
    return FourierMotion.from_free([0.3, -0.2, 1.0], free, 5.0, periods)


@given(harmonics=st.integers(2, 8), periods=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_starts_and_ends_at_rest(harmonics: int, periods: int, seed: int) -> None:
    motion = some_motion(harmonics, periods, seed)
    ends = motion.sample([0.0, motion.duration])
    assert motion.duration == 5.0 * periods
    np.testing.assert_allclose(ends.q, [[0.3, -0.2, 1.0]] * 2, atol=1e-11)
    np.testing.assert_allclose(ends.dq, 0.0, atol=1e-10)
    np.testing.assert_allclose(ends.ddq, 0.0, atol=1e-9)


def test_derivatives_match_central_differences() -> None:
    motion, h = some_motion(), 1e-5
    t = np.linspace(0.5, 9.5, 57)
    here, later, earlier = motion.sample(t), motion.sample(t + h), motion.sample(t - h)
    np.testing.assert_allclose(here.dq, (later.q - earlier.q) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(here.ddq, (later.dq - earlier.dq) / (2 * h), atol=1e-6)
    assert np.abs(here.ddq).max() > 1.0


def test_is_the_series_it_says() -> None:
    motion, t = some_motion(), 1.7
    k, w = np.arange(1, 5), 2 * np.pi / 5.0
    by_hand = (
        motion.start + motion.sine @ np.sin(k * w * t) + motion.cosine @ (np.cos(k * w * t) - 1.0)
    )
    np.testing.assert_allclose(motion.sample([t]).q[0], by_hand, atol=1e-13)
    np.testing.assert_allclose(motion.sample([t + 5.0]).q[0], by_hand, atol=1e-12)


def test_stands_still_outside_its_time() -> None:
    motion = some_motion()
    outside = motion.sample([-3.0, 11.0, 99.0])
    np.testing.assert_array_equal(outside.q, [[0.3, -0.2, 1.0]] * 3)
    assert not outside.dq.any() and not outside.ddq.any()


@pytest.mark.parametrize("harmonics", [2, 5, 9])
def test_rest_basis_is_the_whole_null_space(harmonics: int) -> None:
    basis, k = rest_basis(harmonics), np.arange(1.0, harmonics + 1.0)
    conditions = np.zeros((2, 2 * harmonics))
    conditions[0, :harmonics], conditions[1, harmonics:] = k, k**2
    assert basis.shape == (2 * harmonics, 2 * harmonics - 2)
    np.testing.assert_allclose(conditions @ basis, 0.0, atol=1e-12)
    np.testing.assert_allclose(basis.T @ basis, np.eye(2 * harmonics - 2), atol=1e-12)


def test_round_trip_through_json_is_exact() -> None:
    motion = some_motion()
    back = trajectory_from_dict(json.loads(json.dumps(motion.to_dict())))
    assert isinstance(back, FourierMotion)
    assert motion.to_dict()["kind"] == "fourier"
    for name in ("start", "sine", "cosine", "period", "periods"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))


def test_refuses_a_series_that_starts_moving() -> None:
    with pytest.raises(ValueError, match="velocity is not zero"):
        FourierMotion(np.zeros(1), np.array([[1.0, 0.5]]), np.zeros((1, 2)), 5.0)
    with pytest.raises(ValueError, match="accel. is not zero"):
        FourierMotion(np.zeros(1), np.zeros((1, 2)), np.array([[1.0, 0.5]]), 5.0)


@pytest.mark.parametrize("period, periods", [(0.0, 1), (-1.0, 1), (np.inf, 1), (np.nan, 1), (5, 0)])
def test_refuses_no_time(period: float, periods: int) -> None:
    with pytest.raises(ValueError, match="no motion"):
        FourierMotion.from_free([0.0], np.ones((1, 4)), period, periods)


def test_is_a_trajectory() -> None:
    trajectory: Trajectory = some_motion()
    assert len(trajectory.sample([])) == 0
