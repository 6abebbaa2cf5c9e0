"""Families of motions that are linear in their coefficients."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.excitation.trajectories.exact import ExactTrajectory

SAME = 1e-6
"""Relative difference up to which two motions are one."""


class Basis(Protocol):
    r"""Functions $\phi_i$ that all joints share: $q_j(t) = o_j(t) + \sum_i x_{ji} \phi_i(t)$.

    Attributes:
        joints: Number of joints `n`.
        count: Functions per joint `m`.
        duration: Length in time [s].
        highest: The highest frequency that the functions hold [Hz]; says how densely to sample.
    """

    @property
    def joints(self) -> int:
        """Number of joints."""
        ...

    @property
    def count(self) -> int:
        """Functions per joint."""
        ...

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        ...

    @property
    def highest(self) -> float:
        """Highest frequency that the functions hold [Hz]."""
        ...

    def shapes(self, t: ArrayLike, order: int) -> Array:
        """The functions, or their derivative of order 1 to 3, shape `(N, m)`."""
        ...

    def offset(self, t: ArrayLike, order: int) -> Array:
        """What is there without coefficients, shape `(N, n)`."""
        ...

    def still(self, posture: Array) -> Array:
        """Coefficients, shape `(n, m)`, of standing still at `posture` `(n,)`.

        Where the basis prescribes a start posture, it stands there.
        """
        ...

    def motion(self, x: Array) -> ExactTrajectory:
        """The motion of coefficients `x`, shape `(n, m)`."""
        ...


def coefficients_of(basis: Basis, trajectory: ExactTrajectory) -> Array | None:
    """Coefficients, shape `(n, m)`, of a motion; `None` if it is none of the basis.

    Args:
        basis: The family.
        trajectory: The motion.
    """
    if abs(trajectory.duration - basis.duration) > SAME * basis.duration:
        return None
    samples = int(np.ceil(8.0 * max(basis.highest * basis.duration, basis.count))) + 1
    t = np.linspace(0.0, basis.duration, samples)
    q = trajectory.derivative(t, 0)
    if q.shape[1] != basis.joints:
        return None
    shapes, rest = basis.shapes(t, 0), q - basis.offset(t, 0)
    found = np.linalg.lstsq(shapes, rest, rcond=None)[0]
    if np.abs(shapes @ found - rest).max() > SAME * max(1.0, float(np.abs(q).max())):
        return None
    return np.asarray(found.T)
