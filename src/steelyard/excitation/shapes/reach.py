r"""How fast the distance of two shapes can change per speed of the joints between them.

The distance $s$ of two solids on bodies $a$ and $b$ changes at the rate
$n \cdot (v_b - v_a)$ of their nearest points, whose difference is along $n$. A revolute joint
between $a$ and $b$ contributes $\dot x\, n \cdot (w \times p)$ for any point $p$ on that line, so
at most $|\dot x|$ times the distance of *either* nearest point from the joint's axis; a prismatic
one at most $|\dot x|$; a joint that moves both nothing. The reach of a solid from an axis is
bounded over all postures by a ball around it that is swept about one joint after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.shapes.solids import Ball
from steelyard.kernel.quantities.kinematics import Points
from steelyard.robot.robot import Robot

_POINT = 1e-9


@dataclass(frozen=True, eq=False)
class _Ball:
    """A ball in a frame: centre `(3,)` and radius [m]."""

    centre: Array
    radius: float


def sides(robot: Robot, first: int, second: int) -> NDArray[np.int8]:
    """Per body what its joint moves of two bodies.

    Returns:
        Shape `(B,)`: -1 for a joint that moves only the first, 1 for one that moves only the
        second, 0 for those that move both or none.
    """
    signs = np.zeros(len(robot.bodies), dtype=np.int8)
    for body, sign in ((first, -1), (second, 1)):
        while body >= 0:
            signs[body] += sign
            body = robot.bodies[body].parent
    return signs


def rates(robot: Robot, first: Shape, second: Shape, lower: Array, upper: Array) -> Array:
    """Bound of the change of two shapes' distance per speed of each coordinate.

    Args:
        robot: The robot.
        first: A shape.
        second: Another.
        lower: Least positions that occur, shape `(n,)` [rad; m].
        upper: Greatest positions, shape `(n,)`.

    Returns:
        Shape `(n,)` [m/rad; 1].
    """
    ways = sides(robot, first.body, second.body)
    up = _to_base(robot, first.body, ways)
    down = _to_base(robot, second.body, ways)
    mine = _reaches(robot, first, up, down[::-1], lower, upper)
    theirs = _reaches(robot, second, down, up[::-1], lower, upper)
    bound = np.zeros(robot.n)
    for index in (*up, *down):
        body = robot.bodies[index]
        reach = 1.0 if body.kind == "prismatic" else min(mine[index], theirs[index])
        bound[body.coordinate] += abs(body.ratio) * reach
    return bound


def point_rates(robot: Robot, points: Points, lower: Array, upper: Array) -> Array:
    """How far each point moves at most per change of each coordinate, shape `(m, n)` [m/rad; 1]."""
    base = Shape("base", -1, np.eye(3), np.zeros(3), Ball(_POINT))
    own = [
        Shape("point", body, np.eye(3), place, Ball(_POINT))
        for body, place in zip(points.carriers, points.places, strict=True)
    ]
    return np.array([rates(robot, base, shape, lower, upper) for shape in own])


def _to_base(robot: Robot, body: int, ways: NDArray[np.int8]) -> list[int]:
    """Joints from a body to where the two bodies' ways meet, as numbers of bodies."""
    found = []
    while body >= 0:
        if ways[body]:
            found.append(body)
        body = robot.bodies[body].parent
    return found


def _reaches(
    robot: Robot,
    shape: Shape,
    up: Sequence[int],
    down: Sequence[int],
    lower: Array,
    upper: Array,
) -> dict[int, float]:
    """How far a shape may be from the axes of joints, which it passes first up, then down."""
    centre = shape.position + shape.rotation @ shape.solid.centre
    ball, reaches = _Ball(centre, shape.solid.radius), {}
    for index in up:
        body = robot.bodies[index]
        ball, reaches[index] = _swept(robot, index, ball, lower, upper, 1.0)
        ball = _Ball(body.rotation @ ball.centre + body.position, ball.radius)
    for index in down:
        body = robot.bodies[index]
        ball = _Ball(body.rotation.T @ (ball.centre - body.position), ball.radius)
        ball, reaches[index] = _swept(robot, index, ball, lower, upper, -1.0)
    return reaches


def _swept(
    robot: Robot, index: int, ball: _Ball, lower: Array, upper: Array, sign: float
) -> tuple[_Ball, float]:
    """A ball that holds a ball while a joint moves it, and its reach from the joint's axis."""
    body = robot.bodies[index]
    along = body.axis * (body.axis @ ball.centre)
    reach = float(np.linalg.norm(ball.centre - along)) + ball.radius
    if body.kind == "revolute":
        return _Ball(along, reach), reach
    ends = body.ratio * np.array([lower[body.coordinate], upper[body.coordinate]]) + body.offset
    middle, half = ends.mean(), abs(ends[1] - ends[0]) / 2.0
    return _Ball(ball.centre + sign * middle * body.axis, ball.radius + half), reach
