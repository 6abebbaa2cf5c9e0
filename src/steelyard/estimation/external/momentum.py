r"""External efforts by the generalised momentum: no accelerations are needed [DeLuca2005].

Between two samples the momentum changes by $\Delta p = \int (\tau + u + \tau_e)\,dt$, see
`observed`, so that $s = \Delta p / \Delta t - \overline{\tau + u}$ is the mean external effort, and
the observer of first order with bandwidth $b$ follows it as $r \leftarrow a r + (1 - a) s$ with
$a = e^{-2 \pi b \Delta t}$.
"""

import numpy as np

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
