r"""Inverse dynamics of trees and closed chains, over numbers, arrays and symbols alike.

The recursive Newton-Euler algorithm [Luh1980] in body coordinates. Vectors and matrices are NumPy
arrays of *scalars*, and a scalar is whatever has `+ - *`, `sin` and `cos`: a `Symbol` when
the program is traced, an array over samples in a test.

Every body contributes, about the origin of its own frame and with $a$ the acceleration of that
origin minus gravity,

$$ f = m a + B h, \qquad n = I \dot\omega + \omega \times I \omega + h \times a, \qquad
   B = \dot\omega^\times + \omega^\times \omega^\times, $$

which is linear in its ten numbers $(m, h, I)$. The products of rates are formed once per body and
shared by $B$ and by the map of the six inertias: that is what keeps the regressor, the reverse
derivative of this program, as short as a hand-derived one.

The recursion starts at the base: where it is fixed, with $a = -g$; where it floats, with $\omega$
from its entries of `dq`, $a$ and $\dot\omega$ from those of `ddq`. The wrench on a floating base is
the effort of its six rows.

Closed chains go from independent joints to all joints, and their torques back, by small systems. Up
to three equations are solved by cofactors, more by $L D L^T$ of their normal equations: neither
divides by a pivot that could vanish where the system itself is regular. With all positions known,
pins give $H\,\dot q = 0$; split into independent and passive joints, $\dot q_p = G \dot q_a$ with
$G = -H_p^{-1} H_a$, $\ddot q_p = G \ddot q_a + \dot G \dot q_a$, and the effort of the independent
joints is $\tau_a + G^T \tau_p$ [Murray1994]. The rate is $\dot G \dot q_a = -H_p^{-1} b$, where
$b = \dot H \dot q$ is how the pins' points accelerate apart while no joint accelerates. Which
equations belong to which joints is known from `loop_equations`; blocks of them are solved one by
one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.robot.inertia_and_placement import skew
from steelyard.robot.loop_closures import LoopEquations, chains, loop_equations
from steelyard.robot.robot import Body, Robot

Scalar = Any
Scalars = Sequence[Scalar]
Vector = Any
Matrix = Any


@dataclass(frozen=True)
class JointState:
    """Position, velocity and acceleration of every joint: `q[j]` is a scalar or an array.

    `channels` are what does not follow from one sample alone and was computed along the motion:
    positions of joints that loops determine, states of friction with memory, reference loads.
    """

    q: Scalars
    dq: Scalars
    ddq: Scalars
    channels: Scalars = ()


@dataclass(frozen=True)
class _Moving:
    """One body's motion in its own frame, of which axes and origin are in the parent's.

    The acceleration is of the origin, minus gravity. `spread` is $B$: a point fixed at `p`
    accelerates by `acceleration + B p`; `turning` maps the inertia's six numbers to its moment,
    `(3, 6)`.
    """

    rotation: Matrix
    position: Vector
    omega: Vector
    alpha: Vector
    acceleration: Vector
    spread: Matrix
    turning: Matrix


def inverse_dynamics(robot: Robot, state: JointState, inertials: Sequence[Scalars]) -> list[Scalar]:
    """Joint efforts of the rigid bodies, those that loops determine last [Nm; N].

    Of all joints [rad, rad/s, rad/s²; m for prismatic] and ten numbers per body, Pinocchio's order;
    the gravity of the tree is used, its nominal inertias are not.
    """
    zero = _constant(np.zeros(3))
    base = _moving(_constant(np.eye(3)), zero, zero, zero, _constant(-robot.gravity))
    motions: list[_Moving] = []
    for body in robot.bodies:
        motions.append(_next(body, motions[body.parent] if body.parent >= 0 else base, state))
    wrenches = [_wrench(m, ten) for m, ten in zip(motions, inertials, strict=True)]
    efforts: list[Scalar] = [0.0] * robot.n_joints
    for index, motion in reversed(list(enumerate(motions))):
        body, (force, moment) = robot.bodies[index], wrenches[index]
        if body.kind == "floating":
            efforts[: robot.n_base] = [*force, *moment]
            continue
        along = force if body.kind == "prismatic" else moment
        efforts[body.coordinate] += body.ratio * _dot(_constant(body.axis), along)
        if body.parent >= 0:
            carried = motion.rotation @ force
            parent_force, parent_moment = wrenches[body.parent]
            wrenches[body.parent] = (
                parent_force + carried,
                parent_moment + motion.rotation @ moment + _cross(motion.position, carried),
            )
    return efforts


def carried_point(
    robot: Robot, q: Scalars, body: int, point: ArrayLike, ancestor: int = -1
) -> tuple[Vector, dict[int, Vector]]:
    """Where a point `(3,)` [m] in a body's frame is, seen from one of the bodies that carry it.

    Bodies are given by index, -1 is the base. Returns the position in the ancestor's frame, shape
    `(3,)` [m], and its derivatives by the joints between the two, by index of the joint.
    """
    position, slopes = _constant(point), dict[int, Vector]()
    while body != ancestor:
        link = robot.bodies[body]
        if link.kind == "floating":
            return position, slopes | dict(
                enumerate([*_AXES, *(_cross(a, position) for a in _AXES)])
            )
        rotation, origin = _placement(link, link.ratio * q[link.coordinate] + link.offset)
        axis = _constant(link.axis)
        own = axis if link.kind == "prismatic" else _cross(axis, position)
        slopes[link.coordinate] = _times(own, link.ratio) + slopes.get(link.coordinate, 0.0)
        slopes = {joint: rotation @ slope for joint, slope in slopes.items()}
        position = rotation @ position + origin
        body = link.parent
    return position, slopes


def _next(body: Body, parent: _Moving, state: JointState) -> _Moving:
    """Carry the motion from the parent through the joint into the body's own frame."""
    if body.kind == "floating":
        omega, acceleration = _vector(state.dq[3:6]), _vector(state.ddq[:3])
        alpha = _vector(state.ddq[3:6])
        return _moving(parent.rotation, parent.position, omega, alpha, acceleration)
    x = body.ratio * state.q[body.coordinate] + body.offset
    v = body.ratio * state.dq[body.coordinate]
    a = body.ratio * state.ddq[body.coordinate]
    axis = _constant(body.axis)
    rotation, position = _placement(body, x)
    back = rotation.T
    omega = back @ parent.omega
    alpha = back @ parent.alpha
    acceleration = back @ (parent.acceleration + parent.spread @ position)
    if body.kind == "prismatic":
        acceleration = acceleration + _times(axis, a) + _cross(omega, _times(axis, 2.0 * v))
        return _moving(rotation, position, omega, alpha, acceleration)
    alpha = alpha + _times(axis, a) + _cross(omega, _times(axis, v))
    return _moving(rotation, position, omega + _times(axis, v), alpha, acceleration)


def _moving(
    rotation: Matrix, position: Vector, omega: Vector, alpha: Vector, acceleration: Vector
) -> _Moving:
    """Form the products of rates once."""
    x, y, z = omega
    a, b, c = alpha
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    spread = _matrix(
        [-(yy + zz), xy - c, xz + b],
        [xy + c, -(xx + zz), yz - a],
        [xz - b, yz + a, -(xx + yy)],
    )
    turning = _matrix(
        [a, b - xz, -yz, c + xy, yy - zz, yz],
        [xz, a + yz, b, zz - xx, c - xy, -xz],
        [-xy, xx - yy, xy, a - yz, b + xz, c],
    )
    return _Moving(rotation, position, omega, alpha, acceleration, spread, turning)


def _placement(body: Body, x: Scalar) -> tuple[Matrix, Vector]:
    """Rotation and position of the body's frame in its parent's, at joint position `x`."""
    if body.kind == "prismatic":
        slide = _constant(body.rotation @ body.axis)
        return _constant(body.rotation), _constant(body.position) + _times(slide, x)
    along = np.outer(body.axis, body.axis)
    fixed, cosine, sine = (
        _constant(body.rotation @ part) for part in (along, np.eye(3) - along, skew(body.axis))
    )
    return fixed + _times(cosine, np.cos(x)) + _times(sine, np.sin(x)), _constant(body.position)


def _wrench(motion: _Moving, ten: Scalars) -> tuple[Vector, Vector]:
    """Force and moment that move a body, about its frame's origin."""
    m, h, six = ten[0], _vector(ten[1:4]), _vector(ten[4:10])
    force = _times(motion.acceleration, m) + motion.spread @ h
    return force, motion.turning @ six + _cross(h, motion.acceleration)


def _constant(values: Any) -> Any:
    """An object array of numbers, with the dirt of rounding cleaned to exactly 0 and ±1."""
    clean = np.array(values, dtype=np.float64)
    for exact in (0.0, 1.0, -1.0):
        clean[np.abs(clean - exact) < 1e-12] = exact
    return clean.astype(object)


_AXES = tuple(_constant(np.eye(3)))


def _vector(values: Scalars) -> Vector:
    vector = np.empty(len(values), dtype=object)
    for index, value in enumerate(values):
        vector[index] = value
    return vector


def _matrix(*rows: Scalars) -> Matrix:
    return np.stack([_vector(row) for row in rows])


def _times(array: Any, scalar: Scalar) -> Any:
    """Every entry times one scalar; a symbol must not see the array as a whole."""
    product = np.empty(array.shape, dtype=object)
    for index, entry in np.ndenumerate(array):
        product[index] = entry * scalar
    return product


def _dot(a: Vector, b: Vector) -> Scalar:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return _vector(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


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
        ends = zip(chains(robot, loop), loop.points, strict=True)
        first, second = (_arm(robot, chain, point, q) for chain, point in ends)
        found.append((first, second))
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
