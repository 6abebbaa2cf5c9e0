"""Friction over speed, against the laws' formulas and the model's friction."""

from dataclasses import replace

import numpy as np
import pytest

from closed_chains import five_bar
from report.conftest import identified, robot
from steelyard.base.arrays import Z95, Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.friction.friction_mixes_and_curves import friction_curves
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Robot

POSTURES = np.array([[0.3, -0.4], [0.5, 0.6]])
FASTEST = np.array([2.0, 0.5])


def model_with(*friction: Term, arm: Robot | None = None) -> IdentifiedModel:
    """All base parameters known, with correlated errors."""
    model = Model(arm or robot(), (RigidBody(), *friction))
    base = base_parameters(model)
    rng = np.random.default_rng(4)
    spread = 0.05 * rng.normal(size=(len(base), len(base)))
    plain = identified(robot())
    estimate = replace(
        plain.estimate,
        parameters=Parameters(base.base_names, base.base_units, rng.uniform(0.5, 2.0, len(base))),
        covariance=spread @ spread.T,
        blind=(),
        standard=None,
        learned=None,
        per_run=(),
    )
    return replace(plain, model=model, base=base, estimate=estimate, reference=())


def test_the_curve_is_the_friction_of_the_model_at_constant_speed() -> None:
    found = model_with(Coulomb(), Viscous())
    curves = friction_curves(found, POSTURES, FASTEST)
    assert [curve.joint for curve in curves] == ["shoulder", "elbow"]
    for j, curve in enumerate(curves):
        speed = np.zeros((len(curve.speed), 2))
        speed[:, j] = curve.speed
        motion = Motion(np.arange(len(speed)), 0.0 * speed, speed, 0.0 * speed)
        np.testing.assert_allclose(curve.effort, found.friction(motion)[:, j], rtol=1e-12)
        assert np.all(np.diff(curve.speed) > 0.0) and 0.0 not in curve.speed
        assert curve.speed[[0, -1]].tolist() == [-FASTEST[j], FASTEST[j]]


def test_the_interval_is_that_of_the_parameters_of_the_law() -> None:
    found = model_with(Coulomb(), Viscous())
    names, covariance = found.estimate.parameters.names, found.estimate.covariance
    for curve in friction_curves(found, POSTURES, FASTEST):
        at = [names.index(f"{law}.{curve.joint}") for law in ("coulomb", "viscous")]
        (c, both), (_, v) = covariance[np.ix_(at, at)]
        sign = np.sign(curve.speed)
        variance = c + 2.0 * both * np.abs(curve.speed) + v * curve.speed**2
        np.testing.assert_allclose(curve.half_width, Z95 * np.sqrt(variance), rtol=1e-9)
        assert np.all(sign[[0, -1]] == [-1.0, 1.0])


def test_friction_with_memory_is_in_full_sliding() -> None:
    found = model_with(Dahl(length=0.01), Viscous())
    values = found.estimate.parameters.as_dict()
    for curve in friction_curves(found, POSTURES, FASTEST):
        dahl, viscous = (values[f"{law}.{curve.joint}"] for law in ("dahl", "viscous"))
        expected = dahl * np.sign(curve.speed) + viscous * curve.speed
        np.testing.assert_allclose(curve.effort, expected, rtol=1e-6)


@pytest.mark.parametrize("lacks", ["friction", "motion", "estimate"])
def test_no_curve_where_no_friction_was_identified(lacks: str) -> None:
    found = model_with() if lacks == "friction" else model_with(Coulomb())
    fastest = FASTEST * (lacks != "motion")
    if lacks == "estimate":
        own = found.estimate
        kept = [k for k, n in enumerate(own.parameters.names) if not n.startswith("coulomb")]
        parameters = Parameters(
            [own.parameters.names[k] for k in kept],
            [own.parameters.units[k] for k in kept],
            own.parameters.values[kept],
        )
        estimate = replace(
            own, parameters=parameters, covariance=own.covariance[np.ix_(kept, kept)]
        )
        found = replace(found, estimate=estimate)
    assert friction_curves(found, POSTURES, fastest) == ()


def test_a_robot_with_loops_has_curves_where_they_close() -> None:
    found = model_with(Coulomb(), Viscous(), arm=five_bar())
    n, values = found.model.robot.n, found.estimate.parameters.as_dict()
    at_rest = np.tile(loop_equations(found.model.robot).assembly[:n], (n, 1))
    curves = friction_curves(found, at_rest, np.ones(n))
    assert [curve.joint for curve in curves] == list(found.joints)
    for curve in curves:
        coulomb, viscous = (values[f"{law}.{curve.joint}"] for law in ("coulomb", "viscous"))
        expected = coulomb * np.sign(curve.speed) + viscous * curve.speed
        np.testing.assert_allclose(curve.effort, expected, rtol=1e-9)
    assert friction_curves(found, at_rest + [-1.5, 2.25], np.ones(n)) == ()
