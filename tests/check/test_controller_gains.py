"""Gains from a controller's target torques and target currents."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from check.conftest import MODEL_BASED
from check.test_model_based import GAINS, TAU, edits, in_amperes, wrong
from steelyard.check.all_checks import examine
from steelyard.check.cases_and_checks import Case
from steelyard.check.decision import drive_gains_and_what_init_learns as gains_left
from steelyard.check.decision.drive_gains_and_what_init_learns import (
    ControllerGains,
    controller_gains,
    gains_of_controller,
)
from steelyard.check.finding import Edit, Severity
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.recording import LogInMemory


def case_with_targets(arm, text: str, unit: float = 1.0, weight: float = 1.0) -> Case:
    """Currents, and targets with friction of their own; the last joint has no target.

    Args:
        arm: The arm.
        text: Its robot file.
        unit: That of the currents [A].
        weight: Efforts over those of the model file.
    """
    rng = np.random.default_rng(0)
    table = arm.table.copy()
    torque, dq = weight * table[:, arm.at(TAU)], arm.motion.dq
    friction = 0.2 * torque.std(axis=0) * (np.tanh(dq / 0.05) + 0.3 * dq)
    target = torque - friction
    target[:, 2] = 0.0
    current = target / GAINS + friction / GAINS
    current += 0.02 * current.std(axis=0) * rng.standard_normal(current.shape)
    current /= unit
    table[:, arm.at(TAU)] = torque / GAINS / unit
    case = arm.case(table, text, known=False)
    names = [f"{kind}{j}" for kind in ("tau_target_", "current_target_") for j in range(1, 4)]
    (checked,) = case.logs
    log = LogInMemory(Path("log"), (*arm.columns, *names), np.hstack([table, target, current]))
    recording = replace(checked.recording, log=log)
    return replace(case, logs=(replace(checked, recording=recording),))


def test_gains_are_those_of_the_targets_within_their_intervals(arm):
    gains = controller_gains(case_with_targets(arm, in_amperes(arm)))
    assert gains.columns == ("tau_target_1", "current_target_1")
    assert gains.known.tolist() == [True] * 2 + [False]
    error = np.abs(gains.values - GAINS)[:2]
    assert np.all(error < 0.03 * GAINS[:2])
    assert gains.entries[2] == "identify"


@pytest.mark.slow
def test_gains_of_one_are_refused_with_the_controllers(arm):
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), [1.0] * 3)])
    found = examine(case_with_targets(arm, text), checks=MODEL_BASED)
    gain = edits(found)["signals.effort.gain"]
    np.testing.assert_allclose(gain[:2], GAINS[:2], rtol=0.03)
    assert gain[2] == "identify"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "unit", "size", "weight"), [("mA", "A", 1.0, 1.0), ("A", "mA", 1e-3, 0.6)]
)
def test_the_unit_of_currents_is_corrected_before_gains(arm, declared, unit, size, weight):
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "unit"), declared)])
    case = case_with_targets(arm, text, size, weight)
    found = examine(case, checks=MODEL_BASED)
    assert wrong(found) == ["effort unit"]
    assert edits(found) == {"signals.effort.unit": unit}
    (one,) = gains_of_controller(case)
    assert one.severity is Severity.WRONG
    assert [edit.value for edit in one.fix.edits] == [unit]


@pytest.mark.slow
@pytest.mark.parametrize("weight", [1.0, 3.0])
def test_efforts_of_other_links_are_doubtful_where_gains_are_confirmed(arm, weight):
    case = case_with_targets(arm, in_amperes(arm), weight=weight)
    found = [f for f in examine(case, checks=MODEL_BASED).findings if f.severity]
    if weight == 1.0:
        assert not found
        return
    (one,) = found
    assert one.check == "gain" and one.severity is Severity.DOUBTFUL
    assert "targets confirm the gains, but efforts are 3" in one.says
    assert "it is of another robot, or the arm carries a payload" in one.says


@pytest.mark.parametrize("kind", ["no targets", "torques"])
def test_without_targets_or_currents_there_are_none(arm, kind):
    case = case_with_targets(arm, arm.text if kind == "torques" else in_amperes(arm))
    if kind == "no targets":
        case = arm.case(arm.table, in_amperes(arm), known=False)
    assert controller_gains(case) is None


@pytest.mark.parametrize(
    ("factor", "severity"), [(1.0, Severity.OK), (1.25, Severity.DOUBTFUL), (2.0, Severity.WRONG)]
)
def test_declared_gains_are_compared_with_the_controllers(arm, factor, severity):
    given = [factor * float(GAINS[0]), float(GAINS[1]), float(GAINS[2])]
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), given)])
    found = gains_of_controller(case_with_targets(arm, text))
    (one,) = found
    assert one.severity is severity
    if severity is Severity.OK:
        last = arm.robot.joint_names[-1]
        assert not one.answered and one.says.startswith(f"undecided for {last}; the controller's")
        return
    assert one.joints == (arm.robot.joint_names[0],)
    (edit,) = one.fix.edits
    assert edit.value[0] == pytest.approx(GAINS[0], rel=0.03)
    assert edit.value[1:] == given[1:]


def test_gains_that_all_targets_confirm_are_ok(arm, monkeypatch):
    case = case_with_targets(arm, in_amperes(arm))
    gains = ControllerGains(("a", "b"), np.array(GAINS), 0.001 * np.array(GAINS))
    monkeypatch.setattr(gains_left, "controller_gains", lambda case: gains)
    (one,) = gains_left.gains_of_controller(case)
    assert (
        one.severity is Severity.OK and one.answered and "confirm the gains (a over b" in one.says
    )
