r"""The default way from positions to motion, and periodic motion projected on its harmonics.

Least squares on $q(t) = a_0 + \sum_{k=1}^{K} a_k \cos k\omega t + b_k \sin k\omega t$, on whole or
broken numbers of periods (p2, III-C; [Swevers1997]). Noise between and above the harmonics is
left out altogether: of white noise of variance $\sigma^2$ only $(2K + 1)\,\sigma^2 / N$ is left.

The Kalman smoother of `kalman_smoother` is, away from the ends, the zero-phase low-pass
$1 / (1 + (\omega / \omega_c)^6)$ on positions and $1 / (1 + (\omega / \omega_c)^4)$ on logged
velocities, with the likeliest $\omega_c$ joint by joint; as filters these work on parts of a log of
any length. The likelihood is believed where what it cannot explain, the innovations, is white;
elsewhere (clocks that jitter, values that were interpolated or filtered before) the wide
Butterworth low-pass of the motion's cut-off changes least.

Where a joint repeats its motion as well as its noise lets see, its mean over the periods takes the
place of what each period says: noise is then left out between the harmonics too, as a projection
on them would, but without a hard end.
"""

from dataclasses import dataclass, replace
from math import ceil
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError, ModelError
from steelyard.runs.smoothing.kalman_smoother import (
    HIGHEST_CUTOFF,
    check_cutoffs,
    cutoff_of_ratio,
    filtered,
    likeliest_ratio,
    likeliest_variance,
)
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    Butterworth,
    Designed,
    butterworth,
    continued_at_ends,
    derived_jointly,
    settling,
)
from steelyard.runs.spectrum_and_period import find_period, folded, mean_period, moving_span

HARMONIC_SAMPLES = 8192  # samples whose harmonics are in memory at a time
REFINING_HARMONICS = 12  # harmonics by which the frequency is refined
HARMONIC_OVER_STD = 4.0  # amplitude of the last harmonic kept over its standard deviation
REST_PERIOD_SHARE = 0.2  # share of a period that may pass for rest at its ends
MOST_RESIDUAL = 0.02  # residual over the size of the motion, above which a motion is not periodic


@dataclass(frozen=True, eq=False)
class Series:
    """A Fourier series of C channels about a time `origin` [s]: K harmonics of a frequency [Hz].

    `mean`, `drift` (a slope beside the series [1/s], zero unless requested) and `noise` (standard
    deviation of what is left) have the shape `(C,)`, `cosine` and `sine` `(K, C)`.
    """

    frequency: float
    origin: float
    mean: Array
    drift: Array
    cosine: Array
    sine: Array
    noise: Array

    @property
    def harmonics(self) -> int:
        """Number of harmonics, K."""
        return len(self.cosine)

    def at(self, t: Array) -> Array:
        """Value and first two derivatives at times `t`, shape `(3, len(t), C)`."""
        rate = 2.0 * np.pi * self.frequency * np.arange(1.0, self.harmonics + 1.0)
        result = np.empty((3, len(t), len(self.mean)))
        for start in range(0, len(t), HARMONIC_SAMPLES):
            since = t[start : start + HARMONIC_SAMPLES] - self.origin
            angle = since[:, None] * rate
            cos, sin = np.cos(angle), np.sin(angle)
            part = result[:, start : start + HARMONIC_SAMPLES]
            part[0] = self.mean + since[:, None] * self.drift + cos @ self.cosine + sin @ self.sine
            part[1] = self.drift + (cos * rate) @ self.sine - (sin * rate) @ self.cosine
            part[2] = -(cos * rate**2) @ self.cosine - (sin * rate**2) @ self.sine
        return result


def fourier_series(
    t: Array, values: Array, frequency: float, harmonics: int, drift: bool = False
) -> Series:
    """The series nearest to channels `(N, C)`, whose times may have any steps; a period or more.

    With `drift` a straight line is fitted beside.
    """
    columns = 1 + drift + 2 * harmonics
    span = float(t[-1] - t[0]) if len(t) else 0.0
    if len(t) <= columns or span * frequency < 0.98:
        raise LogError(
            f"{len(t)} samples over {span * frequency:.2g} periods do not determine {harmonics} "
            "harmonics",
            where="projection on harmonics",
            fix="record whole periods, or ask for fewer harmonics",
        )
    origin = float(t[0])
    gram, sums = np.zeros((columns, columns)), np.zeros((columns, values.shape[1]))
    for start in range(0, len(t), HARMONIC_SAMPLES):
        since = t[start : start + HARMONIC_SAMPLES, None] - origin
        angle = since * (2.0 * np.pi * frequency * np.arange(1.0, harmonics + 1.0))
        straight = [np.ones_like(since), *([since / span] if drift else [])]
        basis = np.hstack([*straight, np.cos(angle), np.sin(angle)])
        gram += basis.T @ basis
        sums += basis.T @ values[start : start + HARMONIC_SAMPLES]
    found = np.linalg.solve(gram, sums)
    first = 1 + drift
    zero = np.zeros(values.shape[1])
    lines = found[0], found[1] / span if drift else zero
    waves = found[first : first + harmonics], found[first + harmonics :]
    series = Series(frequency, origin, *map(frozen, (*lines, *waves, zero)))
    left = values - series.at(t)[0]
    return replace(series, noise=frozen(np.sqrt(np.square(left).sum(axis=0) / (len(t) - columns))))


def refined_frequency(t: Array, values: Array, near: float) -> float:
    """The base frequency near a guess at which channels `(N, C)` fit best [Hz].

    Every channel counts relative to its own size. The guess is right to a tenth of a period over
    the whole log.
    """
    from scipy.optimize import minimize_scalar

    every = max(1, len(t) // HARMONIC_SAMPLES)
    t, values = t[::every], values[::every]
    size = np.maximum(values.std(axis=0), 1e-12)
    harmonics = min(REFINING_HARMONICS, (len(t) - 4) // 4)

    def loss(frequency: float) -> float:
        noise = fourier_series(t, values, frequency, harmonics).noise
        return float(np.log(np.square(noise / size).sum()))

    reach = 0.1 / float(t[-1] - t[0])
    least = 0.985 / float(t[-1] - t[0])
    bounds = max(near - reach, least), near + reach
    found = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-7 * near})
    return float(found.x)


def audible_harmonics(series: Series, count: int) -> Series:
    """A series without what does not stand `HARMONIC_OVER_STD` above the noise, channel by channel.

    Every channel keeps its harmonics up to the last one that does.
    """
    amplitude = np.hypot(series.cosine, series.sine)
    loud = amplitude > HARMONIC_OVER_STD * np.sqrt(2.0 / count) * series.noise + 1e-15
    kept = np.flip(np.logical_or.accumulate(np.flip(loud, axis=0), axis=0), axis=0)
    highest = max(int(kept.any(axis=1).sum()), 1)
    cosine, sine = (frozen((x * kept)[:highest]) for x in (series.cosine, series.sine))
    return replace(series, cosine=cosine, sine=sine)


@dataclass(frozen=True)
class Fourier:
    """Motion by projection of the positions on harmonics; logged velocities are not needed.

    Between the rests at its ends the motion must be periodic; the rests themselves are low-passed.
    """

    name: ClassVar[str] = "fourier"
    # base frequency [Hz]; found if neither it nor the period is given
    frequency: float | None = None
    period: float | None = None  # base period [s]
    # their number; by default as many as stand out of the noise, up to the cut-off
    harmonics: int | None = None
    drift: bool = False  # whether a straight line is fitted beside

    def __post_init__(self) -> None:
        given = [x for x in (self.frequency, self.period) if x is not None]
        if len(given) == 2 or any(x <= 0.0 for x in given):
            raise ModelError(
                "the base frequency is given twice" if len(given) == 2 else "it is not positive",
                where="fourier",
                fix="give frequency [Hz] or period [s], above 0, or leave both out",
            )
        if self.harmonics is not None and self.harmonics < 1:
            raise ModelError(
                f"{self.harmonics} harmonics are not a valid motion",
                where="fourier",
                fix="give harmonics = 1 or more, or leave it out",
            )

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The projection for a cut-off [Hz] and a rate [Hz]; velocities are not used."""

        def motion(q: Array, dq: Array | None) -> Array:
            start, stop = self._whole_period(*moving_span(q), q.shape[1], rate)
            result = np.empty((3, *q.shape))
            inside = q[:, start:stop]
            series = self.series(inside, cutoff, rate)
            _require_periodic(series, inside)
            result[:, :, start:stop] = series.at(np.arange(stop - start) / rate).transpose(0, 2, 1)
            if start > 0 or stop < q.shape[1]:
                low = Butterworth().designed(cutoff, rate)
                rests = low(continued_at_ends(q, low.halo or 0, low.halo or 0), None)
                result[:, :, :start], result[:, :, stop:] = rests[:, :, :start], rests[:, :, stop:]
            return result

        return Designed(motion)

    def _whole_period(self, start: int, stop: int, count: int, rate: float) -> tuple[int, int]:
        """The span of motion, with samples at its ends where it lacks a little of a given period.

        A motion from rest to rest begins so slowly that its first samples pass for rest.
        """
        period = self.period if self.frequency is None else 1.0 / self.frequency
        lacking = 0 if period is None else ceil(period * rate) - (stop - start)
        if period is None or not 0 < lacking <= REST_PERIOD_SHARE * period * rate:
            return start, stop
        after = min(count - stop, lacking // 2)
        before = min(start, lacking - after)
        return start - before, min(count, stop + lacking - before)

    def series(self, q: Array, cutoff: float, rate: float) -> Series:
        """The series of positions without rests, shape `(n, N)`."""
        t, values = np.arange(q.shape[1]) / rate, q.T
        frequency = self._frequency(t, values, rate)
        if self.harmonics is not None:
            return fourier_series(t, values, frequency, self.harmonics, self.drift)
        most = int(min(cutoff / frequency, (len(t) - 4) // 4))
        wide = fourier_series(t, values, frequency, max(1, most), self.drift)
        return audible_harmonics(wide, len(t))

    def _frequency(self, t: Array, values: Array, rate: float) -> float:
        if self.frequency is not None:
            return self.frequency
        period = find_period(values.T, rate) if self.period is None else self.period
        if period is None:
            raise LogError(
                "the motion is not periodic: it returns to its start at most once",
                where="method 'fourier' of [processing]",
                fix="choose another method for motion, or give the period of the motion",
            )
        if self.period is not None:
            return 1.0 / period
        return refined_frequency(t, values, 1.0 / period)


def _require_periodic(series: Series, q: Array) -> None:
    size = q.std(axis=1)
    moving = size > 0.02 * size.max(initial=0.0)
    share = np.where(moving, series.noise / np.maximum(size, 1e-300), 0.0)
    worst = int(np.argmax(share))
    if share[worst] > MOST_RESIDUAL:
        raise LogError(
            f"the motion is not periodic with {1.0 / series.frequency:.4g} s: "
            f"{series.harmonics} harmonics leave {100.0 * share[worst]:.2g} % of joint "
            f"{worst + 1}'s motion ({series.noise[worst]:.2g} rad or m)",
            where="method 'fourier' of [processing]",
            fix="correct the period or the number of harmonics, cut the log to whole periods "
            "(LOG@5:25), or choose another method for motion",
        )


WHITE = 0.12
"""Correlation of innovations one to three samples apart up to which noise passes for white."""
LEAST_WHITENESS_SAMPLES = 500  # samples from which on innovations can be tested for whiteness
STILL_JOINT_STD = 0.02  # a joint with a smaller share of the largest standard deviation is left out
PERIODIC_EXCESS = 1.2
"""Power of a motion's distance from its mean period over that of noise in the low-pass alone."""
PERIODIC_EXCESS_ONCE = 2.0  # the same of any single period: the first one often starts from rest
LEAST_PERIODS = 1.9  # least number of periods
ENDS_LEFT_OUT = 1.0
"""How far from its ends a motion is not used for the mean, in periods of the cut-off."""


@dataclass(frozen=True)
class Auto:
    """Low-passes with cut-offs found by maximum likelihood, or the mean period; the default."""

    name: ClassVar[str] = "auto"
    # low-pass of each position [Hz]; found in the log if not given. Where none was found, the
    # Butterworth low-pass of the motion's cut-off is taken
    cutoffs: tuple[float, ...] | None = None
    # low-pass of each logged velocity [Hz], likewise
    velocity_cutoffs: tuple[float, ...] | None = None
    period: float | None = None  # period of the joints that repeat their motion [s]
    periodic: tuple[int, ...] = ()  # numbers of these joints, from 1

    def __post_init__(self) -> None:
        given = self.period is not None, bool(self.periodic)
        if any(given) and not (all(given) and self.cutoffs):
            wrong = "a period is used only with the joints that have it and all cut-offs"
        elif self.period is not None and not 0.0 < self.period < np.inf:
            wrong = f"a period of {self.period:g} s is not above zero and finite"
        elif out := [x for x in self.periodic if not 1 <= x <= len(self.cutoffs or ())]:
            wrong = f"there is no joint {out[0]}"
        else:
            return
        fix = "give cutoffs [Hz] per joint, period [s] and periodic, numbers of joints from 1"
        raise ModelError(wrong, where=self.name, fix=fix)

    @property
    def choice(self) -> str:
        """The filters in words: low-passes, and whose mean period is taken."""
        parts = [
            f"{kind} at {', '.join(f'{value:g}' for value in values)} Hz"
            for kind, values in (("positions", self.cutoffs), ("velocities", self.velocity_cutoffs))
            if values is not None
        ]
        words = f"low-passes per joint, {'; '.join(parts)}" if parts else "butterworth"
        if self.period is not None and self.periodic:
            numbers = ", ".join(map(str, self.periodic))
            words += f", mean over the periods of {self.period:g} s of joints {numbers}"
        return words

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The filters for a cut-off of the motion [Hz] and a rate [Hz]."""
        wide = Butterworth().designed(cutoff, rate)
        given = {3: self.cutoffs, 2: self.velocity_cutoffs}
        low = {order: LowPasses(own, order, rate) for order, own in given.items() if own}
        if not low:
            return wide
        wide_halo = wide.halo or 0
        halo = max(wide_halo, *(one.halo for one in low.values()))

        def states(extended: Array, order: int) -> Array:
            spare = halo - (low[order].halo if order in low else wide_halo)
            inner = extended[:, spare : extended.shape[1] - spare]
            return low[order](inner) if order in low else wide(inner, None)

        local = replace(derived_jointly(states), halo=halo)
        if self.period is None or self.cutoffs is None:
            return local
        length, joints = self.period * rate, [j - 1 for j in self.periodic]
        bent = int(ENDS_LEFT_OUT * rate / min(self.cutoffs))

        def motion(q: Array, dq: Array | None) -> Array:
            velocity = None if dq is None else continued_at_ends(dq, halo, halo)
            result = local(continued_at_ends(q, halo, halo), velocity)
            start, stop = moving_span(q)
            if stop - start >= LEAST_PERIODS * length:
                part = result[:, joints, start:stop]
                result[:, joints, start:stop] = folded(part, length, bent)
            return result

        return Designed(motion)

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> "Auto":
        """The same with what is not given found in a log; see `Choosing`."""
        cutoffs = self.cutoffs or likeliest_cutoffs(q, 3, rate, band)
        velocity = self.velocity_cutoffs
        if dq is not None and not velocity:
            velocity = likeliest_cutoffs(dq, 2, rate, band)
        found = replace(self, cutoffs=cutoffs, velocity_cutoffs=velocity)
        if cutoffs is None or dq is not None or not whole or self.cutoffs is not None:
            return found
        return _is_periodic(found, cutoffs, q, rate)


def likeliest_cutoffs(x: Array, order: int, rate: float, band: float) -> tuple[float, ...] | None:
    """The likeliest cut-off of each channel `(n, N)` [Hz]; `None` if its noise is another.

    `order` is the derivative that wanders freely, 3 for positions and 2 for velocities; no cut-off
    is below the `band`.
    """
    if x.shape[1] < LEAST_WHITENESS_SAMPLES:
        return None
    steps, size = np.ones(x.shape[1]), x.std(axis=1)
    cutoffs = []
    for channel, large in zip(x, size > STILL_JOINT_STD * size.max(initial=0.0), strict=True):
        ratio = likeliest_ratio(channel, steps, order)
        if large:
            kept = filtered(channel, steps, ratio, order)[3:]
            innovation = kept[:, 9] / np.sqrt(kept[:, 10])
            power = float(innovation @ innovation)
            lags = [abs(float(innovation[k:] @ innovation[:-k])) for k in (1, 2, 3)]
            if not (power > 0.0 and max(lags) < WHITE * power):
                return None
        cutoffs.append(cutoff_of_ratio(ratio, order, rate, band))
    return tuple(cutoffs)


class LowPasses:
    """Per channel a zero-phase Butterworth low-pass, and its derivatives below its order."""

    def __init__(self, cutoffs: tuple[float, ...], order: int, rate: float) -> None:
        self._cutoffs = cutoffs
        self.halo = max(settling(cutoff, rate, order) for cutoff in cutoffs)
        low = [butterworth(cutoff, rate, order) for cutoff in cutoffs]
        self.banks = [Bank.derivatives(one, self.halo, rate, order - 1) for one in low]

    def __call__(self, extended: Array) -> Array:
        """Channels `(n, N + 2 halo)` to values and derivatives, `(order, n, N)`."""
        check_cutoffs(self._cutoffs, extended, Auto.name)
        each = [bank(x[None]) for bank, x in zip(self.banks, extended, strict=True)]
        return np.concatenate(each, axis=1)


def _is_periodic(method: Auto, cutoffs: tuple[float, ...], q: Array, rate: float) -> Auto:
    """A method with the joints that repeat their motion, if there are any."""
    period = find_period(q, rate)
    start, stop = moving_span(q)
    if period is None or stop - start < LEAST_PERIODS * period * rate:
        return method
    inside = np.ascontiguousarray(q[:, start:stop])
    table = mean_period(inside, period * rate)
    steps = np.ones(2 * table.shape[1])
    sharper = [likeliest_ratio(x, steps) for x in np.concatenate((table, table), axis=1)]
    own = np.array(sharper) ** (1.0 / 6.0) * rate / (2.0 * np.pi)
    found = np.clip(own, cutoffs, HIGHEST_CUTOFF * rate)
    chosen = tuple(float(f"{x:.3g}") for x in found)
    low = LowPasses(chosen, 3, rate)
    each = low(continued_at_ends(inside, low.halo, low.halo))
    bent = int(ENDS_LEFT_OUT * rate / min(chosen))
    left = (each - folded(each, period * rate, bent))[:, :, bent : stop - start - bent]
    noise = _noise(inside, low, chosen, rate)
    good = (np.square(left).mean(axis=2) < PERIODIC_EXCESS * noise).all(axis=0)
    for part in np.array_split(left, max(1, round(left.shape[2] / (period * rate))), axis=2):
        good &= (np.square(part).mean(axis=2) < PERIODIC_EXCESS_ONCE * noise).all(axis=0)
    joints = np.flatnonzero(good).tolist()
    if not joints:
        return method
    own_cutoffs = tuple(chosen[j] if j in joints else c for j, c in enumerate(cutoffs))
    numbers = tuple(j + 1 for j in joints)
    return replace(method, cutoffs=own_cutoffs, period=period, periodic=numbers)


def _noise(q: Array, low: LowPasses, cutoffs: tuple[float, ...], rate: float) -> Array:
    """Power of noise behind low-passes and their derivatives, shape `(3, n)`."""
    steps, powers = np.ones(q.shape[1]), []
    for x, bank, cutoff in zip(q, low.banks, cutoffs, strict=True):
        ratio = (2.0 * np.pi * cutoff / rate) ** 6
        variance = likeliest_variance(filtered(x, steps, ratio))
        powers.append(variance * np.square(bank.taps).sum(axis=1))
    return np.array(powers).T
