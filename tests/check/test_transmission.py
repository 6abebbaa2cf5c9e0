"""Signs of gear ratios and couplings, of simulated logs of motors."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from check.fitted import log
from short_arm import without_wrist
from steelyard.base.arrays import Array
from steelyard.base.progress import silent
from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.case_from_files_and_precheck import case_of, subject_of
from steelyard.check.cases_and_checks import Case
from steelyard.check.check import CheckResult
from steelyard.check.decision.gears_and_friction_of_logs import (
    missing_coupling,
    other_gears,
    transmission_check,
    with_gears,
)
from steelyard.check.decision.robot_file_edits import file_gains
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Severity
from steelyard.check.findings_text_and_page import CheckContent
from steelyard.cli.log_commands import WHAT_DECIDES_GAINS, WHAT_TO_COMPARE_OF_GEARS, hints
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Transmission
from steelyard.runs.runs_of_named_logs import log_files
from steelyard.simulate.ground_truth import random_truth

RATIOS = (100.0, -100.0, 80.0)
COUPLING = '\ncoupling = [{motor = "motor_3", joint = "shoulder_lift", ratio = 50.0}]'
TRUE = np.diag(RATIOS)
TRUE[2, 1] = 50.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo arm as its model file has it, logged at its motors."""
    there = tmp_path_factory.mktemp("motors")
    log(there / "joints.parquet", random_truth(without_wrist(there).robot, 1, spread=0.0), 1)
    table = pl.read_parquet(there / "joints.parquet")
    columns = {"time_s": table["time_s"].to_numpy()}
    for name, unit, matrix in (("q", "rad", TRUE), ("tau", "Nm", np.linalg.inv(TRUE.T))):
        joints = table.select([f"{name}{k}_{unit}" for k in range(1, 4)]).to_numpy()
        columns |= {f"{name}{k}": x for k, x in enumerate((joints @ matrix.T).T, 1)}
    pl.DataFrame(columns).write_parquet(there / "motors.parquet")
    return there


def text_with(ratios: tuple[float, ...], coupling: str) -> str:
    """A robot file with these gears."""
    return f"""[robot]
urdf = "demo_arm.urdf"
[robot.transmission]
ratios = {list(ratios)}{coupling}
[signals]
time = "time_s"
position = "q{{}}"
coordinates = "motor"
[signals.effort]
columns = "tau{{}}"
kind = "motor_torque"
side = "motor"
unit = "Nm"
"""


def case_with(folder: Path, ratios: tuple[float, ...], coupling: str) -> Case:
    """The log with these gears in the robot file."""
    (folder / "motors.toml").write_text(text_with(ratios, coupling))
    logs = log_files([str(folder / "motors.parquet")])
    return case_of(subject_of(str(folder / "motors.toml"), logs[0]), logs, None, silent)[0]


@pytest.fixture(scope="module")
def uncoupled(folder: Path) -> Case:
    """The log without its coupling, judged once."""
    return case_with(folder, RATIOS, "")


def test_the_gears_of_the_log_are_not_doubted(folder: Path) -> None:
    (finding,) = transmission_check(case_with(folder, RATIOS, COUPLING))
    assert finding.severity == Severity.OK and finding.answered, finding


@pytest.mark.slow
def test_a_wrong_sign_is_found_as_one_of_positions_and_efforts(folder: Path) -> None:
    ratios = (100.0, 100.0, 80.0)
    diagnosis = examine(case_with(folder, ratios, COUPLING), quick=True)
    doubted = {finding.check for finding in diagnosis.findings if finding.severity}
    assert doubted == {"position sign", "effort sign"}


@pytest.mark.slow
def test_a_missing_coupling_is_found(uncoupled: Case) -> None:
    (finding,) = transmission_check(uncoupled)
    assert finding.severity == Severity.DOUBTFUL, finding
    assert finding.says.startswith("a coupling of motor_3 with the joint before")
    best, declared = (float(x) for x in re.findall(r"([\d.]+) %", finding.says))
    assert best < declared


def test_an_open_question_is_to_be_compared_with_the_data_sheet() -> None:
    finding = Finding("transmission", "run", Severity.OK, "undecided", "", answered=False)
    content = CheckContent("arm", "arm.toml", ("run.csv",), None, Diagnosis((finding,)), {})
    lines = hints(CheckResult(content), None, ["arm.toml", "run.csv"])
    assert lines[1] == f"next        # {WHAT_TO_COMPARE_OF_GEARS}"
    assert lines[2].endswith("steelyard identify arm.toml run.csv")


def test_what_decides_the_model_is_said_where_several_facts_are_open() -> None:
    names = "transmission", "gain", "payload"
    findings = tuple(Finding(x, "run", Severity.OK, "?", "", answered=False) for x in names)
    content = CheckContent("arm", "arm.toml", ("run.csv",), None, Diagnosis(findings), {})
    lines = hints(CheckResult(content), None, ["arm.toml", "run.csv"])
    assert lines[1].endswith(WHAT_TO_COMPARE_OF_GEARS) and lines[2].endswith(WHAT_DECIDES_GAINS)


def test_a_coupling_that_may_be_missing_is_a_remark_unless_couplings_are_stated(
    folder: Path,
) -> None:
    says = "undecided: other couplings of m3 with the joint before; the best of them, ..."
    open_one = Finding("transmission", "run", Severity.OK, says, "", answered=False)
    (remark,) = missing_coupling((open_one, open_one), stated=False)
    assert remark.says.startswith("no coupling is declared, but one of m3 with the joint before")
    assert remark.headline and not remark.severity
    assert missing_coupling((open_one,), stated=True) == ()
    signs = replace(open_one, says="undecided: opposite signs of the ratios of m1")
    assert missing_coupling((signs,), stated=False) == ()
    for coupling, stated in (("", False), ("\ncoupling = []", True), (COUPLING, True)):
        assert case_with(folder, RATIOS, coupling).loaded.couplings_stated == stated


@pytest.mark.slow
def test_the_declared_gears_have_the_misfit_of_the_other_checks(uncoupled: Case) -> None:
    decision = judge_log(uncoupled, uncoupled.logs[0])
    assert decision is not None
    likelihood, declared = decision.likelihood, decision.declared
    assert likelihood.signals.effort_map is None and likelihood.gears is not None
    same = with_gears(likelihood, likelihood.gears.matrix)
    assert same.signals.effort_map is not None
    misfits = declared.reading.on(same).score.misfits
    np.testing.assert_allclose(misfits, declared.misfits, rtol=1e-3)


@pytest.mark.slow
def test_gains_of_motors_are_stated_alike_in_a_robot_file_that_is_not_written_yet(
    folder: Path, uncoupled: Case
) -> None:
    decision = judge_log(uncoupled, uncoupled.logs[0])
    assert decision is not None
    fixed = load_robot(folder / "motors-fixed.toml", text_with(RATIOS, ""))
    for loaded in (uncoupled.loaded, fixed):
        np.testing.assert_allclose(file_gains(decision.likelihood, loaded), 1.0)


def test_alternatives_leave_resting_joints_and_declared_gears_out() -> None:
    gears = Transmission(("a", "b", "c"), np.array([[2.0, 0, 0], [3.0, 4.0, 0], [0, 0, 5.0]]))
    listed = {one.says: one.matrix for one in other_gears(gears, [True, True, False])}
    assert not any(np.array_equal(matrix, gears.matrix) for matrix in listed.values())
    assert set(listed) == {
        "the opposite sign of the ratio of a",
        "the opposite sign of the ratio of b",
        "no coupling of b with the joint before",
        "the opposite coupling of b with the joint before",
    }
    changed: Array = listed["the opposite coupling of b with the joint before"]
    assert changed[1, 0] == -3.0
