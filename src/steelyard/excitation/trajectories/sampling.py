"""Samples of a trajectory that stands still before its start and after its end."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import frozen
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.motion import Motion


def sampled(trajectory: ExactTrajectory, t: ArrayLike) -> Motion:
    """The motion at times `t`, shape `(N,)` [s]; at rest before its start and after its end."""
    t = frozen(t, (None,))
    clipped = np.clip(t, 0.0, trajectory.duration)
    inside = ((t >= 0.0) & (t <= trajectory.duration))[:, None]
    q, dq, ddq = (trajectory.derivative(clipped, order) for order in range(3))
    return Motion(t, q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0))
