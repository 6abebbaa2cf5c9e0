"""Structural base parameters: their number, and that torque depends on nothing else."""

from pathlib import Path

import numpy as np
import pytest

from invented import ROBOTS, measured, tree
from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import (
    BaseMap,
    base_parameters,
    refuse_twins,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Body, Coordinate, Robot


@pytest.mark.parametrize(
    ("name", "terms", "count"),
    [
        ("ur10e", (RigidBody(),), 36),
        ("ur10e", (RigidBody(), RotorInertia()), 40),
        ("panda", (RigidBody(),), 43),
        ("rokae_ar5", (RigidBody(),), 45),
    ],
)
def test_counts_of_real_robots(name: str, terms: tuple[RigidBody, ...], count: int) -> None:
    assert len(base_parameters(Model(measured(name), terms))) == count


def test_the_count_depends_on_gravity() -> None:
    sideways = measured("rokae_ar5")
    upright = Robot(sideways.name, sideways.bodies, sideways.coordinates, (0.0, 0.0, -9.81))
    assert len(base_parameters(Model(upright, (RigidBody(),)))) == 43


@pytest.mark.parametrize("name", list(ROBOTS))
def test_torque_depends_on_base_parameters_only(name: str, tmp_path: Path) -> None:
    model = Model(ROBOTS[name](tmp_path))
    base = base_parameters(model)
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 40, model.robot.n))
    motion = Motion(np.arange(40), q, dq, ddq)
    values = rng.normal(size=len(model.names))
    full = model.at(Parameters(model.names, model.units, values)).torque(motion)
    reduced = Parameters(base.base_names, base.base_units, base.base_values(values))
    assert np.abs(model.at(reduced).torque(motion) - full).max() < 1e-9 * np.abs(full).max()
    assert np.allclose(base.lift @ values, base.base_values(values), atol=1e-12)


def test_a_torso_lift_cannot_tell_mass_offset_and_rotor_apart() -> None:
    lift = Body("torso", "lift", "prismatic", -1, np.eye(3), np.zeros(3), [0, 0, 1.0], 0)
    robot = Robot("torso", (lift,), (Coordinate("lift", "prismatic"),))
    base = base_parameters(Model(robot, (RigidBody(), RotorInertia(), Offset())))
    assert base.base_names == ("m.torso", "rotor_inertia.lift")
    assert base.grouping(0) == "m.torso + 0.1019 offset.lift"
    assert base.grouping(1) == "rotor_inertia.lift - 0.1019 offset.lift"


def test_round_trip_is_exact() -> None:
    base = base_parameters(Model(ROBOTS["tree"](Path())))
    again = BaseMap.from_dict(base.to_dict())
    assert again.base_names == base.base_names
    assert np.array_equal(again.coefficients, base.coefficients)


def twins(*terms: Term) -> str:
    """The message on terms of a robot; empty if they are distinguishable."""
    model = Model(ROBOTS["single"](Path()), terms)
    try:
        refuse_twins(model, base_parameters(model))
    except ModelError as error:
        return str(error)
    return ""


def test_causes_that_no_motion_tells_apart_are_named() -> None:
    twice = Viscous(along=(("twice", (("hinge", 2.0),)),))
    message = twins(RigidBody(), Viscous(), Coulomb(), twice)
    assert "'viscous.twice' is not distinguishable from 'viscous.hinge'" in message
    assert "leave one of the terms out, or restrict it to other joints" in message
    assert "robot 'single'" in message and "coulomb" not in message


def test_causes_that_differ_are_allowed_and_so_are_rotors_beside_bodies() -> None:
    assert twins(RigidBody(), Coulomb(), Viscous(), Offset()) == ""
    model = Model(ROBOTS["single"](Path()), (RigidBody(), RotorInertia(), Offset()))
    base = base_parameters(model)
    assert "rotor_inertia.hinge" in [base.names[k] for k in base.dependent]
    refuse_twins(model, base)


def test_a_twin_of_several_names_them_all() -> None:
    sums = (("plus", (("left_joint", 1.0), ("trunk_joint", 1.0))),
            ("minus", (("left_joint", 1.0), ("trunk_joint", -1.0))),
            ("third", (("left_joint", 1.0), ("trunk_joint", 2.0))))  # fmt: skip
    given = Viscous(joints=("left_joint", "trunk_joint"))
    model = Model(ROBOTS["tree"](Path()), (RigidBody(), given, Viscous(along=sums[:1])))
    assert refuse_twins(model, base_parameters(model)) is None  # type: ignore[func-returns-value]
    model = Model(ROBOTS["tree"](Path()), (RigidBody(), given, Viscous(along=sums[:2])))
    with pytest.raises(ModelError) as caught:
        refuse_twins(model, base_parameters(model))
    assert "'viscous.minus' is not distinguishable from " in caught.value.wrong
    assert all(
        f"'viscous.{n}'" in caught.value.wrong for n in ("left_joint", "trunk_joint", "plus")
    )


@pytest.mark.parametrize("threshold", [0.02, 4.0, 500.0, (0.01, 500.0)])
def test_friction_above_any_threshold_is_a_base_parameter(
    threshold: float | tuple[float, ...], tmp_path: Path
) -> None:
    arm = tree()
    given = threshold if isinstance(threshold, float) else (threshold * arm.n)[: arm.n]
    friction = (Coulomb(threshold=given), Viscous(threshold=given))
    plain = base_parameters(Model(arm, (RigidBody(), Coulomb(), Viscous())))
    found = base_parameters(Model(arm, (RigidBody(), *friction)))
    assert found.base_names == plain.base_names and found.unseen == plain.unseen
    np.testing.assert_allclose(found.coefficients, plain.coefficients, atol=1e-9)
