"""Positions, axes and Jacobians of frames against Pinocchio."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from closed_chains import five_bar
from invented import ROBOTS, tree, turned
from oracles import body_map, body_positions, pinocchio_model
from steelyard.base.errors import DataError, ModelError
from steelyard.model.equations.frame_and_point_kinematics import (
    frame_kinematics,
    frame_of,
    points_on,
)
from steelyard.robot.robot import Frame, Robot, frame_origins

PLACE = np.array([0.2, -0.1, 0.3])


def oracle(robot: Robot, frame: Frame, q: np.ndarray) -> tuple[pin.SE3, np.ndarray]:
    """Pose, and Jacobian in the base frame's axes, shape `(6, n)`."""
    model = pinocchio_model(robot)
    placement = pin.SE3(np.array(frame.rotation), np.array(frame.position))
    parent = frame.body + 1
    number = model.addFrame(pin.Frame("f", parent, placement, pin.FrameType.OP_FRAME))
    data, at = model.createData(), body_positions(robot, q)
    pin.computeJointJacobians(model, data, at)
    pin.updateFramePlacements(model, data)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    jacobian = pin.getFrameJacobian(model, data, number, aligned)
    return data.oMf[number], jacobian.reshape(6, -1) @ body_map(robot)


@pytest.mark.parametrize("name", ROBOTS)
def test_frames_are_where_pinocchio_has_them(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    rng = np.random.default_rng(1)
    last = len(robot.bodies) - 1
    for frame in (
        frame_of(robot, robot.bodies[last].name),
        Frame("tool", last, turned(3), PLACE),
        Frame("early", 0, turned(4), PLACE),
    ):
        kinematics = frame_kinematics(robot, frame)
        q = rng.uniform(-2.0, 2.0, (9, robot.n))
        positions, rotations, jacobians = kinematics(q)
        assert positions.shape == (9, 3) and jacobians.shape == (9, 6, robot.n)
        for k, row in enumerate(q):
            pose, jacobian = oracle(robot, frame, row)
            np.testing.assert_allclose(positions[k], pose.translation, atol=1e-12)
            np.testing.assert_allclose(rotations[k], pose.rotation, atol=1e-12)
            np.testing.assert_allclose(jacobians[k], jacobian, atol=1e-12)


def test_points_and_their_slopes() -> None:
    robot = tree()
    points = points_on(robot, (3, 2, -1), [PLACE, 2.0 * PLACE, PLACE])
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, robot.n))
    positions, slopes = points(q)
    assert slopes.shape == (5, 3, 3, robot.n)
    for k, row in enumerate(q):
        for number, (body, place) in enumerate([(3, PLACE), (2, 2.0 * PLACE)]):
            pose, jacobian = oracle(robot, Frame("p", body, np.eye(3), place), row)
            np.testing.assert_allclose(positions[k, number], pose.translation, atol=1e-12)
            np.testing.assert_allclose(slopes[k, number], jacobian[:3], atol=1e-12)
    ends = zip(points.carriers, points.places, strict=True)
    frames = [Frame("p", body, np.eye(3), place) for body, place in ends]
    np.testing.assert_allclose(frame_origins(robot, frames, q), positions, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(points(q)[0][:, 2], np.tile(PLACE, (5, 1)))
    np.testing.assert_array_equal(points(q)[1][:, 2], 0.0)


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(ModelError, match="no frame 'tipp'") as caught:
        frame_of(tree(), "tipp")
    assert "'tip'" in caught.value.fix


def test_points_behind_passive_joints_are_refused() -> None:
    robot = five_bar()
    assert points_on(robot, [0], [PLACE])(np.zeros((1, 2)))[0].shape == (1, 1, 3)
    with pytest.raises(ModelError, match="'left_fore_joint', which a closed loop determines"):
        points_on(robot, [1], [PLACE])


def test_frames_behind_passive_joints_follow_the_driven_ones() -> None:
    robot = five_bar()
    q = np.array([[2.4, 0.6], [2.3, 0.7]])
    ends = []
    for body, point in zip(robot.loops[0].bodies, robot.loops[0].points, strict=True):
        kinematics = frame_kinematics(robot, Frame("pin", body, np.eye(3), point))
        position, _, jacobian = kinematics(q)
        ends.append((position, jacobian[:, :3]))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-9)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-9)
    with pytest.raises(DataError, match="loop 'tip' does not close"):
        frame_kinematics(robot, "left_fore")(np.array([[1.2437, 2.1515]]))
