"""Estimates that no robot can have are found, those of real and rough models are not."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.errors import DataError
from steelyard.check.finding import Severity
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.implausible_estimates_and_gear_side import (
    absurd_bodies_check,
    absurdities,
    heaviest,
    refuse_absurd,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording


def identified(arm, factor: float):
    """The consistent estimate of the arm's log with efforts times a factor."""
    table = arm.table.copy()
    for j in range(arm.motion.n_joints):
        table[:, arm.columns.index(f"tau{j + 1}_Nm")] *= factor
    log = LogInMemory(arm.path, arm.columns, table)
    run = prepare(Recording(log, arm.reference.signals), Processing())
    regressor = base_regressor(arm.reference.model)
    information = gather(regressor, run)
    estimator = Consistent(regressor.base, default_knowledge(regressor.model))
    plain = arm.reference.estimate
    parameters = replace(plain.parameters, values=factor * plain.parameters.values)
    return replace(
        arm.reference,
        estimate=estimator(information),
        reference=(replace(plain, parameters=parameters),),
    )


@pytest.mark.parametrize("factor", [0.4, 1.0, 3.0])
def test_an_arm_of_other_masses_is_possible(arm, factor):
    assert absurdities(identified(arm, factor)) == ()


def test_efforts_in_millinewton_metres_are_absurd(arm):
    model = identified(arm, 1000.0)
    sentences = absurdities(model)
    assert any("denser than tungsten" in x for x in sentences)
    assert any("total mass of the links" in x for x in sentences)
    with pytest.raises(DataError, match="physically absurd") as error:
        refuse_absurd(model, "arm.toml")
    assert "--no-check" in error.value.fix


@pytest.mark.slow
def test_reversed_efforts_give_an_estimate_and_their_reason(arm):
    model = identified(arm, -1.0)
    (finding,) = absurd_bodies_check(FittedCase(model, fitted=(None,)))
    assert finding.severity == Severity.WRONG
    assert "friction of all joints is negative: efforts have the wrong sign" in finding.says
    assert absurd_bodies_check(FittedCase(model)) == ()


def test_a_link_of_tungsten_is_the_heaviest(arm):
    robot = arm.robot
    masses = np.array([heaviest(robot, k) for k in range(len(robot.bodies))])
    nominal = np.array([body.inertia.mass for body in robot.bodies])
    assert np.all(masses > 8.0 * nominal) and np.all(masses < 1000.0)
