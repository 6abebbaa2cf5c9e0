"""The commands that are proposed behind an identification."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Parameters
from steelyard.check.all_checks import Diagnosis
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.implausible_estimates_and_gear_side import rotors_at_zero_check
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.verdict_and_next_steps import (
    fix_commands,
    next_steps,
    path_word,
    robot_file,
    step_lines,
)

MODEL = Path("out")
INCOMPLETE = Finding("model error", "", Severity.OK, "residuals", "", headline=True)
LOADED = Finding(
    "unseen log",
    "points",
    Severity.WRONG,
    "a payload",
    "",
    fix=Fix("identify it", command="steelyard payload MODEL LOG"),
)


def commands(content: ReportContent) -> list[str]:
    return [command for command, _ in next_steps(content, "arm.toml", MODEL)]


def test_a_good_model_is_to_be_used(usual):
    assert commands(usual) == ["steelyard export out --to urdf"]


def test_a_model_of_relative_gains_is_to_get_a_load_before_it_is_exported(usual):
    identified = usual.identified
    count = len(identified.signals.gains)
    gains = np.append(1.0, np.full(count - 1, 0.4))
    signals = replace(identified.signals, effort_units=("A",) * count, gains=gains)
    content = replace(
        usual,
        identified=replace(identified, signals=signals),
        logs={"a": "a.csv", "b": "b.csv"},
    )
    (command,) = (one for one in commands(content) if "--loaded" in one)
    wanted = "steelyard identify arm.toml a.csv --validate b.csv --loaded LOG --payload-mass KG"
    assert command == wanted and not any("export" in one for one in commands(content))


def test_without_a_run_that_was_not_fitted_one_is_to_be_logged(usual):
    assert commands(replace(usual, scores=())) == ["steelyard validate out OTHER_LOG"]


def test_friction_is_to_be_chosen_where_residuals_are_no_noise_and_it_was_not(usual):
    content = replace(usual, limitations=(INCOMPLETE,))
    assert commands(content) == commands(usual)
    remarks = [
        remark for _, remark in next_steps(replace(content, friction=None), "arm.toml", MODEL)
    ]
    assert remarks[0].endswith('in arm.toml, [model], and no "coulomb", "viscous" in terms')


def test_rotor_inertias_at_zero_propose_sensors_behind_the_gears(usual):
    fix = Fix("if so, other sensors")
    zero = Finding(rotors_at_zero_check.name, "", Severity.OK, "rotors", "", fix=fix, headline=True)
    steps = next_steps(replace(usual, limitations=(zero,)), "arm.toml", MODEL)
    edit = 'kind = "link_torque" in arm.toml, no rotor_inertia in terms'
    assert steps[0] == ("", f"if sensors are on the link side: {edit}")
    unfixed = replace(usual, limitations=(replace(zero, fix=None),))
    assert steps[1:] == next_steps(unfixed, "arm.toml", MODEL)


def test_what_is_wrong_with_a_log_comes_first_with_its_path(usual):
    content = replace(usual, limitations=(LOADED,), logs={"points": "logs/points.csv@0:5"})
    assert commands(content) == ["steelyard payload out logs/points.csv@0:5"]
    assert fix_commands(replace(content, logs={}), "out") == (("steelyard payload out LOG", ""),)


def test_where_much_is_unknown_another_motion_is_proposed(usual):
    loose = replace(
        usual.identified.estimate, covariance=1e6 * usual.identified.estimate.covariance
    )
    content = replace(usual, identified=replace(usual.identified, estimate=loose))
    assert commands(content)[0] == "steelyard excite arm.toml --earlier out --still-unknown"


def test_where_a_joint_is_worse_than_good_another_motion_is_proposed(usual):
    score = usual.scores[0]
    shoulder, elbow = score.errors.joints
    light = replace(elbow, used=1.0, error=0.3, least=0.0)
    content = replace(
        usual, scores=(replace(score, errors=replace(score.errors, joints=(shoulder, light))),)
    )
    assert commands(content) == [
        "steelyard excite arm.toml --earlier out --still-unknown",
        "steelyard export out --to urdf",
    ]


def test_parameters_of_small_effect_need_no_other_motion(usual):
    estimate = usual.identified.estimate
    names, units = estimate.parameters.names, estimate.parameters.units
    size = len(names) // 2
    values, std = np.array(estimate.parameters.values), np.array(estimate.std)
    values[:size], std[:size] = 0.0, 1e-5
    zeros = replace(
        estimate, parameters=Parameters(names, units, values), covariance=np.diag(std**2)
    )
    content = replace(usual, identified=replace(usual.identified, estimate=zeros))
    assert commands(content) == ["steelyard export out --to urdf"]


def test_a_poor_error_without_a_reason_is_to_be_checked(usual):
    score = usual.scores[0]
    joints = tuple(replace(joint, error=joint.used) for joint in score.errors.joints)
    bad = replace(score, errors=replace(score.errors, joints=joints))
    content = replace(usual, scores=(bad,), logs={"run1": "run1.csv", "points": "points.csv"})
    assert commands(content) == ["steelyard check arm.toml run1.csv points.csv"]


def test_an_inconclusive_robot_file_is_to_be_checked_first(usual):
    names = ("joint order", "effort unit", "mounting")
    findings = [
        Finding(name, "", Severity.OK, "?", "", answered=False, hidden=True) for name in names
    ]
    logs = {"run1": "run1.csv", "points": "points.csv"}
    content = replace(usual, diagnosis=Diagnosis(tuple(findings)), logs=logs)
    assert commands(content)[0] == "steelyard check arm.toml run1.csv points.csv"


def test_paths_are_from_the_current_folder_and_quoted(usual, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inside, outside = tmp_path / "my logs/run 1.csv", tmp_path.parent / "run1.csv"
    assert [path_word(path) for path in (inside, "run1.csv#3:9", outside)] == [
        "'my logs/run 1.csv'",
        "'run1.csv#3:9'",
        str(outside),
    ]
    steps = next_steps(replace(usual, scores=()), str(tmp_path / "arm.toml"), tmp_path / "my out")
    assert [command for command, _ in steps] == ["steelyard validate 'my out' OTHER_LOG"]
    content = replace(usual, limitations=(LOADED,), logs={"points": str(inside)})
    (step, _), *_ = next_steps(content, "arm.toml", tmp_path / "out")
    assert step == "steelyard payload out 'my logs/run 1.csv'"


def test_steps_stand_below_each_other():
    assert step_lines((("one", "first"), ("", "an edit"), ("a long command", ""))) == [
        "next    # first",
        "        one",
        "        # an edit",
        "        a long command",
    ]
    assert step_lines(()) == []


@pytest.mark.parametrize(("there", "named"), [(True, "arm.toml"), (False, "ROBOT")])
def test_the_robot_file_is_named_where_it_lies_here(
    usual, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: bool, named: str
):
    monkeypatch.chdir(tmp_path)
    if there:
        (tmp_path / "arm.toml").touch()
    inputs = {"robot arm.toml": "", "robot arm.urdf": "", "log run1.csv": ""}
    origin = replace(usual.identified.provenance, inputs=inputs)
    content = replace(usual, identified=replace(usual.identified, provenance=origin))
    assert robot_file(content) == named
