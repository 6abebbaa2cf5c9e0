import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.robot.inertia_and_placement import (
    Placement,
    clean_axis,
    clean_rotation,
    rpy_rotation,
    turn,
)

angles = st.floats(-4.0, 4.0)


@given(angles, angles, angles)
def test_rpy_is_pinocchios(roll: float, pitch: float, yaw: float) -> None:
    assert np.allclose(rpy_rotation(roll, pitch, yaw), pin.rpy.rpyToMatrix(roll, pitch, yaw))


@given(angles)
def test_turn_is_the_exponential(angle: float) -> None:
    axis = np.array([1.0, -2.0, 2.0]) / 3.0
    assert np.allclose(turn(axis, angle), pin.exp3(axis * angle))


@pytest.mark.parametrize("quarter", [1.5708, 1.570796325, 1.57079632679, np.pi / 2])
def test_rounded_quarter_turns_become_exact(quarter: float) -> None:
    matrix = clean_rotation(rpy_rotation(quarter, -quarter, 2 * quarter))
    assert set(np.unique(matrix)) <= {-1.0, 0.0, 1.0}
    assert np.isclose(np.linalg.det(matrix), 1.0)


@given(angles, angles, angles)
def test_cleaning_keeps_a_rotation_and_hardly_moves_it(r: float, p: float, y: float) -> None:
    matrix = rpy_rotation(r, p, y)
    clean = clean_rotation(matrix)
    assert np.allclose(clean.T @ clean, np.eye(3), atol=1e-14)
    assert np.allclose(clean, matrix, atol=5e-5)


def test_placements_compose_as_pinocchios_do() -> None:
    one = Placement(rpy_rotation(0.1, 0.2, 0.3), [1.0, 2.0, 3.0])
    two = Placement(rpy_rotation(-0.4, 0.5, 1.1), [-1.0, 0.5, 0.0])
    oracle = pin.SE3(one.rotation, one.position) * pin.SE3(two.rotation, two.position)
    both = one @ two
    assert np.allclose(both.rotation, oracle.rotation)
    assert np.allclose(both.position, oracle.translation)


def test_axes_are_normalised_and_cleaned() -> None:
    assert np.array_equal(clean_axis([0.0, 1e-6, -3.0]), [0.0, 0.0, -1.0])
    for bad in ([0.0, 0.0, 0.0], [np.inf, 0.0, 0.0], [np.nan, 0.0, 1.0]):
        with pytest.raises(ValueError, match="no direction"):
            clean_axis(bad)
