"""How fast a tool moves and how far off a straight line, proven for all times of a motion."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.constraints.bounding import Stretches, proven_minimum
from steelyard.excitation.constraints.markers import paths
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.kernel.quantities.kinematics import FrameKinematics, Points, points_on

_STRETCHES = 64
"""Stretches of time that a proof begins with."""


@dataclass(frozen=True)
class Extent:
    """Bounds over all times.

    Attributes:
        speed: Of the tool's origin [m/s].
        acceleration: Likewise [m/s²].
        deviation: Distance from the straight line [m]; 0 where there is none.
    """

    speed: float
    acceleration: float
    deviation: float


@dataclass(frozen=True, eq=False)
class ToolWay:
    """The way of a frame's origin.

    Attributes:
        kinematics: Of the frame.
        points: Its origin.
    """

    kinematics: FrameKinematics
    points: Points

    @classmethod
    def of(cls, kinematics: FrameKinematics) -> "ToolWay":
        """Of a frame."""
        frame = kinematics.frame
        points = points_on(kinematics.robot, [frame.body], frame.position[None])
        return cls(kinematics, points)

    def seen(self, motion: ExactTrajectory, t: Array) -> tuple[float, float]:
        r"""Greatest speed and acceleration at times [m/s, m/s²].

        $v = J \dot q$ and $a = J \ddot q + \dot J \dot q$, the second from the Jacobian's change
        along the way.
        """
        q, dq, ddq = (motion.derivative(t, order) for order in range(3))
        jacobian, small = self.kinematics.jacobian, 1e-6
        ahead, behind = jacobian(q + small * dq)[:, :3], jacobian(q - small * dq)[:, :3]
        here = jacobian(q)[:, :3]
        speeds = np.einsum("nij,nj->ni", here, dq)
        bends = np.einsum("nij,nj->ni", here, ddq)
        bends += np.einsum("nij,nj->ni", (ahead - behind) / (2.0 * small), dq)
        speed, bend = (float(np.linalg.norm(x, axis=1).max()) for x in (speeds, bends))
        return speed, bend

    def proven(
        self,
        motion: ExactTrajectory,
        tolerances: tuple[float, float, float],
        ends: Array | None = None,
    ) -> Extent:
        """Bounds that hold at all times.

        Args:
            motion: The motion.
            tolerances: How far above what is reached the bounds of speed, acceleration and
                deviation may stay; infinite where a rough bound will do.
            ends: Two places on the straight line, shape `(2, 3)` [m]; none by default.
        """
        normals = np.zeros((0, 3)) if ends is None else _across(ends[1] - ends[0])
        levels = np.zeros(0) if ends is None else normals @ ends[0]

        def bound(stretches: Stretches) -> tuple[Array, Array]:
            path = paths(self.points, stretches)
            speed, bend = _size(path.speeds[:, 0]), _size(path.bends[:, 0])
            sharp = _size(np.stack(stretches.middles(self.points.bend)))
            off = np.array([path.along(0, n) - d for n, d in zip(normals, levels, strict=True)])
            away = np.zeros((2, len(speed)))
            if len(off):
                away = np.linalg.norm(np.abs(off).max(axis=2), axis=0)
            middle = np.stack([speed, sharp, away[0]])
            over = np.stack([speed + stretches.half * bend, bend, away[1]])
            return -middle, -over

        least = proven_minimum(motion, bound, np.array(tolerances), count=_STRETCHES)
        return Extent(*(float(x) for x in -least))


def _size(bounds: Array) -> Array:
    """Greatest length of vectors within bounds `(2, 3, B)`, shape `(B,)`."""
    return np.asarray(np.linalg.norm(np.abs(bounds).max(axis=0), axis=0))


def _across(way: Array) -> Array:
    """Two unit vectors across a way, shape `(2, 3)`."""
    along = way / np.linalg.norm(way)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])
