"""Limits of effort and power: margins by Pinocchio, proofs by dense sampling."""

import numpy as np
import pytest

from exact_motions import MAKERS
from invented import ball, dh_arm, measured, mimic, tree
from oracles import pinocchio_torque
from steelyard.base.arrays import Array, Parameters, set_fields
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import (
    TORQUE_TOLERANCE,
    EffortLimit,
    power_limit,
    torque_limit,
    with_payload,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Coupled,
    Cubic,
    DirectionalCoulomb,
    DirectionalViscous,
    Quadratic,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia, Spring
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Robot

LAWS: dict[str, tuple[Term, ...]] = {
    "plain": (RotorInertia(), Coulomb(), Viscous(), Offset()),
    "dead zone": (Coulomb(threshold=0.3),),
    "smooth": (Coulomb(smoothing=0.1),),
    "directional": (DirectionalCoulomb(), DirectionalViscous()),
    "powers": (Quadratic(), Cubic(), Root()),
    "stribeck": (Coulomb(), Stribeck(speed=0.2)),
    "coupled": (Coulomb(), Coupled(pairs=(("slider_joint", "tip_joint"),))),
    "spring": (Spring(),),
}


def valued(robot: Robot, laws: tuple[Term, ...], seed: int = 0) -> ValuedModel:
    """Nominal bodies after the laws, whose values are drawn."""
    model = Model(robot, (*laws, RigidBody()))
    drawn = np.random.default_rng(seed).uniform(0.1, 2.0, len(model.names))
    values = [
        d if p.prior is None else p.prior for d, p in zip(drawn, model.parameters, strict=True)
    ]
    return ValuedModel(model, Parameters(model.names, model.units, values))


def drawn_states(n: int, count: int = 300) -> Array:
    """Positions, velocities (some of them zero) and accelerations, shape `(3, count, n)`."""
    rng = np.random.default_rng(1)
    states = rng.normal(size=(3, count, n))
    states[1] *= rng.choice([0.0, 0.01, 0.3, 2.0], (count, n))
    return states


def torque_of(arm: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
    return arm.torque(Motion(np.arange(len(q)), q, dq, ddq))


def split(limit: EffortLimit, states: Array) -> tuple[Array, Array]:
    """Greatest and least values that the margins stand for."""
    values = limit.margins(*states).values
    count = len(limit.limits)
    return limit.limits - values[:, :count], values[:, count:] - limit.limits


def test_torque_without_friction_is_pinocchios() -> None:
    robot = tree()
    arm = valued(robot, ())
    states = drawn_states(robot.n, 40)
    most, least = split(torque_limit({"arm": arm}, [9.0, 10.0, 11.0, 12.0]), states)
    expected = [pinocchio_torque(robot, *state) for state in states.swapaxes(0, 1)]
    np.testing.assert_allclose(most, expected, atol=1e-10)
    np.testing.assert_allclose(least, expected, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("laws", LAWS)
def test_bounds_hold_the_torque_of_every_law(laws: str) -> None:
    arm, states = valued(tree(), LAWS[laws]), drawn_states(4)
    most, least = split(torque_limit({"arm": arm}, np.ones(4)), states)
    tau = torque_of(arm, *states)
    assert np.all(tau <= most + 1e-9) and np.all(tau >= least - 1e-9)
    power = tau * states[1]
    most, least = split(power_limit({"arm": arm}, np.ones(4), 1.0), states)
    assert np.all(power <= most[:, :4] + 1e-9) and np.all(power >= least[:, :4] - 1e-9)
    assert np.all(power.sum(axis=1) <= most[:, 4] + 1e-9)
    assert np.all(power.sum(axis=1) >= least[:, 4] - 1e-9)
    if laws in ("smooth", "powers", "spring"):
        np.testing.assert_allclose(most[:, :4], power, atol=1e-9)


def test_friction_counts_the_worse_way_and_no_more() -> None:
    """One of the two ways of the sign is always reached, joint by joint."""
    arm, states = valued(tree(), LAWS["directional"]), drawn_states(4)
    most, least = split(torque_limit({"arm": arm}, np.ones(4)), states)
    small = states.copy()
    both = []
    for way in (1e-13, -1e-13):
        small[1] = np.where(states[1] == 0.0, way, states[1])
        both.append(torque_of(arm, *small))
    still = states[1] == 0.0
    assert still.sum() > 100
    np.testing.assert_allclose(np.maximum(*both)[still], most[still], atol=1e-9)
    np.testing.assert_allclose(np.minimum(*both)[still], least[still], atol=1e-9)


@pytest.mark.parametrize("laws", LAWS)
@pytest.mark.parametrize("power", [False, True])
def test_derivatives_are_central_differences(laws: str, power: bool) -> None:
    arm, h = valued(tree(), LAWS[laws]), 1e-6
    limit = (power_limit if power else torque_limit)({"arm": arm}, np.ones(4))
    set_fields(limit, activation_distance=np.full(len(limit.labels), np.inf))
    states = np.random.default_rng(2).uniform(0.1, 1.0, (3, 20, 4))
    margins = limit.margins(*states)
    for k, slopes in enumerate((margins.by_q, margins.by_dq, margins.by_ddq)):
        for j in range(4):
            step = np.zeros((3, 1, 4))
            step[k, 0, j] = h
            later, earlier = (limit.margins(*(states + s)).values for s in (step, -step))
            np.testing.assert_allclose(slopes[:, :, j], (later - earlier) / (2 * h), atol=2e-6)


def test_mimic_bodies_count(tmp_path) -> None:
    robot = mimic(tmp_path)
    limits = [joint.limits.effort for joint in robot.coordinates]
    limit = torque_limit({"arm": valued(robot, ())}, limits)
    states = drawn_states(robot.n, 5)
    expected = [pinocchio_torque(robot, *state) for state in states.swapaxes(0, 1)]
    assert limit.limits.tolist() == [50.0]
    np.testing.assert_allclose(split(limit, states)[0], expected, atol=1e-10)


def test_a_payload_adds_to_the_body_that_carries_it() -> None:
    robot, payload = tree(), ball(5)
    arm = valued(robot, LAWS["plain"])
    bodies = list(robot.bodies)
    bodies[3] = Body(**{**vars(bodies[3]), "inertia": bodies[3].inertia + payload})
    heavier = valued(robot.changed(bodies=tuple(bodies)), ())
    states = drawn_states(4, 20)
    light = torque_limit({"arm": valued(robot, ())}, np.ones(4)).margins(*states).values
    heavy = torque_limit({"arm": heavier}, np.ones(4)).margins(*states).values
    both = torque_limit({"arm": arm, "load": with_payload(arm, "tip", payload)}, np.ones(4))
    values = both.margins(*states).values
    assert values.shape == (20, 16) and len(both.labels) == len(both.activation_distance) == 16
    np.testing.assert_allclose(values[:, 8:] - values[:, :8], heavy - light, atol=1e-9)
    assert both.unit == "Nm or N"
    assert both.labels[0] == "torque of 'trunk_joint' below 1 Nm, arm"
    assert both.labels[13] == "force of 'slider_joint' above -1 N, load"


@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
@pytest.mark.parametrize("power", [False, True])
def test_proofs_hold_and_are_near(make, power: bool) -> None:
    motion = make(np.random.default_rng(4))
    arm = valued(dh_arm(), LAWS["plain"])
    t = np.linspace(0.0, motion.duration, 20_000)
    states = np.array([motion.derivative(t, order) for order in range(3)])
    ample = np.full(3, 1e6)
    probe = power_limit({"arm": arm}, ample) if power else torque_limit({"arm": arm}, ample)
    limits = 1e6 - probe.margins(*states).values.min(axis=0).reshape(2, 3).min(axis=0)
    limit = power_limit({"arm": arm}, limits) if power else torque_limit({"arm": arm}, limits)
    sampled = limit.margins(*states).values.min(axis=0)
    proven = limit.proven(motion)
    assert np.all(proven <= sampled + 1e-9 * np.tile(limits, 2))
    assert np.all(sampled - proven <= 3.0 * TORQUE_TOLERANCE * np.tile(limits, 2))


@pytest.mark.parametrize("laws", LAWS)
def test_every_law_can_be_proven(laws: str) -> None:
    arm = valued(tree(), LAWS[laws])
    rng = np.random.default_rng(6)
    motion = FourierMotion.from_free(np.zeros(4), 0.1 * rng.standard_normal((4, 6)), 8.0)
    t = np.linspace(0.0, 8.0, 20_000)
    states = np.array([motion.derivative(t, order) for order in range(3)])
    limit = torque_limit({"arm": arm}, np.full(4, 100.0))
    proven, sampled = limit.proven(motion), limit.margins(*states).values.min(axis=0)
    tau = torque_of(arm, *states)
    assert np.all(proven <= 100.0 - np.concatenate([tau.max(axis=0), -tau.min(axis=0)]))
    assert np.all(proven <= sampled) and np.all(sampled - proven <= 0.11)


def test_a_panda_has_limits_of_its_joints() -> None:
    robot = measured("panda")
    arm = valued(robot, LAWS["plain"])
    rng = np.random.default_rng(0)
    start = [0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.0]
    motion = FourierMotion.from_free(start, 0.45 * rng.standard_normal((7, 8)), 10.0)
    limits = [joint.limits.effort for joint in arm.model.robot.coordinates]
    limit = torque_limit({"arm": arm}, limits)
    assert np.isfinite(limit.proven(motion)).all()
    assert limit.limits.tolist() == [87.0] * 4 + [12.0] * 3
    assert limit.labels[13] == "torque of 'panda_joint7' above -12 Nm"


@pytest.mark.parametrize(
    ("make", "wrong", "fix"),
    [
        (
            lambda: with_payload(valued(tree(), ()), "hand", Inertia.zero()),
            "no frame 'hand'",
            "frames",
        ),
    ],
)
def test_what_cannot_be_bounded_is_refused(make, wrong: str, fix: str) -> None:
    with pytest.raises(ModelError, match=wrong) as caught:
        make()
    assert fix in caught.value.fix
