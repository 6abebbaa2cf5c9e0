"""The weight of the prior: parts that are left out decide whether a narrow one is believed."""

from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.prior_weight_and_contradictions import (
    FIRST_PRIOR_WEIGHT,
    Tried,
    weighed,
)
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia

LIKELIEST = 1e3  # the weight of most evidence below
SCATTER = np.array([3.0, -2.0, 1.0, -3.0, 2.0, -1.0])  # a loss that adds up to nothing


def weight(loss: Callable[[float], Array], rise: float = 0.0, rank: int = 10) -> float:
    """The weight that is found where evidence is greatest at `LIKELIEST`."""

    def attempt(gamma: float, near: Array | None) -> Tried:
        return Tried(gamma, np.zeros(1), rise, -(np.log(gamma / LIKELIEST) ** 2))

    return weighed(attempt, lambda tried: loss(tried.gamma), rank).gamma


def test_a_wide_prior_that_loses_nothing_beyond_chance_is_taken() -> None:
    assert weight(lambda gamma: SCATTER / gamma) == FIRST_PRIOR_WEIGHT


def test_a_narrow_prior_that_predicts_surely_better_is_kept() -> None:
    assert weight(lambda gamma: 1e6 / gamma + SCATTER / gamma) == pytest.approx(LIKELIEST, rel=0.2)


def test_the_widest_prior_that_is_good_enough_is_taken() -> None:
    found = weight(lambda gamma: np.where(gamma < 100.0, 9.0, 0.0) + SCATTER / gamma)
    assert FIRST_PRIOR_WEIGHT < found < LIKELIEST / 2.0


def test_parts_that_cannot_be_left_out_show_nothing() -> None:
    def refused(gamma: float) -> Array:
        raise DataError("too few samples", where="here", fix="log longer")

    assert weight(refused) == pytest.approx(LIKELIEST, rel=0.2)


def test_what_physics_costs_makes_the_prior_no_narrower_than_the_likeliest() -> None:
    found = weight(lambda gamma: 1e6 / gamma + SCATTER / gamma, rise=50.0)
    assert found == pytest.approx(LIKELIEST, rel=0.2)


MODEL = Model(load_robot(Path(str(files("steelyard.simulate") / "demo_arm.urdf"))).robot)
REGRESSOR = base_regressor(MODEL)
WINDOWS, SAMPLES, STEP = 8, 400, 0.02
SLOW, TURNED = 0.15, 0.01  # speeds of the missing friction [rad/s]


def held(seed: int) -> tuple[int, int]:
    """Intervals of inertial parameters that hold the truth, of how many.

    Links are wide, as in model files with large inertias; the prior's masses are off by 10 to 40 %,
    its centres by some percent of the width, and the robot has Stribeck and load-dependent
    friction, which the model lacks.
    """
    rng, known = np.random.default_rng(seed), default_knowledge(MODEL)
    priors, truth = list[Inertia](), dict[str, float]()
    for body, given in zip(known.bodies, known.priors, strict=True):
        assert given is not None
        true = Inertia.about_com(given.mass, given.com, 10.0 * given.inertia_com)
        truth |= {f"{n}.{body}": x for n, x in zip(INERTIAL_NAMES, true.ten, strict=True)}
        factor, shape = np.exp(rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)), rng.uniform(0.85, 1.15)
        width = 0.03 * np.sqrt(np.trace(true.inertia_com) / true.mass)
        com, inertia = true.com + width * rng.uniform(-1, 1, 3), factor * shape * true.inertia_com
        priors.append(Inertia.about_com(factor * true.mass, com, inertia))
    others = {"coulomb": 0.4, "viscous": 0.3}
    values = [truth.get(n, others.get(n.split(".")[0], 0.05)) for n in MODEL.names]
    base = dict(zip(REGRESSOR.base.base_names, REGRESSOR.base.base_values(values), strict=True))
    information = motion(rng, np.array(list(base.values())))
    estimate = Consistent(REGRESSOR.base, replace(known, priors=tuple(priors)))(information)
    names, stds = estimate.parameters.names, np.sqrt(np.diag(estimate.covariance))
    inside = [
        abs(value - base[name]) <= Z95 * std
        for name, value, std in zip(names, estimate.parameters.values, stds, strict=True)
        if name.split(".")[0] in INERTIAL_NAMES
    ]
    return sum(inside), len(inside)


def motion(rng: np.random.Generator, base: Array) -> Information:
    """Windows of a smooth motion; friction that the model lacks is in the efforts."""
    n = MODEL.robot.n
    rate, phase = 2.0 * np.pi * rng.uniform(0.06, 0.75, (n, 6, 1)), rng.uniform(0, 6.28, (n, 6, 1))
    size = rng.uniform(0.3, 1.0, (n, 6, 1)) / np.sqrt(rate)
    size *= 1.8 / size.sum(axis=1, keepdims=True)
    signature = Signature("arm", REGRESSOR.layout.columns, MODEL.robot.effort_units, "none")
    found = []
    for window in range(WINDOWS):
        t = STEP * (SAMPLES * window + np.arange(SAMPLES))
        wave, slope = size * np.sin(rate * t + phase), size * rate * np.cos(rate * t + phase)
        q, dq, ddq = wave.sum(axis=1), slope.sum(axis=1), -(rate**2 * wave).sum(axis=1)
        effort = REGRESSOR.dense(q, dq, ddq) @ base
        noise = 0.02 * np.sqrt(np.square(effort).mean(axis=1))[:, None]
        effort += noise * rng.normal(size=effort.shape)
        missing = 0.24 * np.exp(-np.square(dq / SLOW)) + 0.04 * np.abs(effort)
        effort += missing * np.tanh(dq / TURNED)
        sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
        label = (Window("run", float(t[0]), float(t[-1])),)
        parts = (sums.grams[None], sums.absolute[None], sums.counts[None])
        found.append(Information(REGRESSOR.layout, signature, label, *parts))
    return sum(found[1:], found[0])


@pytest.mark.slow
def test_intervals_hold_the_truth_where_friction_is_missing() -> None:
    inside, count = np.sum([held(seed) for seed in range(6)], axis=0)
    assert inside >= 0.94 * count
