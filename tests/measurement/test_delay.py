"""Delay between channels, to a fraction of a sample, with an honest error."""

import numpy as np
import pytest

from steelyard.errors import LogError
from steelyard.measurement.delay import estimated_delay


def channels(rate: float, lag: float, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.arange(int(20.0 * rate)) / rate
    f, phase, size = (
        np.array([0.2, 0.5, 0.9, 1.7, 2.3]),
        rng.uniform(0, 6, 5),
        rng.uniform(0.3, 1, 5),
    )

    def motion(at: np.ndarray) -> np.ndarray:
        return (size * np.sin(2.0 * np.pi * f * at[:, None] + phase)).sum(axis=1)

    a, b = motion(t), 3.0 * motion(t - lag)
    return a + noise * rng.normal(size=len(t)), b + 3.0 * noise * rng.normal(size=len(t))


def test_delays_lie_within_their_errors() -> None:
    rng, off = np.random.default_rng(1), []
    for seed in range(60):
        rate, lag = rng.choice([100.0, 250.0, 1000.0]), rng.uniform(-0.05, 0.2)
        found = estimated_delay(*channels(rate, lag, rng.choice([0.001, 0.02, 0.1]), seed), rate)
        assert abs(found.seconds - lag) < max(0.3 / rate, 4.0 * found.std)
        assert found.coherence > 0.9
        off.append((found.seconds - lag) / found.std)
    assert 0.3 < np.std(off) < 1.5 and np.abs(off).max() < 4.5


def test_the_order_of_the_channels_is_the_sign() -> None:
    a, b = channels(250.0, 0.08, 0.01, 0)
    forth, back = estimated_delay(a, b, 250.0), estimated_delay(b, a, 250.0)
    assert forth.seconds == pytest.approx(0.08, abs=5e-4)
    assert back.seconds == pytest.approx(-forth.seconds, abs=2e-4)


def test_the_lags_of_real_velocities(real) -> None:
    """As the notes of the data sets say: the Panda's 5 ms."""
    (raw,) = real("panda/panda_gaz2019_trajectory1.parquet").parts()
    import polars as pl

    log = real("panda/panda_gaz2019_trajectory1.parquet").log
    dq = pl.read_parquet(log.path)[[f"dq{j}_rad_s" for j in range(1, 8)]].to_numpy()
    t = np.arange(raw.t[0] + 0.6, raw.t[-1], 1e-3)
    for joint in range(7):
        slope = np.gradient(np.interp(t, raw.t, raw.q[:, joint]), t)
        late = estimated_delay(slope, np.interp(t, raw.t, dq[:, joint]), 1000.0)
        assert late.seconds == pytest.approx(0.005, abs=0.001)


def test_what_has_no_delay_is_told() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(LogError, match="too few for a delay"):
        estimated_delay(np.zeros(50), np.zeros(50), 100.0)
    with pytest.raises(LogError, match="no frequency in common"):
        estimated_delay(rng.normal(size=4000), np.zeros(4000), 100.0)
