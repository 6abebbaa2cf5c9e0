"""A pass over one run: rests, lengths of windows, and runs grouped into folds."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from invented import single
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import MOST_WINDOWS, gather
from steelyard.estimate.information.information import Window
from steelyard.estimate.scores.cross_validation import behind
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

PLAIN = base_regressor(Model(single(), (RigidBody(), Coulomb())))
RATE = 100.0


@pytest.fixture(scope="module")
def run() -> Run:
    """Sixty seconds of one joint, the third ten of them at rest."""
    t = np.arange(0.0, 60.0, 1.0 / RATE)
    speed = np.clip(np.minimum(np.abs(t - 25.0) - 5.0, 1.0), 0.0, 1.0)
    phase = np.cumsum(speed) / RATE
    q = 0.8 * np.sin(1.7 * phase) + 0.2 * np.sin(4.1 * phase)
    effort = np.cos(1.7 * phase) + 0.1 * np.random.default_rng(0).normal(size=len(t))
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, None, None, ("e",), one, "joint_torque", ("Nm",), one)
    log = LogInMemory(Path("swing"), ("t", "q", "e"), np.column_stack([t, q, effort]))
    return prepare(Recording(log, signals), Processing(20.0, 8.0))


def test_rests_count_only_if_wanted(run: Run) -> None:
    moving = gather(PLAIN, behind(run, RATE))
    whole = gather(PLAIN, behind(run, RATE), rests=True)
    data = run.whole()
    assert moving.n_samples[0] == data.moving.sum() < 0.9 * len(data.t)
    assert whole.n_samples[0] == len(data.t)
    dense = PLAIN.dense(data.motion.q.T, data.motion.dq.T, data.motion.ddq.T)[0]
    for found, inside in ((moving, data.moving[:, 0]), (whole, np.ones(len(data.t), bool))):
        columns, effort = dense[inside], data.effort[inside, 0]
        matrix, vector, square = found.normal()
        np.testing.assert_allclose(matrix, columns.T @ columns, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(vector, columns.T @ effort, rtol=1e-9, atol=1e-9)
        assert square == pytest.approx(float(effort @ effort))
    for one, other in zip(whole.without_beside().normal(), moving.normal(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_what_is_not_remembered_yet_never_counts(run: Run) -> None:
    """A Dahl spring knows where it is once it has been turned over."""
    dahl = Model(single(), (RigidBody(), Dahl(length=0.05)))
    whole = gather(base_regressor(dahl), behind(run, RATE), rests=True)
    data, scan = run.whole(), dahl.scan()
    motion = data.motion
    scan(motion.q.T, motion.dq.T, motion.ddq.T, motion.t)
    missing = len(data.t) - whole.n_samples[0]
    warm = dahl.terms[1].warm_up(dahl.robot)[0]  # type: ignore[attr-defined]
    travelled = np.cumsum(np.abs(np.diff(motion.q[:, 0], prepend=motion.q[0, 0])))
    assert missing == pytest.approx(int(np.sum(travelled < warm)), abs=2) and missing > 0


@pytest.mark.parametrize("longest", [0.75, 2.0])
def test_windows_are_no_longer_than_wanted(run: Run, longest: float) -> None:
    free, short = gather(PLAIN, run), gather(PLAIN, run, longest=longest)
    lengths = [w.stop - w.start for w in short.windows]
    assert max(lengths) <= longest + 0.1 < max(w.stop - w.start for w in free.windows)
    assert len(free.windows) < len(short.windows) <= MOST_WINDOWS
    assert all(a.stop <= b.start + 1e-9 for a, b in pairwise(short.windows))
    np.testing.assert_allclose(short.grams.sum(axis=0), free.grams.sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(short.n_samples, free.n_samples)


def test_groups_are_sums_of_their_windows(run: Run) -> None:
    parts = gather(PLAIN, run, longest=2.0)
    groups = [[0, 3, 4], [1], [6, 5]]
    found = parts.grouped(groups)
    for k, group in enumerate(groups):
        wanted = sum(parts.grams[g] for g in group)
        np.testing.assert_allclose(found.grams[k], wanted, rtol=1e-14)
        np.testing.assert_allclose(found.absolute[k], sum(parts.absolute[g] for g in group))
        np.testing.assert_allclose(found.counts[k], sum(parts.counts[g] for g in group))
        first, last = parts.windows[group[0]], parts.windows[group[-1]]
        assert found.windows[k] == Window("swing", first.start, last.stop)
    assert (found.layout, found.signature) == (parts.layout, parts.signature)
    assert found.n_samples[0] < parts.n_samples[0]
    none = parts.grouped([])
    assert none.windows == () and none.grams.shape == (0, parts.grams.shape[1])
