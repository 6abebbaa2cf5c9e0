"""The Kalman smoother as an operation: noise found, standard deviations right, any channels."""

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing, smoother_of
from steelyard.runs.smoothing.kalman_smoother import (
    CausalKalmanSmoother,
    Kalman,
    KalmanSmoother,
    kalman_smoothed,
    likeliest_ratio,
)


def wandering(seed: int, count: int, jerk: float, step: np.ndarray) -> np.ndarray:
    """A channel whose jerk is white noise, with its first two derivatives, `(3, N)`."""
    rng = np.random.default_rng(seed)
    x, states = np.array([1.0, 0.3, 0.0]), []
    for h in step:
        noise = [
            [h**5 / 20, h**4 / 8, h**3 / 6],
            [h**4 / 8, h**3 / 3, h**2 / 2],
            [h**3 / 6, h**2 / 2, h],
        ]
        motion = np.array([[1.0, h, h**2 / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
        x = motion @ x + jerk * np.linalg.cholesky(np.array(noise)) @ rng.standard_normal(3)
        states.append(x)
    return np.array(states).T


@pytest.mark.parametrize("uneven", [False, True])
def test_both_noises_are_found_and_errors_are_as_large_as_stated(uneven: bool) -> None:
    rng = np.random.default_rng(7)
    inside, noises, jerks = [], [], []
    for seed in range(8):
        step = rng.uniform(0.005, 0.015, 1500) if uneven else np.full(1500, 0.01)
        truth = wandering(seed, 1500, 4.0, step)
        noisy = truth[0] + 1e-3 * rng.standard_normal(1500)
        found = kalman_smoothed(np.cumsum(step), noisy[:, None])
        noises.append(found.noise[0])
        jerks.append(found.jerk[0])
        for k, values in enumerate((found.value, found.rate, found.acceleration)):
            inside.append(np.abs(values[:, 0] - truth[k]) < 1.96 * found.std[k, :, 0])
    assert np.mean(noises) == pytest.approx(1e-3, rel=0.03)
    assert np.mean(jerks) == pytest.approx(4.0, rel=0.1)
    assert 0.93 < np.mean(inside) < 0.97


def test_the_likelihood_is_that_of_the_measurements() -> None:
    """The dense Gaussian likelihood with a vague start has its maximum at the same ratio."""
    rng, count = np.random.default_rng(3), 120
    truth = wandering(1, count, 0.05, np.ones(count))
    y = truth[0] + rng.standard_normal(count)
    ratio = likeliest_ratio(y, np.ones(count))
    t = np.arange(count, dtype=float)
    short, long = np.minimum.outer(t, t), np.maximum.outer(t, t)
    more = long - short
    wander = short**5 / 20.0 + more * short**4 / 8.0 + more**2 * short**3 / 12.0
    trend = t[:, None] ** np.arange(3)

    def loss(rho: float) -> float:
        """Restricted likelihood: of what no parabola explains, the variance profiled out."""
        kernel = np.linalg.qr(trend, mode="complete")[0][:, 3:]
        matrix = kernel.T @ (np.eye(count) + rho * wander) @ kernel
        rest = kernel.T @ y
        scale = rest @ np.linalg.solve(matrix, rest) / (count - 3)
        return float((count - 3) * np.log(scale) + np.linalg.slogdet(matrix)[1])

    around = [loss(ratio * 10.0**x) for x in np.linspace(-0.6, 0.6, 25)]
    assert abs(int(np.argmin(around)) - 12) <= 2


def test_seen_from_the_middle_it_is_a_low_pass() -> None:
    rate, cutoff = 200.0, 8.0
    t = np.arange(4000) / rate
    for frequency in (2.0, 8.0, 15.0):
        wave = np.sin(2.0 * np.pi * frequency * t)
        found = kalman_smoothed(t, wave[:, None], cutoff).value[1000:3000, 0]
        gain = 1.0 / (1.0 + (frequency / cutoff) ** 6)
        np.testing.assert_allclose(found, gain * wave[1000:3000], atol=0.02)
        velocity = kalman_smoothed(t, wave[:, None], cutoff, order=2).value[1000:3000, 0]
        gain = 1.0 / (1.0 + (frequency / cutoff) ** 4)
        np.testing.assert_allclose(velocity, gain * wave[1000:3000], atol=0.02)


def test_wrenches_and_still_channels() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0.0, 10.0, 2000))
    clean = np.column_stack([20.0 * np.sin(2.0 * t + k) for k in range(5)] + [np.full(2000, 4.0)])
    noise = 0.5 * rng.standard_normal((2000, 6)) * [1, 1, 1, 1, 1, 0]
    found = kalman_smoothed(t, clean + noise)
    error = np.sqrt(np.square(found.value - clean).mean(axis=0))
    assert (error[:5] < 0.12).all()
    assert error[5] < 1e-9
    np.testing.assert_allclose(found.noise[:5], 0.5, rtol=0.06)


def test_velocities_have_their_own_noise() -> None:
    rng, rate = np.random.default_rng(2), 250.0
    t = np.arange(5000) / rate
    w = 2.0 * np.pi * 0.8
    q, dq, ddq = np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)
    noisy = dq + 1e-3 * rng.standard_normal(len(t))
    positions = q + 1e-5 * rng.standard_normal(len(t))
    found = Kalman().designed(20.0, rate)(positions[None], noisy[None])
    inner = slice(200, -200)
    assert np.std((found[0, 0] - q)[inner]) < 0.6e-5
    assert np.std((found[1, 0] - dq)[inner]) < 0.7e-3
    assert np.std((found[2, 0] - ddq)[inner]) < 0.15


def test_the_cutoff_can_choose() -> None:
    x = np.random.default_rng(5).normal(size=(1, 3000))
    found = Kalman(choose="cutoff").designed(10.0, 100.0)(x, None)
    wanted = kalman_smoothed(np.arange(3000) / 100.0, x.T, 10.0)
    np.testing.assert_array_equal(found[0], wanted.value.T)


@pytest.mark.parametrize("order", [2, 3])
def test_efforts_are_smoothed_by_the_same_smoother(order: int) -> None:
    rng, rate = np.random.default_rng(6), 200.0
    t = np.arange(3000) / rate
    clean = np.stack(
        (8.0 * np.sin(3.0 * t) + 2.0 * np.sign(np.cos(3.0 * t)), 5.0 * np.cos(2.0 * t))
    )
    noisy = clean + 0.5 * rng.standard_normal(clean.shape)
    found = smoother_of({"method": "kalman", "order": order}, "here").smooth(20.0, rate)
    assert found.halo is None
    expected = kalman_smoothed(t, noisy.T, order=order).value.T
    np.testing.assert_array_equal(found(noisy), expected)
    error = np.sqrt(np.mean(np.square(found(noisy) - clean), axis=1))
    assert error[0] < 0.4 and error[1] < 0.1
    fixed = KalmanSmoother("cutoff", order).smooth(6.0, rate)  # type: ignore[arg-type]
    wanted = kalman_smoothed(t, noisy.T, 6.0, order).value.T
    np.testing.assert_array_equal(fixed(noisy), wanted)


def test_the_filter_of_efforts_is_the_textbook_recursion_and_causal() -> None:
    rng, rate, cutoff = np.random.default_rng(8), 200.0, 6.0
    noisy = np.cumsum(rng.normal(size=(2, 2000)), axis=1)
    found = CausalKalmanSmoother("cutoff").smooth(cutoff, rate)(noisy)
    ratio = (2.0 * np.pi * cutoff / rate) ** 4
    step, wander = np.array([[1.0, 1.0], [0.0, 1.0]]), ratio * np.array([[1 / 3, 0.5], [0.5, 1.0]])
    for channel, mine in zip(noisy, found, strict=True):
        state, covariance, wanted = np.array([channel[0], 0.0]), 1e6 * np.eye(2), []
        for y in channel:
            state, covariance = step @ state, step @ covariance @ step.T + wander
            gain = covariance[:, 0] / (covariance[0, 0] + 1.0)
            state = state + gain * (y - state[0])
            covariance = covariance - np.outer(gain, covariance[0])
            wanted.append(state[0])
        np.testing.assert_allclose(mine[300:], wanted[300:], atol=1e-6 * np.ptp(channel))
    changed = noisy.copy()
    changed[:, 1500:] += 10.0
    again = CausalKalmanSmoother("cutoff").smooth(cutoff, rate)(changed)
    np.testing.assert_array_equal(again[:, :1500], found[:, :1500])
    assert not np.allclose(again[:, 1500], found[:, 1500])
    likeliest = smoother_of("kalman_filter", "here").smooth(cutoff, rate)(noisy)
    late = np.sum(np.square(likeliest - noisy)) < np.sum(np.square(found - noisy))
    assert late  # a random walk without noise is followed at once


def test_a_run_has_efforts_by_kalman(recording, sines) -> None:
    t = np.arange(4000) * 0.01
    motion = sines(t)
    noisy = motion["effort"] + 0.1 * np.random.default_rng(1).normal(size=motion["effort"].shape)
    log = recording(t, motion["q"], noisy)
    for effort, cutoff, most in (
        (KalmanSmoother(), None, 0.04),
        (KalmanSmoother("cutoff"), 4.0, 0.04),
        (CausalKalmanSmoother("cutoff"), 20.0, 0.09),
    ):
        processing = Processing(8.0, 4.0, effort=effort, effort_cutoff=cutoff)
        run = prepare(log, processing)
        data = run.whole()
        truth = sines(data.t)["effort"]
        inner = slice(100, -100)
        assert np.std((data.effort - truth)[inner]) < most
        assert "efforts by kalman" in run.chain.words


@pytest.mark.parametrize("t", [np.arange(3.0), np.array([0.0, 1, 2, 2, 3, 4, 5])])
def test_too_little_is_reported(t: np.ndarray) -> None:
    with pytest.raises(LogError, match="cannot be smoothed") as caught:
        kalman_smoothed(t, np.zeros((len(t), 1)))
    assert "in order of time" in caught.value.fix
