"""Scales of efforts: found where they are known, and as sure as they say."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.nonlinear.effort_scales import DEVIATION, Scaled, Scales, effort_scales
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
ROWS, N = REGRESSOR.layout.rows, 4
PARTS, LENGTH = 5, 300
OFF = np.array([0.8, 1.05, 1.0, 1.2])[: len(ROWS)]


def information_of(
    scales: np.ndarray, seed: int, noise: float = 0.01, heavier: float = 1.0
) -> Information:
    """What five stretches of random motion say of the robot, efforts times scales.

    Its bodies are the nominal ones, times `heavier`.
    """
    rng, n = np.random.default_rng(seed), MODEL.robot.n
    values = heavier * np.array([p.prior or 0.0 for p in MODEL.parameters])
    friction = [k for k, p in enumerate(MODEL.parameters) if p.prior is None]
    values[friction] = rng.uniform(0.1, 1.0, len(friction))
    valued = MODEL.at(Parameters(MODEL.names, MODEL.units, values))
    signature = Signature(
        MODEL.fingerprint, REGRESSOR.layout.columns, MODEL.robot.effort_units, "none"
    )
    parts = []
    for part in range(PARTS):
        q, dq, ddq = (
            rng.uniform(-1.5, 1.5, (3, LENGTH, n)) * np.array([1.0, 2.0, 6.0])[:, None, None]
        )
        torque = valued.torque(Motion(np.arange(LENGTH) * 0.01, q, dq, ddq)).T
        size = np.sqrt(np.square(torque).mean(axis=1, keepdims=True))
        effort = scales[:, None] * torque + noise * size * rng.normal(size=torque.shape)
        sums = Accumulator(REGRESSOR)(Stretch(q.T, dq.T, ddq.T, effort))
        parts.append(
            Information(
                REGRESSOR.layout,
                signature,
                (Window("run", float(part), part + 1.0),),
                sums.grams[None],
                sums.absolute[None],
                sums.counts[None],
            )  # fmt: skip
        )
    return sum(parts[1:], parts[0])


def consistent() -> Consistent:
    return Consistent(base_parameters(MODEL), default_knowledge(MODEL))


def test_the_predicted_effort_is_a_column() -> None:
    information, rng = information_of(OFF, 0), np.random.default_rng(1)
    values = rng.normal(size=len(information.layout.columns))
    names, added = [f"s.{row}" for row in ROWS], rng.normal(size=len(ROWS))
    wide = information.with_predicted(values, names, added)
    assert wide.layout.columns == (*information.layout.columns, *names)
    p = len(values)
    other = rng.normal(size=p)
    factor = rng.normal(size=len(ROWS))
    # y + a A v - A o - f A v = y - A (o + (f - a) v), row by row
    found = wide.residual_squares(np.concatenate([other, factor]))
    for row in range(len(ROWS)):
        wanted = information.residual_squares(other + (factor - added)[row] * values)[row]
        assert found[row] == pytest.approx(wanted, rel=1e-9)


def test_scales_are_found_within_their_intervals() -> None:
    scaled, information = Scaled(consistent(), ROWS), information_of(OFF, 2)
    start = scaled.unscaled(information)
    np.testing.assert_array_equal(start.values, 1.0)
    found = scaled.converged(information, start, weigh=True)
    far = np.abs(np.log(found.values / OFF)) / found.std
    assert far.max() < 3.0 and found.std.max() < DEVIATION[1]
    assert np.abs(found.values - 1.0).max() > 0.1
    again = scaled.step(information, found)
    np.testing.assert_allclose(again.values, found.values, rtol=2e-3)


def test_the_estimate_is_that_of_efforts_in_the_right_scale_but_less_sure() -> None:
    scaled, information = Scaled(consistent(), ROWS), information_of(OFF, 3)
    found = scaled.converged(information, scaled.unscaled(information), weigh=True)
    right = information.scaled(1.0 / found.values, information.signature.effort)
    estimate, plain = scaled.estimate(right, found), consistent()(right)
    assert estimate.parameters.names == plain.parameters.names
    assert estimate.condition == pytest.approx(plain.condition)
    assert estimate.condition_normalised == pytest.approx(plain.condition_normalised)
    assert estimate.standard is not None and plain.standard is not None
    assert estimate.standard.parameters.names == plain.standard.parameters.names
    far = np.abs(estimate.parameters.values - plain.parameters.values) / estimate.std
    assert far.max() < 1.0
    heavy = estimate.parameters.names.index(max(plain.parameters.names, key=lambda n: abs(
        plain.parameters.as_dict()[n]) / plain.std[plain.parameters.names.index(n)]))  # fmt: skip
    assert estimate.std[heavy] > 1.5 * plain.std[heavy]


@pytest.mark.slow
def test_efforts_that_agree_are_not_scaled() -> None:
    assert all(
        effort_scales(consistent(), information_of(np.ones(len(ROWS)), k)) is None for k in range(4)
    )


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "heavier"), [(0.5, 1.2), (1.8, 0.85)])
def test_one_joint_that_is_far_off_does_not_change_the_others(
    factor: float, heavier: float
) -> None:
    true = np.where(np.arange(len(ROWS)) == 1, factor, 1.0)
    scales = effort_scales(consistent(), information_of(true, 5, heavier=heavier))
    assert scales is not None
    np.testing.assert_allclose(scales.found.values, true, rtol=0.03)
    assert np.all(np.abs(scales.found.values - true) < scales.known.half_width)


def test_scales_that_scatter_are_not_known_better_than_they_scatter() -> None:
    apart = Scales(np.array([0.7, 0.9, 1.1, 1.4]), np.eye(4), np.zeros(0), 1.0, np.zeros(0))
    alike = replace(apart, values=np.array([1.0, 1.001, 0.5, 0.999]))
    assert apart.deviation == DEVIATION[1] and alike.deviation == DEVIATION[0]
    assert alike.prior_std[2] > 10.0 * alike.prior_std[0]


@pytest.mark.slow
def test_efforts_that_are_off_are_scaled_and_predicted_better() -> None:
    found = effort_scales(consistent(), information_of(OFF, 4))
    assert found is not None and found.error < 0.9 * found.without
    assert found.joints == ROWS and "effort_scales" in found.note
    printed = found.to_dict()
    assert printed["values"] == found.found.values.tolist()
    assert np.all(np.abs(found.found.values - OFF) < 1.5 * found.known.half_width)
    one = replace(found.found, values=np.ones(len(ROWS)))
    assert one.distance == 0.0 < found.found.distance
