"""Torques with and without those of the rotors, before a fit and after it."""

from dataclasses import replace
from pathlib import Path

import pytest

from check.fitted import case as fitted_case
from check.fitted import demo_arm, log
from steelyard.base.arrays import Parameters
from steelyard.base.progress import silent
from steelyard.check.all_checks import Diagnosis
from steelyard.check.case_from_files_and_precheck import Subject, case_of
from steelyard.check.cases_and_checks import Case
from steelyard.check.check import CheckResult
from steelyard.check.finding import Severity
from steelyard.check.findings_text_and_page import CheckContent
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.implausible_estimates_and_gear_side import (
    SEPARABLE_ROTORS,
    gear_side_check,
    rotors_at_zero_check,
    rotors_of,
)
from steelyard.cli.log_commands import hints
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import log_files
from steelyard.simulate.ground_truth import random_truth


def case(folder: Path, rotors: float, *changes: tuple[str, str]) -> Case:
    """One log of the demo arm, rotor inertias times a factor, and a changed robot file."""
    robot, path = folder / "arm.toml", folder / "run.parquet"
    loaded = demo_arm(folder)
    text = robot.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    truth = random_truth(loaded.robot, 1)
    known = truth.values
    factors = [rotors if name.startswith("rotor_inertia") else 1.0 for name in known.names]
    values = Parameters(known.names, known.units, known.values * factors)
    log(path, replace(truth, values=values), 1)
    subject = Subject(robot, text, load_robot(robot, text))
    return case_of(subject, log_files([str(path)]), None, silent)[0]


def test_rotors_in_the_torques_decide(tmp_path: Path) -> None:
    (finding,) = gear_side_check(case(tmp_path, 1.0))
    assert finding.answered and finding.severity == Severity.OK and finding.fix is None
    assert finding.says == (
        f"torques contain those of the rotors: 4 of 4 {SEPARABLE_ROTORS} are significantly positive"
    )


def test_without_them_the_question_is_open(tmp_path: Path) -> None:
    (finding,) = gear_side_check(case(tmp_path, 0.0))
    assert not finding.answered and finding.severity == Severity.OK
    assert finding.figure == f"0 of 4 {SEPARABLE_ROTORS} are significantly positive"
    assert 'kind = "link_torque" without rotor_inertia' in finding.says
    content = CheckContent("arm", "arm.toml", ("run.csv",), None, Diagnosis((finding,)), {})
    assert hints(CheckResult(content), None, ["arm.toml", "run.csv"])[1:] == [
        'next        # if sensors are on the link side: kind = "link_torque" in arm.toml, '
        "no rotor_inertia in terms",
        "            steelyard identify arm.toml run.csv",
    ]


@pytest.mark.parametrize("kind", ["joint_torque", "link_torque"])
def test_models_without_rotors_ask_nothing(kind: str, tmp_path: Path) -> None:
    changes = (('"rotor_inertia", ', ""), ('"joint_torque"', f'"{kind}"'))
    assert gear_side_check(case(tmp_path, 0.0, *changes)) == ()


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FittedCase:
    folder = tmp_path_factory.mktemp("arm")
    loaded = demo_arm(folder)
    log(folder / "run.parquet", random_truth(loaded.robot, 1), 1)
    return fitted_case(loaded, [folder / "run.parquet"])


def at_bound(fitted: FittedCase, count: int) -> FittedCase:
    """With so many rotor inertias at their bound."""
    estimate = fitted.identified.estimate
    changed = replace(estimate, at_bound=rotors_of(estimate)[:count])
    return replace(fitted, identified=replace(fitted.identified, estimate=changed))


def test_rotors_at_zero_are_a_remark_with_what_to_change(fitted: FittedCase) -> None:
    (finding,) = rotors_at_zero_check(at_bound(fitted, 2))
    assert finding.headline and finding.severity == Severity.OK
    assert finding.says.startswith(f"2 of 4 {SEPARABLE_ROTORS} are zero")
    assert finding.joints == ("elbow", "forearm_roll")
    assert finding.fix is not None and 'kind = "link_torque"' in finding.fix.says


def test_one_rotor_at_zero_is_no_reason(fitted: FittedCase) -> None:
    assert rotors_at_zero_check(at_bound(fitted, 1)) == ()
    assert rotors_at_zero_check(replace(at_bound(fitted, 4), fitted=())) == ()
    signals = replace(fitted.identified.signals, effort_kind="motor_torque")
    case = at_bound(fitted, 4)
    motors = replace(case, identified=replace(case.identified, signals=signals))
    assert rotors_at_zero_check(motors) == ()
