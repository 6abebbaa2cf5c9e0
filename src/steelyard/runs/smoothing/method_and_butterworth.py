"""What a method of `[processing] motion` is, and the method `butterworth`.

A method is a frozen dataclass of settings with a name; `designed` makes of it, for a cut-off and a
rate, a pure function from measured channels to motion. A local one says its halo, and any split of
a segment into parts gives the same; one without a halo is given the whole segment at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.runs.smoothing.zero_phase_filters import (
    LOWPASS_ORDER,
    Bank,
    butterworth,
    check_passes,
    low_pass,
    repeated_response,
    repeated_smoother,
    settling,
)


class Designed:
    """A method or a smoother made for one cut-off and rate.

    A method takes positions with context, `(n, N + 2 halo)` [rad; m], and velocities likewise
    [rad/s; m/s], or `None` where positions are to be differentiated, to `q, dq, ddq`, `(3, n, N)`.
    A smoother takes channels to channels. Without a halo, a sample depends on all of its segment,
    which is given at once.
    """

    def __init__(self, function: Callable[..., Array], halo: int | None = None) -> None:
        self._function, self.halo = function, halo

    def __call__(self, *channels: Array | None) -> Array:
        """The results."""
        return self._function(*channels)


def derived_jointly(states: Callable[[Array, int], Array]) -> Designed:
    """A method by a smoother that gives channels `(n, N)` and their derivatives, `(3, n, N)`.

    The second argument of `states` is the derivative that is white noise: 3 for positions, 2 for
    logged velocities.
    """

    def motion(q: Array, dq: Array | None) -> Array:
        position = states(q, 3)
        if dq is None:
            return position
        velocity = states(dq, 2)
        return np.stack((position[0], velocity[0], velocity[1]))

    return Designed(motion)


@runtime_checkable
class Method(Protocol):
    """A way from positions to motion: `motion = ...` under `[processing]`; frozen dataclass."""

    name: ClassVar[str]

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The method for a cut-off up to which motion is kept and a rate, above twice that [Hz]."""
        ...


@runtime_checkable
class Choosing(Method, Protocol):
    """A method some settings of which come from the log: `prepare` calls it once per log."""

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> Method:
        """The method with what is not given found in an even stretch of a log, `(n, N)`.

        The motion lives below the `band` [Hz]; `whole` allows work on the log as a whole.
        """
        ...


@runtime_checkable
class Smoother(Protocol):
    """A way to smooth efforts: `effort = ...` under `[processing]`; frozen dataclass."""

    name: ClassVar[str]

    def smooth(self, cutoff: float, rate: float) -> Bank | Designed:
        """The smoother for a cut-off and a rate, above twice that [Hz]."""
        ...


HIGHEST_ORDER = 12  # beyond it the response rings like an ideal low-pass


@dataclass(frozen=True)
class Butterworth:
    """Zero-phase Butterworth low-pass of positions, and of logged velocities."""

    name: ClassVar[str] = "butterworth"
    order: int = LOWPASS_ORDER  # order of the filter that is run forward and backward
    passes: int = 1  # how often that is done

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
        return differentiating(Bank.derivatives(response, halo, rate, 2).taps)

    def smooth(self, cutoff: float, rate: float) -> Bank:
        """The filter alone, for efforts."""
        return repeated_smoother(low_pass(cutoff, rate, self.order).taps[0], self.passes)


def differentiating(rows: Array) -> Designed:
    """Motion by the taps of a low-pass, its first and second derivative, `(3, 2 halo + 1)`."""
    twice, once, low = Bank(rows), Bank(rows[:2]), Bank(rows[:1])

    def motion(q: Array, dq: Array | None) -> Array:
        return twice(q) if dq is None else np.concatenate((low(q), once(dq)))

    return Designed(motion, twice.halo)
