"""Joints that do not count from where the model file says, as `check` finds them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.fitted import demo_arm, log
from steelyard.diagnosis import Case, Severity, joint_zeros
from steelyard.diagnosis.joint_zeros import JointZeros
from steelyard.identification.checks.check_case import Subject, case_of
from steelyard.identification.logs import log_files
from steelyard.progress import silent
from steelyard.robot_file.file import load_robot
from steelyard.virtual.invent import random_truth


def case(folder: Path, offset: tuple[float, ...], line: str = "") -> Case:
    """One log of the demo arm whose encoders are off, read with one more line of `[signals]`."""
    robot, path = folder / "arm.toml", folder / "run.parquet"
    loaded = demo_arm(folder)
    text = robot.read_text().replace("[signals]\n", f"[signals]\n{line}\n")
    log(path, random_truth(loaded.robot, 1), 1, offset)
    subject = Subject(robot, text, load_robot(robot, text))
    return case_of(subject, log_files([str(path)]), None, silent)[0]


def test_an_offset_is_doubtful_with_the_line_that_corrects_it(tmp_path: Path) -> None:
    (finding,) = JointZeros()(case(tmp_path, (0.0, 0.2, 0.0, 0.0, 0.0, 0.0)))
    assert finding.severity == Severity.DOUBTFUL and finding.joints == ("shoulder_lift",)
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    np.testing.assert_allclose(edit.value, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0], atol=0.01)


def test_zeros_that_are_quarter_turns_away_are_doubtful(tmp_path: Path) -> None:
    (finding,) = JointZeros()(case(tmp_path, (0.0, 0.5 * np.pi, -0.5 * np.pi, 0.0, 0.0, 0.0)))
    assert finding.severity == Severity.DOUBTFUL and finding.joints == ("shoulder_lift", "elbow")
    assert "of the model file: shoulder_lift +90°, elbow -90° (error on" in finding.says
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    np.testing.assert_allclose(edit.value, [0.0, 1.5708, -1.5708, 0.0, 0.0, 0.0], atol=1e-4)


def test_with_that_line_no_offset_stands_out(tmp_path: Path) -> None:
    line = "position_offset = [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]"
    (finding,) = JointZeros()(case(tmp_path, (0.0, 0.2, 0.0, 0.0, 0.0, 0.0), line))
    assert finding.severity == Severity.OK and finding.says.startswith(
        "no significant zero offset of shoulder_lift, elbow, "
    )
    assert "zero offset of shoulder_lift 0.1998 ± 0.00" in finding.figure
    assert "not identifiable: shoulder_turn, flange_roll" in finding.figure


@pytest.mark.parametrize("line", ['position_offset = "identify"'])
def test_what_is_to_be_identified_is_not_reported(line: str, tmp_path: Path) -> None:
    assert JointZeros()(case(tmp_path, (0.0,) * 6, line)) == ()


def test_an_offset_that_other_errors_explain_as_well_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joint_zeros.ranked_causes
    monkeypatch.setattr(joint_zeros, "ranked_causes", lambda *a: replace(found(*a), blamed=()))
    (finding,) = JointZeros()(case(tmp_path, (0.0, 0.2, 0.0, 0.0, 0.0, 0.0)))
    assert finding.severity == Severity.OK and not finding.answered
    assert "zero offset of shoulder_lift 0.1998 ± 0.00" in finding.says
    assert "undecided" in finding.says


def test_where_no_offset_is_identifiable_the_question_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = joint_zeros.estimated_offsets
    monkeypatch.setattr(
        joint_zeros,
        "estimated_offsets",
        lambda *a: replace(offsets := found(*a), std=np.full_like(offsets.std, np.nan)),
    )
    (finding,) = JointZeros()(case(tmp_path, (0.0,) * 6))
    assert finding.severity == Severity.OK and not finding.answered
    assert finding.says.startswith("not identifiable")
