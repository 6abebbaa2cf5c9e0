"""Trajectories whose extremes over all times are known, not only at samples."""

from typing import Any, Protocol

from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.motion import Trajectory

ORDERS = ("position", "velocity", "acceleration", "jerk")
"""Derivatives by their order."""


class ExactTrajectory(Trajectory, Protocol):
    """A motion that can be differentiated, bounded and stored.

    Attributes:
        breaks: Times, ascending, from 0 to the duration; between two of them position, velocity,
            acceleration and jerk are continuous.
    """

    @property
    def breaks(self) -> Array:
        """Shape `(k,)` [s]."""
        ...

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Order 0 (position) to 4 at times `t` from 0 to the duration, shape `(N, n)`."""
        ...

    def extremes(self, order: int) -> tuple[Array, Array]:
        """Least and greatest value over all times, each `(n,)`; orders as those of `derivative`.

        Both sides of a break count.
        """
        ...

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON, with a `kind`."""
        ...
