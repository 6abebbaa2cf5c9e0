"""Efforts that were computed from the motion are distinguished from measured ones."""

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.signals.measured_signals import (
    computed_efforts_check,
    noise_levels,
)

STEP = 2.0 * np.pi / 2**17


@pytest.fixture(scope="module")
def smooth(made: Arm) -> Array:
    """The log of the arm with efforts that the nominal model computes."""
    table = made.table.copy()
    table[:, made.at("tau{}_Nm")] = made.reference.model.prior.torque(made.motion)
    return table


def found(arm: Arm, table: Array, steps: float = STEP) -> Finding:
    table = table.copy()
    if steps:
        q = arm.at("q{}_rad")
        table[:, q] = np.round(table[:, q] / steps) * steps
    (finding,) = computed_efforts_check(arm.case(table))
    return finding


def test_measured_efforts_are_ok(arm: Arm) -> None:
    assert found(arm, arm.table).severity == Severity.OK


@pytest.mark.parametrize("digits", [2, 15])
def test_efforts_of_a_model_are_wrong_beside_measured_positions(
    arm: Arm, smooth: Array, digits: int
) -> None:
    table = smooth.copy()
    efforts = arm.at("tau{}_Nm")
    table[:, efforts] = np.round(table[:, efforts], digits)
    finding = found(arm, table)
    assert finding.severity == (Severity.WRONG if digits > 2 else Severity.OK), finding.figure
    assert digits == 2 or "computed from the motion, not measured" in finding.says


def test_a_simulation_without_any_noise_is_called_one(arm: Arm, smooth: Array) -> None:
    finding = found(arm, smooth, steps=0.0)
    assert finding.severity == Severity.DOUBTFUL and "simulation" in finding.says


def test_smooth_efforts_with_more_than_the_model_may_be_filtered(arm: Arm, smooth: Array) -> None:
    table = smooth.copy()
    q, efforts = arm.motion.q, arm.at("tau{}_Nm")
    table[:, efforts] += 0.1 * table[:, efforts].std(axis=0) * np.sin(5.0 * q)
    finding = found(arm, table)
    assert finding.severity == Severity.DOUBTFUL and "low-passed" in finding.says
    both = found(arm, table, steps=0.0)
    assert both.severity == Severity.OK and not both.answered


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_noise_is_measured_far_below_the_signal(jitter: float) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(4000.0) + jitter * rng.uniform(-0.5, 0.5, 4000)
    x = np.sin(0.02 * t)[:, None] * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0]
    x[:, 1] += 1e-4 * rng.standard_normal(len(t))
    levels = noise_levels(t, x, np.ones(x.shape, dtype=np.bool_))
    assert levels[0] < 1e-9 and levels[1] == pytest.approx(1e-4, rel=0.05)
    assert np.isnan(levels[2])
