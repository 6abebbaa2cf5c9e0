r"""The motion of a floating base, and what contacts add to the efforts, from logged columns.

Rows have six channels of the base: its proper acceleration or its place, and its angular velocity
or roll, pitch and yaw $\phi, \theta, \psi$ of its orientation $R_z(\psi) R_y(\theta) R_x(\phi)$.
They are smoothed and differentiated as positions of joints are. From these and their derivatives
come, along the base link's axes,

$$ \omega = \begin{bmatrix} \dot\phi - \dot\psi s_\theta \\
   \dot\theta c_\phi + \dot\psi s_\phi c_\theta \\
   -\dot\theta s_\phi + \dot\psi c_\phi c_\theta \end{bmatrix}, \qquad a = R^T (\ddot p - g), $$

and at the origin of the base frame, with the sensor at $r$,
$a_0 = a - \dot\omega \times r - \omega \times (\omega \times r)$.
"""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.robot import BASE_COORDINATES
from steelyard.runs.frames_of_contacts import kinematics_of

STEEPEST = np.deg2rad(80.0)
"""Pitch beyond which roll and yaw do not tell an orientation well."""


def rotations(values: Array, kind: str) -> Array:
    """Rotation matrices `(N, 3, 3)` of logged orientations `(N, 3, 4 or 9)`."""
    if kind == "matrix":
        return values.reshape(-1, 3, 3)
    if kind in ("wxyz", "xyzw"):
        order = (0, 1, 2, 3) if kind == "wxyz" else (3, 0, 1, 2)
        with np.errstate(invalid="ignore", divide="ignore"):
            w, x, y, z = (values[:, order] / np.linalg.norm(values, axis=1, keepdims=True)).T
        entries = [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ]  # fmt: skip
        return np.stack(entries, axis=1).reshape(-1, 3, 3)
    return of_angles((np.pi / 180.0 if kind == "rpy_deg" else 1.0) * values.T)


def of_angles(angles: Array) -> Array:
    """Rotation matrices `(N, 3, 3)` of roll, pitch and yaw `(3, N)` [rad]."""
    (a, b, c), (d, e, f) = np.cos(angles), np.sin(angles)
    entries = [
        b * c, d * e * c - a * f, a * e * c + d * f,
        b * f, d * e * f + a * c, a * e * f - d * c,
        -e, d * b, a * b,
    ]  # fmt: skip
    return np.stack(entries, axis=1).reshape(-1, 3, 3)


def base_channels(base: BaseSignals, logged: Array, where: str) -> tuple[Array, Array | None]:
    """Channels of the base `(N, 6)` from its logged columns, and axes `(N, 3, 3)` in the world.

    The axes are those of the base link; `None` if no orientation is logged.
    """
    split = np.split(logged, np.cumsum([3, len(base.angular_velocity)]), axis=1)
    translation, velocity, orientation = split
    axes = None
    if base.orientation:
        sensor = rotations(orientation, base.orientation_kind)
        axes = sensor @ np.reshape(base.axes, (3, 3)).T
    if base.angular_velocity:
        turning = base.angular_scale * velocity - np.array(base.angular_bias)
    else:
        assert axes is not None
        turning = _angles(axes, base.tracked, where)
    return np.hstack([base.scale * translation - np.array(base.bias), turning]), axes


def _angles(axes: Array, tracked: bool, where: str) -> Array:
    """Roll, pitch and yaw `(N, 3)` [rad] of the base link's axes `(N, 3, 3)`."""
    with np.errstate(invalid="ignore"):
        pitch = np.arcsin(np.clip(-axes[:, 2, 0], -1.0, 1.0))
        steep = np.abs(pitch) > STEEPEST
    if steep.any():
        raise LogError(
            f"the base pitches by {np.rad2deg(pitch[steep][0]):.0f}°, where roll and yaw are not "
            "distinct",
            where=where,
            fix="name a window of the log without that: LOG@START:STOP"
            if tracked
            else "log angular_velocity of a gyroscope, and name it under [signals.base]",
        )
    roll = np.arctan2(axes[:, 2, 1], axes[:, 2, 2])
    return np.column_stack([roll, pitch, np.arctan2(axes[:, 1, 0], axes[:, 0, 0])])


def base_motion(base: BaseSignals, z: Array, dz: Array, ddz: Array) -> tuple[Array, Array]:
    """Entries of the base in `dq` and `ddq`, `(6, N)`, of its channels and derivatives `(6, N)`."""
    velocity = np.zeros((3, z.shape[1]))
    axes, place = np.reshape(base.axes, (3, 3)), np.reshape(base.place, (3, 1))
    if base.angular_velocity:
        omega, alpha = axes @ z[3:], axes @ dz[3:]
    else:
        omega, alpha = _rates(z[3:], dz[3:], ddz[3:])
    acceleration = axes @ z[:3]
    if base.tracked:
        back = of_angles(z[3:]).transpose(0, 2, 1)
        world = ddz[:3] - np.reshape(base.gravity, (3, 1))
        acceleration, velocity = (np.einsum("nij,jn->in", back, x) for x in (world, dz[:3]))
    swing = _cross(omega, place)
    acceleration = acceleration - _cross(alpha, place) - _cross(omega, swing)
    if base.tracked:
        velocity = velocity - swing
    return np.concatenate([velocity, omega]), np.concatenate([acceleration, alpha])


def with_base_motion(
    base: BaseSignals, q: Array, dq: Array, ddq: Array
) -> tuple[Array, Array, Array]:
    """Motion `(n, N)` of all coordinates of a floating robot, channels of its base in their places.

    Positions of the base, which nothing depends on, are zero.
    """
    n = len(BASE_COORDINATES)
    velocity, acceleration = base_motion(base, q[:n], dq[:n], ddq[:n])
    rest = np.zeros((n, q.shape[1]))
    first = (rest, velocity, acceleration)
    q, dq, ddq = (np.concatenate([x, y[n:]]) for x, y in zip(first, (q, dq, ddq), strict=True))
    return q, dq, ddq


def _rates(angles: Array, d: Array, dd: Array) -> tuple[Array, Array]:
    """Angular velocity and acceleration along the turned axes, of roll, pitch, yaw `(3, N)`."""
    (cr, cp, _), (sr, sp, _) = np.cos(angles), np.sin(angles)
    (r, p, y), (rr, pp, yy) = d, dd
    omega = np.stack([r - y * sp, p * cr + y * sr * cp, -p * sr + y * cr * cp])
    alpha = np.stack(
        [
            rr - yy * sp - y * p * cp,
            pp * cr - p * r * sr + yy * sr * cp + y * (r * cr * cp - p * sr * sp),
            -pp * sr - p * r * cr + yy * cr * cp - y * (r * sr * cp + p * cr * sp),
        ]
    )
    return omega, alpha


def _cross(a: Array, b: Array) -> Array:
    return np.cross(a, np.broadcast_to(b, a.shape), axis=0)


def contact_efforts(base: BaseSignals, q: Array, pushes: Array, axes: Array | None) -> Array:
    r"""Efforts $\sum J^T F$ `(N, n)` of logged contacts, at positions `(N, n)`; in Nm and N."""
    efforts, first = np.zeros(q.shape), 0
    known = np.isfinite(q).all(axis=1) & np.isfinite(pushes).all(axis=1)
    frames = tuple(contact.frame for contact in base.contacts)
    for contact, kinematics in zip(base.contacts, kinematics_of(base, frames), strict=True):
        count = len(contact.columns)
        _, turn, jacobian = kinematics(q[known])
        if contact.in_world:
            assert axes is not None
            turn = axes[known].transpose(0, 2, 1)
        wrench = pushes[known, first : first + count].reshape(-1, count // 3, 3)
        turned = np.einsum("nij,nkj->nki", turn, wrench).reshape(-1, count)
        efforts[known] += np.einsum("nki,nk->ni", jacobian[:, :count], turned)
        first += count
    efforts[~known] = np.nan
    return efforts
