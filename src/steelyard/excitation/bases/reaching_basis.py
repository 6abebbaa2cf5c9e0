"""A basis of minimum-jerk moves between postures."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.excitation.bases.linear_basis import LinearBasis, check_times, checked_postures
from steelyard.excitation.trajectories.minimum_jerk import through_postures
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion


@dataclass(frozen=True, eq=False)
class ReachingBasis(LinearBasis):
    """Minimum-jerk moves between postures; the postures are the coefficients.

    Attributes:
        joints: Number of joints `n`.
        targets: Postures to choose `m`; without a `start`, the first of them is the start.
        move_s: Time of every move [s].
        dwell_s: Time to stand after every move [s].
        start: Posture at the start, shape `(n,)`, if it is not to be chosen.
        closed: Whether a last move leads back to the start.
    """

    joints: int
    targets: int
    move_s: float
    dwell_s: float = 0.0
    start: Array | None = None
    closed: bool = True

    def __post_init__(self) -> None:
        check_times(move_s=self.move_s)
        checked_postures(self.joints, self.start)
        if self.targets < (fewest := 2 - len(self.prescribed_postures)):
            raise ValueError(f"{self.targets} targets are no motion, {fewest} or more are")
        self.made_of(np.zeros((1, self.count + len(self.prescribed_postures))))

    @property
    def count(self) -> int:
        """Functions per joint: one a target."""
        return self.targets

    @property
    def highest(self) -> float:
        """A move's acceleration is about one sine long [Hz]."""
        return 1.0 / self.move_s

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """The start, if it is given."""
        return checked_postures(self.joints, self.start)

    def still(self, posture: Array) -> Array:
        """All targets at the posture, or at the start if it is given, shape `(n, m)`."""
        (place,) = self.prescribed_postures or (posture,)
        return np.repeat(frozen(place, (self.joints,))[:, None], self.targets, axis=1)

    def made_of(self, rows: Array) -> PiecewiseMotion:
        """The motion through the postures in the columns, shape `(k, m + p)`."""
        postures = np.roll(rows.T, len(self.prescribed_postures), axis=0)
        if self.closed:
            postures = np.vstack([postures, postures[:1]])
        return through_postures(postures, self.move_s, self.dwell_s)
