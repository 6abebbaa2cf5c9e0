import json
from dataclasses import replace

import numpy as np
import pytest

from law_cases import CASES, LawCase, name_of
from steelyard.base.errors import ModelError
from steelyard.model.laws.friction_over_speed import Coulomb, Stribeck, Viscous
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent, LuGre
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia, Spring
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Find
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Limits, Robot, Transmission
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.typical_torques_and_masses import scales_of
from steelyard.simulate.virtual_robot import MujocoPlant


def test_same_seed_same_truth(arm: Robot) -> None:
    one, same, other = (random_truth(arm, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.values.values, same.values.values)
    np.testing.assert_array_equal(one.smoothing, same.smoothing)
    assert np.abs(one.inertial / other.inertial - 1.0).max() > 0.05


@pytest.mark.slow
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
    terms = (RigidBody(), Dahl(length=(1e-3, 2e-3, 3e-3, 4e-3)), LoadDependent(), Spring())
    truth = random_truth(tree, 3, terms=terms)
    data = json.loads(json.dumps(truth.to_dict()))
    back = Truth.from_dict(data, tree)
    assert back.model.terms == truth.model.terms
    np.testing.assert_array_equal(back.values.values, truth.values.values)
    np.testing.assert_array_equal(back.smoothing, truth.smoothing)
    assert data["parameters"]["m.lift"] == {"value": truth.inertial[1, 0], "unit": "kg"}
    assert data["parameters"]["dahl.b"] == {"value": truth.values["dahl.b"], "unit": "N"}
    assert data["smoothing"]["d"] == truth.smoothing[3]


def test_truths_of_others_are_refused(tree: Robot, arm: Robot) -> None:
    data = random_truth(tree, 3).to_dict()
    with pytest.raises(ModelError, match="schema 'steelyard-truth/1' instead of") as caught:
        Truth.from_dict({**data, "schema": "steelyard-truth/1"}, tree)
    assert "this version" in caught.value.fix
    with pytest.raises(ModelError, match="not those of robot 'steelyard_demo_arm'|not those of"):
        Truth.from_dict(data, arm)


def test_values_out_of_range_are_refused(arm: Robot) -> None:
    truth = random_truth(arm, 0)
    for name in ("rotor_inertia.elbow", "coulomb.elbow", "viscous.elbow", "m.hand"):
        with pytest.raises(ModelError, match=f"'{name}' is -1, which is out of its range"):
            truth.changed(**{name: -1.0})
    assert truth.changed(**{"offset.elbow": -1.0}).values["offset.elbow"] == -1.0
    with pytest.raises(ModelError, match="smoothing speed is not positive"):
        replace(truth, smoothing=np.zeros(arm.n))
    with pytest.raises(ModelError, match="has no bodies"):
        random_truth(arm, 0, terms=(Viscous(),))


@pytest.mark.parametrize("seed", range(5))
def test_drawn_truths_run_at_the_default_step(arm: Robot, tree: Robot, seed: int) -> None:
    for robot in (arm, tree):
        assert MujocoPlant(robot, random_truth(robot, seed)).timestep >= 1.25e-4


@pytest.mark.parametrize("case", [c for c in CASES if c.simulated], ids=name_of)
def test_every_law_is_drawn_in_proportion_to_the_torque(arm: Robot, case: LawCase) -> None:
    law = case.on(arm)
    truth = random_truth(arm, 2, terms=(RigidBody(), law))
    drawn = truth.law_values
    assert np.all(np.isfinite(drawn)) and np.all(drawn != 0.0)
    other = random_truth(arm, 3, terms=(RigidBody(), law)).law_values
    assert np.all(drawn != other)


def test_rotors_of_motors_are_drawn_for_their_gears(arm: Robot) -> None:
    gears = np.diag([100.0, 100.0, 100.0, 50.0, 50.0, 50.0])
    gears[5, 4] = 50.0
    motors = tuple(f"m{k}" for k in range(1, 7))
    geared = arm.changed(transmission=Transmission(motors, gears))
    truth = random_truth(geared, 0, terms=(RigidBody(), RotorInertia(motors=motors)))
    plain = random_truth(arm, 0, terms=(RigidBody(), RotorInertia()))
    assert truth.rotors[5].row == (0.0, 0.0, 0.0, 0.0, 50.0, 50.0)
    felt = [r.inertia * max(r.row) ** 2 for r in truth.rotors]
    np.testing.assert_allclose(felt[:5], [r.inertia for r in plain.rotors][:5])


def test_open_fields_are_drawn_and_loads_are_the_true_ones(arm: Robot) -> None:
    terms = (RigidBody(), Dahl(length=Find(1e-4, 1e-2)), LoadDependent(joints=("elbow",)))
    truth = random_truth(arm, 4, terms=terms)
    dahl, load = truth.laws
    assert isinstance(dahl, Dahl) and isinstance(load, LoadDependent)
    assert 1e-4 < dahl.length < 1e-2
    np.testing.assert_array_equal(load.reference_of(arm), truth.inertial.ravel())


def test_bristles_are_damped_below_twice_critical(arm: Robot) -> None:
    terms = (RigidBody(), LuGre(length=1e-3), Viscous())
    truth = random_truth(arm, 0, terms=terms)
    friction, damping = (
        np.array([truth.values[f"{law}.{joint}"] for joint in arm.joint_names])
        for law in ("lugre", "lugre_damping")
    )
    inertia = scales_of(arm, truth.inertial).inertia
    ratio = damping / (2.0 * np.sqrt(friction * 1e-3 * inertia))
    assert np.all((ratio > 0.15) & (ratio < 1.5))


def test_smoothing_grows_where_friction_is_stiff(arm: Robot) -> None:
    assert random_truth(arm, 0, terms=(RigidBody(), Coulomb())).smoothing.max() == 0.005
    terms = (RigidBody(), Stribeck(speed=1.0))
    bare = random_truth(arm, 0, terms=terms)
    assert bare.smoothing.min() == 0.005 and bare.smoothing.max() > 0.03
    assert MujocoPlant(arm, bare).timestep == 1.25e-4
    assert Model(arm, terms).names == bare.values.names


def test_a_law_that_loads_no_joint_divides_by_nothing(tree: Robot) -> None:
    """Warnings are errors here; a greatest speed of 1e12 made one."""
    strong = [replace(c, limits=Limits(-1.0, 1.0, 1e12)) for c in tree.coordinates]
    truth = random_truth(tree.changed(coordinates=tuple(strong)), 1)
    assert np.isfinite(truth.values.values).all()
