"""Scores on a run in memory, against numbers worked out by hand and by SciPy."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from invented import single
from steelyard.measurement import Processing, Recording, Run, prepare
from steelyard.measurement.recording import LogInMemory
from steelyard.model import Model, ValuedModel
from steelyard.motion import Motion
from steelyard.parameters import Parameters
from steelyard.robot_file.signals import Signals
from steelyard.validation.score import score

MODEL = Model(single())
GAIN = 2.5
RATE = 200.0


def valued(factor: float = 1.0) -> ValuedModel:
    values = np.random.default_rng(0).normal(size=len(MODEL.names)) * factor
    return MODEL.at(Parameters(MODEL.names, MODEL.units, values))


def run_of(effort_of: object, rest: float = 0.0, pause: bool = False) -> Run:
    """A log of one joint: rest, then a swing, with a pause from 5 to 8 s; effort in amperes."""
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    phase = np.clip(t - rest, 0.0, None)
    if pause:
        ramp = np.clip(np.minimum(abs(t - 6.5) - 1.5, 0.5), 0.0, 0.5) / 0.5
        phase = np.cumsum(ramp**2 * (3.0 - 2.0 * ramp)) / RATE
    fade = np.clip(phase, 0.0, 1.0) ** 3
    q = 0.8 * fade * np.sin(2.0 * phase)
    dq, ddq = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    effort = effort_of(Motion(t, q[:, None], dq[:, None], ddq[:, None]))  # type: ignore[operator]
    one = np.ones(1)
    signals = Signals(
        "t", 1.0, ("q",), one, None, None, ("i",), one, "motor_current", ("A",), GAIN * one
    )
    table = np.column_stack([t, q, effort])
    log = LogInMemory(Path("swing"), ("t", "q", "i"), table)
    return prepare(Recording(log, signals), Processing(20.0, 5.0))


def test_the_true_model_has_next_to_no_error() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN)
    found = score(valued(), run, np.array([GAIN]), 5.0)
    assert found.joints[0].relative_percent < 0.5
    assert found.joints[0].unit == "A"


def test_figures_are_those_of_the_definition() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN + 0.3)
    found = score(valued(), run, np.array([GAIN]), 5.0, MODEL.prior)
    data = run.whole()
    sos = butter(4, 5.0, fs=run.rate, output="sos")
    inside = slice(200, -200)
    measured = sosfiltfilt(sos, data.effort[:, 0])
    predicted = sosfiltfilt(sos, valued().torque(data.motion)[:, 0] / GAIN)
    assert np.allclose(found.traces.measured[inside, 0], measured[inside], atol=1e-6)
    assert np.allclose(found.traces.predicted[inside, 0], predicted[inside], atol=1e-6)
    joint = found.joints[0]
    error = found.traces.measured - found.traces.predicted
    assert joint.rmse == pytest.approx(np.sqrt(np.mean(error**2)))
    assert joint.rmse == pytest.approx(0.3, rel=0.02)
    zero = np.sqrt(np.mean(found.traces.measured**2))
    assert joint.predict_zero == pytest.approx(zero)
    assert joint.relative_percent == pytest.approx(100.0 * joint.rmse / zero)
    assert found.pooled_percent == pytest.approx(joint.relative_percent)
    assert found.mean_percent == pytest.approx(joint.relative_percent)
    nominal = MODEL.prior
    assert nominal is not None
    prior = sosfiltfilt(sos, nominal.torque(data.motion)[:, 0] / GAIN)
    assert joint.prior_rmse == pytest.approx(np.sqrt(np.mean((measured - prior) ** 2)), rel=0.02)


def test_rests_do_not_count_where_the_joint_moves() -> None:
    def sticky(motion: Motion) -> np.ndarray:
        torque = valued().torque(motion) / GAIN
        return torque + np.where(np.abs(motion.t[:, None] - 6.5) < 1.2, 5.0, 0.0)

    found = score(valued(), run_of(sticky, pause=True), np.array([GAIN]), 5.0)
    joint = found.joints[0]
    assert joint.relative_percent > 30.0
    assert joint.relative_percent_moving is not None
    assert joint.relative_percent_moving < 5.0
    resting = ~found.traces.moving[:, 0]
    assert 2.0 < resting.sum() / RATE < 3.2


def test_the_score_begins_with_the_first_motion() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN, rest=4.0)
    found = score(valued(), run, np.array([GAIN]), 5.0)
    assert 4.0 <= found.traces.t[0] < 4.6


def test_a_joint_without_effort_has_no_finite_relative_error() -> None:
    run = run_of(lambda motion: 0.0 * motion.q)
    found = score(valued(), run, np.array([GAIN]), 5.0)
    assert found.joints[0].relative_percent == float("inf")
    assert found.joints[0].predict_zero == 0.0
    printed = found.to_dict()["joints"][0]
    assert printed["relative_percent"] is None


def test_traces_of_long_runs_are_evenly_spaced(monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN + 0.3)
    full = score(valued(), run, np.array([GAIN]), 5.0)
    monkeypatch.setattr("steelyard.validation.score.MOST_DRAWN", 300)
    monkeypatch.setattr(Run, "blocks", lambda self, size=4096: blocks(self, 217))
    few = score(valued(), run, np.array([GAIN]), 5.0)
    assert 150 <= len(few.traces.t) <= 300
    step = round(len(full.traces.t) / len(few.traces.t))
    for name in ("t", "measured", "predicted", "moving"):
        assert np.allclose(getattr(few.traces, name), getattr(full.traces, name)[::step])
    assert few.joints[0].rmse == pytest.approx(full.joints[0].rmse, rel=1e-9)
    assert few.pooled_percent_moving == pytest.approx(full.pooled_percent_moving, rel=1e-9)


blocks = Run.blocks
