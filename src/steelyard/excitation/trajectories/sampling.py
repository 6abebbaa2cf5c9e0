"""Samples of a trajectory that stands still before its start and after its end."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.motion import Motion, sample_times


def sampled(trajectory: ExactTrajectory, t: ArrayLike) -> Motion:
    """The motion at times `t`, shape `(N,)` or one number [s]; at rest outside its time."""
    t = sample_times(t)
    clipped = np.clip(t, 0.0, trajectory.duration)
    inside = ((t >= 0.0) & (t <= trajectory.duration))[:, None]
    q, dq, ddq = (trajectory.derivative(clipped, order) for order in range(3))
    return Motion(t, q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0))
