"""The most likely reason of a large error on a log that was not fitted."""

import re
from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted import incomplete_model_and_unseen_error
from steelyard.check.fitted.incomplete_model_and_unseen_error import (
    _one_file,
    excess_error,
    unseen_reason_check,
)
from steelyard.check.fitted.post_fit_checks import FittedCase, examine_fit
from steelyard.estimate.scores.score import score
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.simulate.ground_truth import Truth, random_truth


def found_in(
    arm, table: Array, fitted: tuple[str, ...] = (), unresolved: tuple[Finding, ...] = ()
) -> tuple[Finding, ...]:
    log = arm.case(table).logs[0]
    origin = replace(arm.reference.provenance, runs=fitted)
    run, model = log.run, replace(arm.reference, provenance=origin)
    scored = score(model.valued, run, model.signals.gains, model.cutoffs.score)
    return examine_fit(
        FittedCase(model, unseen=(run,), unseen_scores=(scored,), unresolved=unresolved)
    )


def of(arm, truth: Truth) -> Array:
    """The log as another truth would have written it."""
    table = arm.table.copy()
    torque = truth.model.at(truth.values).torque(arm.motion)
    noise = 0.01 * torque.std(axis=0) * np.random.default_rng(4).standard_normal(torque.shape)
    table[:, arm.at("tau{}_Nm")] = torque + noise
    return table


def test_a_clean_log_needs_no_reason(arm):
    assert found_in(arm, arm.table) == ()


@pytest.mark.parametrize("mass", [1.0, 3.0])
def test_a_load_is_named_with_its_mass(arm, mass):
    names = [p.name for p in RigidBody().parameters(arm.robot)][-10:]
    load = Inertia.about_com(mass, [0.02, -0.01, 0.08], np.eye(3) * 0.0025 * mass).ten
    values = dict(zip(names, (arm.truth.inertial[-1] + load).tolist(), strict=True))
    (found,) = found_in(arm, of(arm, arm.truth.changed(**values)))
    assert (
        f"most likely reason of the error: the arm carries a payload of about {mass:.2g} kg"
        in found.says
    )
    assert found.check == unseen_reason_check.name and found.log == "log"
    assert found.fix is not None and found.fix.command == "steelyard payload MODEL LOG"


def test_a_tool_that_was_removed_is_named_with_its_mass(arm):
    names = [p.name for p in RigidBody().parameters(arm.robot)][-10:]
    carried = arm.truth.inertial[-1]
    ten = dict(zip(names, (0.2 * carried).tolist(), strict=True))
    (found,) = found_in(arm, of(arm, arm.truth.changed(**ten)))
    mass = 0.8 * float(carried[0])
    assert f"carries about {mass:.2g} kg less on " in found.says and "was removed" in found.says
    assert found.severity and found.fix is not None and "same tool" in found.fix.says


def test_another_robot_is_not_called_a_gain(arm):
    (found,) = found_in(arm, of(arm, random_truth(arm.robot, 81)))
    assert "no cause of the error was found; tested: payload" in found.says
    assert "may come from another robot" in found.says and found.severity
    assert "times the residuals of the fit" in found.figure


def test_windows_of_one_file_are_of_one_robot(arm):
    (found,) = found_in(arm, of(arm, random_truth(arm.robot, 81)), fitted=("data/log@0:5",))
    assert "no cause of the error was found" in found.says and "another robot" not in found.says


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [("log", "data/log@0:5", True), ("a/log@5:", "a/log@0:5", True), ("a/log", "b/log", False)],
)
def test_logs_of_one_name_in_two_folders_are_two_files(one: str, other: str, same: bool):
    assert _one_file(one, other) == _one_file(other, one) == same


def test_an_open_finding_about_the_fitted_log_comes_before_another_robot(arm):
    finding = Finding("effort sign", "first", Severity.DOUBTFUL, "all joints turned", "")
    (found,) = found_in(arm, of(arm, random_truth(arm.robot, 81)), unresolved=(finding,))
    assert "was doubtful about first: all joints turned" in found.says
    assert "another robot" not in found.says and found.severity == Severity.DOUBTFUL


def test_friction_that_would_not_dissipate_is_no_explanation(arm):
    names = [n for n in arm.truth.values.names if n.startswith(("coulomb.", "viscous."))]
    more = of(arm, arm.truth.changed(**{name: 6.0 * arm.truth.values[name] for name in names}))
    table = 2.0 * of(arm, arm.truth) - more  # friction times -4
    (found,) = found_in(arm, table)
    assert "no cause of the error was found" in found.says


def test_friction_that_changed_is_named_with_what_is_left(arm):
    names = [n for n in arm.truth.values.names if n.startswith(("coulomb.", "viscous."))]
    much = {name: 6.0 * arm.truth.values[name] for name in names}
    (found,) = found_in(arm, of(arm, arm.truth.changed(**much)))
    assert found.severity == Severity.DOUBTFUL
    assert found.says.startswith("friction or offsets differ from those of the fitted logs")


def test_a_sign_is_a_reason(arm):
    table = arm.table.copy()
    table[:, arm.at("tau{}_Nm")[1]] *= -1.0
    (found,) = found_in(arm, table)
    assert "effort of 'shoulder_lift' has the opposite sign" in found.says
    assert found.joints == ("shoulder_lift",)


def test_a_zero_offset_is_a_reason_with_its_line(arm):
    table = arm.table.copy()
    table[:, arm.at("q{}_rad")[1]] += 0.2
    (found,) = found_in(arm, table)
    assert "reason of the error: zero offset of shoulder_lift -0." in found.says
    assert found.joints == ("shoulder_lift",) and found.severity is Severity.WRONG
    assert found.fix is not None
    (value,) = re.findall(r"position_offset = \[0\.0, (-0\.\d+), 0\.0\]", found.fix.says)
    assert float(value) == pytest.approx(-0.2, abs=0.01)


def test_a_unit_is_a_reason(arm):
    table = arm.table.copy()
    table[:, arm.at("tau{}_Nm")] *= 1000.0
    (found,) = found_in(arm, table)
    assert "efforts are logged in a unit 1000 times smaller" in found.says
    assert found.fix is not None
    assert found.fix.command == "steelyard check ROBOT LOG --model MODEL"


def test_a_log_in_which_joints_rest_is_not_judged_by_their_friction(arm):
    """Efforts of joints at rest, and of logs without motion, lie anywhere in their dead zone."""
    log = arm.case(arm.table).logs[0]
    run, model = log.run, arm.reference
    plain = score(model.valued, run, model.signals.gains, model.cutoffs.score)
    stuck = [replace(joint, rmse=1e3 * joint.rmse) for joint in plain.joints]
    scored = replace(plain, joints=tuple(stuck))
    assert excess_error(model, scored) == excess_error(model, plain) < 2.0
    far = [replace(joint, rmse_moving=1e3 * joint.rmse) for joint in plain.joints]
    errors = replace(plain.errors, at_rest=True)
    still = replace(plain, joints=tuple(far), errors=errors)
    case = FittedCase(model, unseen=(run,), unseen_scores=(still,))
    assert excess_error(model, still) > 2.0 and unseen_reason_check(case) == ()


def test_what_explains_nothing_is_no_reason_however_bad_the_fit(arm, monkeypatch):
    noise = arm.table.copy()
    efforts = arm.at("tau{}_Nm")
    noise[:, efforts] = 5.0 * np.random.default_rng(1).standard_normal(noise[:, efforts].shape)
    monkeypatch.setattr(incomplete_model_and_unseen_error, "_own", lambda *_: 90.0)
    assert not [f for f in found_in(arm, noise) if "most likely reason" in f.says]


def test_an_open_finding_about_a_fitted_log_comes_before_a_reason(arm):
    names = [p.name for p in RigidBody().parameters(arm.robot)][-10:]
    load = Inertia.about_com(3.0, [0.02, -0.01, 0.08], np.eye(3) * 0.0075).ten
    values = dict(zip(names, (arm.truth.inertial[-1] + load).tolist(), strict=True))
    finding = Finding("effort kind", "fit1", Severity.DOUBTFUL, "no reading explains it", "")
    (found,) = found_in(arm, of(arm, arm.truth.changed(**values)), unresolved=(finding,))
    assert found.says.startswith("the check before the fit was doubtful about fit1: no reading")
    assert (
        "the most likely reason of the error: the arm carries a payload of about 3 kg"
    ) in found.says
    assert found.severity is Severity.DOUBTFUL


@pytest.mark.slow
def test_efforts_at_a_limit_are_named_where_the_error_counts_them(arm):
    table = arm.table.copy()
    for k in arm.at("tau{}_Nm"):
        most = 0.6 * np.abs(table[:, k]).max()
        table[:, k] = np.clip(table[:, k], -most, most)
    (found,) = [f for f in found_in(arm, table) if f.check == "clipped efforts"]
    assert "are saturated: the error includes them" in found.says and found.headline
