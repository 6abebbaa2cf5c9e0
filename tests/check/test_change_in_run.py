"""A load that is picked up and an offset that jumps in the middle of a run are found."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted.changes_within_run import (
    change_in_run_check,
    force_of_run,
    scale_drifts,
)
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

HALF = 2300
"""Row at which something changes: in the middle of a window, after 11.5 of 20 s."""


def found(arm: Arm, table: Array, *, fitted: bool = True) -> tuple[Finding, ...]:
    signals = arm.reference.signals
    run = prepare(Recording(LogInMemory(Path("log"), arm.columns, table), signals), Processing())
    if not fitted:
        return change_in_run_check(FittedCase(arm.reference, unseen=(run,)))
    information = information_from([run])(base_regressor(arm.reference.model))
    return change_in_run_check(FittedCase(arm.reference, fitted=(run,), information=information))


def with_load(arm: Arm, mass: float) -> Array:
    """The log with a load at the last link from the middle on."""
    ten = Inertia.about_com(mass, [0.02, -0.01, 0.08], np.eye(3) * 0.0025 * mass).ten
    last = arm.robot.bodies[-1].name
    names = [name for name in arm.truth.values.names if name.endswith(f".{last}")][:10]
    values = {name: arm.truth.values[name] + x for name, x in zip(names, ten, strict=True)}
    loaded = arm.truth.changed(**values)
    more = loaded.model.at(loaded.values).torque(arm.motion)
    more -= arm.truth.model.at(arm.truth.values).torque(arm.motion)
    table = arm.table.copy()
    table[HALF:, arm.at("tau{}_Nm")] += more[HALF:]
    return table


@pytest.mark.parametrize("fitted", [True, False])
def test_a_load_that_is_picked_up_is_weighed(arm: Arm, fitted: bool) -> None:
    (finding,) = found(arm, with_load(arm, 1.2), fitted=fitted)
    assert finding.severity == Severity.WRONG and finding.log == "log"
    assert "picks up a payload of 1.2" in finding.says
    start, stop = (
        float(x) for x in finding.says.split("between ")[1].split(" s")[0].split(" and ")
    )
    assert start <= 11.5 <= stop <= start + 6.0
    assert finding.fix is not None and f"@{stop:.3g}:" in finding.fix.says


@pytest.mark.parametrize("fitted", [True, False])
def test_a_force_that_passes_is_found_with_its_time_and_joints(arm: Arm, fitted: bool) -> None:
    table = arm.table.copy()
    columns = arm.at("tau{}_Nm")[:2]
    push = np.sin(np.linspace(0.0, np.pi, 400))[:, None] * 0.8 * table[:, columns].std(axis=0)
    table[1800:2200, columns] += push
    (finding,) = found(arm, table, fitted=fitted)
    assert finding.severity == Severity.DOUBTFUL and "as by a contact" in finding.says
    assert finding.joints == arm.robot.joint_names[:2]
    start, stop = (float(x) for x in re.findall(r"from ([\d.]+) to ([\d.]+) s", finding.says)[0])
    assert start == pytest.approx(9.0, abs=0.7) and stop == pytest.approx(11.0, abs=0.7)
    assert finding.fix is not None and f"LOG@{stop:.3g}:" in finding.fix.says


def test_nothing_is_left_of_a_force_whose_time_is_left_out(arm: Arm) -> None:
    table, columns = arm.table.copy(), arm.at("tau{}_Nm")[:2]
    table[1800:2200, columns] += 0.8 * table[:, columns].std(axis=0)
    recording = Recording(LogInMemory(Path("log"), arm.columns, table), arm.reference.signals)
    run, regressor = prepare(recording, Processing()), base_regressor(arm.reference.model)
    force = force_of_run(arm.reference, information_from([run])(regressor), run)
    assert force is not None and force.start <= 9.0 and force.stop >= 11.0
    assert 0.5 * (force.start + force.stop) == pytest.approx(10.0, abs=0.15)
    rest = run.leaving_out([force.stretch])
    assert force_of_run(arm.reference, information_from([rest])(regressor), rest) is None


def test_an_offset_that_jumps_is_found_with_its_joint(arm: Arm) -> None:
    table = arm.table.copy()
    column = arm.at("tau{}_Nm")[1]
    jump = 0.2 * float(np.std(table[:, column]))
    table[HALF:, column] += jump
    (finding,) = found(arm, table)
    assert finding.joints == (arm.robot.joint_names[1],) and finding.severity
    value = float(finding.says.split("jumps by ")[1].split(" ")[0])
    assert value == pytest.approx(jump, rel=0.03)


def test_offsets_of_all_joints_that_jump_are_no_payload(arm: Arm) -> None:
    table, efforts = arm.table.copy(), arm.at("tau{}_Nm")
    jumps = 0.3 * np.std(table[:, efforts], axis=0) * [1.0, -1.0, 1.0]
    table[HALF:, efforts] += jumps
    (finding,) = found(arm, table)
    assert finding.joints == arm.robot.joint_names and "offsets jump between" in finding.says
    values = [float(x) for x in re.findall(r"by ([+-][\d.]+) ±", finding.says)]
    np.testing.assert_allclose(values, jumps, rtol=0.05)


def test_a_torque_of_the_position_is_no_jump_of_an_offset(arm: Arm) -> None:
    """A hose pulls one way in the first half of a slow motion, and the other way in the second."""
    table, t = arm.table.copy(), arm.table[:, 0]
    column = arm.at("tau{}_Nm")[0]
    pull = 0.3 * np.std(table[:, column]) * np.sin(np.pi * (t / t[-1] - 0.5))
    table[:, column] += pull
    assert not any("offset" in finding.says for finding in found(arm, table))


def test_a_sound_log_is_no_change_and_slow_drift_is_of_friction(arm: Arm) -> None:
    assert found(arm, arm.table) == ()
    drift = arm.table.copy()
    efforts = arm.at("tau{}_Nm")
    ramp = np.linspace(-0.05, 0.05, len(drift))[:, None] * drift[:, efforts].std(axis=0)
    drift[:, efforts] += ramp * np.sign(arm.motion.dq)
    (finding,) = found(arm, drift)
    assert finding.severity == Severity.OK and "friction differs between the parts" in finding.says


@pytest.mark.parametrize("law", ["lugre", "directional_coulomb", "cubic"])
def test_all_laws_of_friction_count_as_friction(arm: Arm, law: str) -> None:
    signals = arm.reference.signals
    run = prepare(
        Recording(LogInMemory(Path("log"), arm.columns, arm.table), signals), Processing()
    )
    known = information_from([run])(base_regressor(arm.reference.model))
    names = tuple(name.replace("coulomb.", f"{law}.") for name in known.layout.columns)
    named = replace(known, layout=replace(known.layout, columns=names))
    assert names != known.layout.columns
    for friction in (True, False):
        assert scale_drifts(named, friction=friction) == scale_drifts(known, friction=friction)


def test_a_scale_that_drifts_is_named_with_its_joints(arm: Arm) -> None:
    table = arm.table.copy()
    efforts = arm.at("tau{}_Nm")
    table[:, efforts] *= np.linspace(1.0, 1.3, len(table))[:, None]
    (finding,) = found(arm, table)
    assert finding.severity == Severity.DOUBTFUL and finding.log == "log"
    assert "the effort scale differs between the parts" in finding.says
    assert "warm" not in finding.says and len(finding.joints) >= 2
    changes = [float(part.split(" %")[0]) for part in finding.says.split("by about ")[1:]]
    assert changes == pytest.approx([26.0] * len(changes), abs=6.0)


def repeated(arm: Arm) -> tuple[Array, Array]:
    """Seven times the periodic motion, 140 s, and the share of it that is over."""
    table = np.tile(arm.table, (7, 1))
    table[:, 0] = 0.005 * np.arange(len(table))
    return table, np.linspace(0.0, 1.0, len(table))


@pytest.mark.slow
def test_a_scale_that_drifts_through_a_long_log_is_like_one_that_gets_warm(arm: Arm) -> None:
    table, over = repeated(arm)
    table[:, arm.at("tau{}_Nm")] *= 1.0 + 0.3 * over[:, None]
    (finding,) = found(arm, table)
    assert finding.severity == Severity.DOUBTFUL
    assert "the effort scale drifts during the log, as with a gain or sensor warm" in finding.says


@pytest.mark.slow
@pytest.mark.parametrize("steady", [True, False])
def test_friction_that_steps_in_a_long_log_is_not_getting_warm(arm: Arm, steady: bool) -> None:
    table, over = repeated(arm)
    less = 0.5 * (over if steady else over > 0.5)
    names = [n for n in arm.truth.values.names if n.startswith(("coulomb.", "viscous."))]
    none = arm.truth.changed(**dict.fromkeys(names, 0.0))
    friction = arm.truth.model.at(arm.truth.values).torque(arm.motion)
    friction -= none.model.at(none.values).torque(arm.motion)
    table[:, arm.at("tau{}_Nm")] -= less[:, None] * np.tile(friction, (7, 1))
    (finding,) = found(arm, table)
    words = "drifts during the log, as with gears warm" if steady else "differs between the parts"
    assert f"friction {words}" in finding.says and ("warm" in finding.says) == steady


def test_friction_that_falls_is_no_drift_of_the_scale(arm: Arm) -> None:
    names = [n for n in arm.truth.values.names if n.startswith(("coulomb.", "viscous."))]
    less = arm.truth.changed(**{name: 0.5 * arm.truth.values[name] for name in names})
    change = less.model.at(less.values).torque(arm.motion)
    change -= arm.truth.model.at(arm.truth.values).torque(arm.motion)
    table = arm.table.copy()
    table[:, arm.at("tau{}_Nm")] += np.linspace(0.0, 1.0, len(table))[:, None] * change
    (finding,) = found(arm, table)
    assert finding.severity == Severity.OK and finding.headline
    assert "friction differs between the parts" in finding.says and "scale" not in finding.says
