"""Whether residuals of a stream are those of contact, or of other efforts than the model's."""

import numpy as np

from steelyard.application.other_efforts import LARGE, LEAST_EXPLAINED
from steelyard.arrays import Array

OFTEN = 0.5
"""Share of the time from which on residuals beyond their thresholds mean that something lasts."""

LASTING = 5.0
"""Time of samples, or of residuals beyond their thresholds, from which on it is said [s]."""

LIKELIER = "other efforts, units or signs, a payload or another tool are likelier than contact"


class Doubt:
    """Counts what `steelyard contact` refuses or warns of, sample by sample.

    Attributes:
        text: Why residuals may be no contact, for people to read; empty without doubt.
    """

    def __init__(self, sigma: Array) -> None:
        """Begin.

        Args:
            sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
        """
        self.text = ""
        self._weights = 1.0 / np.square(sigma)
        self._seconds = self._beyond = 0.0
        self._squares = np.zeros(2)

    def step(self, seconds: float, beyond: bool, residual: Array, measured: Array) -> None:
        """Take the next sample.

        Args:
            seconds: Time since the sample before; zero after a pause.
            beyond: Whether a residual is beyond its threshold.
            residual: Shape `(n,)` [Nm; N].
            measured: Measured effort, likewise.
        """
        self._seconds += seconds
        self._beyond += seconds * beyond
        sizes = (residual @ (self._weights * residual), measured @ (self._weights * measured))
        self._squares += seconds / len(residual) * np.array(sizes)
        if self._seconds < LASTING:
            return
        left, whole = (float(x) / self._seconds for x in self._squares)
        if left > LARGE**2 and left > (1.0 - LEAST_EXPLAINED) * whole:
            share = max(0.0, 1.0 - left / whole) if whole else 0.0
            self.text = (
                f"the model explains {100.0 * share:.0f} % of the squared efforts of "
                f"{self._seconds:.0f} s: {LIKELIER}"
            )
        elif self._beyond > max(LASTING, OFTEN * self._seconds):
            self.text = (
                f"residuals exceed their thresholds in {self._beyond:.0f} of {self._seconds:.0f} "
                f"s: {LIKELIER}"
            )
