"""How noisy sampled signals are, from the signals alone."""

import numpy as np

from steelyard.arrays import Array

_ORDER = 4
_NORM = np.sqrt(70.0)
"""Size of a fourth difference of white noise of size 1: the root of 1 + 16 + 36 + 16 + 1."""

_GAUSSIAN = 1.482602218505602
"""Standard deviation over the median size of normal numbers."""


def white_noise(values: Array) -> Array:
    """Standard deviation of the white noise on smooth signals, shape `(C,)`.

    Fourth differences hold next to nothing of what is smooth; their median size does not mind a few
    jumps.

    Args:
        values: Uniform samples, shape `(N, C)`.
    """
    differences = np.diff(values, n=_ORDER, axis=0)
    return np.asarray(_GAUSSIAN * np.median(np.abs(differences), axis=0) / _NORM)


def torque_noise(tau: Array, q: Array) -> Array:
    """Standard deviation of what torque sensors add, shape `(n,)`.

    A controller answers the noise of measured positions with real torques. What follows that noise,
    at the same sample or a neighbour, is therefore no noise of the torque.

    Args:
        tau: Torques, uniform samples, shape `(N, n)`.
        q: Positions of the same joints and samples, not filtered, shape `(N, n)`.
    """
    noisy, answered = (np.diff(x, n=_ORDER, axis=0) for x in (tau, q))
    rest = noisy[1:-1].copy()
    for joint in range(tau.shape[1]):
        own = answered[:, joint]
        near = np.column_stack((own[:-2], own[1:-1], own[2:]))
        rest[:, joint] -= near @ np.linalg.lstsq(near, rest[:, joint], rcond=None)[0]
    return np.asarray(_GAUSSIAN * np.median(np.abs(rest), axis=0) / _NORM)
