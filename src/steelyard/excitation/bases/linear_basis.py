"""What all bases share: their functions are the motions of unit coefficients."""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.excitation.trajectories.exact import ExactTrajectory


class LinearBasis(ABC):
    r"""A family of motions $q_j(t) = \sum_i x_{ji} \phi_i(t) + \sum_h p_{jh} \psi_h(t)$.

    The `x` are its coefficients, and the `p` prescribed postures. A member only says how a
    motion is made of both; all functions are then that motion for a row of ones and zeros.

    Attributes:
        joints: Number of joints `n`.
    """

    joints: int

    @property
    @abstractmethod
    def count(self) -> int:
        """Functions per joint `m`."""

    @property
    @abstractmethod
    def highest(self) -> float:
        """The highest frequency that the functions hold [Hz]."""

    @property
    @abstractmethod
    def prescribed_postures(self) -> tuple[Array, ...]:
        """Prescribed postures `p`, each of shape `(n,)`; may be none."""

    @abstractmethod
    def still(self, posture: Array) -> Array:
        """Coefficients, shape `(n, m)`, of standing still at `posture` or the prescribed start."""

    @abstractmethod
    def made_of(self, rows: Array) -> ExactTrajectory:
        """The motion of the coefficients and the prescribed postures, shape `(k, m + p)`."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self._units.duration

    def shapes(self, t: ArrayLike, order: int) -> Array:
        """The functions, or their derivative of order 1 to 3, shape `(N, m)`."""
        return self._units.derivative(t, order)[:, : self.count]

    def offset(self, t: ArrayLike, order: int) -> Array:
        """What is there without coefficients, shape `(N, n)`."""
        postures = np.reshape(self.prescribed_postures, (-1, self.joints))
        return self._units.derivative(t, order)[:, self.count :] @ postures

    def motion(self, x: Array) -> ExactTrajectory:
        """The motion of coefficients `x`, shape `(n, m)`."""
        x = frozen(x, (self.joints, self.count))
        return self.made_of(np.column_stack([x, *self.prescribed_postures]))

    @cached_property
    def _units(self) -> ExactTrajectory:
        return self.made_of(np.eye(self.count + len(self.prescribed_postures)))


def checked_postures(joints: int, *postures: ArrayLike | None) -> tuple[Array, ...]:
    """Those postures that are given, as arrays of shape `(n,)`.

    Raises:
        ValueError: There are no joints, or a posture is one of another number of them.
    """
    if joints < 1:
        raise ValueError(f"a motion needs a joint or more, not {joints}")
    return tuple(frozen(posture, (joints,)) for posture in postures if posture is not None)


def check_times(**seconds: float) -> None:
    """All of them are positive and finite.

    Raises:
        ValueError: Says which is not.
    """
    for name, value in seconds.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value} s: it must be above 0")
