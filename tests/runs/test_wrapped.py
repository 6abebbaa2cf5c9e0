"""Positions that are logged modulo a turn are made continuous."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import TURN, LogInMemory, Recording, wrapped_middles
from steelyard.simulate.simulate import write_demo_arm


def motion(duration: float = 20.0) -> tuple[Array, Array]:
    """Time and positions of six joints; the first turns on and on, the third stays within."""
    t = np.arange(0.0, duration, 0.01)
    size = np.array([0.0, 2.4, 1.0, 0.6, 2.0, 0.3])
    phase = np.array([0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
    q = size * np.sin(phase * t[:, None])
    q[:, 0] = 0.8 * (t - 5.0) + 0.3 * np.sin(t)
    return t, q


def recording(folder: Path, t: Array, q: Array, parts: int = 1) -> Recording:
    signals = write_demo_arm(folder).signals
    assert signals is not None
    dq = np.gradient(q, t, axis=0)
    wrapped = np.mod(q, TURN)
    wrapped[:, 2] = q[:, 2]
    rng = np.random.default_rng(0)
    tau = np.cos(q) + 0.1 * dq + 1e-3 * rng.normal(size=q.shape)
    table = np.column_stack([t, wrapped, dq, tau])
    return Recording(LogInMemory(Path("log"), signals.columns, table), signals)


def test_wrapped_positions_are_continuous_in_every_part(tmp_path: Path) -> None:
    t, q = motion()
    found = recording(tmp_path, t, q).unwrapped()
    assert found.wrapped == ("q1_rad", "q2_rad", "q4_rad", "q5_rad", "q6_rad")
    for size in (len(t), 137):
        x = np.concatenate([x[:, :6] for _, x in found.raw((0, None), size)])
        turns = (x - q) / TURN
        np.testing.assert_allclose(turns, np.round(turns[0]) * np.ones((len(t), 1)), atol=1e-9)
        np.testing.assert_allclose(x[:, 1:], q[:, 1:], atol=1e-9)
    assert abs(float(np.mean(x[:, 0]))) < TURN


def test_a_run_says_that_positions_were_wrapped(tmp_path: Path) -> None:
    t, q = motion()
    plain = prepare(recording(tmp_path, t, q).unwrapped(), Processing())
    assert "q1_rad, q2_rad, q4_rad" in plain.quality.losses[0]
    assert "wrap after a turn" in plain.quality.losses[0]
    assert plain.quality.kept == len(t)
    np.testing.assert_allclose(np.ptp(plain.whole().motion.q[:, 1]), 4.8, rtol=0.02)


@pytest.mark.parametrize("kind", ["never wrapped", "garbage", "one place to another"])
def test_other_positions_are_left_alone(kind: str) -> None:
    _, q = motion()
    q = q[:, 1:].copy()
    if kind == "garbage":
        q[500] = [-2.9, 3.0, 0.0, 1e293, np.nan]
    if kind == "one place to another":
        q[1000:] += 4.0
    assert np.isnan(wrapped_middles([q])).all()
