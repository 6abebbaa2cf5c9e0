"""Base parameters behind axes that are tilted a little: their number, and how well they differ."""

import numpy as np
import pytest

from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    clear_map,
    full_regressor,
    independent_columns,
    rank,
)
from steelyard.excite.design_problem_from_tables import memoryless
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.robot.robot import Body, Coordinate, Robot
from tilted import ARMS, drawn, rank_by_gap, singular_values, tilted

TERMS = (RigidBody(), RotorInertia())


def condition(matrix: np.ndarray, columns: list[int]) -> float:
    """Of columns of unit length."""
    chosen = matrix[:, columns]
    return float(np.linalg.cond(chosen / np.linalg.norm(chosen, axis=0)))


@pytest.mark.parametrize("seed", range(24))
def test_as_many_columns_as_the_singular_values_say(seed: int) -> None:
    model = Model(drawn(seed), TERMS)
    regressor = full_regressor(model, seed)
    columns = independent_columns(regressor)
    # the rank is that of other states
    assert len(columns) == rank_by_gap(full_regressor(model, seed + 1000))
    # no choice of columns is better conditioned by orders of magnitude
    whole = singular_values(regressor)[len(columns) - 1]
    assert singular_values(regressor[:, columns])[-1] > 0.03 * whole


@pytest.mark.parametrize("tilt", [0.0, 3e-5, 1.4e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_parallel_axes_askew_to_their_frames(n: int, tilt: float) -> None:
    """Axes along `0 tilt -1`: small parts of a column never lead a group."""
    axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    axes += [[0.0, tilt, -1.0]] * n
    bodies = tuple(
        Body(f"l{k}", f"j{k}", "revolute", k - 1, np.eye(3), [0.03, 0.02, 0.01],
             np.array(axis) / np.linalg.norm(axis), k)
        for k, axis in enumerate(axes)
    )  # fmt: skip
    joints = tuple(Coordinate(f"j{k}", "revolute") for k in range(len(axes)))
    regressor = full_regressor(Model(Robot("chain", bodies, joints), TERMS))
    columns = independent_columns(regressor)
    assert len(columns) == 16 + 8 * n
    assert condition(regressor, columns) < 10.0


def test_clean_arms_keep_the_customary_grouping() -> None:
    for name, rows in ARMS.items():
        model = Model(tilted(name, np.zeros((len(rows), 3))), TERMS)
        regressor = full_regressor(model)
        taken: list[int] = []
        for column in range(regressor.shape[1]):
            if np.linalg.matrix_rank(regressor[:, [*taken, column]], tol=1e-9) > len(taken):
                taken.append(column)
        assert list(base_parameters(model).independent) == taken, name


def test_torque_is_the_same_behind_tilted_axes() -> None:
    model = Model(drawn(4), TERMS)
    regressor, base = full_regressor(model, 1), base_parameters(model)
    values = np.random.default_rng(0).normal(size=regressor.shape[1])
    torque = regressor @ values
    grouped = regressor[:, list(base.independent)] @ base.base_values(values)
    assert np.abs(grouped - torque).max() < 1e-9 * np.abs(torque).max()


def test_motions_are_designed_for_what_they_can_show() -> None:
    tilts = np.zeros((6, 3))
    upright = Model(tilted("elbow", tilts), TERMS)
    assert clear_map(upright).base_names == base_parameters(upright).base_names
    tilts[0] = tilts[2] = [1e-4, 0.0, 0.0]
    model = Model(tilted("elbow", tilts), TERMS)
    found, clear = base_parameters(model), clear_map(model)
    faint = set(found.base_names) - set(clear.base_names)
    assert len(clear) == len(base_parameters(upright)) and len(faint) == len(found) - len(clear) > 0
    bare, notes = memoryless(model)
    assert bare.terms == model.terms
    assert notes == (
        "left out of the criterion, as at most "
        "0.1 % of their columns is independent of the others: "
        + ", ".join(name for name in found.base_names if name in faint),
    )
    assert memoryless(upright)[1] == ()
    # torque is the same but for what the tilt of 1e-4 rad adds
    regressor = full_regressor(model, 1)
    values = np.random.default_rng(0).normal(size=regressor.shape[1])
    rest = regressor @ values - regressor[:, list(clear.independent)] @ clear.base_values(values)
    assert 0.0 < np.abs(rest).max() < 1e-3 * np.abs(regressor @ values).max()


def test_no_columns_and_zero_columns() -> None:
    assert independent_columns(np.zeros((4, 2))) == []
    assert independent_columns(np.array([[0.0, 1.0], [0.0, 2.0]])) == [1]
    # a gap, and what is behind it is rounding errors
    assert rank(np.array([3.0, 1.0, 0.5, 1e-5, 1e-13, 0.0])) == 4
    assert rank(np.array([3.0, 1.0, 0.5, 1e-9, 1e-16])) == 3
    assert rank(np.array([3.0, 0.5])) == 2
    assert rank(np.array([3.0])) == 1
