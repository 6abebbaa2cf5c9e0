"""What a method of motion does to noise: its responses to a single sample."""

import numpy as np

from steelyard.arrays import Array
from steelyard.measurement.methods.butterworth import Butterworth
from steelyard.measurement.methods.protocols import Method


def responses(method: Method, cutoff: float, rate: float, joints: int) -> tuple[Array, Array]:
    """Responses of a local method to one sample; of the Butterworth low-pass for others.

    Args:
        method: A linear method.
        cutoff: [Hz].
        rate: [Hz].
        joints: Number of joints, n.

    Returns:
        Position, velocity and acceleration after one position, shape `(3, n, 2 halo + 1)`, and
        velocity after one logged velocity, shape `(n, 2 halo + 1)`.
    """
    of_position, of_velocity = motion_responses(method, cutoff, rate, joints)
    return of_position, of_velocity[1]


def motion_responses(
    method: Method, cutoff: float, rate: float, joints: int
) -> tuple[Array, Array]:
    """The same; after one logged velocity too all three, shape `(3, n, 2 halo + 1)`."""
    designed = method.designed(cutoff, rate)
    if designed.halo is None:
        designed = Butterworth().designed(cutoff, rate)
    halo = designed.halo or 0
    impulse = np.zeros((joints, 4 * halo + 1))
    impulse[:, 2 * halo] = 1.0
    return designed(impulse, None), designed(np.zeros_like(impulse), impulse)


def noise_gain(response: Array, rate: float) -> Array:
    """Standard deviations of filters' results for white noise of density 1 per Hz, `(n,)`."""
    return np.asarray(np.sqrt(0.5 * rate * np.square(response).sum(axis=-1)))
