"""Errors in the fixed band, against SciPy and numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import BAND
from steelyard.estimate.scores.effort_errors import (
    BandErrors,
    EffortReference,
    JointError,
    as_logged,
    band_of,
    gains_known,
    pooled,
)
from steelyard.estimate.scores.score import score
from swinging import GAIN, RATE, run_of, valued


def with_tone(motion: Motion) -> np.ndarray:
    """The true current, half an ampere too large, with a tone at 15 Hz outside the band."""
    tone = 3.0 * np.sin(2.0 * np.pi * 15.0 * motion.t[:, None])
    return valued().torque(motion) / GAIN + 0.5 + tone


def test_the_band_is_fixed_whatever_the_band_of_the_fit() -> None:
    run, gains = run_of(with_tone), np.array([GAIN])
    narrow, wide = (score(valued(), run, gains, cutoff) for cutoff in (2.0, 40.0))
    assert narrow.joints[0].rmse < 0.6 < 2.0 < wide.joints[0].rmse
    for found in (narrow, wide):
        assert found.errors.cutoff == BAND and not found.errors.at_rest
        (joint,) = found.errors.joints
        assert joint.unit == "Nm" and joint.counted
        assert joint.error == pytest.approx(0.5 * GAIN, rel=0.1), "but for the ends of the log"
    data = run.whole()
    sos = butter(4, BAND, fs=run.rate, output="sos")
    measured = sosfiltfilt(sos, data.effort[:, 0])[data.moving[:, 0]]
    used = narrow.errors.joints[0].used
    assert used == pytest.approx(GAIN * np.sqrt(np.mean(measured**2)), rel=0.02)


def test_another_band_may_be_given_and_slow_logs_limit_it() -> None:
    run = run_of(with_tone)
    found = score(valued(), run, np.array([GAIN]), 5.0, reference=EffortReference(40.0))
    assert found.errors.cutoff == 40.0 and found.errors.joints[0].error > 2.0 * GAIN
    assert band_of(EffortReference(), 10.0) == 4.0 and band_of(EffortReference(), 100.0) == BAND


def test_with_estimated_scales_the_error_is_that_of_efforts_as_logged_too() -> None:
    scale = 0.8
    run = run_of(lambda motion: scale * valued().torque(motion) / GAIN)
    gains, reference = np.array([GAIN / scale]), EffortReference(fitted=(1e3,), scales=(scale,))
    found = score(valued(), run, gains, 5.0, reference=reference).errors
    (joint,), (logged,) = found.joints, found.as_logged
    assert joint.percent_of_used < 0.1 and joint.least == 250.0
    assert logged.used == pytest.approx(scale * joint.used) and logged.least == 200.0
    assert logged.error == pytest.approx((1.0 - scale) * joint.used, rel=5e-3)
    (alone,) = pooled(as_logged([found]))
    assert alone.error == pytest.approx(logged.error)
    assert found.to_dict()["as_logged"]["pooled"] == [alone.to_dict()]
    unknown = score(valued(), run, np.ones(1) / scale, 5.0, reference=reference).errors
    for one in (*unknown.joints, *unknown.as_logged):
        assert (one.unit, one.least) == ("A", 250.0), "without a gain in the logged unit"
    plain = score(valued(), run, gains, 5.0).errors
    assert plain.as_logged == () and as_logged([plain]) == []
    assert plain.to_dict()["as_logged"] is None


def test_without_a_gain_the_error_is_in_the_logged_unit() -> None:
    run = run_of(lambda motion: valued().torque(motion) + 0.5)
    reference = EffortReference(limit=(50.0,))
    (joint,) = score(valued(), run, np.ones(1), 5.0, reference=reference).errors.joints
    assert joint.unit == "A" and joint.limit is None and joint.percent_of_limit is None


def test_a_gain_of_one_is_a_scale_for_all_currents() -> None:
    assert gains_known(("A", "A", "Nm"), np.array([1.0, 0.8, 1.0])) == (False, False, True)
    assert gains_known(("A", "A", "Nm"), np.array([-9.8, 0.8, 1.0])) == (True, True, True)
    assert gains_known(("%", "N"), np.array([-1.0, 1.0])) == (False, True)
    scaled = np.array([1.0, 9.0]) / [0.97, 1.1]
    assert gains_known(("A", "A"), scaled, (0.97, 1.1)) == (False, False)


def test_rested_time_does_not_count_where_the_joint_moves() -> None:
    def sticky(motion: Motion) -> np.ndarray:
        torque = valued().torque(motion) / GAIN
        return torque + np.where(np.abs(motion.t[:, None] - 6.5) < 1.2, 5.0, 0.0)

    run = run_of(sticky, pause=True)
    (joint,) = score(valued(), run, np.array([GAIN]), 5.0).errors.joints
    assert joint.percent_of_used < 5.0
    assert joint.samples < run.n_samples - 2.0 * RATE


ONE = JointError(
    joint="one", unit="Nm", samples=300, seconds=3.0, error=3.0, used=20.0, least=5.0, limit=100.0
)
TWO = JointError(
    joint="two", unit="Nm", samples=100, seconds=1.0, error=1.0, used=2.0, least=4.0, limit=50.0
)


def test_a_joint_is_related_to_what_it_uses_and_to_its_rating() -> None:
    assert ONE.percent_of_used == pytest.approx(15.0)
    assert ONE.percent_of_limit == pytest.approx(3.0)
    assert TWO.percent_of_used == pytest.approx(25.0), "of the least reference, not of 2 Nm"
    assert replace(TWO, used=0.0, least=0.0).percent_of_used == float("inf")
    assert replace(TWO, used=0.0, least=0.0).to_dict()["percent_of_used"] is None


def test_pooled_errors_are_of_all_samples_that_count() -> None:
    resting = replace(TWO, joint="resting", counted=False, error=1e3)
    run = BandErrors(5.0, False, (ONE, TWO, resting))
    (both,) = pooled([run])
    assert both.error == pytest.approx(np.sqrt((300 * 9.0 + 100 * 1.0) / 400))
    assert both.reference == pytest.approx(np.sqrt((300 * 400.0 + 100 * 16.0) / 400))
    assert both.limit == pytest.approx(np.sqrt((300 * 1e4 + 100 * 2500.0) / 400))
    (twice,) = pooled([run, run])
    assert twice == both
    assert pooled([BandErrors(5.0, False, (ONE, replace(TWO, limit=None)))])[0].limit is None


def test_efforts_of_different_units_are_pooled_apart() -> None:
    run = BandErrors(5.0, False, (ONE, replace(TWO, unit="N")))
    assert [(one.unit, one.error) for one in pooled([run])] == [("Nm", 3.0), ("N", 1.0)]
