"""Set-points of a controller in place of measurements."""

from dataclasses import replace

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.signals.measured_signals import set_points_check
from steelyard.robot.init.column_names import Column

STEP = 2.0 * np.pi / 2**20


def found(arm: Arm, table: Array, steps: float = STEP) -> Finding:
    table = table.copy()
    if steps:
        q = arm.at("q{}_rad")
        table[:, q] = np.round(table[:, q] / steps) * steps
    (finding,) = set_points_check(arm.case(table))
    return finding


@pytest.mark.parametrize(
    ("name", "target"),
    [
        *((name, True) for name in ("q_des1", "tau_des1_Nm", "target_q_0", "cmd_pos1", "q_d_3")),
        *((name, True) for name in ("/arm/state/desired/positions[0]", "setpointJ1", "ref_q1")),
        *((name, False) for name in ("q1", "tau1_Nm", "dq1_rad_s", "actual_q_0", "offset1")),
        *((name, False) for name in ("/joint_states/position/elbow", "TorqueCur1", "effort_raw")),
    ],
)
def test_names_of_set_points(name: str, target: bool) -> None:
    assert Column(name).of_target == target


def test_measured_signals_are_ok(arm: Arm) -> None:
    finding = found(arm, arm.table)
    assert finding.severity == Severity.OK and finding.answered


def test_positions_without_noise_beside_noisy_efforts_are_an_open_question(arm: Arm) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")] = arm.motion.q
    finding = found(arm, table, steps=0.0)
    assert finding.severity == Severity.OK and not finding.answered
    assert "positions are noise-free: commanded positions" in finding.says
    assert found(arm, table).answered


def test_columns_that_are_called_set_points_are_doubtful_with_those_to_take(arm: Arm) -> None:
    columns = arm.columns
    renamed = tuple(c.replace("q", "q_des") if c.startswith("q") else c for c in columns)
    text = arm.text.replace('"q{}_rad"', '"q_des{}_rad"')
    (finding,) = set_points_check(replace(arm, columns=renamed).case(arm.table, text))
    assert finding.severity == Severity.DOUBTFUL
    assert finding.says == (
        "position column 'q_des1_rad' and 2 more: commanded by their names, not measured"
    )
    assert finding.fix is not None and "this log has" not in finding.fix.says
    both = (*renamed, *(c for c in columns if c.startswith("q")))
    table = np.column_stack([arm.table, arm.table[:, arm.at("q{}_rad")]])
    (finding,) = set_points_check(replace(arm, columns=both).case(table, text))
    assert finding.fix is not None and finding.fix.says.endswith("; this log has 'q{}_rad' too")
