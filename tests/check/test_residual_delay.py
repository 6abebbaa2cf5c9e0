"""A delay of efforts shows in the residuals of a fit, if it is the same in all joints."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.all_checks import edits_that_serve_all_logs
from steelyard.check.decision.hypothesis_checks import EFFORT_DELAY
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.signs_and_delay_by_friction import (
    no_common_delay,
    residual_delay,
)


def late(arm: Arm, seconds: Array) -> Array:
    """The log with each joint's effort logged that much later."""
    table = arm.table.copy()
    t = table[:, 0]
    for column, delay in zip(arm.at("tau{}_Nm"), seconds, strict=True):
        table[:, column] = np.interp(t - delay, t, arm.table[:, column])
    return table


@pytest.mark.slow
@pytest.mark.parametrize("delay", [-0.02, 0.004, 0.03])
def test_a_short_delay_is_found_without_a_reference(arm: Arm, delay: float) -> None:
    case = arm.case(late(arm, np.full(3, delay)), known=False)
    finding, *others = EFFORT_DELAY(case)
    assert all(other.severity == Severity.OK for other in others)
    assert finding.severity == Severity.WRONG and finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "effort", "delay")
    assert edit.value == pytest.approx(delay, abs=3e-4)
    assert ("early" if delay < 0.0 else "late") in finding.says


def test_efforts_in_time_and_lags_that_differ_are_no_delay(arm: Arm) -> None:
    assert residual_delay(arm.case(arm.table, known=False)) is None
    lags = np.array([0.002, 0.011, 0.03])
    assert residual_delay(arm.case(late(arm, lags), known=False)) is None


@pytest.mark.slow
def test_efforts_that_lead_in_fast_motion_only_are_no_delay(arm: Arm) -> None:
    """A drive or a filter shifts slow and fast motion by different times; a delay does not."""
    early, efforts = late(arm, np.full(3, -0.045)), arm.at("tau{}_Nm")
    table, low = early.copy(), butter(2, 1.0, fs=200.0, output="sos")
    for j in efforts:
        table[:, j] += sosfiltfilt(low, arm.table[:, j] - early[:, j])
    case = arm.case(table, known=False)
    found = EFFORT_DELAY(case)
    assert Severity.WRONG not in [finding.severity for finding in found]
    assert not edits_that_serve_all_logs(found)[0].fix or not found[0].fix.edits
    assert no_common_delay(case, case.logs[0], -0.045)
    case = arm.case(early, known=False)
    assert not no_common_delay(case, case.logs[0], -0.045)


@pytest.mark.slow
def test_presliding_friction_is_no_delay(arm: Arm) -> None:
    presliding = arm.table.copy()
    for q, tau in zip(arm.at("q{}_rad"), arm.at("tau{}_Nm"), strict=True):
        steps = np.diff(presliding[:, q], prepend=presliding[0, q])
        kept = np.exp(-2.0 * np.abs(steps) / np.std(steps))
        state = np.zeros(len(steps))
        for k in range(1, len(steps)):
            state[k] = kept[k] * state[k - 1] + (1.0 - kept[k]) * np.sign(steps[k])
        presliding[:, tau] += 0.6 * np.std(presliding[:, tau]) * (state - np.sign(steps))
    assert residual_delay(arm.case(presliding, known=False)) is None


def test_the_interval_contains_errors_of_the_model(arm: Arm) -> None:
    table = late(arm, np.array([0.018, 0.02, 0.023]))  # joints that differ by more than their noise
    finding = residual_delay(arm.case(table, known=False))
    assert finding is not None and finding.fix is not None
    (edit,) = finding.fix.edits
    half = float(finding.says.partition("(± ")[2].partition(")")[0])
    assert 2.0 < half < 8.0 and half == pytest.approx(2e3 * edit.spread * edit.value, rel=0.05)
    assert abs(1e3 * edit.value - 20.0) < half


def test_friction_near_standstill_is_no_delay(arm: Arm) -> None:
    table = late(arm, np.full(3, 0.02))
    for dq, tau in zip(arm.at("dq{}_rad_s"), arm.at("tau{}_Nm"), strict=True):
        speed, size = table[:, dq], np.std(table[:, tau])
        slow = np.exp(-np.square(speed / (0.05 * np.max(np.abs(speed)))))  # and early by 40 ms
        table[:, tau] += 0.2 * size * np.roll(np.sign(speed) * slow, -8)
    finding = residual_delay(arm.case(table, known=False))
    assert finding is not None and finding.fix is not None
    assert finding.fix.edits[0].value == pytest.approx(0.02, abs=2e-3)


@pytest.mark.slow
def test_a_declared_delay_is_counted_in(arm: Arm) -> None:
    text = arm.text.replace('unit = "Nm"', 'unit = "Nm"\ndelay = 0.01')
    finding = residual_delay(arm.case(late(arm, np.full(3, 0.014)), text, known=False))
    assert finding is not None and finding.fix is not None
    assert finding.fix.edits[0].value == pytest.approx(0.014, abs=3e-4)


@pytest.mark.slow
def test_a_log_with_a_gap_is_not_used(arm: Arm) -> None:
    table = late(arm, np.full(3, 0.012))
    t = table[:, 0]
    whole = arm.case(table, known=False)
    assert residual_delay(whole) is not None
    gap = np.abs(t - 0.5 * (t[0] + t[-1])) < 0.15
    assert residual_delay(arm.case(table[~gap], known=False)) is None


@pytest.mark.slow
@pytest.mark.parametrize("both", [True, False])
def test_a_delay_is_written_if_every_log_shows_it(arm: Arm, both: bool) -> None:
    tables = late(arm, np.full(3, 0.012)), late(arm, np.full(3, 0.012 * both))[:-200]
    logs = [arm.case(table, known=False).logs[0] for table in tables]
    named = tuple(replace(one, name=name) for one, name in zip(logs, "ab", strict=True))
    found = EFFORT_DELAY(replace(arm.case(arm.table, known=False), logs=named))
    assert [f.severity for f in found] == [Severity.WRONG, Severity.WRONG if both else Severity.OK]
    edits = [f.fix.edits for f in edits_that_serve_all_logs(found) if f.fix is not None]
    assert [bool(one) for one in edits] == ([True, True] if both else [False])
