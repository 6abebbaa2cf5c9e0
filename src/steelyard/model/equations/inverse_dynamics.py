r"""Inverse dynamics of a tree of bodies, written once, over numbers, arrays and symbols alike.

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
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.robot.inertia_and_placement import skew
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
    motions = _outward(robot, state)
    wrenches = [_wrench(m, ten) for m, ten in zip(motions, inertials, strict=True)]
    efforts: list[Scalar] = [0.0] * robot.n_joints
    for body, motion, index in reversed(
        list(zip(robot.bodies, motions, range(len(motions)), strict=True))
    ):
        force, moment = wrenches[index]
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
        x = link.ratio * q[link.coordinate] + link.offset
        rotation, origin = _placement(link, x)
        axis = _constant(link.axis)
        own = axis if link.kind == "prismatic" else _cross(axis, position)
        slopes[link.coordinate] = _times(own, link.ratio) + slopes.get(link.coordinate, 0.0)
        slopes = {joint: rotation @ slope for joint, slope in slopes.items()}
        position = rotation @ position + origin
        body = link.parent
    return position, slopes


def _outward(robot: Robot, state: JointState) -> list[_Moving]:
    zero = _constant(np.zeros(3))
    gravity = _constant(-robot.gravity)
    base = _moving(_constant(np.eye(3)), zero, zero, zero, gravity)
    motions: list[_Moving] = []
    for body in robot.bodies:
        parent = motions[body.parent] if body.parent >= 0 else base
        motions.append(_next(body, parent, state))
    return motions


def _next(body: Body, parent: _Moving, state: JointState) -> _Moving:
    """Carry the motion from the parent through the joint into the body's own frame."""
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
    moment = motion.turning @ six + _cross(h, motion.acceleration)
    return force, moment


def _constant(values: Any) -> Any:
    """An object array of numbers, with the dirt of rounding cleaned to exactly 0 and ±1."""
    clean = np.array(values, dtype=np.float64)
    for exact in (0.0, 1.0, -1.0):
        clean[np.abs(clean - exact) < 1e-12] = exact
    return clean.astype(object)


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
