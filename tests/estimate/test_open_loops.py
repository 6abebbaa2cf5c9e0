from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from closed_chains import five_bar
from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.scores.score import score
from steelyard.identify.runs_and_notes_of_logs import dropped, first_dropped
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import LoopClosure, Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run, open_stretches

RATE = 100.0


def robot(open_loops: str = "drop") -> Robot:
    """A five-bar with short forearms: the elbows can go too far apart."""
    tip = LoopClosure("tip", (1, 3), [[0.3, 0.0, 0.0], [0.32, 0.0, 0.0]])
    return five_bar().changed(loops=(tip,), assembly=(2.0, 1.1, -1.0, 1.0), open_loops=open_loops)


def motion() -> Motion:
    """Wide swings, with two excursions beyond the reach of the forearms."""
    t = np.arange(0.0, 24.0, 1.0 / RATE)
    out = 0.5 * (np.exp(-(((t - 8.0) / 0.5) ** 2)) + np.exp(-(((t - 17.0) / 0.5) ** 2)))
    left = 2.0 + 0.2 * np.sin(1.7 * t) + 0.15 * np.sin(4.1 * t) + out
    right = 1.1 + 0.2 * np.sin(2.3 * t + 1.0) + 0.1 * np.sin(5.2 * t) - out
    q = np.stack([left, right], axis=1)
    dq = np.gradient(q, 1.0 / RATE, axis=0)
    return Motion(t, q, dq, np.gradient(dq, 1.0 / RATE, axis=0))


def apart(q: Array) -> Array:
    """How far the forearms are from reaching each other [m]."""
    left, right = q.T
    return np.abs(0.3 * np.exp(1j * left) - (0.25 + 0.05j) - 0.28 * np.exp(1j * right)) - 0.62


def run_of(nonsense: float = 0.0) -> Run:
    """A log with smooth efforts, and `nonsense` where the loop is open."""
    way = motion()
    effort = np.stack([np.sin(way.t), np.cos(1.3 * way.t)], axis=1)
    for first, last in openings():
        effort[first : last + 1] += nonsense
    names = ("t", "q0", "q1", "e0", "e1")
    ones = np.ones(2)
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=names[1:3],
        position_scale=ones,
        velocity=None,
        velocity_scale=None,
        effort=names[3:],
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=("Nm", "Nm"),
        gains=ones,
    )
    table = np.column_stack([way.t, way.q, effort])
    wanted = Processing(motion_cutoff=20.0, matched_cutoff=10.0)
    return prepare(Recording(LogInMemory(Path("log"), names, table), signals), wanted)


def openings() -> list[tuple[int, int]]:
    """First and last sample of every stretch beyond reach."""
    inside = np.concatenate([[0], apart(motion().q) > 0.0, [0]]).astype(int)
    steps = np.diff(inside)
    return list(zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0) - 1, strict=True))


def test_open_stretches_are_reported_with_time_and_gap() -> None:
    stretches = open_stretches(run_of(), robot())
    wanted = openings()
    assert len(stretches) == len(wanted) > 1
    for stretch, (first, last) in zip(stretches, wanted, strict=True):
        assert stretch.loop == "tip" and abs(stretch.samples - (last - first + 1)) <= 2
        assert abs(stretch.start - first / RATE) < 0.02 and abs(stretch.stop - last / RATE) < 0.02
        assert 0.0 < stretch.gap < 0.02
        assert f"from {stretch.start:.4f} s" in str(stretch) and "closure error" in str(stretch)
    assert open_stretches(run_of(), Model(robot()).bodies_only.robot) == ()


def test_the_first_stretch_is_printed_with_the_number_of_others() -> None:
    run, model = run_of(), Model(robot())
    stretches = dropped(model, [run])
    assert len(stretches) == len(openings())
    more = f"; {len(stretches) - 1} more with -v"
    assert first_dropped(stretches) == (stretches[0] + more,)
    assert first_dropped(stretches[:1]) == stretches[:1] and first_dropped(()) == ()


@pytest.mark.slow
def test_dropped_samples_leave_no_trace() -> None:
    regressor = base_regressor(Model(robot(), (RigidBody(),)))
    first, second = (gather(regressor, run_of(x)) for x in (0.0, 1000.0))
    assert np.array_equal(first.counts, second.counts)
    scale = np.abs(first.grams).max(axis=0)
    assert np.all(np.abs(first.grams - second.grams) <= 1e-9 * scale)
    reaching = Model(robot().changed(loops=five_bar().loops, assembly=five_bar().assembly))
    whole = gather(base_regressor(Model(reaching.robot, (RigidBody(),))), run_of())
    assert 0.5 < first.counts.sum() / whole.counts.sum() < 0.98


@pytest.mark.slow
def test_open_loops_stop_by_default() -> None:
    model = Model(robot("stop"), (RigidBody(),))
    run = run_of()
    first = open_stretches(run, model.robot)[0]
    with pytest.raises(DataError) as caught:
        gather(base_regressor(model), run)
    assert f"does not close at t = {first.start:.4f} s" in caught.value.wrong
    assert f"closure error {first.gap:.3g} m" in caught.value.wrong


@pytest.mark.slow
def test_scores_keep_what_is_closed() -> None:
    run = run_of(1000.0)
    model = Model(robot(), (RigidBody(),))
    zero = model.at(Parameters((), (), []))
    found = score(zero, run, np.ones(2), 20.0)
    missing = sum(s.samples for s in open_stretches(run, robot()))
    assert len(found.traces.t) == run.n_samples - missing
    assert found.joints[0].predict_zero < 100.0
    assert np.sum(np.abs(found.traces.measured).max(axis=1) > 100.0) <= 20 * len(openings())
    signals = replace(run.recording.signals, position_offset=np.array([1.2, -1.2]))
    away = replace(run, recording=replace(run.recording, signals=signals))
    with pytest.raises(DataError, match="close at no sample"):
        score(zero, away, np.ones(2), 20.0)


def test_what_is_remembered_ends_at_an_open_loop() -> None:
    dahl = Dahl(joints=("left_joint", "left_fore_joint"), length=0.01)
    model = Model(robot(), (RigidBody(), dahl))
    t = np.linspace(0.0, 1.0, 400)
    q = np.stack([2.0 - 0.2 * t, 1.1 + 0.1 * t])
    q[:, 200:210] = [[3.1], [0.0]]
    dq, ddq = np.gradient(q, t, axis=1), np.zeros_like(q)
    whole, fresh, parts = (model.scan(drop=True) for _ in range(3))
    channels = whole(q, dq, ddq)
    assert not whole.closed[200:210].any() and whole.closed.sum() == 390
    wanted = fresh(q[:, 210:], dq[:, 210:], ddq[:, 210:])
    assert np.allclose(channels[2:, 210:], wanted[2:], rtol=0.0, atol=1e-9)
    assert np.array_equal(whole.warm[:, 210:], fresh.warm)
    assert not whole.warm[0, 0] and not whole.warm[0, 210] and whole.warm[:, -1].all()
    edges = (0, 205, 300, 400)
    split = [
        parts(q[:, a:b], dq[:, a:b], ddq[:, a:b])
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    assert np.allclose(np.concatenate(split, axis=1), channels, rtol=0.0, atol=1e-9)
