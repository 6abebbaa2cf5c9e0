"""The reference of load-dependent friction: refitted until convergence, else a note."""

from collections.abc import Callable

import numpy as np
import pytest

from invented import single
from steelyard.base.arrays import Parameters
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import (
    MOST_REFERENCE_REFITS,
    bodies_of,
    converged_reference,
    reference_of,
)
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.friction_with_memory import LoadDependent
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model

MODEL = Model(single(), (RigidBody(), Coulomb(), LoadDependent(length=1e-3)))


class Recorder:
    """Estimates from invented numbers, one set of bodies per call; the requested regressors."""

    def __init__(self, bodies: Callable[[int], float]) -> None:
        self.bodies = bodies
        self.models: list[Model] = []

    def information_of(self, regressor: Regressor) -> Information:
        self.models.append(regressor.model)
        return regressor  # type: ignore[return-value]

    def __call__(self, information: Information) -> Estimate:
        size = self.bodies(len(self.models) - 1)
        named = Parameters(("mx.rod", "mz.rod", "coulomb.hinge"), ("kg m",) * 3, [size, 1.0, 5.0])
        return Estimate("", named, np.zeros((3, 3)), (), np.ones(1), np.ones(1), 1.0, 1.0)


def references(*models: Model) -> list[dict[str, float]]:
    terms = [t for model in models for t in model.terms if isinstance(t, LoadDependent)]
    return [dict(t.reference) for t in terms]


def test_only_load_dependent_friction_needs_one() -> None:
    assert any(term.needs_reference for term in MODEL.terms)
    assert not any(term.needs_reference for term in Model(single()).terms)
    plain = Model(single(), (RigidBody(), Coulomb()))
    assert all(term.with_reference({"m.rod": 1.0}) == term for term in plain.terms)


def test_numbers_of_bodies_alone_are_the_reference() -> None:
    recorder = Recorder(lambda _: 2.0)
    assert bodies_of(recorder(None)) == {"mx.rod": 2.0, "mz.rod": 1.0}  # type: ignore[arg-type]


def test_the_first_reference_is_fitted_without_load_dependent_friction() -> None:
    recorder = Recorder(lambda _: 2.0)
    assert reference_of(MODEL, recorder.information_of, recorder) == {"mx.rod": 2.0, "mz.rod": 1.0}
    assert [type(t) for t in recorder.models[0].terms] == [RigidBody, Coulomb]


def test_it_converges_once_the_bodies_stand_still() -> None:
    recorder = Recorder(lambda call: 2.0 + 10.0 ** (-3.0 * call))
    model, converged = converged_reference(MODEL, recorder.information_of, recorder)
    assert converged and len(recorder.models) == 3
    assert references(*recorder.models[1:]) == [
        {"mx.rod": pytest.approx(3.0), "mz.rod": 1.0},
        {"mx.rod": pytest.approx(2.001), "mz.rod": 1.0},
    ]
    assert references(model)[0]["mx.rod"] == pytest.approx(2.001)


def test_it_says_that_it_does_not_converge() -> None:
    recorder = Recorder(lambda call: 2.0 + (-1.0) ** call)
    model, converged = converged_reference(MODEL, recorder.information_of, recorder)
    assert not converged and len(recorder.models) == 1 + MOST_REFERENCE_REFITS
    assert references(model)[0]["mx.rod"] in (1.0, 3.0)
