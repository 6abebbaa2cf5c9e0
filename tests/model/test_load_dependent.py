"""Friction that grows with the load, against Pinocchio's torques and by hand."""

import numpy as np
import pytest

from closed_chains import five_bar
from invented import single, tree
from moving import channels, cycles, geared
from oracles import pinocchio_torque
from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Robot


def loads(robot: Robot, state: np.ndarray) -> np.ndarray:
    """Pinocchio's torques along a motion, shape `(n, N)`."""
    count = state.shape[2]
    return np.array([pinocchio_torque(robot, *state[:, :, k]) for k in range(count)]).T


def test_channels_are_load_times_direction() -> None:
    robot, state = tree(), cycles(4, 1, 300)
    found = channels(LoadDependent(length=0.02), robot, state)
    direction = channels(Dahl(length=0.02), robot, state)
    expected = np.abs(loads(robot, state)) * direction
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()


def test_motors_bear_what_the_gears_leave_them() -> None:
    robot, state = geared(), cycles(4, 1, 300)
    assert robot.transmission is not None
    motors = robot.transmission.motors
    found = channels(LoadDependent(length=0.5, motors=motors[1:]), robot, state)
    direction = channels(Dahl(length=0.5, motors=motors[1:]), robot, state)
    at_motors = np.linalg.solve(robot.transmission.matrix.T, loads(tree(), state))
    expected = np.abs(at_motors[1:]) * direction
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()


def test_other_coordinates_bear_their_share() -> None:
    """Twice a joint bears half its torque; a sum of two bears half of the sum."""
    along = (
        ("double", (("tip_joint", 2.0),)),
        ("sum", (("left_joint", 1.0), ("tip_joint", 1.0))),
    )
    robot, state = tree(), cycles(4, 1, 100)
    found = np.abs(channels(LoadDependent(length=1e-9, along=along), robot, state))[:, 1:]
    torque = loads(robot, state)[:, 1:]
    assert np.allclose(found[0], np.abs(torque[3] / 2.0), rtol=1e-10)
    assert np.allclose(found[1], np.abs(torque[2] + torque[3]) / 2.0, rtol=1e-10, atol=1e-10)


def test_motors_of_closed_chains_bear_the_passive_bodies_too() -> None:
    robot = five_bar()
    model = Model(robot, (RigidBody(),))
    state = 0.1 * cycles(2, 1, 200)
    state[0] += robot.assembly[:2, None]
    values = Parameters(model.names, model.units, robot.nominal.ravel())
    load = model.at(values).torque(Motion(np.arange(200), *(x.T for x in state))).T
    scan = Model(robot, (LoadDependent(length=1e-9),)).scan()
    found = np.abs(scan(*state)[2:, 1:])
    assert np.abs(found - np.abs(load[:, 1:])).max() < 1e-9 * np.abs(load).max()


def test_a_reference_replaces_the_nominal_bodies() -> None:
    robot, state = tree(), cycles(4, 1, 50)
    names = [p.name for p in RigidBody().parameters(robot)]
    doubled = dict(zip(names, 2.0 * robot.nominal.ravel(), strict=True))
    nominal = channels(LoadDependent(), robot, state)
    twice = LoadDependent().with_reference({**doubled, "coulomb.tip_joint": 3.0})
    assert np.allclose(channels(twice, robot, state), 2.0 * nominal, rtol=1e-12)
    only = LoadDependent().with_reference({"m.tip": 1.0})
    found = np.abs(channels(only, robot, state))
    assert found[1].max() > 1.0 and not found[2].any()


def test_programs_do_not_depend_on_the_reference() -> None:
    terms = [LoadDependent().with_reference({"m.tip": m, "mx.tip": m}) for m in (1.0, 2.0)]
    keys = [Model(tree(), (RigidBody(), term)).program_key for term in terms]
    assert keys[0] == keys[1]
    assert terms[0] != terms[1]


def test_the_reference_is_checked() -> None:
    state = cycles(4, 1, 10)
    with pytest.raises(ModelError, match=r"names 'm\.tap'") as caught:
        channels(LoadDependent().with_reference({"m.tap": 1.0}), tree(), state)
    assert "'m.tip'" in caught.value.fix
    with pytest.raises(ModelError, match="names no number of a body"):
        LoadDependent().with_reference({"coulomb.tip_joint": 1.0})
    for wrong in ((("m.tip", float("nan")),), (("m.tip", "heavy"),), "m.tip", 3):
        with pytest.raises(ModelError, match="load-dependent friction has reference = ") as caught:
            LoadDependent(reference=wrong)
        assert 'reference = {"m.forearm" = 3.2}' in caught.value.fix


def test_without_masses_a_reference_is_requested() -> None:
    rod = single().bodies[0]
    blank = Body(**{**vars(rod), "inertia": Inertia.zero(), "known": False})
    robot = single().changed(bodies=(blank,))
    with pytest.raises(ModelError, match="no body has a mass") as caught:
        channels(LoadDependent(), robot, cycles(1, 1, 10))
    assert "`reference`" in caught.value.fix
