r"""Closed chains: from independent joints to all joints and their torques back, by small systems.

Up to three equations are solved by cofactors, more by $L D L^T$ of their normal equations: neither
divides by a pivot that could vanish where the system itself is regular.

With all positions known, pins give $H\,\dot q = 0$; split into independent and passive joints,
$\dot q_p = G \dot q_a$ with $G = -H_p^{-1} H_a$, $\ddot q_p = G \ddot q_a + \dot G \dot q_a$, and
the effort of the independent joints is $\tau_a + G^T \tau_p$ [Murray1994]. The rate is
$\dot G \dot q_a = -H_p^{-1} b$, where $b = \dot H \dot q$ is how the pins' points accelerate apart
while no joint accelerates.

Which equations belong to which joints is known from `loop_equations`; blocks of them are solved one
by one.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steelyard.model.equations.inverse_dynamics import (
    JointState,
    Scalar,
    Scalars,
    Vector,
    _constant,
    _cross,
    _dot,
    _placement,
    _times,
)
from steelyard.robot.loop_closures import LoopEquations, chains, loop_equations
from steelyard.robot.robot import Body, Robot

COFACTORS = 3  # largest system that is solved by cofactors


def solved(matrix: list[list[Scalar]], sides: Sequence[list[Scalar]]) -> list[list[Scalar]]:
    """Solutions of a square system of rows, one per right-hand side."""
    if len(matrix) > COFACTORS:
        columns = list(zip(*matrix, strict=True))
        normal = [[along(a, b) for b in columns] for a in columns]
        return solved_by_factors(normal, [[along(c, side) for c in columns] for side in sides])[0]
    size = range(len(matrix))
    adjugate = [[_cofactor(matrix, row, column) for row in size] for column in size]
    inverse = 1.0 / along(matrix[0], [adjugate[k][0] for k in size])
    return [[inverse * along(adjugate[k], side) for k in size] for side in sides]


def _cofactor(matrix: Sequence[Scalars], row: int, column: int) -> Scalar:
    rest = [
        [x for k, x in enumerate(line) if k != column] for j, line in enumerate(matrix) if j != row
    ]
    value = along(rest[0], [_cofactor(rest, 0, k) for k in range(len(rest))]) if rest else 1.0
    return value if (row + column) % 2 == 0 else -value


def solved_by_factors(
    matrix: Sequence[Scalars], sides: Sequence[Scalars]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    r"""Solutions of a positive definite system $L D L^T$, one per right-hand side; and $D$."""
    size = range(len(matrix))
    lower: list[list[Scalar]] = [[0.0] * len(matrix) for _ in size]
    pivots: list[Scalar] = []
    for j in size:
        scaled = [lower[j][k] * pivots[k] for k in range(j)]
        pivots.append(matrix[j][j] - along(lower[j][:j], scaled))
        for i in size[j + 1 :]:
            lower[i][j] = (matrix[i][j] - along(lower[i][:j], scaled)) / pivots[j]
    solutions = []
    for side in sides:
        x = list(side)
        for i in size:
            x[i] = x[i] - along(lower[i][:i], x[:i])
        x = [value / pivot for value, pivot in zip(x, pivots, strict=True)]
        for i in reversed(size):
            x[i] = x[i] - along([lower[k][i] for k in size[i + 1 :]], x[i + 1 :])
        solutions.append(x)
    return solutions, pivots


def along(row: Scalars, values: Scalars) -> Scalar:
    """Sum of products, leaving out what is zero by structure."""
    total: Scalar = None
    for factor, value in zip(row, values, strict=True):
        if factor is not None:
            total = factor * value if total is None else total + factor * value
    return 0.0 if total is None else total


Hinges = list[tuple[Body, Vector, Vector]]
"""Joints on the way to a pin, their axes and origins where the last body carries both ends."""
Arm = tuple[Hinges, Vector]  # one end of a pin: the joints on the way, and where its point is


def completed(robot: Robot, state: JointState) -> tuple[JointState, Any]:
    """The state of all joints, and the map `G` by which passive torques load independent joints.

    The first channels are positions of the passive joints; others are handed on. `G`,
    `[passive][independent]`, is `None` where it is zero by structure, and as a whole for a tree.
    """
    if not robot.passive:
        return state, None
    count = len(robot.passive)
    q = [*state.q, *state.channels[:count]]
    equations = loop_equations(robot)
    arms = _arms(robot, q)
    slopes = _slopes(equations, arms)
    torque_map: list[list[Scalar]] = [[None] * robot.n for _ in range(count)]
    for rows, joints in _blocks(equations, robot.n):
        active = [k for k in range(robot.n) if equations.depends[rows, k].any()]
        sides = [[-slopes[r][k] for r in rows] for k in active]
        columns = solved([[slopes[r][j] for j in joints] for r in rows], sides)
        for k, column in zip(active, columns, strict=True):
            for joint, value in zip(joints, column, strict=True):
                torque_map[joint - robot.n][k] = value
    dq = [*state.dq, *(along(row, state.dq) for row in torque_map)]
    drifts = [
        -_dot(_constant(direction), _drift(arms[loop][0], dq) - _drift(arms[loop][1], dq))
        for loop, direction in zip(equations.loops, equations.directions, strict=True)
    ]
    ddq = [along(row, state.ddq) for row in torque_map]
    for rows, joints in _blocks(equations, robot.n):
        matrix = [[slopes[r][j] for j in joints] for r in rows]
        (values,) = solved(matrix, [[drifts[r] for r in rows]])
        for joint, value in zip(joints, values, strict=True):
            ddq[joint - robot.n] = ddq[joint - robot.n] + value
    return JointState(q, dq, [*state.ddq, *ddq], state.channels[count:]), torque_map


def corrected(robot: Robot, q: Scalars, passive: Scalars) -> list[Scalar]:
    """One Newton step of the passive positions, and the squared gap of every pin [m²] before it."""
    equations = loop_equations(robot)
    arms = _arms(robot, [*q, *passive])
    slopes = _slopes(equations, arms)
    lacks = [first - second for (_, first), (_, second) in arms]
    result = list(passive)
    for rows, joints in _blocks(equations, robot.n):
        side = [-_dot(_constant(equations.directions[r]), lacks[equations.loops[r]]) for r in rows]
        (steps,) = solved([[slopes[r][j] for j in joints] for r in rows], [side])
        for joint, step in zip(joints, steps, strict=True):
            result[joint - robot.n] = result[joint - robot.n] + step
    return [*result, *(_dot(lack, lack) for lack in lacks)]


def projected(
    robot: Robot, entries: Mapping[tuple[int, int], Scalar], torque_map: Any
) -> Mapping[tuple[int, int], Scalar]:
    """Rows of all joints as rows of the independent ones, `(row, column)` to scalar."""
    if torque_map is None:
        return entries
    result: dict[tuple[int, int], Scalar] = {}
    for (row, column), value in entries.items():
        if row < robot.n:
            targets = [(row, value)]
        else:
            gains = enumerate(torque_map[row - robot.n])
            parts = [(k, g * value) for k, g in gains if g is not None]
            # symbols may be zero by structure; arrays and numbers never are
            targets = [(k, x) for k, x in parts if not getattr(x, "is_zero", bool)()]
        for target, part in targets:
            old = result.get((target, column))
            result[target, column] = part if old is None else old + part
    return result


def _arms(robot: Robot, q: Scalars) -> list[tuple[Arm, Arm]]:
    found = []
    for loop in robot.loops:
        first, second = chains(robot, loop)
        found.append(
            (_arm(robot, first, loop.points[0], q), _arm(robot, second, loop.points[1], q))
        )
    return found


def _arm(robot: Robot, chain: Sequence[int], point: Any, q: Scalars) -> Arm:
    rotation, position = _constant(np.eye(3)), _constant(np.zeros(3))
    hinges: Hinges = []
    for body in (robot.bodies[k] for k in chain):
        axis = rotation @ _constant(body.rotation @ body.axis)
        turned, moved = _placement(body, body.ratio * q[body.coordinate] + body.offset)
        position = position + rotation @ moved
        rotation = rotation @ turned
        hinges.append((body, axis, position))
    return hinges, position + rotation @ _constant(point)


def _slopes(equations: LoopEquations, arms: Sequence[tuple[Arm, Arm]]) -> list[list[Scalar]]:
    """$H$, one row per equation."""
    rows: list[list[Scalar]] = []
    for loop, direction, depends in zip(
        equations.loops, equations.directions, equations.depends, strict=True
    ):
        row: list[Scalar] = [0.0] * len(depends)
        for sign, (hinges, tip) in zip((1.0, -1.0), arms[loop], strict=True):
            for body, axis, origin in hinges:
                joint = body.coordinate
                if depends[joint]:
                    lever = axis if body.kind == "prismatic" else _cross(axis, tip - origin)
                    part = _dot(_constant(direction), lever)
                    row[joint] = row[joint] + sign * body.ratio * part
        rows.append(row)
    return rows


def _drift(arm: Arm, dq: Scalars) -> Vector:
    """How the point of an arm accelerates while no joint accelerates."""
    zero = _constant(np.zeros(3))
    omega, alpha, acceleration, last = zero, zero, zero, zero
    hinges, tip = arm
    for body, axis, origin in hinges:
        rate = _times(axis, body.ratio * dq[body.coordinate])
        acceleration = acceleration + _carried(omega, alpha, origin - last)
        last = origin
        if body.kind == "prismatic":
            acceleration = acceleration + _times(_cross(omega, rate), 2.0)
        else:
            alpha = alpha + _cross(omega, rate)
            omega = omega + rate
    return acceleration + _carried(omega, alpha, tip - last)


def _carried(omega: Vector, alpha: Vector, arm: Vector) -> Vector:
    return _cross(alpha, arm) + _cross(omega, _cross(omega, arm))


def _blocks(equations: LoopEquations, n: int) -> list[tuple[list[int], list[int]]]:
    """Equations and passive joints that hang together: rows of the equations, joints."""
    left, blocks = set(range(len(equations.loops))), []
    while left:
        rows = {min(left)}
        joints: set[int] = set()
        grown = True
        while grown:
            joints = {n + int(j) for r in rows for j in np.flatnonzero(equations.depends[r, n:])}
            more = {r for r in left if equations.depends[r, sorted(joints)].any()}
            grown, rows = not more <= rows, rows | more
        blocks.append((sorted(rows), sorted(joints)))
        left -= rows
    return blocks
