"""The default method: likeliest low-passes, the mean period, and when neither is believed."""

from typing import Any

import numpy as np
import pytest

from steelyard.base.errors import LogError, ModelError
from steelyard.runs.smoothing.kalman_smoother import kalman_smoothed
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import (
    Auto,
    LowPasses,
    likeliest_cutoffs,
)
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Butterworth,
    Choosing,
    continued_at_ends,
)

RATE = 250.0


def motion(count: int, period: float | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two joints, with corners as friction makes them; they repeat or do not."""
    t = np.arange(count) / RATE
    tones = [(0.31, 0.5), (0.73, 0.3)] if period is None else [(1 / period, 0.5), (2 / period, 0.3)]
    states = []
    for shift in (0.0, 1.0):
        q, dq, ddq = np.zeros((3, count))
        for f, a in tones:
            w = 2.0 * np.pi * f
            for k in range(1, 12, 2):
                angle = k * w * t + shift
                q += a / k**4 * np.sin(angle)
                dq += a * w / k**3 * np.cos(angle)
                ddq -= a * w**2 / k**2 * np.sin(angle)
        states.append((q, dq, ddq))
    q, dq, ddq = np.array(states).transpose(1, 0, 2)
    return q, dq, ddq


def applied(method: Auto, q: np.ndarray, dq: np.ndarray | None = None) -> np.ndarray:
    designed = method.designed(30.0, RATE)
    halo = designed.halo or 0
    return designed(
        continued_at_ends(q, halo, halo), None if dq is None else continued_at_ends(dq, halo, halo)
    )


def test_white_noise_gives_the_kalman_smoother_as_a_filter() -> None:
    rng = np.random.default_rng(0)
    q, _, _ = motion(6000)
    noisy = q + np.array([[1e-5], [1e-4]]) * rng.standard_normal(q.shape)
    method = Auto().chosen(noisy, None, RATE, 0.8, whole=True)
    assert method.cutoffs is not None and method.cutoffs[0] > 1.5 * method.cutoffs[1]
    assert method.periodic == ()
    assert isinstance(method, Choosing)
    found = applied(method, noisy)
    kalman = kalman_smoothed(np.arange(6000) / RATE, noisy.T)
    inner = slice(600, -600)
    for ours, theirs in zip(found, (kalman.value, kalman.rate, kalman.acceleration), strict=True):
        apart = np.std((ours - theirs.T)[:, inner], axis=1)
        assert (apart < 0.15 * np.std((theirs.T - found.mean())[:, inner], axis=1)).all()
    errors = [np.std((x - y)[:, inner]) for x, y in ((found[0], q), (kalman.value.T, q))]
    assert errors[0] == pytest.approx(errors[1], rel=0.05)


def test_noise_that_is_not_white_leaves_the_butterworth() -> None:
    rng = np.random.default_rng(1)
    q, dq, _ = motion(6000)
    jumpy = q + np.repeat(1e-3 * rng.standard_normal((2, 1500)), 4, axis=1)
    assert likeliest_cutoffs(jumpy, 3, RATE, 0.8) is None
    method = Auto().chosen(jumpy, None, RATE, 0.8, whole=True)
    assert method == Auto()
    designed = Butterworth().designed(30.0, RATE)
    extended = continued_at_ends(jumpy, designed.halo or 0, designed.halo or 0)
    np.testing.assert_array_equal(applied(method, jumpy), designed(extended, None))
    white = q + 1e-4 * rng.standard_normal(q.shape)
    smooth = dq + np.repeat(1e-2 * rng.standard_normal((2, 1500)), 4, axis=1)
    mixed = Auto().chosen(white, smooth, RATE, 0.8, whole=True)
    assert mixed.cutoffs is not None and mixed.velocity_cutoffs is None
    found = applied(mixed, white, smooth)
    extended = continued_at_ends(smooth, designed.halo or 0, designed.halo or 0)
    wide = designed(extended, extended)
    np.testing.assert_allclose(found[1:], wide[1:], atol=1e-9)
    alone = LowPasses(mixed.cutoffs, 3, RATE)
    np.testing.assert_allclose(found[0], alone(continued_at_ends(white, alone.halo, alone.halo))[0])


def test_logged_velocities_have_their_own_low_passes() -> None:
    rng = np.random.default_rng(2)
    q, dq, ddq = motion(6000)
    positions = q + 1e-4 * rng.standard_normal(q.shape)
    velocities = dq + 1e-2 * rng.standard_normal(q.shape)
    method = Auto().chosen(positions, velocities, RATE, 0.8, whole=True)
    assert method.velocity_cutoffs is not None and method.period is None
    found = applied(method, positions, velocities)
    inner = slice(600, -600)
    assert np.std((found[1] - dq)[:, inner]) < 0.6e-2
    wide = applied(Auto(), positions, velocities)
    assert np.std((found[2] - ddq)[:, inner]) < 0.5 * np.std((wide[2] - ddq)[:, inner])


def test_joints_that_repeat_are_averaged() -> None:
    rng = np.random.default_rng(3)
    q, dq, ddq = motion(6000, 4.0)
    other = motion(6000)[0][1]
    both = np.stack((q[0], q[0] + 5e-4 * other))
    noisy = both + 1e-4 * rng.standard_normal(both.shape)
    once = Auto().chosen(noisy, None, RATE, 0.8, whole=False)
    assert once.period is None
    method = Auto().chosen(noisy, None, RATE, 0.8, whole=True)
    assert method.periodic == (1,)
    assert method.period == pytest.approx(4.0, abs=1e-3)
    assert method.designed(30.0, RATE).halo is None
    better, plain = applied(method, noisy), applied(once, noisy)
    inner = slice(600, -600)
    for order, true in enumerate((q, dq, ddq)):
        ours, theirs = (np.std((x[order, 0] - true[0])[inner]) for x in (better, plain))
        assert ours < (0.7, 0.8, 0.95)[order] * theirs
    np.testing.assert_allclose(better[:, 1], plain[:, 1], atol=1e-12)


def test_too_few_samples_tell_nothing() -> None:
    assert likeliest_cutoffs(np.random.default_rng(0).normal(size=(2, 400)), 3, RATE, 1.0) is None


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"period": 2.0, "periodic": (1,)}, "only with the joints that have it and all cut-offs"),
        ({"cutoffs": (5.0,), "period": 2.0}, "only with the joints that have it"),
        ({"cutoffs": (5.0,), "periodic": (1,)}, "only with the joints that have it"),
        ({"cutoffs": (5.0,), "period": -2.0, "periodic": (1,)}, "-2 s is not above zero"),
        ({"cutoffs": (5.0,), "period": np.nan, "periodic": (1,)}, "nan s is not above zero"),
        ({"cutoffs": (5.0,), "period": 2.0, "periodic": (0,)}, "no joint 0"),
        ({"cutoffs": (5.0,), "period": 2.0, "periodic": (1, 2)}, "no joint 2"),
    ],
)
def test_a_period_that_does_not_fit(keys: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ModelError, match=wrong):
        Auto(**keys)


def test_cutoffs_that_do_not_fit() -> None:
    with pytest.raises(LogError, match="3 cut-offs for 2 joints"):
        applied(Auto(cutoffs=(5.0, 6.0, 7.0)), motion(3000)[0])
