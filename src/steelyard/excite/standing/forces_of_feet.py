r"""Forces of the feet along a motion: each pushes and none slips; efforts of joints with them.

Inverse dynamics of the tree gives the force $f$ that the floor must exert and its moment $m$ about
the world's origin. Points $r_i$ of the feet bear them together,

$$\sum_i F_i = f, \qquad \sum_i r_i \times F_i = m,$$

and how they share is not determined by the motion. Taken are the least forces, $F = A^+ (f, m)$
with the constant matrix $A$ of the equations: if these push and stay inside the friction pyramid
$|F_x|, |F_y| \le \mu F_z / \sqrt{2}$, the motion is possible without slipping, and the zero-moment
point, the mean of the points with the weights $F_{z,i}$, lies inside the support polygon.
Efforts of the joints are $\tau - J^T F$ with the same forces.

Margins are smooth in the motion, so that interval arithmetic bounds them over stretches of time.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, set_fields
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import (
    TracedConstraint,
)
from steelyard.excite.standing.standing_robot import places_of_feet, points_of_feet
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars, carried_point
from steelyard.model.laws.laws_without_friction import body_efforts
from steelyard.robot.file.excitation_sections import StanceSection
from steelyard.robot.robot import BASE_COORDINATES, Frame, Robot, robot_to_dict

_ROOM = 0.2  # share of a point's load, or of a limit of effort, at which it begins to matter
_TOLERANCE = 0.02  # a proof may stay so far below the least margin at a sample, over the same
_BASE = len(BASE_COORDINATES)


@dataclass(frozen=True, eq=False)
class FeetForces(TracedConstraint):
    """Feet of the tree push the floor and do not slip, and joints have the efforts for it.

    The `points` of feet, on their bodies, stand at `places`, `(p, 3)` [m]. Each bears `least` [N]
    or more, with the coefficient of `friction`; efforts of joints are below `limits`, `(n - 6,)`
    [Nm; N], infinite for any.
    """

    tree: Robot
    points: tuple[Frame, ...]
    places: Array
    least: float
    friction: float
    limits: Array
    name: str = "forces of the feet"
    unit: str = "N or Nm"
    scope: str = "the least forces that carry the motion, with masses of the model file"
    how: str = "interval arithmetic bounds the rate of change of forces over every time interval"
    labels: tuple[str, ...] = field(init=False)
    activation_distance: Array = field(init=False)

    def __post_init__(self) -> None:
        sides = ("+x", "-x", "+y", "-y")
        limited = [int(k) for k in np.flatnonzero(np.isfinite(self.limits))]
        joints = [self.tree.coordinates[_BASE + k] for k in limited]
        labels = [f"load of '{point.name}' above {self.least:.3g} N" for point in self.points]
        labels += [
            f"'{point.name}' does not slip along {side} with a friction of {self.friction:g}"
            for point in self.points
            for side in sides
        ]
        labels += [
            f"{'torque' if joint.kind == 'revolute' else 'force'} of '{joint.name}' {side}"
            f"{self.limits[k]:.4g} {joint.effort_unit}"
            for side in ("below ", "above -")
            for k, joint in zip(limited, joints, strict=True)
        ]
        load = self.weight / len(self.points)
        sizes = np.full(5 * len(self.points), load)
        sizes[len(self.points) :] *= self.friction
        room = _ROOM * np.concatenate([sizes, np.tile(self.limits[limited], 2)])
        set_fields(self, labels=tuple(labels), activation_distance=room)

    @property
    def weight(self) -> float:
        """Of the whole robot [N]."""
        return weight_of(self.tree)

    @property
    def n(self) -> int:
        """See `TracedConstraint`."""
        return self.tree.n

    @property
    def tolerance(self) -> Array:
        """See `TracedConstraint`."""
        return _TOLERANCE / _ROOM * self.activation_distance

    @property
    def key(self) -> list[Any]:
        """See `TracedConstraint`."""
        limits = [float(x) if np.isfinite(x) else None for x in self.limits]
        places = [[p.body, p.position.tolist()] for p in self.points]
        own = [self.places.tolist(), self.least, self.friction, limits]
        return ["forces of feet", robot_to_dict(self.tree), places, own]

    def equations(self, q: Scalars, dq: Scalars, ddq: Scalars, *shared: Scalars) -> list[Scalar]:
        """See `TracedConstraint`."""
        forces, efforts = self._forces_and_efforts(q, dq, ddq)
        share = self.friction / np.sqrt(2.0)
        found = [force[2] - self.least for force in forces]
        found += [
            share * force[2] - sign * force[axis]
            for force in forces
            for axis in (0, 1)
            for sign in (1.0, -1.0)
        ]
        limited = [(e, most) for e, most in zip(efforts, self.limits, strict=True) if most < np.inf]
        return [
            *found,
            *(most - effort for effort, most in limited),
            *(most + effort for effort, most in limited),
        ]

    def columns(self, q: Array, dq: Array, ddq: Array) -> dict[str, Array]:
        """Columns of efforts of the joints and of forces on the feet along the world's axes.

        By name, `(N,)` each [Nm; N], at positions, velocities and accelerations `(N, n)`.
        """
        forces, efforts = self._forces_and_efforts([*q.T], [*dq.T], [*ddq.T])
        joints = self.tree.coordinates[_BASE:]
        found = {f"tau_{c.name}": np.asarray(x) for c, x in zip(joints, efforts, strict=True)}
        for point, force in zip(self.points, forces, strict=True):
            found |= {
                f"force_{point.name}_{axis}": np.asarray(x)
                for axis, x in zip("xyz", force, strict=True)
            }
        return found

    def _forces_and_efforts(
        self, q: Scalars, dq: Scalars, ddq: Scalars
    ) -> tuple[list[list[Any]], list[Any]]:
        """The least forces of the points along the world's axes, and efforts of the joints."""
        ten = [x for body in self.tree.bodies for x in body.inertia.ten]
        efforts = body_efforts(self.tree, JointState(q, dq, ddq), ten)
        wrench = [*efforts[:3], *_moment(q, efforts)]
        carried = np.linalg.pinv(wrench_of_forces(self.places))
        rows = [
            sum((x * w for x, w in zip(row[1:], wrench[1:], strict=True)), row[0] * wrench[0])
            for row in carried.tolist()
        ]
        forces = [rows[3 * k : 3 * k + 3] for k in range(len(self.points))]
        joints = list(efforts[_BASE:])
        for point, force in zip(self.points, forces, strict=True):
            _, slopes = carried_point(self.tree, q, point.body, point.position)
            for k, slope in slopes.items():
                if k >= _BASE:
                    pushed = [x * f for x, f in zip(slope, force, strict=True)]
                    joints[k - _BASE] = joints[k - _BASE] - (pushed[0] + pushed[1] + pushed[2])
        return forces, joints


def _moment(q: Scalars, efforts: Scalars) -> list[Any]:
    """The moment about the world's origin, from the efforts of the joints that carry the base.

    These are its components along the axes of yaw, pitch and roll, about the base's origin.
    """
    roll, pitch, yaw = efforts[3:6]
    ahead = (roll + np.sin(q[4]) * yaw) / np.cos(q[4])
    cosine, sine = np.cos(q[5]), np.sin(q[5])
    own = [cosine * ahead - sine * pitch, sine * ahead + cosine * pitch, yaw]
    x, y, z, (fx, fy, fz) = *q[:3], efforts[:3]
    return [own[0] + y * fz - z * fy, own[1] + z * fx - x * fz, own[2] + x * fy - y * fx]


def wrench_of_forces(places: Array) -> Array:
    """Force and moment about the world's origin per force at places `(p, 3)` [m], `(6, 3 p)`."""
    across = [[[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]] for x, y, z in places]
    return np.vstack([np.tile(np.eye(3), len(places)), np.hstack(across)])


def weight_of(robot: Robot) -> float:
    """Weight of all bodies, of the model file [N]."""
    return float(np.linalg.norm(robot.gravity) * sum(b.inertia.mass for b in robot.bodies))


LEAST_FORCES_NOTE = (
    "the feet share the weight in the least way; how real legs share it depends on their stiffness "
    "and on the floor"
)


def feet_forces(tree: Robot, stance: StanceSection, joints: Array, limits: Array) -> FeetForces:
    """The constraint of feet that stand where they are at positions of all joints `(n,)`.

    Raises:
        ModelError: The model file gives no masses, or gravity is not along the floor's normal.
    """
    weight = weight_of(tree)
    if not weight > 0.0 or not all(b.known or b.massless for b in tree.bodies):
        raise ModelError(
            "the balance of a robot that stands needs its masses, and the model file gives none",
            where="[excitation.stance]",
            fix="give the links of the model file masses and inertias",
        )
    if np.linalg.norm(tree.gravity[:2]) > 1e-6 * np.linalg.norm(tree.gravity):
        raise ModelError(
            "the floor of a robot that stands is horizontal, but gravity is not along z",
            where="[robot] gravity",
            fix="give gravity along -z of the world, or leave it out",
        )
    points = points_of_feet(tree, stance, joints)
    load = stance.least_load * weight / len(points)
    places = places_of_feet(tree, stance, joints)
    return FeetForces(tree, tuple(points), places, load, stance.friction, limits)


def zero_moment_margin(forces: FeetForces, trajectory: ExactTrajectory, samples: int) -> float:
    """Least distance of the zero-moment point from the edges of the support polygon [m].

    At samples of the motion of the tree's joints; negative outside.
    """
    from scipy.spatial import ConvexHull

    t = np.linspace(0.0, trajectory.duration, samples)
    q, dq, ddq = (trajectory.derivative(t, order) for order in range(3))
    count = len(forces.points)
    load = forces.margins(q, dq, ddq).values[:, :count] + forces.least
    place = load @ forces.places[:, :2] / load.sum(axis=1, keepdims=True)
    edges = ConvexHull(forces.places[:, :2]).equations
    return float(-(place @ edges[:, :2].T + edges[:, 2]).max())
