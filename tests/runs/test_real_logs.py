"""The quirks that the public data sets' notes name."""

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LoggedSamples


def test_a_garbage_head_is_dropped(real) -> None:
    run = prepare(real("ur10e/identification/ur-19_09_27-11_32_02.parquet"))
    assert run.quality.rows == 1139 and run.quality.kept == 1119
    assert len(run.segments) == 1
    assert run.quality.max_speed.max() < 3.0


@pytest.mark.parametrize(
    "name",
    ["ur-20_02_05-20sec_8harm", "ur-20_02_10-30sec_12harm", "ur-20_02_19_14harm50sec"],
)
def test_ur10e_alternating_clock(real, name: str) -> None:
    recording = real(f"ur10e/identification/{name}.parquet")
    run = prepare(recording)
    assert run.rate == 100.0 and not run.quality.dropped and not run.quality.gaps
    assert 4.0 <= run.motion_cutoff <= 25.0
    assert (run.rest_speed < 0.012).all()
    data = run.whole()
    assert (data.moving.mean(axis=0) > 0.88).all()
    ((t, x),) = recording.raw(recording.cut.rows)
    raw = LoggedSamples.of(t, x, recording.channels)
    t = raw.t - raw.t[0]
    np.testing.assert_allclose(
        data.motion.q, np.stack([np.interp(data.t, t, q) for q in raw.q.T], axis=1), atol=5e-3
    )
    assert (data.t[-1] - data.t[0]) / t[-1] < 0.995


def test_ur10e_logged_velocity_and_position_agree(real) -> None:
    recording = real("ur10e/identification/ur-20_02_10-30sec_12harm.parquet")
    ((t, x),) = recording.raw(recording.cut.rows)
    raw = LoggedSamples.of(t, x, recording.channels)
    data = prepare(recording).whole()
    step = np.gradient(data.motion.q, data.t, axis=0)
    lag = np.abs(step - data.motion.dq)[50:-50]
    assert lag.max() < 0.05 * np.abs(data.motion.dq).max()
    assert raw.dq is not None


def test_point_to_point_rests(real) -> None:
    run = prepare(real("ur10e/validation/ur-20_01_17-ptp_10_points.parquet"))
    data = run.whole()
    assert run.span == pytest.approx((6.3, 47.0), abs=0.1)
    share = data.moving.mean(axis=0)
    assert (share[:4] > 0.97).all() and 0.45 < share[5] < 0.55


def test_a_lone_moving_joint(real) -> None:
    data = prepare(real("ur10e/jointwise_motion/ur-20_01_22-joint_4.parquet")).whole()
    share = data.moving.mean(axis=0)
    assert share[3] > 0.97 and (np.delete(share, 3) < 0.05).all()


@pytest.mark.parametrize("posture", [1, 2, 3, 4, 5])
def test_a_robot_at_rest(real, posture: int) -> None:
    with pytest.raises(LogError, match="no joint moves"):
        prepare(real(f"ur10e/validation/ur-20_01_17-p{posture}.parquet"))


@pytest.mark.slow
def test_panda_jitter_and_lost_packets(real) -> None:
    run = prepare(real("panda/panda_gaz2019_trajectory1.parquet@0.6:9.5"))
    assert run.rate == 1000.0 and len(run.segments) == 1 and not run.quality.dropped
    assert run.quality.steps[3] == pytest.approx(0.0085, abs=5e-4)
    assert 4.0 <= run.matched_cutoff <= 8.0
    whole = prepare(real("panda/panda_gaz2019_trajectory1.parquet")).whole()
    again = whole.t > 13.83
    at = whole.t[again] - 13.3333333
    for joint in range(7):
        first = np.interp(at, whole.t, whole.motion.q[:, joint])
        rms = np.sqrt(np.mean((first - whole.motion.q[again, joint])[:6600] ** 2))
        assert rms < 1e-3


def test_tiago_rows_and_ar5_even_clock(real) -> None:
    run = prepare(real("tiago/tiago_run1_rows0_5600.parquet#921:4442"))
    assert run.quality.rows == 3521 and run.rate == 100.0
    assert run.whole().t[0] == pytest.approx(9.21, abs=0.05)
    even = prepare(
        real("rokae_ar5/ar5_run1_rows0_2300.parquet@:34"),
        Processing(motion_cutoff=8.0, matched_cutoff=4.0),
    )
    assert even.rate == 50.0 and even.quality.steps[1] < 1e-6
    assert even.whole().t[-1] < 34.0
