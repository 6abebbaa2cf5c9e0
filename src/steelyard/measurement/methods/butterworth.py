"""The method `butterworth`: zero-phase low-pass, derivatives exact in its band."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.measurement.convolve import Bank, Response, Single
from steelyard.measurement.methods.derivative import differentiated
from steelyard.measurement.methods.lowpass import ORDER, butterworth, settling
from steelyard.measurement.methods.passes import (
    check_passes,
    repeated_response,
    repeated_smoother,
)
from steelyard.measurement.methods.protocols import Designed

HIGHEST_ORDER = 12
"""Beyond it the response rings like an ideal low-pass."""


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass of positions, and of logged velocities.

    Attributes:
        order: Order of the filter that is run forward and backward.
        passes: How often that is done.
    """

    name: ClassVar[str] = "butterworth"
    order: int = ORDER
    passes: int = 1

    def __post_init__(self) -> None:
        check_passes(self.passes, self.name)
        if not 1 < self.order <= HIGHEST_ORDER:
            raise ModelError(
                f"a Butterworth low-pass of order {self.order} cannot be differentiated twice"
                if self.order < 2
                else f"a Butterworth low-pass of order {self.order} rings",
                where="butterworth",
                fix=f"choose an order from 2 to {HIGHEST_ORDER}",
            )

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filter and its derivatives for a cut-off [Hz] and a rate [Hz]."""
        halo = self.passes * settling(cutoff, rate, self.order)
        response = repeated_response(butterworth(cutoff, rate, self.order), self.passes)
        return Differentiating(response, halo, rate)

    def smooth(self, cutoff: float, rate: float) -> Single:
        """The filter alone, for efforts."""
        halo = settling(cutoff, rate, self.order)
        bank = Bank([butterworth(cutoff, rate, self.order)], halo)
        return repeated_smoother(bank, self.passes)


class Differentiating:
    """A symmetric low-pass and its exact derivatives; halo and results as in `Designed`.

    Args:
        response: The low-pass; it must vanish at half the rate.
        halo: Samples on each side after which its impulse response has died out.
        rate: [Hz].
    """

    def __init__(self, response: Response, halo: int, rate: float) -> None:
        rows = [differentiated(response, rate, times) for times in range(3)]
        self._twice, self._once = Bank(rows, halo), Bank(rows[:2], halo)
        self._smooth = Bank(rows[:1], halo)

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return self._twice.halo

    def __call__(self, q: Array, dq: Array | None) -> Array:
        """Positions, and velocities if logged, to motion; see `Designed`."""
        if dq is None:
            return self._twice(q)
        return np.concatenate((self._smooth(q), self._once(dq)))
