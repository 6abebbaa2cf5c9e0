"""How a tool is oriented while it moves: anyhow, or along a direction."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen


class Attitude(Protocol):
    """Requirements on a frame's orientation, as turns that must be zero.

    Attributes:
        rows: Number of turns `k` that must be zero, 0 to 2.
    """

    @property
    def rows(self) -> int:
        """Number of turns that must be zero."""
        ...

    def turns(self, rotation: Array) -> Array:
        """Turns that are left to make, shape `(N, k)` [rad], at orientations `(N, 3, 3)`."""
        ...

    def slopes(self, angular: Array) -> Array:
        """How the turns made grow with the joints, `(N, k, n)`, from rates `(N, 3, n)`."""
        ...


@dataclass(frozen=True)
class AnyAttitude:
    """The tool may turn as it likes."""

    rows: int = 0

    def turns(self, rotation: Array) -> Array:
        """Nothing is left to turn, shape `(N, 0)`."""
        return np.zeros((len(rotation), 0))

    def slopes(self, angular: Array) -> Array:
        """No rows, shape `(N, 0, n)`."""
        return angular[:, :0]


@dataclass(frozen=True, eq=False)
class Pointing:
    """An axis of the tool points in a direction; the turn about it is free.

    Attributes:
        direction: Shape `(3,)`, in the base frame.
        axis: Shape `(3,)`, in the tool's frame.
        rows: Two turns, about two axes across the direction.
    """

    direction: Array
    axis: Array
    rows: int

    def __init__(self, direction: ArrayLike, axis: ArrayLike = (0.0, 0.0, 1.0)) -> None:
        for name, values in (("direction", direction), ("axis", axis)):
            vector = frozen(values, (3,))
            length = float(np.linalg.norm(vector))
            if not 1e-9 < length < np.inf:
                raise ValueError(f"the {name} of a tool has no direction: {vector}")
            object.__setattr__(self, name, frozen(vector / length))
        object.__setattr__(self, "rows", 2)

    def turns(self, rotation: Array) -> Array:
        """Turn from the tool's axis to the direction along the two cross axes, `(N, 2)` [rad]."""
        axis = rotation @ self.axis
        normal = np.cross(axis, self.direction)
        sine = np.linalg.norm(normal, axis=1)
        angle = np.arctan2(sine, axis @ self.direction)
        across = self._across
        opposite = (sine < 1e-9) & (angle > 1.0)
        normal[opposite], sine[opposite] = across[0], 1.0
        length = np.where(sine < 1e-12, 1.0, angle / np.maximum(sine, 1e-12))
        turned: Array = (normal * length[:, None]) @ across.T
        return turned

    def slopes(self, angular: Array) -> Array:
        """Turning rates about the two cross axes, shape `(N, 2, n)`."""
        rates: Array = self._across @ angular
        return rates

    @cached_property
    def _across(self) -> Array:
        """Two unit vectors across the direction, shape `(2, 3)`."""
        least = np.eye(3)[int(np.argmin(np.abs(self.direction)))]
        first = np.cross(self.direction, least)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(self.direction, first)])
