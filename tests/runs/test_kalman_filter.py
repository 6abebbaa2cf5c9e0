"""The causal Kalman filter, sample by sample and in the chain, against dense least squares."""

from dataclasses import replace

import numpy as np
import pytest

import steelyard
from runs.test_kalman import wandering
from steelyard.base.errors import DataError, LogError
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.smoothing.kalman_smoother import CausalKalman
from steelyard.runs.smoothing.streaming_kalman_filter import KalmanFilter, transition

NOISE, JERK, SPEED, ACCELERATION = 0.01, 3.0, 2.0, 5.0


def positions(seed: int, t: np.ndarray) -> np.ndarray:
    return np.sin(2.0 * t) + NOISE * np.random.default_rng(seed).standard_normal(len(t))


def dense(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the last state: one least-squares problem of all noises."""
    size = 3 * len(t)
    rows, right = [], []
    for k, value in ((1, SPEED), (2, ACCELERATION)):
        rows.append(np.eye(size)[k] / value)
        right.append(0.0)
    state = np.eye(3, size)
    for k, (at, measured) in enumerate(zip(t, y, strict=True)):
        if k:
            motion, wander = transition(at - t[k - 1])
            drawn = np.zeros((3, size))
            drawn[:, 3 * k : 3 * k + 3] = JERK * np.linalg.cholesky(wander)
            state = motion @ state + drawn
            rows += list(np.eye(size)[3 * k : 3 * k + 3])
            right += [0.0] * 3
        if np.isfinite(measured):
            rows.append(state[0] / NOISE)
            right.append(measured / NOISE)
    matrix = np.array(rows)
    found = np.linalg.lstsq(matrix, np.array(right), rcond=None)[0]
    covariance = state @ np.linalg.inv(matrix.T @ matrix) @ state.T
    return state @ found, np.sqrt(np.diag(covariance))


def filled(t: np.ndarray, q: np.ndarray) -> KalmanFilter:
    found = KalmanFilter(NOISE, JERK, speed=SPEED, acceleration=ACCELERATION)
    for at, sample in zip(t, q, strict=True):
        found.step(at, sample)
    return found


@pytest.mark.parametrize("missing", [(), (5,), (7, 8, 9)])
def test_every_step_is_the_best_estimate_of_all_samples_so_far(missing: tuple[int, ...]) -> None:
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.01, 0.06, 16))
    y = positions(0, t)
    y[list(missing)] = np.nan
    for count in (1, 2, 3, 8, 9, 16):
        found = filled(t[:count], np.column_stack((y, positions(1, t)))[:count])
        states = np.stack((found.q, found.dq, found.ddq))
        mean, std = dense(t[:count], y[:count])
        np.testing.assert_allclose(states[:, 0], mean, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(found.std[:, 0], std, rtol=1e-6)
        np.testing.assert_allclose(states[:, 1], dense(t[:count], positions(1, t)[:count])[0])
        assert found.steps == count


def test_errors_are_as_large_as_stated() -> None:
    inside = []
    rng = np.random.default_rng(7)
    step = rng.uniform(0.005, 0.015, 1200)
    truth = np.stack([wandering(seed, 1200, 4.0, step) for seed in range(6)], axis=2)
    noisy = truth[0] + 1e-3 * rng.standard_normal(truth[0].shape)
    found = KalmanFilter(noise=1e-3, jerk=np.full(6, 4.0))
    for k, at in enumerate(np.cumsum(step)):
        found.step(at, noisy[k])
        if k > 20:
            error = np.stack((found.q, found.dq, found.ddq)) - truth[:, k]
            inside.append(np.abs(error) < 1.96 * found.std)
    assert 0.93 < np.mean(inside) < 0.97


def test_noise_and_jerk_come_from_a_recording() -> None:
    step = np.full(2000, 0.01)
    t = np.cumsum(step)
    truth = np.stack([wandering(seed, 2000, 4.0, step)[0] for seed in (0, 1)], axis=1)
    noisy = truth + 1e-3 * np.random.default_rng(1).standard_normal(truth.shape)
    found = KalmanFilter.fitted(t, noisy, speed=1.0)
    again = steelyard.KalmanFilter(noise=1e-3, jerk=4.0)
    for at, sample in zip(t, noisy, strict=True):
        found.step(at, sample)
        again.step(at, sample)
    np.testing.assert_allclose(found.std, again.std, rtol=0.1)
    np.testing.assert_allclose(found.dq, again.dq, atol=0.5 * again.std[1].min())
    with pytest.raises(DataError, match="joint 2 has no noise"):
        KalmanFilter.fitted(t, np.column_stack((noisy[:, 0], np.ones(2000))))


def test_delays_are_those_of_a_sine() -> None:
    rate, frequency, jerk = 200.0, 1.5, 40.0
    w = 2.0 * np.pi * frequency
    t = np.arange(2000) / rate
    found = KalmanFilter(noise=1e-4, jerk=jerk)
    states = []
    for at in t:
        found.step(at, [np.sin(w * at)])
        states.append([found.q[0], found.dq[0], found.ddq[0]])
    wave = np.exp(-1j * w * t[1200:])[:, None]
    phase = np.angle(2j * (np.array(states)[1200:] * wave).mean(axis=0) / (1j) ** np.arange(3.0))
    delays = found.delay(frequency, rate)
    np.testing.assert_allclose(delays[:, 0], -phase / w, atol=2e-5)
    assert delays[2, 0] > 10.0 * delays[1, 0] > 2e-4
    np.testing.assert_allclose(delays, KalmanFilter(1e-4, jerk).delay(frequency, rate))


def test_slow_accelerations_are_late_as_stated() -> None:
    """The continuous filter: two over the cut-off for accelerations, nothing for velocities."""
    rate, cutoff = 1000.0, 3.0
    w = 2.0 * np.pi * cutoff
    jerk = 1e-3 * np.sqrt(w**6 / rate)
    delays = KalmanFilter(1e-3, np.full(2, jerk)).delay(0.01 * cutoff, rate)
    assert delays.shape == (3, 2)
    assert delays[2] == pytest.approx(CausalKalman(cutoffs=(cutoff,)).lateness(50.0), rel=0.02)
    assert CausalKalman().lateness(cutoff) == pytest.approx(2.0 / w)
    assert np.abs(delays[:2]).max() < 1e-3 * delays[2, 0]


@pytest.mark.parametrize(
    ("t", "q", "words"),
    [
        (1.0, [0.0, 0.0], "a sample at 1.0 s after one at 1.0 s"),
        (float("nan"), [0.0, 0.0], "a sample at nan s"),
        (2.0, [0.0], "where there are 2 joints"),
        (2.0, [[0.0, 0.0]], "where there are 2 joints"),
        (2.0, [0.0, np.inf], "positions"),
    ],
)
def test_samples_that_do_not_fit_are_refused(t: float, q: list[float], words: str) -> None:
    found = KalmanFilter(0.1, 1.0)
    found.step(1.0, [0.0, 0.0])
    before = found.q
    with pytest.raises(DataError, match=words):
        found.step(t, q)
    assert found.steps == 1 and (found.q == before).all()


def test_impossible_filters_are_refused() -> None:
    with pytest.raises(DataError, match="noise = 0.0"):
        KalmanFilter(0.0, 1.0)
    with pytest.raises(DataError, match="jerk = "):
        KalmanFilter(1.0, [1.0, np.nan])
    with pytest.raises(DataError, match="finite numbers"):
        KalmanFilter(1.0, 1.0).step(0.0, [np.nan])
    with pytest.raises(DataError, match="where there are 3 joints"):
        KalmanFilter(1.0, [1.0, 2.0, 3.0]).step(0.0, [0.0])
    for frequency in (0.0, 50.0):
        with pytest.raises(DataError, match="below half the rate"):
            KalmanFilter(1.0, 1.0).delay(frequency, 100.0)


def test_the_method_is_the_filter_of_a_stream() -> None:
    rate, cutoffs = 100.0, (4.0, 9.0)
    t = np.arange(600) / rate
    q = np.stack((positions(0, t), positions(1, t)))
    found = CausalKalman(cutoffs=cutoffs).designed(20.0, rate)(q, None)
    jerk = NOISE * np.sqrt((2.0 * np.pi * np.array(cutoffs)) ** 6 / rate)
    stream = KalmanFilter(NOISE, jerk)
    for at, sample in zip(t, q.T, strict=True):
        stream.step(at, sample)
    for k, now in enumerate((stream.q, stream.dq, stream.ddq)):
        np.testing.assert_allclose(found[k, :, -1], now, rtol=1e-8)


@pytest.mark.parametrize("velocities", [False, True])
def test_the_method_looks_at_no_later_sample(velocities: bool) -> None:
    x = np.cumsum(np.random.default_rng(2).normal(size=(2, 800)), axis=1)
    other = x.copy()
    other[:, 500:] += 3.0
    designed = CausalKalman(choose="cutoff").designed(8.0, 100.0)
    one, two = (designed(y, y if velocities else None) for y in (x, other))
    np.testing.assert_array_equal(one[:, :, :500], two[:, :, :500])
    assert np.abs(one - two)[:, :, 500].min() > 0.0


def test_a_run_states_how_late_the_filter_is(recording, sines) -> None:
    t = np.arange(6000) * 0.005
    motion = sines(t)
    noisy = motion["q"] + 1e-4 * np.random.default_rng(0).normal(size=motion["q"].shape)
    method = CausalKalman()
    run = prepare(recording(t, noisy, motion["effort"]), Processing(20.0, 4.0, motion=method))
    chosen = run.chain.processing.motion
    assert isinstance(chosen, CausalKalman) and chosen.cutoffs is not None
    late = chosen.lateness(20.0)
    words = " ".join(run.quality.notes)
    assert f"causal: slow accelerations {1e3 * late:.2g} ms late" in words
    data = run.whole()
    truth = sines(data.t)["ddq"][:, 0]
    at = slice(1000, 5000)
    lags = np.arange(0, 60)
    errors = [np.sum((data.motion.ddq[at, 0] - np.roll(truth, k)[at]) ** 2) for k in lags]
    assert 0.005 * lags[int(np.argmin(errors))] == pytest.approx(late, abs=0.02)
    assert np.argmin(errors) > 0
    by_velocity = prepare(
        recording(t, noisy, motion["effort"], motion["dq"]), Processing(20.0, 4.0, motion=method)
    ).chain.processing.motion
    assert isinstance(by_velocity, CausalKalman) and by_velocity.velocity_cutoffs is not None
    slowest = min(by_velocity.velocity_cutoffs)
    assert by_velocity.lateness(20.0) == pytest.approx(np.sqrt(0.5) / (np.pi * slowest))
    same = replace(method, choose="cutoff")
    assert same.chosen(noisy.T, None, 200.0, 1.0, whole=True) is same


def test_cutoffs_fit_the_joints() -> None:
    with pytest.raises(LogError, match="there are 1 cut-offs for 2 joints"):
        CausalKalman(cutoffs=(3.0,)).designed(8.0, 100.0)(np.ones((2, 50)), None)
