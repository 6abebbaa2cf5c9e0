import json
from dataclasses import replace

import numpy as np
import pytest

from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Robot
from steelyard.virtual.plant import MujocoPlant
from steelyard.virtual.truth import Truth, random_truth

FIELDS = ("inertial", "rotor_inertia", "coulomb", "viscous", "offset", "smoothing")


def test_same_seed_same_truth(arm: Robot) -> None:
    one, same, other = (random_truth(arm, seed) for seed in (1, 1, 2))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
    assert np.abs(one.inertial / other.inertial - 1.0).max() > 0.05


def test_bodies_exist_and_are_off_by_twenty_to_thirty_percent(arm: Robot) -> None:
    ratios = []
    for seed in range(30):
        truth = random_truth(arm, seed)
        assert all(Inertia.from_ten(ten).flaw() is None for ten in truth.inertial)
        ratios.append(truth.inertial[:, 0] / arm.nominal[:, 0])
    assert 0.2 < np.std(np.log(ratios)) < 0.4
    assert abs(np.mean(np.log(ratios))) < 0.1


def test_no_spread_is_the_nominal_model(arm: Robot) -> None:
    np.testing.assert_allclose(random_truth(arm, 0, spread=0.0).inertial, arm.nominal, atol=1e-12)


def test_unknown_links_become_balls(pendulum: Robot) -> None:
    bare = Robot(
        "bare", (replace(pendulum.bodies[0], inertia=Inertia.zero()),), pendulum.coordinates
    )
    truth = random_truth(bare, 0, spread=0.0)
    assert truth.inertial[0, 0] == pytest.approx(1.0)
    assert Inertia.from_ten(truth.inertial[0]).flaw() is None


def test_known_massless_links_stay_massless(arm: Robot) -> None:
    bodies = list(arm.bodies)
    bodies[3] = replace(bodies[3], inertia=Inertia.zero(), known=True)
    truth = random_truth(Robot("r", tuple(bodies), arm.coordinates), 0)
    assert not truth.inertial[3].any()


def test_json_round_trip_is_exact_and_named(tree: Robot) -> None:
    truth = random_truth(tree, 3)
    values = json.loads(json.dumps(truth.to_dict(tree)))
    back = Truth.from_dict(values, tree)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(back, name), getattr(truth, name))
    assert values["links"]["lift"]["m"] == truth.inertial[1, 0]
    assert values["joints"]["d"]["viscous"] == truth.viscous[3]


def test_friction_law() -> None:
    truth = Truth(np.zeros((1, 10)), [0.1, 0.1], [2.0, 1.0], [0.5, 0.0], [0.3, -0.3], [0.01, 0.02])
    np.testing.assert_allclose(truth.friction(np.array([1.0, -1.0])), [2.8, -1.3])
    np.testing.assert_allclose(truth.friction(np.zeros(2)), [0.3, -0.3])
    np.testing.assert_allclose(truth.friction(np.array([0.01, 0.0]))[0], 2 * np.tanh(1) + 0.305)


@pytest.mark.parametrize("seed", range(5))
def test_drawn_truths_run_at_the_default_step(arm: Robot, tree: Robot, seed: int) -> None:
    for robot in (arm, tree):
        assert MujocoPlant(robot, random_truth(robot, seed)).timestep >= 1.25e-4


@pytest.mark.parametrize("field", ["rotor_inertia", "coulomb", "viscous"])
def test_negative_values_are_refused(arm: Robot, field: str) -> None:
    truth = random_truth(arm, 0)
    with pytest.raises(ValueError, match=f"{field} is negative"):
        replace(truth, **{field: -getattr(truth, field)})


def test_smoothing_must_be_positive(arm: Robot) -> None:
    truth = random_truth(arm, 0)
    with pytest.raises(ValueError, match="smoothing"):
        replace(truth, smoothing=np.zeros(arm.n))
