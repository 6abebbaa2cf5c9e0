"""Rows of a sample without the forces of contacts that are not measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from floating_logs import FLAG, HAND, IMU, TOE, dog, record
from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.nonlinear.nonlinear_parameters import information
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import BaseSignals
from steelyard.runs.contact_projection import Touching, margin_samples, with_margins
from steelyard.runs.runs_of_named_logs import load_runs

N = 10  # coordinates of the dog
ORIENTED = 'orientation = "marker_q{}"\norientation_kind = "xyzw"\n'


def base_of(folder: Path, contacts: str, more: str = "") -> BaseSignals:
    signals = load_robot(dog(folder, IMU + more + contacts)).signals
    assert signals is not None and signals.base is not None
    return replace(signals.base, spread=tuple(np.linspace(0.3, 2.0, N).tolist()))


def touching(base: BaseSignals, flags: list[float], up: Array | None = None) -> Touching:
    given = np.array(flags)[None] > 0.0
    return Touching(base, np.ones(N), given, np.zeros((0, len(flags))) if up is None else up)


@pytest.fixture
def positions() -> Array:
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (N, 4))
    q[:6] = 0.0
    return q


def toe_jacobian(folder: Path, q: Array, arm: Array | None = None) -> Array:
    """Of the point that touches, `(N, 3, n)`; `arm` is from the foot's origin to it."""
    model = Model(load_robot(dog(folder, IMU)).robot, (RigidBody(),)).prior
    assert model is not None
    foot = model.jacobian(q.T, "fore_foot")
    at = model.pose(q.T, "fore_foot")[1] @ np.array(TOE) if arm is None else arm
    return np.asarray(foot[:, :3] + np.cross(foot[:, 3:], at[:, :, None], axis=1))


def test_forces_of_a_point_are_gone_and_the_best_rows_are_left(
    positions: Array, tmp_path: Path
) -> None:
    base = base_of(tmp_path, FLAG)
    found = touching(base, [1, 0, 1, 1]).projection(positions)
    jacobian, spread = toe_jacobian(tmp_path, positions), np.array(base.spread)
    for k, (matrix, j) in enumerate(zip(found, jacobian, strict=True)):
        if k == 1:  # nothing touches
            np.testing.assert_allclose(matrix, np.eye(N), atol=1e-12)
            continue
        np.testing.assert_allclose(matrix @ j.T, 0.0, atol=1e-12)
        np.testing.assert_allclose(matrix @ matrix, matrix, atol=1e-12)
        assert np.trace(matrix) == pytest.approx(N - 3)
        weighted = matrix.T @ np.diag(spread**-2) @ matrix
        # what is left of weighted least squares when the forces are eliminated
        w = np.diag(spread**-2)
        left = w - w @ j.T @ np.linalg.inv(j @ w @ j.T) @ j @ w
        np.testing.assert_allclose(weighted, left, atol=1e-10)


def test_levers_are_what_a_force_at_another_point_adds(positions: Array, tmp_path: Path) -> None:
    hind = FLAG.replace("fore_", "hind_")
    base = base_of(tmp_path, FLAG + hind)
    flags = np.array([[1, 0, 1, 1], [1, 1, 1, 0]]) > 0
    one = Touching(base, np.ones(N), flags, np.zeros((0, 4)))
    counted = np.ones((N, 4), dtype=np.bool_)
    counted[7, 2] = False
    forces = np.random.default_rng(1).normal(size=(4, 6)) * np.repeat(flags.T, 3, axis=1)
    efforts = np.einsum("bki,bk->ib", one.jacobian(positions), forces)
    found = one.levers(positions, efforts, counted)
    assert found.shape == (N, 4, 6)
    matrix = one.projection(positions, counted)
    for k in range(6):
        place = np.array(base.touches[k // 3].place) + np.eye(3)[k % 3]
        touches = [replace(t, place=tuple(place)) if n == k // 3 else t
                   for n, t in enumerate(base.touches)]  # fmt: skip
        moved = replace(one, base=replace(base, touches=tuple(touches)))
        added = np.einsum("bki,bk->bi", moved.jacobian(positions), forces) - efforts.T
        expected = np.einsum("bij,bj->ib", matrix, added)
        np.testing.assert_allclose(found[..., k], expected, atol=1e-9)
    assert np.abs(found).max(axis=(0, 1)).min() > 1e-3


def test_a_sole_takes_moments_and_a_ball_touches_below(positions: Array, tmp_path: Path) -> None:
    sole = base_of(tmp_path, FLAG + "sole = true\n")
    assert np.trace(touching(sole, [1] * 4).projection(positions)[0]) == pytest.approx(N - 6)
    ball = base_of(tmp_path, FLAG + "radius = 0.05\n", ORIENTED)
    up = np.tile([[0.6], [0.0], [0.8]], 4)
    found = touching(ball, [1] * 4, up).projection(positions)
    axes = Model(load_robot(dog(tmp_path, IMU)).robot, (RigidBody(),)).prior
    assert axes is not None
    arm = axes.pose(positions.T, "fore_foot")[1] @ np.array(TOE) - 0.05 * up.T
    below = toe_jacobian(tmp_path, positions, arm)
    np.testing.assert_allclose(found @ below.transpose(0, 2, 1), 0.0, atol=1e-12)


def test_rows_that_do_not_count_are_in_no_other(positions: Array, tmp_path: Path) -> None:
    counted = np.ones((N, 4), dtype=np.bool_)
    counted[7] = False
    found = touching(base_of(tmp_path, FLAG), [1] * 4).projection(positions, counted)
    assert not found[:, 7].any() and not found[:, :, 7].any()
    jacobian = toe_jacobian(tmp_path, positions)
    np.testing.assert_allclose(found @ jacobian.transpose(0, 2, 1), 0.0, atol=1e-12)


def test_contacts_may_begin_earlier_and_end_later(tmp_path: Path) -> None:
    base = base_of(tmp_path, FLAG + "margin = 0.02\n")
    halo = margin_samples(base, 100.0)
    assert halo == 2
    flags = np.zeros((1, 20))
    flags[0, 8:11] = 1.0
    found = with_margins(base, flags, 100.0)[0]
    assert np.flatnonzero(found).tolist() == [4, 5, 6, 7, 8, 9, 10]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("dog"), push=30.0)[0]


def test_true_values_explain_the_rows(log: Path, tmp_path: Path) -> None:
    file = dog(tmp_path, IMU + HAND + FLAG)
    loaded, runs = load_robot(file), load_runs(file, log)
    model = Model(loaded.robot, (RigidBody(),))
    assert model.prior is not None
    regressor = base_regressor(model)
    values = regressor.base.base_values(model.prior.values.values)
    whole = information(model, runs)
    assert whole.layout.mixed
    sizes = np.sqrt(whole.residual_squares(values) / whole.n_samples)
    plain = information(model, load_runs(dog(tmp_path, IMU + HAND), log))
    wrong = np.sqrt(plain.residual_squares(values) / plain.n_samples)
    assert sizes.max() < 0.05 and wrong.max() > 5.0
    # 3 of 10 rows are gone where it touches, somewhat more than half of the time
    share = whole.n_samples.sum() / plain.n_samples.sum()
    assert 0.82 < share < 0.86
    kept = gather_samples(regressor, runs[0]).information()
    np.testing.assert_allclose(kept.n_samples, whole.n_samples, rtol=0.02)
    mine, its = kept.normal()[0], whole.normal()[0]
    np.testing.assert_allclose(mine, its, atol=0.02 * np.abs(its).max())


def test_predicted_efforts_have_the_forces_that_fit_best(log: Path, tmp_path: Path) -> None:
    (run,) = load_runs(dog(tmp_path, IMU + HAND + FLAG), log)
    model = Model(load_robot(dog(tmp_path, IMU)).robot, (RigidBody(),)).prior
    assert model is not None
    with_forces, without, inside = [], [], slice(300, -300)
    for block in run.blocks():
        predicted = model.block(block.q, block.dq, block.ddq, None)
        with_forces.append(block.effort - run.with_forces(block, predicted))
        without.append(block.effort - predicted)
    sizes = [np.sqrt(np.mean(np.hstack(x)[:, inside] ** 2)) for x in (with_forces, without)]
    assert sizes[0] < 0.02 and sizes[1] > 1.0


def test_flags_without_a_number_leave_rows_out(log: Path, tmp_path: Path) -> None:
    table = pl.read_parquet(log)
    load = table["fore_load"].to_numpy().copy()
    load[2000:2050] = np.nan
    path = tmp_path / "holes.parquet"
    table.with_columns(fore_load=load).write_parquet(path)
    (run,) = load_runs(dog(tmp_path, IMU + HAND + FLAG), path)
    assert sum(run.quality.dropped.values()) >= 50
