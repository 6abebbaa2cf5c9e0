"""Torques of small errors of geometry and of effort readings, as columns beside the model's own.

The torque is not linear in the geometry. Around a reference model it is to first order, and the
columns of this term are those derivatives: what a fit gives them is how far the geometry is off.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from typing import Any, ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array, Parameter, frozen
from steelyard.model.equations.inverse_dynamics import JointState, Scalars, inverse_dynamics
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.terms.term import Columns, Dissipation, StatefulTerm, Term, TermSamples
from steelyard.robot.robot import Body, Coordinate, Robot, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, compiled_equations, recurrence
from steelyard.symbolic.program_and_softening import InputArray as Input

MOVES = 6  # of each joint frame: along its x, y, z [m], then about them [rad]

DISPLACEMENT_STEP = 1e-4
"""Half a step of the central difference [m; rad]: the torque is smooth, errors are below 1e-8."""


@lru_cache(maxsize=4)
def placement_code(robot: Robot) -> Code:
    """Machine code; inputs are motion, ten numbers and `MOVES` displacements per body."""
    count, n = len(robot.bodies), robot.n_joints

    def torque(q: Any, dq: Any, ddq: Any, tens: Any, moves: Any) -> Scalars:
        movable, none = with_displacements(robot), [0.0] * (MOVES * count)
        state = JointState([*q, *moves], [*dq, *none], [*ddq, *none])
        bodies = [[0.0] * 10] * len(movable.bodies)
        for k in range(count):
            bodies[(MOVES + 1) * k + MOVES] = tens[10 * k : 10 * k + 10]
        return inverse_dynamics(movable, state, bodies)[:n]

    inputs = [Input("q", n), Input("dq", n), Input("ddq", n)]
    inputs += [Input("tens", 10 * count, shared=True), Input("moves", MOVES * count, shared=True)]
    return compiled_equations(["placement", robot_to_dict(robot)], torque, inputs)


def with_displacements(robot: Robot) -> Robot:
    """The tree with six massless bodies before each body, that slide and turn its joint frame."""
    axes, still = frozen(np.eye(3)), frozen(np.zeros(3))
    bodies: list[Body] = []
    for k, body in enumerate(robot.bodies):
        parent = (MOVES + 1) * body.parent + MOVES if body.parent >= 0 else -1
        for move in range(MOVES):
            bodies.append(
                Body(
                    f"{body.name} {move}",
                    f"{body.joint} {move}",
                    "prismatic" if move < 3 else "revolute",
                    len(bodies) - 1 if move else parent,
                    axes if move else body.rotation,
                    still if move else body.position,
                    axes[move % 3],
                    robot.n_joints + MOVES * k + move,
                )
            )
        placed = {"rotation": axes, "position": still, "parent": len(bodies) - 1}
        bodies.append(Body(**{**vars(body), **placed}))
    moved = [Coordinate(f"move {k}", "revolute") for k in range(MOVES * len(robot.bodies))]
    return Robot(robot.name, tuple(bodies), (*robot.joints, *moved), robot.gravity)


GeometryErrorKind = Literal["zero_offset", "compliance", "position", "axis"]


@dataclass(frozen=True)
class GeometryErrors(StatefulTerm):
    r"""Errors of the geometry, $\partial \tau / \partial x$ at a reference, ten numbers per body.

    Per joint its `zero_offset` [rad; m], per body the `position` of its joint in the parent [m;
    three numbers in the joint's frame] and the tilt of its `axis` [rad; two numbers], and per joint
    its `compliance` [rad/Nm; m/N]: the offset per torque, against which it turns. Trees only:
    closed chains have no columns.
    """

    law: ClassVar[str] = "displaced"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("reference",)
    which: tuple[GeometryErrorKind, ...] = ("zero_offset",)
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

    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """Derivatives of the reference model's torque along the motion."""
        tens = RigidBody.numbers_of(robot, dict(self.reference))
        given, code = [samples.q, samples.dq, samples.ddq, tens], placement_code(robot)
        joints, found = [joint.name for joint in robot.joints], []
        for name, _, move in self._moves(robot):
            step = DISPLACEMENT_STEP * move
            slope = (code([*given, step]) - code([*given, -step])) / (2.0 * DISPLACEMENT_STEP)
            kind, _, joint = name.partition(".")
            if kind == "compliance":
                slope = -samples.rigid_torque(tens)[joints.index(joint)] * slope
            found.append(slope)
        return np.concatenate(found), None

    def _moves(self, robot: Robot) -> Iterator[tuple[str, str, Array]]:
        """Name, unit and direction `(MOVES n_bodies,)` of every parameter."""
        if robot.passive:
            return
        for kind, unit in (("zero_offset", "{0}"), ("compliance", "{0}/{1}")):
            for k, joint in enumerate(robot.joints if kind in self.which else ()):
                units = unit.format(joint.unit, joint.effort_unit)
                yield f"{kind}.{joint.name}", units, _displacement_with_joint(robot, k)
        count = len(robot.bodies)
        unit_moves = np.eye(MOVES * count).reshape(count, MOVES, MOVES * count)
        for k, body in enumerate(robot.bodies):
            if "position" in self.which:
                for number, axis in enumerate("xyz"):
                    yield f"position_{axis}.{body.joint}", "m", unit_moves[k, number]
            if "axis" in self.which:
                first = np.cross(body.axis, np.eye(3)[int(np.argmin(np.abs(body.axis)))])
                first /= np.linalg.norm(first)
                for number, across in enumerate((first, np.cross(body.axis, first)), start=1):
                    yield f"axis_{number}.{body.joint}", "rad", across @ unit_moves[k, 3:]


def _displacement_with_joint(robot: Robot, joint: int) -> Array:
    """What a joint's own motion displaces: its body, and those that mimic it."""
    moves = np.zeros((len(robot.bodies), MOVES))
    for k, body in enumerate(robot.bodies):
        if body.coordinate == joint:
            along = slice(0, 3) if body.kind == "prismatic" else slice(3, 6)
            moves[k, along] = body.ratio * body.axis
    return moves.ravel()


HYSTERESIS = 0.1  # change of a torque over its scale after which its direction is forgotten


@dataclass(frozen=True)
class EffortReadingErrors(StatefulTerm):
    r"""Errors of efforts, around the torque $\tau$ of a reference model.

    The model has ten numbers per body and, if given, terms `beside` them, each with its values.
    Columns are without a unit, per joint: `gain`, the bodies' torque: its effort is that share too
    large; `saturation`, $\tau_j |\tau_j| / \tau_0$: the gain has changed by that share at a torque
    $\tau_0$, the `scale` [Nm; N], 1 if none is given; `hysteresis`, $\tau_0 z$ with $dz =
    (d\tau_j - z\,|d\tau_j|) / (0.1\,\tau_0)$: what is read depends on the way to the torque; and
    of every other joint $k$ `crosstalk_k`, $\tau_k$: the share of it that is read too. Trees only.
    """

    law: ClassVar[str] = "misread"
    dissipation: ClassVar[Dissipation] = "none"
    state_only_fields: ClassVar[tuple[str, ...]] = ("reference", "scale", "beside")
    reference: tuple[tuple[str, float], ...] = ()
    scale: tuple[float, ...] = ()
    beside: tuple[tuple[Term, tuple[float, ...]], ...] = ()  # terms without memory

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names like `gain.elbow`; `crosstalk_1.elbow` is of the first joint in the elbow."""
        names = [f"{kind}.{robot.joints[row].name}" for kind, row in self._places(robot)]
        return tuple(Parameter(name, "1") for name in names)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The channels, each in its joint's row."""
        rows = (row for _, row in self._places(robot))
        return {(row, k): state.channels[k] for k, row in enumerate(rows)}

    def n_channels(self, robot: Robot) -> int:
        """One per parameter."""
        return len(self._places(robot))

    def remember(self, robot: Robot, samples: TermSamples, memory: Any) -> tuple[Array, Any]:
        """Torques of the reference model, and what sensors may make of them."""
        rigid = samples.rigid_torque(RigidBody.numbers_of(robot, dict(self.reference)))
        torque, state = rigid.copy(), JointState(*map(list, (samples.q, samples.dq, samples.ddq)))
        for term, values in self.beside:
            for (row, k), column in term.columns(robot, state).items():
                torque[row] += values[k] * column
        scale = np.array(self.scale or (1.0,) * robot.n_joints)[:, None]
        before, start = memory or (torque[:, 0], np.zeros(len(torque)))
        steps = np.diff(torque, axis=1, prepend=before[:, None]) / (HYSTERESIS * scale)
        decay = np.exp(-np.abs(steps))
        way, end = recurrence(decay, np.sign(steps) * (1.0 - decay), np.ones_like(decay), start)
        others = [torque[k : k + 1] for k, _ in permutations(range(robot.n_joints), 2)]
        own = (rigid, torque * np.abs(torque) / scale, scale * way)
        return np.concatenate((*own, *others)), (torque[:, -1], end)

    def _places(self, robot: Robot) -> list[tuple[str, int]]:
        """Kind and row of every column."""
        if robot.passive:
            return []
        kinds = ("gain", "saturation", "hysteresis")
        own = [(kind, row) for kind in kinds for row in range(robot.n_joints)]
        pairs = permutations(range(robot.n_joints), 2)
        return own + [(f"crosstalk_{k + 1}", row) for k, row in pairs]
