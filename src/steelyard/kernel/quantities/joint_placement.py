"""Torques of a tree whose joints lie a little beside where the model file places them."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.kernel.equations.dynamics import JointState, Scalar, inverse_dynamics
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program
from steelyard.robot.json import robot_to_dict
from steelyard.robot.robot import Body, Coordinate, Robot

MOVES = 6
"""Of each joint frame: along its x, y, z [m], then about them [rad]."""

STEP = 1e-4
"""Half a step of the central difference [m; rad]: the torque is smooth, errors are below 1e-8."""


def torque_slope(
    robot: Robot, motion: tuple[Array, Array, Array], tens: Array, move: Array
) -> Array:
    """Change of the bodies' torques with a displacement of joint frames, `(n_joints, N)`.

    Args:
        robot: A tree.
        motion: `q, dq, ddq` of all joints, each `(n_joints, N)`.
        tens: Ten numbers per body, shape `(10 n_bodies,)`.
        move: What is differentiated by: displacements per unit, in each joint's own frame,
            shape `(MOVES n_bodies,)`.
    """
    code, shared = placement_code(robot), (False, False, False, True, True)
    ahead, behind = (code([*motion, tens, sign * STEP * move], shared) for sign in (1.0, -1.0))
    return np.asarray((ahead - behind) / (2.0 * STEP))


@lru_cache(maxsize=4)
def placement_code(robot: Robot) -> Code:
    """Machine code; inputs are motion, ten numbers and `MOVES` displacements per body."""

    def build() -> tuple[Program, dict[str, Any]]:
        from steelyard.kernel.program.trace import symbolic

        count, n = len(robot.bodies), robot.n_joints
        movable, none = with_displacements(robot), [0.0] * (MOVES * count)

        def torque(q: Any, dq: Any, ddq: Any, tens: Any, moves: Any) -> Sequence[Scalar]:
            state = JointState([*q, *moves], [*dq, *none], [*ddq, *none])
            bodies = [[0.0] * 10] * len(movable.bodies)
            for k in range(count):
                bodies[(MOVES + 1) * k + MOVES] = tens[10 * k : 10 * k + 10]
            return inverse_dynamics(movable, state, bodies)[:n]

        inputs = [Input("q", n), Input("dq", n), Input("ddq", n)]
        inputs += [
            Input("tens", 10 * count, shared=True),
            Input("moves", MOVES * count, shared=True),
        ]
        return symbolic(torque, inputs), {}

    return compiled(["placement", robot_to_dict(robot)], build)


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
