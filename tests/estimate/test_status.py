"""How well parameters are identified, by their interval and by what it causes."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.base.arrays import Z95, Parameters
from steelyard.estimate.estimate import Estimate, Removed, Unidentifiable
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    SMALL,
    effort_shares,
    statuses,
)
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from weighed import identified_of


@pytest.fixture
def identified() -> IdentifiedModel:
    """All base parameters with their values, known to 1 %."""
    found = identified_of(tree(), (RigidBody(), Viscous()))
    base = base_parameters(found.model)
    values = base.base_values(found.valued.values.values)
    known = Parameters(base.base_names, base.base_units, values)
    covariance = np.diag((0.01 * values) ** 2)
    estimate = replace(found.estimate, parameters=known, covariance=covariance, standard=None)
    return replace(found, base=base, estimate=estimate)


def with_one(identified: IdentifiedModel, name: str, value: float, std: float) -> IdentifiedModel:
    """The model with another value and standard deviation of one parameter."""
    estimate = identified.estimate
    names, units = estimate.parameters.names, estimate.parameters.units
    k, values = names.index(name), np.array(estimate.parameters.values)
    stds = np.array(estimate.std)
    values[k], stds[k] = value, std
    changed: Estimate = replace(
        estimate, parameters=Parameters(names, units, values), covariance=np.diag(stds**2)
    )
    return replace(identified, estimate=changed)


def test_shares_are_those_of_efforts_in_a_moderate_motion(identified: IdentifiedModel) -> None:
    rng = np.random.default_rng(5)
    n, base = identified.robot.n, identified.base
    q, dq, ddq = rng.uniform(-np.pi, np.pi, (2000, n)), *rng.normal(size=(2, 2000, n))
    columns = identified.regressor(q, dq, ddq)[:, :, list(base.independent)]
    efforts = np.sqrt(np.mean(identified.torque(q, dq, ddq) ** 2, axis=0))
    wanted = 100.0 * np.sqrt(np.mean(columns**2, axis=0)) / efforts[:, None]
    shares = effort_shares(identified)
    assert tuple(shares) == base.base_names
    assert np.array(list(shares.values())) == pytest.approx(wanted.max(axis=0), rel=0.3)


def test_a_parameter_has_a_small_effect_if_its_whole_interval_has(
    identified: IdentifiedModel,
) -> None:
    name = "viscous." + identified.joints[1]
    small = SMALL / effort_shares(with_one(identified, name, 0.0, 0.0))[name]
    for value, std, word in (
        (0.0, 0.9 * small / Z95, "small effect"),
        (0.0, 1.2 * small / Z95, "poorly identified"),
        (0.3 * small, 0.1 * small, "small effect"),  # significantly different from zero, but small
        (3.0 * small, 1.0 * small, "poorly identified"),
        (3.0 * small, 0.5 * small, "identified"),
        (0.01 * small, 0.001 * small, "identified"),
        (0.0, 0.0, "small effect"),
        (0.0, 1e6, "poorly identified"),  # of a joint that never moved
        (float("nan"), 1.0, "poorly identified"),
    ):
        assert statuses(with_one(identified, name, value, std))[name] == word


def test_what_has_no_interval_has_its_own_word(identified: IdentifiedModel) -> None:
    names = identified.base.base_names
    assert set(statuses(identified).values()) == {"identified"}
    kept = Parameters(
        names[:-2], identified.base.base_units[:-2], identified.estimate.parameters.values[:-2]
    )
    learned = np.append(np.ones(len(names) - 3), 0.19)
    estimate = replace(
        identified.estimate,
        parameters=kept,
        covariance=identified.estimate.covariance[:-2, :-2],
        learned=learned,
        at_bound=names[:1],
        known=names[1:2],
        blind=(Unidentifiable(names[-1]),),
        removed=(Removed(names[-2], 1, 0.5),),
    )
    found = statuses(replace(identified, estimate=estimate))
    words = [found[names[k]] for k in (0, 1, 2, -3, -2, -1)]
    assert words == [
        "at a bound",
        "known",
        "identified",
        "from the prior",
        "removed",
        "not identifiable",
    ]
