"""Scores on a run in memory, against numbers worked out by hand and by SciPy."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from steelyard.base.motion import Motion
from steelyard.estimate.scores.score import score
from steelyard.runs.run import Run
from swinging import GAIN, MODEL, RATE, run_of, valued

WIDE = 0.0225
"""Half of the length of a jolt [s]."""


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
    assert joint.mae == pytest.approx(np.mean(np.abs(error)))
    moved = np.abs(error)[found.traces.moving[:, 0], 0]
    assert joint.mae_moving == pytest.approx(np.mean(moved))
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
    moving = found.traces.moving[:, 0]
    error = (found.traces.measured - found.traces.predicted)[moving, 0]
    assert joint.rmse_moving == pytest.approx(np.sqrt(np.mean(error**2)))
    assert joint.mae_moving == pytest.approx(np.mean(np.abs(error)))
    assert joint.mae > 2.0 * joint.mae_moving
    resting = ~moving
    assert 2.0 < resting.sum() / RATE < 3.2


def test_the_score_begins_with_the_first_motion() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN, rest=4.0)
    found = score(valued(), run, np.array([GAIN]), 5.0)
    assert 4.0 <= found.traces.t[0] < 4.6


def test_a_jolt_at_the_first_motion_is_low_passed_with_what_precedes_it() -> None:
    """At the end of a signal the filter keeps its last value; here the log begins earlier."""
    first = run_of(lambda motion: valued().torque(motion) / GAIN, rest=4.0).whole().t[0]

    def jolted(motion: Motion) -> np.ndarray:
        jolt = np.where(np.abs(motion.t[:, None] - first) < WIDE, -20.0, 0.0)
        return valued().torque(motion) / GAIN + jolt

    run = run_of(jolted, rest=4.0)
    assert run.whole().t[0] == pytest.approx(first) and first > 4.0
    found = score(valued(), run, np.array([GAIN]), 5.0)
    assert found.traces.t[0] == pytest.approx(first)
    error = (found.traces.measured - found.traces.predicted)[:, 0]
    jolt = np.where(np.abs(np.arange(2001) - 1000) < WIDE * RATE, 20.0, 0.0)
    low = sosfiltfilt(butter(4, 5.0, fs=RATE, output="sos"), jolt)
    assert np.abs(error).max() == pytest.approx(low.max(), rel=0.05)


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
    monkeypatch.setattr("steelyard.estimate.scores.score.MOST_DRAWN", 300)
    monkeypatch.setattr(Run, "blocks", lambda self, size=4096: blocks(self, 217))
    few = score(valued(), run, np.array([GAIN]), 5.0)
    assert 150 <= len(few.traces.t) <= 300
    step = round(len(full.traces.t) / len(few.traces.t))
    for name in ("t", "measured", "predicted", "moving"):
        assert np.allclose(getattr(few.traces, name), getattr(full.traces, name)[::step])
    assert few.joints[0].rmse == pytest.approx(full.joints[0].rmse, rel=1e-9)
    assert few.joints[0].mae == pytest.approx(full.joints[0].mae, rel=1e-9)
    assert few.pooled_percent_moving == pytest.approx(full.pooled_percent_moving, rel=1e-9)


blocks = Run.blocks


@pytest.mark.parametrize("rest_speed", [0.003, 0.3, 0.7])
def test_the_samples_that_count_are_those_of_the_log_whatever_the_fit_left_out(
    rest_speed: float,
) -> None:
    def slow_is_sticky(motion: Motion) -> np.ndarray:
        return valued().torque(motion) / GAIN + np.where(np.abs(motion.dq) < 0.4, 5.0, 0.0)

    usual, given = (
        run_of(slow_is_sticky, rest=2.0, rest_speed=speed) for speed in (None, rest_speed)
    )
    assert given.rest_speed.tolist() == [rest_speed] != usual.rest_speed.tolist()
    found, same = (score(valued(), run, np.array([GAIN]), 5.0) for run in (usual, given))
    assert same.to_dict() == found.to_dict()
    (joint,) = same.errors.joints
    assert joint.seconds == pytest.approx(joint.samples / RATE) and 8.0 < joint.seconds < 10.0
