"""`friction = "auto"` judged by the consistent estimate, of a robot with two joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from invented import ball
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.base.progress import Event
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.friction.friction_choice import FrictionChoice, choose_friction
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import PLAUSIBLE, Dahl, LoadDependent
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.file.sections import EffortKind
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Body, Coordinate, Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

RATE = 100.0


def arm() -> Robot:
    """Two links that swing in a plane."""
    bodies = tuple(
        Body(n, f"{n}_joint", "revolute", i - 1, np.eye(3), [0.4 * i, 0.0, 0.0], [0.0, 1.0, 0.0], i)
        for i, n in enumerate(("upper", "lower"))
    )
    known = tuple(replace(b, inertia=ball(i), known=True) for i, b in enumerate(bodies))
    return Robot("arm", known, tuple(Coordinate(b.joint, "revolute") for b in bodies))


MODEL = Model(arm(), (RigidBody(),))


def logged(lengths: tuple[float, float], seed: int) -> Run:
    """Friction of 1 Nm and 0.6 N m s/rad."""
    values = {f"dahl.{c.name}": 1.0 for c in MODEL.robot.coordinates}
    values |= {f"viscous.{c.name}": 0.6 for c in MODEL.robot.coordinates}
    return logged_with((Dahl(length=lengths), Viscous()), values, seed)


def logged_with(
    laws: tuple[Term, ...],
    known: dict[str, float],
    seed: int,
    kind: EffortKind = "joint_torque",
) -> Run:
    """Swings with many reversals, small ones too; torque noise of 0.02 Nm."""
    model = replace(MODEL, terms=(*MODEL.terms, *laws))
    values = {p.name: p.prior or 0.0 for p in model.parameters} | known
    valued = model.at(Parameters(model.names, model.units, [values[n] for n in model.names]))
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    states = np.zeros((3, len(t), 2))
    for w, size in ((0.6, 0.8), (2.1, 0.25), (5.3, 0.02)):
        phase, w = rng.uniform(0.0, 6.0, 2), w * rng.uniform(0.9, 1.1, 2)
        s, c = size * np.sin(np.outer(t, w) + phase), size * np.cos(np.outer(t, w) + phase)
        states += [s, w * c, -w * w * s]
    q, dq, ddq = states
    effort = valued.torque(Motion(t, q, dq, ddq)) + 0.02 * rng.normal(size=q.shape)
    ones = np.ones(2)
    signals = Signals(
        "t", 1.0, ("q1", "q2"), ones, ("v1", "v2"), ones, ("e1", "e2"), ones,
        kind, ("Nm", "Nm"), ones,
    )  # fmt: skip
    table = np.column_stack([t, q, dq, effort])
    log = LogInMemory(Path(f"run{seed}"), ("t", "q1", "q2", "v1", "v2", "e1", "e2"), table)
    return prepare(Recording(log, signals), Processing(20.0, 8.0))


def consistent(model: Model, base: BaseMap) -> Consistent:
    return Consistent(base, default_knowledge(model))


def choose(runs: list[Run], events: list[Event]) -> FrictionChoice:
    def watch(event: Event) -> bool:
        events.append(event)
        return True

    return choose_friction(MODEL, runs, WeightedLeastSquares(), consistent, progress=watch)


@pytest.mark.slow
def test_every_joint_gets_its_length_whatever_the_order_of_the_logs() -> None:
    runs = [logged((1e-3, 1e-2), seed) for seed in range(3)]
    events: list[Event] = []
    found = choose(runs, events)
    (dahl,) = (term for term in found.best.terms if isinstance(term, Dahl))
    assert dahl.length == (1e-3, 1e-2)
    turned = choose(runs[::-1], [])
    assert turned.best.name == found.best.name
    for one, other in zip(found.table, turned.table, strict=True):
        np.testing.assert_allclose(one.error, other.error, rtol=1e-6)
    fits = [event for event in events if event.phase == "choosing friction laws"]
    assert len({event.done for event in fits}) > 5
    assert all(0.0 <= event.done <= event.total for event in fits)


@pytest.mark.slow
def test_no_length_per_joint_where_one_is_best_for_all() -> None:
    found = choose([logged((1e-2, 1e-2), seed) for seed in range(3)], [])
    lengths = [t.length for mix in found.table for t in mix.terms if isinstance(t, Dahl)]
    assert lengths and not any(isinstance(length, tuple) for length in lengths)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("upper", "lower", "joints"),
    [(0.2, 0.3, None), (0.2, 0.9, ("upper_joint",)), (0.8, 0.9, ())],
)
def test_load_dependent_friction_is_of_joints_that_it_is_plausible_of(
    upper: float, lower: float, joints: tuple[str, ...] | None
) -> None:
    laws = (Coulomb(), Viscous(), LoadDependent(length=1e-3))
    values = {"coulomb.upper_joint": 1.0, "coulomb.lower_joint": 1.0}
    values |= {"load_dependent.upper_joint": upper, "load_dependent.lower_joint": lower}
    runs = [logged_with(laws, values, seed, "motor_torque") for seed in range(3)]
    found = choose_friction(MODEL, runs, WeightedLeastSquares())
    loaded = [term for term in found.best.terms if isinstance(term, LoadDependent)]
    assert max(upper, lower) > PLAUSIBLE or joints is None
    if joints == ():
        assert not loaded and "load_dependent" not in str(found.to_dict())
        return
    (law,) = loaded
    assert law.joints == joints
    named = "" if joints is None else f"joints {', '.join(joints)}, "
    assert f"load_dependent ({named}length 0.001)" in found.best.name
