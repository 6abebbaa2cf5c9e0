"""Laws that every estimator keeps that looks at sums of products or at samples."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import dh_arm, single
from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import ESTIMATORS, Context, Offer
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.prior.body_priors import Knowledge, default_knowledge
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

OFFERS = [offer for offer in ESTIMATORS if not offer.slow]

NEARLY = {"consistent": 1e-6, "pullback": 1e-6}
"""Noise of exact data for those that need some, relative to the torque; ten times that is their
torque error."""

FADING = {"RLS"}
"""To whom the order of windows matters."""


@dataclass(frozen=True, eq=False)
class Case:
    """A robot whose prior is the truth."""

    regressor: Regressor
    knowledge: Knowledge
    truth: Array

    @classmethod
    def of(cls, robot: Robot) -> "Case":
        model = Model(robot)
        knowledge = default_knowledge(model)
        standard = np.full(len(model.names), 0.3)
        for body, prior in enumerate(knowledge.priors):
            assert prior is not None
            standard[knowledge.tens(body)] = prior.ten
        regressor = base_regressor(model)
        return cls(regressor, knowledge, regressor.base.base_values(standard))

    def samples(
        self,
        noise: float = 0.0,
        count: int = 400,
        seed: int = 0,
        run: str = "run",
        alike: int = 1,
        **fixed: Any,
    ) -> FilteredSamples:
        """A drawn motion, each instant `alike` times; `noise` is relative to torques."""
        n = len(self.regressor.layout.rows)
        motion = motion_of(n, count // alike, seed, fixed.pop("still", ()))
        torque = self.regressor.dense(*motion) @ self.truth
        size = np.sqrt(np.mean(np.square(torque), axis=1, keepdims=True))
        drawn = np.random.default_rng([seed, 1]).normal(size=torque.shape)
        effort = torque + noise * size * drawn
        motion = tuple(np.repeat(x, alike, axis=1) for x in motion)
        return samples_of(self.regressor, motion, np.repeat(effort, alike, axis=1), run, **fixed)

    def fit(self, offer: Offer, samples: FilteredSamples) -> Estimate:
        """What an estimator makes of samples; skips where a package is missing."""
        try:
            estimator = offer.make(Context(self.regressor, self.knowledge))
            return estimator(samples if offer.needs == "samples" else samples.information())
        except DataError as error:
            if "pip install" in error.fix:
                pytest.skip(error.wrong)
            raise

    def torque_error(self, estimate: Estimate, seed: int = 9) -> float:
        """Relative error of the torque on another motion."""
        dense = self.regressor.dense(*motion_of(len(self.regressor.layout.rows), 200, seed))
        known = estimate.parameters.as_dict()
        values = np.array([known.get(name, 0.0) for name in self.regressor.layout.columns])
        wanted = dense @ self.truth
        return float(np.linalg.norm(dense @ values - wanted) / np.linalg.norm(wanted))


def massless() -> Robot:
    """One joint that carries nothing."""
    robot = single()
    body = replace(robot.bodies[0], inertia=Inertia.zero())
    return replace(robot, bodies=(body,))


CASES: dict[str, Callable[[], Robot]] = {"arm": dh_arm, "single": single, "massless": massless}


@cache
def case(name: str) -> Case:
    return Case.of(CASES[name]())


def deviations(estimate: Estimate, least_learned: float = 0.0) -> dict[str, float]:
    """Standard deviations by name, of parameters that the data and not the prior show."""
    learned = estimate.learned
    names, stds = estimate.parameters.names, estimate.std.tolist()
    return {
        name: std
        for k, (name, std) in enumerate(zip(names, stds, strict=True))
        if learned is None or learned[k] > least_learned
    }


every = pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("offer", "name"),
    [
        pytest.param(offer, name, id=f"{name}-{offer.name}")
        for k, offer in enumerate(OFFERS)
        for name in ("arm", ("single", "massless")[k % 2])
    ],
)
def test_exact_data_give_the_truth(offer: Offer, name: str) -> None:
    noise = NEARLY.get(offer.name, 0.0)
    estimate = case(name).fit(offer, case(name).samples(noise))
    assert case(name).torque_error(estimate) < 1e-6 + 10.0 * noise
    assert estimate.blind == ()
    removed = {one.name for one in estimate.removed}
    left = (column for column in case(name).regressor.layout.columns if column not in removed)
    assert estimate.parameters.names == tuple(left)
    assert np.isfinite(estimate.covariance).all()


@every
def test_a_joint_that_never_moved_is_named(offer: Offer) -> None:
    estimate = case("arm").fit(offer, case("arm").samples(0.01, still=[2]))
    blind = {one.name for one in estimate.blind}
    joint = case("arm").regressor.layout.rows[2]
    assert {f"{law}.{joint}" for law in ("coulomb", "viscous", "rotor_inertia")} & set(
        case("arm").regressor.layout.columns
    ) <= blind
    assert f"viscous.{joint}" in blind
    assert not blind & set(estimate.parameters.names)
    assert np.isfinite(estimate.std).all()


@every
def test_an_estimate_comes_back_from_its_file(offer: Offer) -> None:
    estimate = case("single").fit(offer, case("single").samples(0.05))
    text = json.dumps(estimate.to_dict(), allow_nan=False)
    again = Estimate.from_dict(json.loads(text))
    assert json.dumps(again.to_dict()) == text
    assert again.estimator and np.array_equal(again.covariance, estimate.covariance)


@every
def test_the_order_of_runs_does_not_matter(offer: Offer) -> None:
    if offer.name in FADING:
        pytest.skip("it looks at them one after another")
    first = case("arm").samples(0.05, run="a")
    second = case("arm").samples(0.05, seed=5, run="b", start=30.0)
    one, other = (case("arm").fit(offer, both) for both in (first + second, second + first))
    assert np.all(np.abs(one.parameters.values - other.parameters.values) < 1e-3 * one.std)
    assert np.allclose(one.std, other.std, rtol=1e-3)


@pytest.mark.slow
@every
def test_standard_deviations_grow_with_the_noise(offer: Offer) -> None:
    name = "single" if offer.slow else "arm"
    low, high = (case(name).fit(offer, case(name).samples(noise)) for noise in (0.01, 0.03))
    narrow, wide = (deviations(estimate, least_learned=0.99) for estimate in (low, high))
    ratios = [wide[column] / narrow[column] for column in narrow.keys() & wide.keys()]
    assert ratios
    if low.parameters.names == high.parameters.names:
        assert np.allclose(ratios, 3.0, rtol=0.1)
    else:
        assert np.isclose(np.median(ratios), 3.0, rtol=0.1)


@pytest.mark.slow
@every
def test_more_samples_tell_more(offer: Offer) -> None:
    name = "single" if offer.slow else "arm"
    few = case(name).fit(offer, case(name).samples(0.05, 200))
    worth = case(name).fit(offer, case(name).samples(0.05, 200, share=0.25, alike=4))
    many = case(name).fit(offer, case(name).samples(0.05, 3200))
    shared = set.intersection(*(set(one.parameters.names) for one in (few, worth, many)))
    least, less, more = (deviations(one) for one in (many, few, worth))
    assert np.median([least[column] / less[column] for column in shared]) < 0.4
    assert np.median([more[column] / less[column] for column in shared]) > 1.2


@every
@pytest.mark.parametrize("count", [1, 3, 8])
def test_too_few_samples_are_refused_or_leave_doubt(offer: Offer, count: int) -> None:
    name = "single" if offer.slow else "arm"
    try:
        estimate = case(name).fit(offer, case(name).samples(0.05, count))
    except DataError as error:
        assert error.where and error.fix
        return
    assert np.isfinite(estimate.parameters.values).all()
    assert np.isfinite(estimate.std).all() and (estimate.std > 0.0).all()


@every
def test_no_samples_are_refused(offer: Offer) -> None:
    none = case("arm").samples().of(np.zeros(400, dtype=bool))
    with pytest.raises(DataError):
        case("arm").fit(offer, none)


@every
def test_a_joint_without_samples_stops_nobody(offer: Offer) -> None:
    name, silent = "arm", 1
    samples = case(name).samples(0.02)
    rows, weights, at = list(samples.rows), list(samples.weights), list(samples.at)
    rows[silent], weights[silent] = rows[silent][:0], frozen([])
    at[silent] = at[silent][:0]
    deaf = replace(samples, rows=tuple(rows), weights=tuple(weights), at=tuple(at))
    estimate = case(name).fit(offer, deaf)
    assert np.isfinite(estimate.parameters.values).all()
    assert np.isfinite(estimate.std).all()
    assert estimate.n_samples[silent] == 0.0


@pytest.mark.parametrize("name", sorted({*NEARLY, *FADING}))
def test_exceptions_are_of_estimators_that_there_are(name: str) -> None:
    assert name in {offer.name for offer in ESTIMATORS}
