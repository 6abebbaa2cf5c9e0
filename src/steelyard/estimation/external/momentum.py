r"""External efforts by the generalised momentum: no accelerations are needed [DeLuca2005].

Between two samples the momentum changes by $\Delta p = \int (\tau + u + \tau_e)\,dt$, see
`observed`, so that $s = \Delta p / \Delta t - \overline{\tau + u}$ is the mean external effort, and
the observer of first order with bandwidth $b$ follows it as $r \leftarrow a r + (1 - a) s$ with
$a = e^{-2 \pi b \Delta t}$.
"""

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError

PER_PERIOD = 10.0
"""Samples that a period of the observer's bandwidth needs."""

NOISE = 0.5 * np.pi
"""Noise bandwidth of a low-pass of first order over its bandwidth."""


def check_bandwidth(bandwidth: float) -> None:
    """Check a bandwidth.

    Raises:
        DataError: It is not above zero.
    """
    if not 0.0 < bandwidth < np.inf:
        raise DataError(
            f"{bandwidth:g} Hz is no bandwidth",
            where="observer of external efforts",
            fix="give a frequency above zero, such as 8 Hz",
        )


def momentum_residual(momentum: Array, effort: Array, rate: float) -> Array:
    r"""External efforts along one segment, not low-passed, shape `(N, n)` [Nm; N].

    That of a sample is the mean of $s$ before and after it; zero where there is one sample alone.

    Args:
        momentum: Shape `(N, n)`.
        effort: Joint efforts and what else drives the momentum, $\tau + u$, shape `(N, n)`.
        rate: Of the samples [Hz].
    """
    if len(momentum) < 2:
        return np.zeros_like(momentum)
    between = rate * np.diff(momentum, axis=0) - 0.5 * (effort[1:] + effort[:-1])
    return np.asarray(
        0.5 * (between[[0, *range(len(between))]] + between[[*range(len(between)), -1]])
    )
