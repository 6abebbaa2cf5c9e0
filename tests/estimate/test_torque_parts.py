"""Efforts by cause, against the quantities of the dynamics and the whole prediction."""

from collections.abc import Sequence

import numpy as np
import pytest

from estimate.test_score import GAIN, run_of, valued
from invented import single, tree
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS, TorqueSplit
from steelyard.estimate.scores.score import MOST_KEPT, score
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia, Spring
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term
from steelyard.runs.run import Block

TERMS = (RigidBody(), RotorInertia(), Coulomb(), Viscous(), Spring(), Offset())


def drawn(terms: Sequence[Term]) -> ValuedModel:
    model = Model(tree(), tuple(terms))
    values = np.random.default_rng(2).uniform(0.5, 2.0, len(model.names))
    return model.at(Parameters(model.names, model.units, values))


def block_of(model: Model, count: int = 200) -> tuple[Block, Motion]:
    t, rates = np.linspace(0.0, 2.0, count), np.arange(2.0, 2.0 + model.robot.n)
    angle = np.outer(t, rates)
    q, dq, ddq = np.sin(angle), rates * np.cos(angle), -(rates**2) * np.sin(angle)
    motion = Motion(t, q, dq, ddq)
    rows = [np.ascontiguousarray(x.T) for x in (q, dq, ddq)]
    channels = model.scan()(*rows)
    return Block(0, t, *rows, 0.0 * rows[0], rows[0] > -9.0, channels), motion


def test_parts_are_the_quantities_of_the_dynamics() -> None:
    model = drawn(TERMS)
    block, motion = block_of(model.model)
    parts = dict(zip(PARTS, TorqueSplit(model).block(block).swapaxes(1, 2), strict=True))
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    gravity = model.gravity(q)
    np.testing.assert_allclose(parts["gravity"], gravity, atol=1e-10)
    np.testing.assert_allclose(parts["coriolis"], model.bias(q, dq) - gravity, atol=1e-10)
    inertia = np.einsum("kij,kj->ki", model.mass_matrix(q), ddq)
    np.testing.assert_allclose(parts["inertia"], inertia, atol=1e-9)
    np.testing.assert_allclose(parts["friction"], model.friction(motion), atol=1e-10)
    named = model.values.as_dict()
    joints = model.model.robot.joint_names
    springs = np.column_stack(
        [named[f"spring.{j}"] * q[:, k] + named[f"offset.{j}"] for k, j in enumerate(joints)]
    )
    np.testing.assert_allclose(np.abs(parts["other"]), np.abs(springs), atol=1e-10)


@pytest.mark.parametrize(
    "terms",
    [
        TERMS,
        (RigidBody(), Dahl(length=0.01), Viscous()),
        (RigidBody(), LoadDependent(reference=()), Offset()),
        (Coulomb(), Viscous()),
    ],
    ids=["usual", "memory", "load", "no bodies"],
)
def test_parts_add_up_to_the_whole_effort(terms: Sequence[Term]) -> None:
    model = drawn(terms)
    block, motion = block_of(model.model)
    whole = TorqueSplit(model).block(block).sum(axis=0).T
    expected = model.torque(motion)
    assert np.abs(whole - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())


def test_a_score_keeps_parts_at_the_joints_behind_its_low_pass() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN + 0.1)
    gains = np.array([GAIN])
    found = score(valued(), run, gains, 5.0, split=TorqueSplit(valued()))
    parts, traces = found.parts, found.traces
    assert parts is not None and len(parts.t) == len(traces.t) <= MOST_KEPT
    np.testing.assert_array_equal(parts.t, traces.t)
    np.testing.assert_array_equal(parts.moving, traces.moving)
    np.testing.assert_allclose(parts.measured, GAIN * traces.measured, rtol=1e-12)
    np.testing.assert_allclose(parts.predicted, GAIN * traces.predicted, atol=1e-10)
    data = run.whole()
    at = np.searchsorted(data.motion.t, parts.t)
    np.testing.assert_array_equal(parts.q, data.motion.q[at])
    np.testing.assert_array_equal(parts.dq, data.motion.dq[at])
    np.testing.assert_allclose(
        parts.friction - parts.parts[PARTS.index("friction")], parts.residual, atol=1e-12
    )


def test_a_score_without_a_split_is_the_same_and_has_no_parts() -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN + 0.1)
    gains = np.array([GAIN])
    plain, split = (
        score(valued(), run, gains, 5.0, Model(single()).prior, split=how)
        for how in (None, TorqueSplit(valued()))
    )
    assert plain.parts is None and split.parts is not None
    assert plain.joints == split.joints
    np.testing.assert_array_equal(plain.traces.predicted, split.traces.predicted)


def test_parts_of_long_runs_are_evenly_spaced(monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_of(lambda motion: valued().torque(motion) / GAIN)
    gains = np.array([GAIN])
    full = score(valued(), run, gains, 5.0, split=TorqueSplit(valued())).parts
    monkeypatch.setattr("steelyard.estimate.scores.score.MOST_KEPT", 300)
    few = score(valued(), run, gains, 5.0, split=TorqueSplit(valued())).parts
    assert 150 <= len(few.t) <= 300
    step = -(-len(full.t) // len(few.t))
    np.testing.assert_array_equal(few.t, full.t[::step])
    np.testing.assert_array_equal(few.parts, full.parts[:, ::step])
