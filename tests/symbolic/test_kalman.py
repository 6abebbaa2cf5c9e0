"""The compiled Kalman filter and smoother against the textbook's, written down with matrices."""

import numpy as np
import pytest

from steelyard.symbolic.native.kalman_loops import filtered, smoothed


def model(step: float, ratio: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Motion and noise of a step: the noise by quadrature over when the jerk struck."""
    motion = np.array([[1.0, step, step**2 / 2.0], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    noise = np.zeros((3, 3))
    for node, weight in zip(nodes, weights, strict=True):
        left = 0.5 * step * (node + 1.0)
        state = np.array([left**2 / 2.0, left, 1.0])
        if order == 2:
            state = np.array([left, 1.0, 0.0])
        noise += 0.5 * step * weight * ratio * np.outer(state, state)
    return motion, noise


def textbook(
    y: np.ndarray, h: np.ndarray, ratio: float, x: np.ndarray, p: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Innovations with variances, smoothed states and their variances (p5, eq 16; RTS)."""
    before, spread, after, narrow, seen = [], [], [], [], []
    for k in range(len(y)):
        motion, noise = model(h[k], ratio, order)
        x, p = motion @ x, motion @ p @ motion.T + noise
        before.append(x)
        spread.append(p)
        gain = p[:, 0] / (p[0, 0] + 1.0)
        seen.append((y[k] - x[0], p[0, 0] + 1.0))
        left = np.eye(3) - np.outer(gain, [1.0, 0.0, 0.0])
        x, p = x + gain * (y[k] - x[0]), left @ p @ left.T + np.outer(gain, gain)
        after.append(x)
        narrow.append(p)
    for k in range(len(y) - 2, -1, -1):
        motion, _ = model(h[k + 1], ratio, order)
        back = narrow[k] @ motion.T @ np.linalg.pinv(spread[k + 1], rcond=1e-13)
        after[k] = after[k] + back @ (after[k + 1] - before[k + 1])
        narrow[k] = narrow[k] + back @ (narrow[k + 1] - spread[k + 1]) @ back.T
    return np.array(seen), np.array(after), np.array([np.diag(p) for p in narrow])


@pytest.mark.parametrize("order", [3, 2])
@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("count", [1, 2, 300])
def test_it_is_the_textbooks(order: int, ratio: float, count: int) -> None:
    rng = np.random.default_rng(count)
    h = rng.uniform(0.3, 1.7, count)
    h[0] = 0.0
    y = 20.0 * np.sin(np.cumsum(h) / 9.0) + rng.standard_normal(count)
    start, spread = np.array([1.0, 2.0, 0.0]), np.diag([10.0, 3.0, 0.5 if order == 3 else 0.0])
    kept = filtered(y, h, ratio, start, spread, order)
    seen, states, variances = textbook(y, h, ratio, start, spread, order)
    np.testing.assert_allclose(kept[:, 9:], seen, rtol=1e-9, atol=1e-9)
    found, narrow = smoothed(kept, h)
    np.testing.assert_allclose(found, states, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(narrow, variances, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("ratio", [1e-18, 1e-12])
def test_a_parabola_stays_one_however_little_noise_there_is(ratio: float) -> None:
    """The banded normal equations of the states are off by percents, or have no Cholesky factor."""
    h = np.concatenate(([0.0], np.ones(1999)))
    t = np.cumsum(h)
    y = 3.0 + 0.2 * t + 0.01 * t**2
    start = np.array([3.0, 0.2, 0.02])
    states, _ = smoothed(filtered(y, h, ratio, start, 1e6 * np.eye(3)), h)
    truth = np.stack((y, 0.2 + 0.02 * t, np.full_like(t, 0.02)), axis=1)
    assert (np.abs(states - truth).max(axis=0) < [1e-8, 1e-10, 1e-12]).all()


def test_no_samples_and_wrong_shapes() -> None:
    none = np.zeros(0)
    kept = filtered(none, none, 1.0, np.zeros(3), np.eye(3))
    assert kept.shape == (0, 11)
    assert smoothed(kept, none)[0].shape == (0, 3)
    with pytest.raises(ValueError, match="differ in shape"):
        filtered(np.zeros(3), np.zeros(2), 1.0, np.zeros(3), np.eye(3))


def test_arrays_of_any_layout() -> None:
    rng = np.random.default_rng(1)
    y, h = rng.normal(size=(40, 3))[:, 1], np.ones((40, 2))[:, 0]
    kept = filtered(y, h, 0.1, np.zeros(3), np.eye(3))
    again = filtered(y.copy(), h.copy(), 0.1, np.zeros(3), np.eye(3))
    np.testing.assert_array_equal(kept, again)
