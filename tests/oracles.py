"""Pinocchio as an oracle for steelyard's robots, built from the bodies alone."""

import numpy as np
import pinocchio as pin

from steelyard.base.arrays import Array
from steelyard.robot.robot import Body, Robot


def pinocchio_model(robot: Robot) -> pin.Model:
    """One Pinocchio joint per body, in the bodies' order; gravity is the robot's.

    Joint `k + 1` carries body `k`; its velocity index is `k`. Mimic bodies are joints of their
    own here: `body_positions` and `body_map` lead from coordinates to them.
    """
    model = pin.Model()
    model.name = robot.name
    model.gravity.linear = np.array(robot.gravity)
    for body in robot.bodies:
        placement = pin.SE3(np.array(body.rotation), np.array(body.position))
        index = model.addJoint(body.parent + 1, _joint_model(body), placement, body.joint)
        model.appendBodyToJoint(index, _inertia(body), pin.SE3.Identity())
    return model


def body_map(robot: Robot) -> Array:
    """Joint position of each body per coordinate, shape `(n_bodies, n)`."""
    matrix = np.zeros((len(robot.bodies), robot.n))
    for k, body in enumerate(robot.bodies):
        matrix[k, body.coordinate] = body.ratio
    return matrix


def body_positions(robot: Robot, q: Array) -> Array:
    """Joint positions of all bodies at coordinates `q`, shape `(n_bodies,)`."""
    return body_map(robot) @ q + np.array([body.offset for body in robot.bodies])


def pinocchio_torque(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Inverse dynamics at one sample, mimic joints included, shape `(n,)`."""
    model, s = pinocchio_model(robot), body_map(robot)
    return s.T @ pin.rnea(model, model.createData(), body_positions(robot, q), s @ dq, s @ ddq)


def pinocchio_regressor(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Rigid-body regressor at one sample, shape `(n, 10 * n_bodies)`."""
    model, s = pinocchio_model(robot), body_map(robot)
    at = body_positions(robot, q)
    regressor = pin.computeJointTorqueRegressor(model, model.createData(), at, s @ dq, s @ ddq)
    return s.T @ regressor.reshape(len(robot.bodies), -1)


def _joint_model(body: Body) -> pin.JointModel:
    axis = np.array(body.axis)
    if body.kind == "prismatic":
        return pin.JointModelPrismaticUnaligned(axis)
    return pin.JointModelRevoluteUnaligned(axis)


def _inertia(body: Body) -> pin.Inertia:
    """Set number by number: Pinocchio's constructor refuses bodies that cannot exist."""
    inertia = pin.Inertia.Zero()
    inertia.mass = body.inertia.mass
    inertia.lever = np.array(body.inertia.com)
    inertia.inertia = np.array(body.inertia.inertia_com)
    return inertia
