"""Joints with load that the nominal model predicts better than the fit are named."""

from dataclasses import replace

import pytest

from check.fitted import case, demo_arm, log
from steelyard.check.finding import Severity
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.post_fit_checks import below_nominal_check
from steelyard.estimate.scores.score import score
from steelyard.simulate.ground_truth import random_truth


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> FittedCase:
    folder = tmp_path_factory.mktemp("arm")
    loaded = demo_arm(folder)
    log(folder / "run.parquet", random_truth(loaded.robot, 1), 1)
    fitted = case(loaded, [folder / "run.parquet"])
    model, (run,) = fitted.identified, fitted.fitted
    found = score(model.valued, run, model.signals.gains, model.cutoffs.score)
    return replace(fitted, fitted_scores=(found,))


def worse(scored: FittedCase, joint: int, times: float) -> FittedCase:
    """With the error of one joint that many times the nominal model's."""
    (found,) = scored.fitted_scores
    one = found.joints[joint]
    changed = replace(one, rmse=times * one.rmse, prior_rmse=one.rmse)
    joints = (*found.joints[:joint], changed, *found.joints[joint + 1 :])
    return replace(scored, fitted_scores=(replace(found, joints=joints),))


def loads(scored: FittedCase) -> list[float]:
    return [joint.predict_zero for joint in scored.fitted_scores[0].joints]


def test_a_joint_with_load_is_named(scored: FittedCase) -> None:
    most = loads(scored).index(max(loads(scored)))
    (finding,) = below_nominal_check(worse(scored, most, 2.0))
    assert finding.severity == Severity.DOUBTFUL and "nominal model" in finding.says
    assert finding.joints == (scored.fitted_scores[0].joints[most].joint,)
    assert below_nominal_check(worse(scored, most, 1.1)) == ()


def test_a_joint_without_load_is_not(scored: FittedCase) -> None:
    least = loads(scored).index(min(loads(scored)))
    assert below_nominal_check(worse(scored, least, 3.0)) == ()


def test_rotor_inertias_at_zero_point_to_sensors_behind_the_gears(scored: FittedCase) -> None:
    most = loads(scored).index(max(loads(scored)))
    plain = worse(scored, most, 2.0)
    names = plain.identified.estimate.parameters.names
    rotors = tuple(name for name in names if name.startswith("rotor_inertia."))
    estimate = replace(plain.identified.estimate, at_bound=rotors)
    case = replace(plain, identified=replace(plain.identified, estimate=estimate))
    (finding,) = below_nominal_check(case)
    assert finding.fix is not None and 'kind = "link_torque"' in finding.fix.says
