"""Speed, acceleration and way off a line of the tool: bounds over all times of a motion."""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.collision.shape_kinematics import axes_along
from steelyard.excite.constraints.bounds_at_all_times import Stretches, proven_minimum
from steelyard.excite.constraints.tool_workspace import paths
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.model.equations.frame_kinematics import FrameKinematics, points_on

_FIRST_STRETCHES = 64  # stretches of time that a proof begins with


@dataclass(frozen=True)
class Extent:
    """Bounds over all times of the tool's speed [m/s], acceleration [m/s²], way off a line [m]."""

    speed: float
    acceleration: float
    deviation: float


class ToolWay:
    """The way of a frame's origin."""

    def __init__(self, kinematics: FrameKinematics) -> None:
        frame = kinematics.frame
        self.kinematics = kinematics
        self.points = points_on(kinematics.robot, [frame.body], frame.position[None])

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

        They may stay the tolerances above what is reached, of speed, acceleration and deviation;
        infinite where a rough bound will do. The straight line is through two `ends`, `(2, 3)` [m],
        if given.
        """
        normals = np.zeros((0, 3)) if ends is None else axes_along(ends[1] - ends[0])[:, :2].T
        levels = np.zeros(0) if ends is None else normals @ ends[0]

        def bound(stretches: Stretches) -> tuple[Array, Array]:
            path = paths(self.points, stretches)
            speed, bend = _greatest_length(path.speeds[:, 0]), _greatest_length(path.bends[:, 0])
            sharp = _greatest_length(np.stack(stretches.middles(self.points.bend)))
            off = np.array([path.along(0, n) - d for n, d in zip(normals, levels, strict=True)])
            away = np.zeros((2, len(speed)))
            if len(off):
                away = np.linalg.norm(np.abs(off).max(axis=2), axis=0)
            middle = np.stack([speed, sharp, away[0]])
            over = np.stack([speed + stretches.half * bend, bend, away[1]])
            return -middle, -over

        least = proven_minimum(motion, bound, np.array(tolerances), count=_FIRST_STRETCHES)
        return Extent(*(float(x) for x in -least))


def _greatest_length(bounds: Array) -> Array:
    """Greatest length of vectors within bounds `(2, 3, B)`, shape `(B,)`."""
    return np.asarray(np.linalg.norm(np.abs(bounds).max(axis=0), axis=0))
