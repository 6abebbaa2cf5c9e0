r"""What a method of motion is; zero-phase filters of signals in parts, the method `butterworth`.

A method is a frozen dataclass of settings with a name; `designed` makes of it, for a cut-off and a
rate, a pure function from measured channels to motion. A local one says its halo, and any split of
a segment into parts gives the same; one without a halo is given the whole segment at once.

An operation declares its halo: how many samples of context it needs on each side. At the ends of a
segment the signal is continued by odd reflection, $2 x_0 - x_k$, which keeps value and slope.

Forward and backward filtering with the digital Butterworth filter of order k (bilinear transform),
which is what `scipy.signal.sosfiltfilt` does, has the response
$|H|^2 = 1 / (1 + (\tan(\omega/2) / \tan(\omega_c/2))^{2 k})$. It is one half at the cut-off. Its
impulse response dies out exponentially, so a finite halo gives it to rounding.

The derivative of a band-limited signal has the response $i \omega$, in the low-pass's pass band
as well as in its transition. Central differences only approach it (with seven points they are 6.6 %
short at a quarter of the rate), so the low-pass and the derivative are designed as one filter.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError, ModelError

CHUNK = 8192  # samples that an operation is given at a time, at least


class ChunkOperation(Protocol):
    """A local operation on uniformly sampled channels; `halo`: samples of context on each side."""

    @property
    def halo(self) -> int: ...  # noqa: D102

    def __call__(self, extended: Array) -> Array:
        """Channels with context, shape `(C, N + 2 halo)`, to results, shape `(D, N)`."""


def apply(operation: ChunkOperation, parts: Iterable[Array], chunk: int = CHUNK) -> Iterator[Array]:
    """The results for one segment, in order, in parts `(D, any)`; the split changes nothing.

    At least `chunk` samples are worked on at once.
    """
    halo = operation.halo
    length = max(chunk, 4 * halo)
    buffer: Array | None = None
    begun = False
    for part in parts:
        buffer = part if buffer is None else np.concatenate((buffer, part), axis=-1)
        if not begun:
            if buffer.shape[-1] <= 2 * halo:
                continue
            buffer, begun = continued_at_ends(buffer, halo, 0), True
        while buffer.shape[-1] >= length + 2 * halo:
            yield operation(buffer[..., : length + 2 * halo])
            buffer = buffer[..., length:]
    if buffer is not None and buffer.shape[-1]:
        buffer = continued_at_ends(buffer, 0 if begun else halo, halo)
        if buffer.shape[-1] > 2 * halo:
            yield operation(buffer)


def continued_at_ends(channels: Array, before: int, after: int) -> Array:
    """Channels `(C, N)` continued by odd reflection, repeatedly if they are short."""
    if before == after == 0:
        return channels
    pad = [(0, 0)] * (channels.ndim - 1) + [(before, after)]
    return np.pad(channels, pad, mode="reflect", reflect_type="odd")


Response = Callable[[Array], Array]
"""Angular frequency per sample, in [0, pi], to the complex response of a filter."""


@dataclass(frozen=True, eq=False)
class Bank:
    """Convolutions of the same channels, with taps `(k, 2 halo + 1)`; an operation with a halo.

    The middle tap is the sample itself. Of taps `(2 halo + 1,)` it is one convolution.
    """

    taps: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "taps", frozen(self.taps))

    @classmethod
    def derivatives(cls, response: Response, halo: int, rate: float, highest: int) -> "Bank":
        """A low-pass that vanishes at half the rate [Hz], and its derivatives up to `highest`.

        All are cut off behind `halo` samples.
        """
        omega = np.linspace(0.0, np.pi, fast_length(4 * halo + 2) // 2 + 1)
        powers = (1j * omega * rate) ** np.arange(highest + 1)[:, None]
        rows = np.fft.irfft(response(omega) * powers)
        return cls(np.roll(rows, halo, axis=-1)[:, : 2 * halo + 1])

    @property
    def halo(self) -> int:
        """Samples of context on each side."""
        return int(self.taps.shape[-1] // 2)

    def __call__(self, extended: Array) -> Array:
        """Channels `(C, N + 2 halo)` to results `(k, C, N)`, of one convolution `(C, N)`."""
        width = extended.shape[-1]
        length = fast_length(width)
        spectrum = np.fft.rfft(extended, length)
        filters = np.fft.rfft(np.atleast_2d(self.taps), length)
        results = np.empty((len(filters), *extended.shape[:-1], width - 2 * self.halo))
        for result, response in zip(results, filters, strict=True):
            result[...] = np.fft.irfft(spectrum * response, length)[..., 2 * self.halo : width]
        return results if self.taps.ndim == 2 else results[0]


def fast_length(least: int) -> int:
    """The smallest even number from `least` on without prime factors above 5."""
    from scipy.fft import next_fast_len

    return 2 * int(next_fast_len(-(-least // 2), real=True))


MOST_PASSES = 20
"""The more passes, the nearer a moving average is to a Gaussian: more are another filter's work."""


def check_passes(passes: int, method: str) -> None:
    """Refuse a number of passes that is not from 1 to `MOST_PASSES`."""
    if not 1 <= passes <= MOST_PASSES:
        raise ModelError(
            f"a filter cannot be applied {passes} times",
            where=method,
            fix=f"choose a number of passes from 1 to {MOST_PASSES}",
        )


def repeated_smoother(taps: Array, passes: int) -> Bank:
    """A symmetric low-pass `(2 halo + 1,)` applied several times, as one convolution.

    At the ends of a segment, which is continued by odd reflection, it gives what a pass after the
    other gives: symmetric filters of gain 1 keep the reflection.
    """
    return Bank(convolved(taps[None], taps, passes - 1)[0])


def convolved(rows: Array, taps: Array, times: int) -> Array:
    """Filters `(k, N)` behind more passes of another one `(M,)`: `(k, N + times (M - 1))`."""
    return np.array([reduce(np.convolve, [taps] * times, row) for row in rows])


def kaiser_lowpass(suppression: float, width: float, cutoff: float) -> Array:
    r"""Coefficients of a linear-phase low-pass, odd in number, their sum 1.

    As `scipy.signal.firwin` of the length and shape that `scipy.signal.kaiserord` gives.

    Args:
        suppression: Of the stop band [dB], 8 or more.
        width: Of the transition, relative to half the sampling rate.
        cutoff: Half-amplitude frequency, likewise.
    """
    if not 0.0 < cutoff < 1.0:
        raise ValueError(f"cut-off {cutoff:g} is not between 0 and 1")
    length = int(np.ceil((suppression - 7.95) / (2.285 * np.pi * width) + 1.0))
    length += 1 - length % 2
    above = max(suppression - 21.0, 0.0)
    beta = 0.5842 * above**0.4 + 0.07886 * above
    if suppression > 50.0:
        beta = 0.1102 * (suppression - 8.7)
    middle = np.arange(length) - 0.5 * (length - 1)
    taps = cutoff * np.sinc(cutoff * middle) * np.kaiser(length, beta)
    return np.asarray(taps / taps.sum())


LOWPASS_ORDER = 4
SETTLED_TAIL = 1e-12  # what is left of the impulse response where it is cut off
SAMPLES_PER_PERIOD = 40.0  # sampling rate over cut-off at which the noise bandwidth is taken
RESPONSE_FREQUENCIES = 4096  # frequencies that it is summed over


def butterworth(cutoff: float, rate: float, order: int = LOWPASS_ORDER) -> Response:
    """Response of the Butterworth low-pass of an order, run forward and backward."""
    edge = np.tan(np.pi * cutoff / rate)

    def response(omega: Array) -> Array:
        with np.errstate(over="ignore"):
            ratio = (np.tan(np.minimum(omega, np.pi * (1.0 - 1e-12)) / 2.0) / edge) ** (2 * order)
            return np.asarray(1.0 / (1.0 + ratio))

    return response


def settling(
    cutoff: float, rate: float, order: int = LOWPASS_ORDER, tail: float = SETTLED_TAIL
) -> int:
    """Samples after which the impulse response of `butterworth` has died out to `tail`."""
    k = np.arange(order)
    poles = np.tan(np.pi * cutoff / rate) * np.exp(0.5j * np.pi * (2 * k + order + 1) / order)
    slowest = np.abs((1.0 + poles) / (1.0 - poles)).max()
    return int(np.ceil(np.log(tail) / np.log(slowest))) + 1


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as `butterworth` [Hz]."""
    omega = (np.arange(RESPONSE_FREQUENCIES) + 0.5) * np.pi / RESPONSE_FREQUENCIES
    gain = butterworth(cutoff, SAMPLES_PER_PERIOD * cutoff)(omega)
    return float(0.5 * SAMPLES_PER_PERIOD * cutoff * np.mean(np.square(gain)))


def low_pass(
    cutoff: float, rate: float, order: int = LOWPASS_ORDER, tail: float = SETTLED_TAIL
) -> Bank:
    """The zero-phase low-pass as an operation with a halo, its response cut off at `tail`."""
    halo = settling(cutoff, rate, order, tail)
    return Bank.derivatives(butterworth(cutoff, rate, order), halo, rate, 0)


def require_fitting(cutoff: float, rate: float) -> None:
    """Check that a low-pass can be made."""
    if not 0.0 < cutoff < 0.5 * rate:
        raise LogError(
            f"a low-pass of {cutoff:g} Hz does not fit samples at {rate:g} Hz",
            where="zero-phase low-pass",
            fix=f"choose a cut-off above 0 and below {0.5 * rate:g} Hz",
        )


def zero_phase(values: Array, cutoff: float, rate: float, order: int = LOWPASS_ORDER) -> Array:
    """A whole segment, `(N,)` or `(N, C)`, through the zero-phase low-pass; the same shape."""
    require_fitting(cutoff, rate)
    if len(values) == 0:
        return values.copy()
    channels = values.reshape(len(values), -1).T
    filtered = [part[0] for part in apply(low_pass(cutoff, rate, order), [channels])]
    return np.concatenate(filtered, axis=-1).T.reshape(values.shape)


@dataclass(frozen=True)
class Designed:
    """A method or a smoother made for one cut-off and rate.

    A method takes positions with context, `(n, N + 2 halo)` [rad; m], and velocities likewise
    [rad/s; m/s], or `None` where positions are to be differentiated, to `q, dq, ddq`, `(3, n, N)`.
    A smoother takes channels to channels. Without a halo, a sample depends on all of its segment,
    which is given at once.
    """

    function: Callable[..., Array]
    halo: int | None = None

    def __call__(self, *channels: Array | None) -> Array:
        """The results."""
        return self.function(*channels)


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


@runtime_checkable
class Choosing(Method, Protocol):
    """A method some settings of which come from the log: `prepare` calls it once per log."""

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> Method:
        """The method with what is not given found in an even stretch of a log, `(n, N)`.

        The motion lives below the `band` [Hz]; `whole` allows work on the log as a whole.
        """


@runtime_checkable
class Smoother(Protocol):
    """A way to smooth efforts: `effort = ...` under `[processing]`; frozen dataclass."""

    name: ClassVar[str]

    def smooth(self, cutoff: float, rate: float) -> Bank | Designed:
        """The smoother for a cut-off and a rate, above twice that [Hz]."""


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
            wrong = "cannot be differentiated twice" if self.order < 2 else "rings"
            raise ModelError(
                f"a Butterworth low-pass of order {self.order} {wrong}",
                where="butterworth",
                fix=f"choose an order from 2 to {HIGHEST_ORDER}",
            )

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filter and its derivatives for a cut-off [Hz] and a rate [Hz]."""
        halo = self.passes * settling(cutoff, rate, self.order)
        once = butterworth(cutoff, rate, self.order)
        every = Bank.derivatives(lambda omega: once(omega) ** self.passes, halo, rate, 2)
        return differentiating(every.taps)

    def smooth(self, cutoff: float, rate: float) -> Bank:
        """The filter alone, for efforts."""
        return repeated_smoother(low_pass(cutoff, rate, self.order).taps[0], self.passes)


def differentiating(rows: Array) -> Designed:
    """Motion by the taps of a low-pass, its first and second derivative, `(3, 2 halo + 1)`."""
    twice, once, low = Bank(rows), Bank(rows[:2]), Bank(rows[:1])

    def motion(q: Array, dq: Array | None) -> Array:
        return twice(q) if dq is None else np.concatenate((low(q), once(dq)))

    return Designed(motion, twice.halo)
