"""Joints that do not count from where the model file says, as `check` finds them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import steelyard
from check.conftest import MODEL_BASED
from check.fitted import demo_arm, log
from steelyard.base.progress import silent
from steelyard.check.all_checks import examine
from steelyard.check.case_from_files_and_precheck import Subject, case_of
from steelyard.check.cases_and_checks import Case
from steelyard.check.decision import joint_zeros_and_quarter_turns
from steelyard.check.decision.hypothesis_checks import JOINT_ZEROS
from steelyard.check.decision.joint_zeros_and_quarter_turns import joint_zeros_check, turned_joints
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.finding import Severity
from steelyard.check.hypotheses import position_and_effort_hypotheses as by_zero
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    zero_offsets,
    zeros_without_effect,
)
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import edited
from steelyard.runs.runs_of_named_logs import log_files
from steelyard.simulate.ground_truth import random_truth


def case(folder: Path, offset: tuple[float, ...], line: str = "") -> Case:
    """One log of the demo arm whose encoders are off, read with one more line of `[signals]`."""
    robot, path = folder / "arm.toml", folder / "run.parquet"
    loaded = demo_arm(folder, joints=len(offset))
    text = robot.read_text().replace("[signals]\n", f"[signals]\n{line}\n")
    log(path, random_truth(loaded.robot, 1), 1, offset)
    subject = Subject(robot, text, load_robot(robot, text))
    return case_of(subject, log_files([str(path)]), None, silent)[0]


@pytest.mark.slow
def test_an_offset_is_doubtful_with_the_line_that_corrects_it(tmp_path: Path) -> None:
    (finding,) = joint_zeros_check(case(tmp_path, (0.0, 0.2, 0.0)))
    assert finding.severity == Severity.DOUBTFUL and finding.joints == ("shoulder_lift",)
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    np.testing.assert_allclose(edit.value, [0.0, 0.2, 0.0], atol=0.01)


@pytest.mark.slow
def test_identify_says_what_is_off_and_nothing_of_zeros_that_are_right(tmp_path: Path) -> None:
    """Scales of the efforts would hide it: the error on unseen motion is small."""
    (finding,) = joint_zeros_check(replace(case(tmp_path, (0.0, 0.2, 0.0)), quick=True))
    assert finding.severity == Severity.DOUBTFUL
    found = steelyard.identify(tmp_path / "arm.toml", tmp_path / "run.parquet")
    assert any("zero offset of shoulder_lift" in one.text for one in found.verdict.limitations)
    assert joint_zeros_check(replace(case(tmp_path, (0.0, 0.0, 0.0)), quick=True)) == ()


@pytest.mark.slow
def test_zeros_that_are_quarter_turns_away_are_doubtful(tmp_path: Path) -> None:
    (finding,) = joint_zeros_check(case(tmp_path, (0.0, 0.5 * np.pi, -0.5 * np.pi, 0.0)))
    assert finding.severity == Severity.DOUBTFUL and finding.joints == ("shoulder_lift", "elbow")
    assert "of the model file: shoulder_lift +90°, elbow -90° (error on" in finding.says
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    np.testing.assert_allclose(edit.value, [0.0, 1.5708, -1.5708, 0.0], atol=1e-4)


def turned_case(folder: Path, joint: int, turn: float) -> Case:
    """One joint of an arm with the masses of its model file is turned."""
    loaded, path = demo_arm(folder), folder / "run.parquet"
    offset = tuple(turn * (k == joint) for k in range(6))
    log(path, random_truth(loaded.robot, 1, spread=0.0), 1, offset)
    subject = Subject(folder / "arm.toml", (folder / "arm.toml").read_text(), loaded)
    return case_of(subject, log_files([str(path)]), None, silent)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "degrees"), [(1, 90), (4, -90)])
def test_nominal_masses_name_the_joint_that_is_turned(
    tmp_path: Path, joint: int, degrees: int
) -> None:
    given = turned_case(tmp_path, joint, np.deg2rad(degrees))
    (finding,) = JOINT_ZEROS(given)
    assert finding.severity == Severity.DOUBTFUL and finding.joints == (given.joints[joint],)
    assert f"of the model file: {given.joints[joint]} {degrees:+d}°: misfit" in finding.says
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    expected = [np.deg2rad(degrees) * (k == joint) for k in range(6)]
    np.testing.assert_allclose(edit.value, expected, atol=1e-4)
    (limit, *others) = turned_joints((finding, finding))
    assert limit.severity == Severity.DOUBTFUL and not limit.log and not others


def test_nominal_masses_are_silent_where_no_joint_is_turned(tmp_path: Path) -> None:
    assert JOINT_ZEROS(turned_case(tmp_path, 0, 0.0)) == ()


@pytest.mark.slow
def test_with_that_line_no_offset_stands_out(tmp_path: Path) -> None:
    line = "position_offset = [0.0, 0.2, 0.0]"
    (finding,) = joint_zeros_check(case(tmp_path, (0.0, 0.2, 0.0), line))
    assert (
        finding.severity == Severity.OK
        and finding.answered
        and finding.says.startswith("no significant zero offset of shoulder_lift; ")
    )
    assert "zero offset of shoulder_lift 0.1995 ± 0.00" in finding.figure
    assert "not identifiable: shoulder_turn, elbow" in finding.figure


@pytest.mark.slow
@pytest.mark.parametrize("joint, offset", [(1, -0.4), (2, 1.5)])
def test_a_reference_finds_the_joint_and_its_offset(arm, joint: int, offset: float) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[joint]] += offset
    found = examine(arm.case(table), checks=(*MODEL_BASED, JOINT_ZEROS))
    (finding,) = [f for f in found.findings if f.severity]
    assert finding.check == joint_zeros_check.name and finding.severity == Severity.WRONG
    assert finding.joints == (arm.robot.joint_names[joint],)
    (edit,) = found.edits
    assert edit.path == ("signals", "position_offset")
    expected = np.where(np.arange(3) == joint, -offset, 0.0)
    np.testing.assert_allclose(edit.value, expected, atol=0.01)
    again = examine(arm.case(table, edited(arm.text, found.edits)), checks=(JOINT_ZEROS,))
    assert again.severity == Severity.OK and again.open_checks == ()


def test_the_interval_of_an_offset_holds_it(arm) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[1]] += 0.15
    case = arm.case(table)
    found = ranking(case, case.logs[0])
    assert found is not None
    zero = zero_offsets(found.declared.reading)[1]
    assert 0.0 < zero.std < 0.02 and abs(zero.value + 0.15) < 2.0 * zero.std
    assert zero.words.startswith("shoulder_lift -0.1")


@pytest.mark.slow
def test_joints_that_cannot_be_told_apart_are_named_together(
    arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[1]] += 0.15
    (finding,) = JOINT_ZEROS(arm.case(table))
    assert "(or of" not in finding.says
    monkeypatch.setattr(by_zero, "CLOSE_HYPOTHESES", 1e6)
    (finding,) = JOINT_ZEROS(arm.case(table))
    assert "zero offset of shoulder_lift -0.1" in finding.says
    assert "(or of elbow " in finding.says


@pytest.mark.slow
def test_with_a_reference_zeros_that_are_not_identifiable_leave_the_question_open(
    arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    (finding,) = JOINT_ZEROS(arm.case(arm.table))
    assert finding.answered and finding.says.startswith("joint zeros are those of the reference")
    monkeypatch.setattr(by_zero, "LOOSEST", {"rad": 1e-9, "m": 1e-9})
    (finding,) = JOINT_ZEROS(arm.case(arm.table))
    assert finding.severity == Severity.OK and not finding.answered
    assert finding.says == "undecided: not identifiable from these data: shoulder_lift"


def test_a_reference_states_how_far_zeros_may_be_off(arm) -> None:
    (finding,) = JOINT_ZEROS(arm.case(arm.table))
    bound = re.search(r"within \(95 %\): shoulder_lift (0\.\d+) rad", finding.says)
    assert bound and 0.0 < float(bound[1]) < 0.05, finding.says
    assert finding.says.count("not identifiable: ") == 1


def test_a_small_offset_leaves_the_zeros_open(arm) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[1]] += 0.02
    (finding,) = JOINT_ZEROS(arm.case(table))
    assert finding.severity == Severity.OK and not finding.answered
    assert "undecided: with a zero offset of shoulder_lift -0.02" in finding.says
    assert finding.says.endswith("; compare the zeros with the robot")


@pytest.mark.slow
def test_quick_checks_with_a_reference_include_the_zeros_once(arm) -> None:
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[1]] += 0.15
    for quick in (True, False):
        found = examine(arm.case(table), quick=quick)
        assert [f.check for f in found.findings if f.severity] == ["joint zeros"]
    assert JOINT_ZEROS(arm.case(table, known=False)) == ()


def test_first_joints_along_gravity_and_last_ones_have_no_identifiable_zero(arm) -> None:
    assert zeros_without_effect(arm.robot) == (True, False, True)
    assert zeros_without_effect(arm.robot.changed(gravity=(9.81, 0.0, 0.0))) == (False, False, True)


def test_what_is_to_be_identified_is_not_reported(tmp_path: Path) -> None:
    assert joint_zeros_check(case(tmp_path, (0.0,) * 3, 'position_offset = "identify"')) == ()


def test_unknown_gains_leave_the_question_open(tmp_path: Path) -> None:
    given = case(tmp_path, (0.0,) * 3)
    log = given.logs[0]
    signals = replace(log.recording.signals, unknown_gains=(False, False, True))
    unknown = replace(log, recording=replace(log.recording, signals=signals))
    case_of_unknown = replace(given, logs=(unknown,))
    (finding,) = joint_zeros_check(case_of_unknown)
    assert finding.check == "joint zeros" and not finding.answered and not finding.severity
    assert finding.says == 'not tested by a fit while gains are unknown (gain = "identify")'
    terms = tuple(t for t in given.loaded.terms if t.description != "rigid_body")
    bodiless = replace(given.loaded, terms=terms)
    assert joint_zeros_check(replace(case_of_unknown, loaded=bodiless)) == ()


@pytest.mark.slow
def test_an_offset_that_other_errors_explain_as_well_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joint_zeros_and_quarter_turns.ranked_causes
    monkeypatch.setattr(
        joint_zeros_and_quarter_turns, "ranked_causes", lambda *a: replace(found(*a), blamed=())
    )
    (finding,) = joint_zeros_check(case(tmp_path, (0.0, 0.2, 0.0)))
    assert finding.severity == Severity.OK and not finding.answered
    assert "zero offset of shoulder_lift 0.1995 ± 0.00" in finding.says
    assert "undecided" in finding.says


@pytest.mark.slow
def test_where_no_offset_is_identifiable_the_question_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joint_zeros_and_quarter_turns.estimated_offsets
    monkeypatch.setattr(
        joint_zeros_and_quarter_turns,
        "estimated_offsets",
        lambda *a: replace(offsets := found(*a), std=np.full_like(offsets.std, np.nan)),
    )
    (finding,) = joint_zeros_check(case(tmp_path, (0.0,) * 3))
    assert finding.severity == Severity.OK and not finding.answered
    assert finding.says.startswith("not identifiable")


@pytest.mark.slow
def test_an_inner_joint_that_is_not_identifiable_leaves_the_question_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joint_zeros_and_quarter_turns.estimated_offsets

    def without_elbow(*given):
        offsets = found(*given)
        elbow = np.array([joint == "elbow" for joint in offsets.joints])
        return replace(offsets, std=np.where(elbow, np.nan, offsets.std))

    monkeypatch.setattr(joint_zeros_and_quarter_turns, "estimated_offsets", without_elbow)
    (finding,) = joint_zeros_check(case(tmp_path, (0.0,) * 4))
    assert finding.severity == Severity.OK and not finding.answered
    assert finding.says.startswith("no significant zero offset of shoulder_lift; ")
    assert "not identifiable: shoulder_turn, elbow, forearm_roll; a model from" in finding.says
