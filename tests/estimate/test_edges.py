"""Intervals of bodies at the edge of what can exist: the penalty is steep there."""

import numpy as np
import pytest

from at_prior import at_prior
from in_amperes import GAINS, ROBOT, run_of
from steelyard.base.arrays import Z95, Parameters
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    Entropic,
    Pullback,
    unknowns,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.convex_program_and_newton_refinement import (
    Program,
    conic_constraints,
)
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.runs.processing_choices import Processing
from steelyard.simulate.ground_truth import Truth, random_truth

MODEL = Model(ROBOT)
REGRESSOR = base_regressor(MODEL)
KNOWN = default_knowledge(MODEL)
CUTOFFS = Processing(motion_cutoff=17.0, matched_cutoff=5.5)


def thin_truth(seed: int) -> Truth:
    """Every body pressed to a twentieth of its width along a random direction."""
    truth, rng = random_truth(ROBOT, seed), np.random.default_rng(seed)
    values = truth.values.as_dict()
    for body in ROBOT.bodies:
        names = [f"{name}.{body.name}" for name in INERTIAL_NAMES]
        root = np.linalg.cholesky(body.inertia.pseudo)
        direction = rng.standard_normal(4)
        direction /= np.linalg.norm(direction)
        press = root @ (np.eye(4) - 0.95 * np.outer(direction, direction)) @ np.linalg.inv(root)
        pseudo = press @ Inertia.from_ten([values[name] for name in names]).pseudo @ press.T
        values |= dict(zip(names, Inertia.from_pseudo(pseudo).ten.tolist(), strict=True))
    known = Parameters(truth.values.names, truth.values.units, list(values.values()))
    return Truth(truth.model, known, truth.smoothing)


def information_of(seed: int) -> Information:
    truth, units = thin_truth(seed), ROBOT.effort_units
    runs = [run_of(truth, 10 * seed + k, wanted=CUTOFFS) for k in range(2)]
    first, second = (gather(REGRESSOR, run).scaled(GAINS, units) for run in runs)
    return first + second


@pytest.mark.slow
def test_intervals_hold_where_bodies_are_at_the_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    estimator, edge = Consistent(REGRESSOR.base, KNOWN), list[bool]()
    for seed in range(4):
        information, values = information_of(seed), thin_truth(seed).values.values
        true = dict(zip(REGRESSOR.base.base_names, REGRESSOR.base.base_values(values), strict=True))
        estimate = estimator(information)
        with monkeypatch.context() as patch:
            patch.setattr(Program, "stated_precision", Program.precision)
            before = estimator(information)
        assert np.array_equal(estimate.parameters.values, before.parameters.values)
        error = np.abs(
            estimate.parameters.values - [true[name] for name in estimate.parameters.names]
        )
        there = estimate.std > 1.1 * before.std
        edge += (error <= Z95 * estimate.std)[there].tolist()
        assert (estimate.std >= 0.999 * before.std).all()
    assert len(edge) > 10 and np.mean(edge) >= 0.9


@pytest.mark.parametrize("form", [Entropic(), Pullback()], ids=lambda form: form.name)
def test_the_edge_adds_nothing_to_what_is_known(form: Entropic | Pullback) -> None:
    known = unknowns(whitened(information_of(0)), REGRESSOR.base, KNOWN)
    program = Program(known, conic_constraints(known, KNOWN), form)
    stated = program.stated_precision(at_prior(known), 2.0)
    assert np.allclose(stated, program.precision(at_prior(known), 2.0), rtol=1e-12)
    u = at_prior(known)
    u[0] = 0.01
    assert np.allclose(program.stated_precision(u, 2.0), stated, rtol=1e-12)
    u[0] = 3.0
    assert np.allclose(program.stated_precision(u, 2.0), program.precision(u, 2.0), rtol=1e-12)
