"""Drift of frames against Pinocchio on trees, against differences on closed chains."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from closed_chains import CHAINS, independent_path
from invented import ROBOTS, turned
from oracles import body_map, body_positions, pinocchio_model
from steelyard.model.equations.frame_and_point_kinematics import frame_kinematics
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.robot.robot import Frame

PLACE = np.array([0.2, -0.1, 0.3])


@pytest.mark.parametrize("name", ROBOTS)
def test_the_drift_is_pinocchios(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    frame = Frame("tool", len(robot.bodies) - 1, turned(3), PLACE)
    motion, model = frame_kinematics(robot, frame), pinocchio_model(robot)
    placement = pin.SE3(np.array(frame.rotation), PLACE)
    number = model.addFrame(pin.Frame("f", frame.body + 1, placement, pin.FrameType.OP_FRAME))
    data, rng = model.createData(), np.random.default_rng(1)
    for _ in range(3):
        q, dq = rng.uniform(-2.0, 2.0, (2, robot.n))
        velocities = body_map(robot) @ dq
        pin.forwardKinematics(model, data, body_positions(robot, q), velocities, 0.0 * velocities)
        pin.updateFramePlacements(model, data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        oracle = pin.getFrameClassicalAcceleration(model, data, number, aligned)
        place, axes, jacobian, drift = motion.moving(q, np.empty(0), dq)
        np.testing.assert_allclose(drift, oracle.vector, atol=1e-10)
        expected = motion(q[None])
        for value, other in zip((place, axes, jacobian), expected, strict=True):
            np.testing.assert_allclose(value, other[0], atol=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_the_drift_behind_loops_is_how_velocities_grow(name: str) -> None:
    robot = CHAINS[name]()
    frame = Frame("tool", len(robot.bodies) - 1, turned(3), PLACE)
    motion, step = frame_kinematics(robot, frame), 1e-5
    way = independent_path(robot, 40, 0.2)[:, ::10]
    dq = np.random.default_rng(2).uniform(-1.0, 1.0, robot.n)
    for q in way.T:
        around = np.stack([q + s * step * dq for s in (-1.0, 0.0, 1.0)], axis=1)
        passive = passive_positions(robot, around)
        before, _, after = (
            motion.moving(own, more, dq)[2] @ dq
            for own, more in zip(around.T, passive.T, strict=True)
        )
        drift = motion.moving(q, passive[:, 1], dq)[3]
        np.testing.assert_allclose(drift, (after - before) / (2.0 * step), atol=1e-7, rtol=1e-6)
