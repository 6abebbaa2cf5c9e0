"""Columns of geometric errors, against torques of robots whose geometry is really off."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invented import ROBOTS, dh_arm
from steelyard.base.arrays import Parameters
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.geometry_and_effort_errors import GeometryErrors
from steelyard.robot.inertia_and_placement import skew
from steelyard.robot.robot import Body, Robot

STEP = 1e-6


def torque(robot: Robot, motion: np.ndarray) -> np.ndarray:
    model = Model(robot, (RigidBody(),))
    return model.at(Parameters(model.names, model.units, robot.nominal.ravel())).block(*motion)


def moved(robot: Robot, index: int, **fields: Any) -> Robot:
    bodies = [
        Body(**{**vars(body), **(fields if k == index else {})})
        for k, body in enumerate(robot.bodies)
    ]
    return robot.changed(bodies=tuple(bodies))


def columns(robot: Robot, kind: Any, motion: np.ndarray) -> dict[str, np.ndarray]:
    """Per parameter the column, `(n_joints, N)`."""
    names = [p.name for p in RigidBody().parameters(robot)]
    reference = tuple(zip(names, robot.nominal.ravel().tolist(), strict=True))
    model = Model(robot, (GeometryErrors((kind,), reference),))
    channels = model.scan()(*motion)
    found = GeometryErrors((kind,)).columns(robot, JointState(*map(list, motion), list(channels)))
    return {
        name: np.array([found[row, k] for row in range(robot.n_joints)])
        for k, name in enumerate(model.names)
    }


def motion_of(robot: Robot) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(3, robot.n_joints, 40))


@pytest.mark.parametrize("name", ["single", "tree", "dh arm", "mimic"])
def test_zero_offsets_are_derivatives_by_position(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    motion = motion_of(robot)
    for joint, column in enumerate(columns(robot, "zero_offset", motion).values()):
        shift = np.zeros((3, robot.n_joints, 1))
        shift[0, joint] = STEP
        ahead, behind = torque(robot, motion + shift), torque(robot, motion - shift)
        np.testing.assert_allclose(column, (ahead - behind) / (2 * STEP), rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("kind", ["position", "axis"])
def test_displaced_frames_are_those_of_another_robot(kind: str, index: int) -> None:
    robot = dh_arm()
    motion, body = motion_of(robot), robot.bodies[index]
    found = columns(robot, kind, motion)
    mine = [c for name, c in found.items() if name.endswith(f".{body.joint}")]

    def changed(number: int, step: float) -> Robot:
        if kind == "position":
            along = body.position + step * body.rotation[:, number]
            return moved(robot, index, position=along)
        across = np.eye(3)[number] - body.axis * body.axis[number]
        return moved(robot, index, rotation=body.rotation @ (np.eye(3) + step * skew(across)))

    slopes: Callable[[int], np.ndarray] = lambda k: (  # noqa: E731
        (torque(changed(k, STEP), motion) - torque(changed(k, -STEP), motion)) / (2 * STEP)
    )
    if kind == "position":
        assert len(mine) == 3
        for number, column in enumerate(mine):
            np.testing.assert_allclose(column, slopes(number), rtol=1e-5, atol=1e-5)
        return
    # the two tilts span those about x, y and z, whose part along the axis is taken out
    basis = np.array(mine).reshape(2, -1).T
    for number in range(3):
        wanted = slopes(number).ravel()
        rest = wanted - basis @ np.linalg.lstsq(basis, wanted, rcond=None)[0]
        assert np.linalg.norm(rest) <= 1e-5 * max(float(np.linalg.norm(wanted)), 1.0)


def test_a_closed_chain_has_no_columns() -> None:
    robot = dh_arm()
    closed = robot.changed(
        coordinates=robot.coordinates[:2], passive=robot.coordinates[2:], assembly=np.zeros(3)
    )
    assert GeometryErrors(("zero_offset", "axis")).parameters(closed) == ()
