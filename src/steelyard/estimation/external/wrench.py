r"""From external joint efforts to the wrench that makes them.

A wrench $F$ on a frame makes efforts $\tau = J^T F$. With the covariance $S$ of what the model
predicts wrongly, and wrenches of the expected size $P$,

$$\hat F = (J S^{-1} J^T + P^{-1})^{-1} J S^{-1} \tau = P J (J^T P J + S)^{-1} \tau$$

with the covariance $P - P J (J^T P J + S)^{-1} J^T P$. The second form needs no inverse of $J$: it
is finite in singular postures, for any number of joints. What no effort shows stays at zero, with
an interval as wide as the expected size.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError

FORCE = 30.0
"""Expected size of a force [N]: a firm push."""

LEVER = 0.1
"""Expected distance of a force from the frame's origin [m]."""


@dataclass(frozen=True)
class Expected:
    """The size that wrenches are expected to have.

    Attributes:
        force: Standard deviation of each component of the force [N].
        lever: That of each component of the moment, over `force` [m]; 0 for forces at the origin.
    """

    force: float = FORCE
    lever: float = LEVER

    def __post_init__(self) -> None:
        if not (0.0 < self.force < np.inf and 0.0 <= self.lever < np.inf):
            raise DataError(
                f"a force of {self.force:g} N with a lever of {self.lever:g} m is no expected size",
                where="expected wrench",
                fix="give the size of a usual force, such as 30 N, and how far from the frame's "
                "origin it acts, such as 0.1 m",
            )

    @property
    def variances(self) -> Array:
        """Diagonal of $P$, shape `(6,)`."""
        moment = self.force * self.lever
        return frozen(np.repeat(np.square([self.force, moment]), 3))
