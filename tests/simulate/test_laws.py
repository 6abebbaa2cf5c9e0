"""The laws as the plant's machine code steps them."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from law_cases import CASES, LawCase, name_of
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.equations.passive_joints import all_joints
from steelyard.model.laws.friction_over_speed import Coulomb, Coupled, DirectionalCoulomb, Root
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent, LuGre, MaxwellSlip
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.laws.register import term_of
from steelyard.model.model import Model
from steelyard.model.terms.term import Term, TermSamples
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.laws_beside_mujoco import Laws, LawsInUse
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.virtual_robot import MujocoPlant, VirtualRobot

MEMORIES = (
    Dahl(length=(2e-3, 1e-3, 3e-3, 5e-3)),
    MaxwellSlip(lengths=(1e-3, 5e-3)),
    MaxwellSlip(lengths=(1e-3, 5e-3), relaxing=True),
    LuGre(length=2e-3, breakaway=1.4, speed=0.1),
    LoadDependent(length=1e-3),
)


def in_use(robot: Robot, *laws: Term, widths: float = 0.01) -> tuple[LawsInUse, list[np.ndarray]]:
    """Laws with parameters 1, 2, 3, ... over arrays of positions, velocities, accelerations."""
    values = 1.0 + np.arange(sum(len(law.parameters(robot)) for law in laws))
    model = build(robot)
    seen = [np.zeros(len(model.offset)) for _ in range(3)]
    made = Laws(robot, laws, values, np.full(robot.n_joints, widths), model)
    return LawsInUse(made, *seen), seen


def stepped(robot: Robot, law: Term, motion: Motion) -> np.ndarray:
    """Torque of a law sample by sample, as the plant evaluates it, shape `(N, n)`."""
    used, seen = in_use(robot, law)
    model, result = used.laws.model, np.zeros_like(motion.q)
    for k in range(len(motion)):
        for array, x in zip(seen, (motion.q[k], motion.dq[k], motion.ddq[k]), strict=True):
            array[:] = model.map @ x
        seen[0] += model.offset
        if k == 0:
            used.forget()
        forces = np.zeros(len(model.offset))
        forces[used.dofs] = -used.step()
        result[k] = model.map.T @ forces
    return result


def wander(robot: Robot, samples: int = 400) -> Motion:
    t = 1e-3 * np.arange(samples)[:, None]
    rates = np.array([14.0, 6.0, 22.0, 10.0])[: robot.n]
    q, dq, ddq = 1.0 - np.cos(rates * t), rates * np.sin(rates * t), rates**2 * np.cos(rates * t)
    return Motion(t[:, 0], 0.02 * q, 0.02 * dq, 0.02 * ddq)


@pytest.mark.parametrize("law", MEMORIES, ids=str)
def test_memory_steps_as_along_a_log(tree: Robot, law: Any) -> None:
    motion = wander(tree)
    q, dq, ddq = motion.q.T, motion.dq.T, motion.ddq.T
    loads = partial(Model(tree).rigid_torque, q, dq, ddq)
    channels, _ = law.remember(tree, TermSamples(q, dq, ddq, loads), None)
    state = type("State", (), {"q": q, "dq": dq, "ddq": ddq, "channels": channels})
    wanted = np.zeros_like(motion.q)
    for (row, column), values in law.columns(tree, state).items():
        wanted[:, row] += (1.0 + column) * values
    found = stepped(tree, law, motion)
    assert np.abs(wanted).max() > 1.0
    np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())


def test_loads_on_passive_joints_are_borne_by_the_others(four_bar: Robot) -> None:
    t = np.linspace(0.0, 1.0, 200)
    crank = [1.1 + 0.1 * np.sin(9.0 * t), 0.9 * np.cos(9.0 * t), -8.1 * np.sin(9.0 * t)]
    own = [x[None] for x in crank]
    law = LoadDependent(length=1e-3)
    passive, load = np.split(Model(four_bar, (law,)).scan()(*own), [2])
    motion = Motion(t, *(x.T for x in all_joints(four_bar, *own, passive)))
    found = stepped(four_bar, law, motion)[1:, 0]
    assert np.abs(load).max() > 1.0
    # the log's first sample is taken to have moved before, the plant begins at rest
    late = t[1:] > 0.1
    np.testing.assert_allclose(found[late], load[0, 1:][late], rtol=1e-6, atol=1e-6)


def test_jumps_at_zero_speed_are_softened(tree: Robot) -> None:
    pairs = [("a", "c")]
    laws = (Coulomb(joints=("a",)), DirectionalCoulomb(joints=("b",)), Coupled(pairs, "coulomb"))
    for scale in (0.3, 1.0, 50.0):
        dq = scale * 0.01 * np.array([1.0, -1.0, 1.0, 0.0])
        motion = Motion(np.zeros(1), np.zeros((1, 4)), dq[None], np.zeros((1, 4)))
        turn = np.tanh(scale)
        found = sum((stepped(tree, law, motion)[0] for law in laws), np.zeros(4))
        # forward 1, backward 2 of the directional law
        np.testing.assert_allclose(found, [turn, -2.0 * turn, turn, 0.0], atol=1e-9)
    root = stepped(tree, Root(joints=("c",)), Motion(*np.zeros((1, 1)), *_speeds(1e-4, 2)))
    assert root[0, 2] == pytest.approx(1e-4 / np.sqrt(0.01), rel=1e-9)


def _speeds(speed: float, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    dq = np.zeros((1, 4))
    dq[0, joint] = speed
    return np.zeros((1, 4)), dq, np.zeros((1, 4))


def test_widths_follow_a_coordinate(tree: Robot) -> None:
    law = Coulomb(along=(("belt", (("a", 3.0), ("c", -1.0))),))
    dq = np.array([0.01, 0.0, 0.01, 0.0])
    found = stepped(tree, law, Motion(np.zeros(1), np.zeros((1, 4)), dq[None], np.zeros((1, 4))))
    turn = np.tanh(0.02 / 0.04)
    np.testing.assert_allclose(found[0], [3.0 * turn, 0.0, -turn, 0.0], atol=1e-9)


def test_smooth_laws_and_thresholds_stay_as_they_are(tree: Robot) -> None:
    for table in ({"smoothing": 0.003}, {"threshold": 0.02}):
        law = term_of({"law": "coulomb", **table}, "test")
        motion = Motion(np.zeros(1), np.zeros((1, 4)), np.full((1, 4), 0.015), np.zeros((1, 4)))
        found = stepped(tree, law, motion)[0]
        size = np.tanh(0.015 / 0.003) if "smoothing" in table else 0.0
        np.testing.assert_allclose(found, size * np.arange(1.0, 5.0), atol=1e-9)


def felt(robot: Robot, law: Term, seed: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Logged torque, the model's, and the law's part of it, where all joints move."""
    truth = random_truth(robot, seed, terms=(RigidBody(), RotorInertia(), law))
    run = VirtualRobot(robot, truth, rest=0.3).follow(
        random_fourier(robot, seed=7, period=1.5, harmonics=2)
    )
    spline = CubicSpline(run.t, run.q)
    motion = Motion(run.t, *(spline(run.t, k) for k in range(3)))
    torque = truth.model.at(truth.values).torque(motion)
    laws = [t for t in truth.model.terms if not isinstance(t, RigidBody | RotorInertia)]
    bare = {p.name: 0.0 for term in laws for p in term.parameters(robot)}
    without = truth.changed(**bare)
    part = torque - without.model.at(without.values).torque(motion)
    moving = np.all(np.abs(run.dq) > 0.15, axis=1)
    inner = moving & (run.t > 0.5) & (run.t < 1.7)
    return run.tau[inner], torque[inner], part[inner]


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [c for c in CASES if c.simulated and c.law != "rotor_inertia"], ids=name_of
)
def test_every_law_is_felt_in_the_log(leg: Robot, case: LawCase) -> None:
    logged, torque, part = felt(leg, case.on(leg))
    assert np.linalg.norm(logged - torque) < 0.02 * np.linalg.norm(part)
    assert np.linalg.norm(part) > 1e-3 * np.linalg.norm(torque)


def swing(robot: Robot, truth: Truth, ticks: int) -> np.ndarray:
    """Energy of a pendulum of 1 kg at half a metre, at every millisecond of a free swing [J]."""
    plant = MujocoPlant(robot, truth)
    plant.place([1.2])
    states = np.array([np.ravel(plant.step(np.zeros(1), 1e-3)) for _ in range(ticks)])
    return 0.5 * 0.251 * states[:, 1] ** 2 - 9.81 * 0.5 * np.cos(states[:, 0])


def test_a_free_swing_keeps_its_energy(pendulum: Robot, pendulum_truth: Truth) -> None:
    energy = swing(pendulum, pendulum_truth, 5000)
    assert np.ptp(energy) < 1e-5 * (energy[0] + 9.81 * 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [c for c in CASES if c.units is not None and c.energy == "taken"], ids=name_of
)
def test_friction_never_gives_energy(pendulum: Robot, make_truth: Callable, case: LawCase) -> None:
    law = case.on(pendulum)
    values = {p.name: 0.1 for p in law.parameters(pendulum)}
    if case.law == "lugre":
        values["lugre_damping.pivot"] = 1e-3
    energy = swing(pendulum, make_truth(pendulum, law, smoothing=0.005, **values), 2000)
    # what bristles hold and give back
    bristles = 0.1 * 1e-2 if case.law == "maxwell_slip" else 0.13 * 1e-3
    assert np.diff(energy).max() < 1e-6 + bristles
    assert energy[-1] < energy[0] - (1e-4 if case.faint else 0.1)
    assert energy.max() <= energy[0] + 1e-6
    assert np.all(np.diff(energy[::100]) < 1e-6 + bristles)


@pytest.mark.parametrize("law", [Dahl(), MaxwellSlip(), LuGre()], ids=lambda law: law.law)
def test_a_resting_pendulum_is_held_by_its_bristles(
    pendulum: Robot, make_truth: Callable, law: Term
) -> None:
    values = {p.name: 2.0 if "damping" not in p.name else 0.01 for p in law.parameters(pendulum)}
    plant = MujocoPlant(pendulum, make_truth(pendulum, law, **values))
    plant.place([0.3])
    for _ in range(3000):
        q, dq = plant.step(np.zeros(1), 1e-3)
    assert 0.29 < q[0] < 0.3001 and abs(dq[0]) < 0.03
