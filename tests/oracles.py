"""Pinocchio as an oracle for steelyard's robots, built from the bodies alone."""

import numpy as np
import pinocchio as pin

from steelyard.base.arrays import Array
from steelyard.robot.robot import Body, Robot


def pinocchio_model(robot: Robot) -> pin.Model:
    """One Pinocchio joint per body, in the bodies' order; gravity is the robot's.

    Joint `k + 1` carries body `k`; its velocity index is `k`, or `k + 5` behind a floating base.
    Mimic bodies are joints of their own here: `body_positions` and `body_map` lead from coordinates
    to them; of a floating robot `body_map` has the base's coordinates first, unchanged.
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
    n, hinges = robot.n_base, robot.bodies[1 if robot.floating else 0 :]
    matrix = np.zeros((n + len(hinges), robot.n))
    matrix[:n, :n] = np.eye(n)
    for k, body in enumerate(hinges, start=n):
        matrix[k, body.coordinate] = body.ratio
    return matrix


def floating_state(
    robot: Robot, turn: Array, q: Array, dq: Array, ddq: Array
) -> tuple[Array, Array, Array]:
    """What Pinocchio has for a state of a floating robot, its axes `(3, 3)` being `turn`.

    Its acceleration of the base is the spatial one, without gravity: from the proper one
    `a = classical - g`, `classical - omega x v`.
    """
    s, hinges = body_map(robot), robot.bodies[1:]
    offsets = [body.offset for body in hinges]
    at = np.concatenate([[1.0, 2.0, 3.0], pin.Quaternion(turn).coeffs(), (s @ q)[6:] + offsets])
    speed, acceleration = s @ dq, s @ ddq
    acceleration[:3] += turn.T @ robot.gravity - np.cross(dq[3:6], dq[:3])
    return at, speed, acceleration


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
    if body.kind == "floating":
        return pin.JointModelFreeFlyer()
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
