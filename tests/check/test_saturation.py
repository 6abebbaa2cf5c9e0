"""Efforts that are cut off, and coarse ones that only look so."""

from pathlib import Path

import numpy as np
import pytest

from check.test_signals import case_of, sound
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.signals.measured_signals import saturation_check

SLOW = 2.0 * np.pi * 0.1 * np.arange(4000) / 100.0
WAVES = {
    "sine": np.sin(SLOW),
    "two sines": np.sin(SLOW) + 0.4 * np.sin(2.7 * SLOW + 0.5),
    "gravity and friction": np.cos(np.sin(SLOW)) + 0.3 * np.tanh(20.0 * np.cos(SLOW)),
    "half a peak": np.cos(0.25 * SLOW),
}


def finding_of(folder: Path, effort: Array) -> Finding:
    """What is found where the third joint has this effort."""
    table = np.resize(sound(), (len(effort), 10))
    table[:, 0] = 0.01 * np.arange(len(effort))
    table[:, 9] = effort
    (finding,) = saturation_check(case_of(folder, table))
    return finding


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03])
@pytest.mark.parametrize("step", [0.0005, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("wave", WAVES)
def test_a_coarse_effort_is_not_cut_off(
    tmp_path: Path, wave: str, step: float, noise: float
) -> None:
    effort = WAVES[wave] / np.ptp(WAVES[wave])
    effort = effort + noise * np.random.default_rng(1).normal(size=len(effort))
    assert finding_of(tmp_path, np.round(effort / step) * step).severity == Severity.OK


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize(("step", "limit"), [(1e-5, 0.45), (0.002, 0.45), (0.02, 0.4), (0.05, 0.3)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_effort_that_is_cut_off_is_found(
    tmp_path: Path, sign: float, step: float, limit: float, noise: float
) -> None:
    effort = 0.5 * WAVES["sine"] + noise * np.random.default_rng(1).normal(size=len(SLOW))
    effort = sign * np.minimum(np.round(effort / step) * step, limit)
    found = finding_of(tmp_path, effort)
    assert found.severity == Severity.DOUBTFUL and found.joints == ("joint_3",)
    assert f"stays at {sign * limit:.4g} Nm" in found.says


def test_a_torque_that_is_switched_is_not_cut_off(tmp_path: Path) -> None:
    effort = 1e-3 * np.sin(7.0 * SLOW)
    effort[500:620], effort[900:1020] = 1.0, -1.0
    assert finding_of(tmp_path, effort).severity == Severity.OK
