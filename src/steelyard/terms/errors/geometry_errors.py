"""What torques change with small errors of a robot's geometry, as columns beside a model's own.

The torque is not linear in the geometry. Around a reference model it is to first order, and the
columns of this term are those derivatives: what a fit gives them is how far the geometry is off.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState
from steelyard.kernel.quantities.joint_placement import MOVES, torque_slope
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.term import Columns, Dissipation, Samples, StatefulTerm

Which = Literal["zero_offset", "compliance", "position", "axis"]


@dataclass(frozen=True)
class Displaced(StatefulTerm):
    r"""Errors of the geometry, $\partial \tau / \partial x$ at a reference model.

    Per joint its `zero_offset` [rad; m], per body the `position` of its joint in the parent
    [m; three numbers in the joint's frame] and the tilt of its `axis` [rad; two numbers], and per
    joint its `compliance` [rad/Nm; m/N]: the offset per torque, against which it turns.
    Trees only: closed chains have no columns.

    Attributes:
        which: Kinds of errors.
        reference: Ten numbers per body by name; absent ones are zero.
    """

    law: ClassVar[str] = "displaced"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("reference",)
    which: tuple[Which, ...] = ("zero_offset",)
    reference: tuple[tuple[str, float], ...] = ()

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names like `zero_offset.elbow`, `position_x.elbow`, `axis_1.elbow`."""
        return tuple(Parameter(name, unit) for name, unit, _ in self._moves(robot))

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channels, parameter by parameter, all joints of each."""
        n, count = robot.n_joints, len(list(self._moves(robot)))
        return {(row, k): state.channels[k * n + row] for k in range(count) for row in range(n)}

    def n_channels(self, robot: Robot) -> int:
        """One per joint and parameter."""
        return robot.n_joints * len(list(self._moves(robot)))

    def warm_up(self, robot: Robot) -> Array:
        """Nothing is remembered."""
        return np.zeros(robot.n_joints)

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """Derivatives of the reference model's torque along the motion."""
        names, values = [p.name for p in RigidBody().parameters(robot)], dict(self.reference)
        tens = np.array([values.get(name, 0.0) for name in names])
        motion = samples.q, samples.dq, samples.ddq
        found = []
        for name, _, move in self._moves(robot):
            slope = torque_slope(robot, motion, tens, move)
            kind, _, joint = name.partition(".")
            if kind == "compliance":
                slope = -samples.rigid_torque(tens)[_number(robot, joint)] * slope
            found.append(slope)
        return np.concatenate(found), None

    def _moves(self, robot: Robot) -> Iterator[tuple[str, str, Array]]:
        """Name, unit and direction `(MOVES n_bodies,)` of every parameter."""
        if robot.passive:
            return
        for kind, unit in (("zero_offset", "{0}"), ("compliance", "{0}/{1}")):
            for joint in robot.joints if kind in self.which else ():
                units = unit.format(joint.unit, joint.effort_unit)
                yield f"{kind}.{joint.name}", units, _own(robot, joint.name)
        for k, body in enumerate(robot.bodies):
            if "position" in self.which:
                for number, axis in enumerate("xyz"):
                    move = np.eye(MOVES)[number]
                    yield f"position_{axis}.{body.joint}", "m", _one(robot, k, move)
            if "axis" in self.which:
                for number, across in enumerate(_across(body.axis), start=1):
                    move = np.concatenate((np.zeros(3), across))
                    yield f"axis_{number}.{body.joint}", "rad", _one(robot, k, move)


def _number(robot: Robot, joint: str) -> int:
    return [coordinate.name for coordinate in robot.joints].index(joint)


def _own(robot: Robot, joint: str) -> Array:
    """What a joint's own motion displaces: its body, and those that mimic it."""
    moves = np.zeros((len(robot.bodies), MOVES))
    for k, body in enumerate(robot.bodies):
        if body.coordinate == _number(robot, joint):
            along = slice(0, 3) if body.kind == "prismatic" else slice(3, 6)
            moves[k, along] = body.ratio * body.axis
    return moves.ravel()


def _one(robot: Robot, body: int, move: Array) -> Array:
    moves = np.zeros((len(robot.bodies), MOVES))
    moves[body] = move
    return moves.ravel()


def _across(axis: Array) -> Array:
    """Two unit vectors across an axis, shape `(2, 3)`."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])
