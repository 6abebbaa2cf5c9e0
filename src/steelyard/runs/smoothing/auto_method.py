r"""The default way from positions to motion: what is least wrong for the noise that a log has.

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
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.runs.smoothing.kalman_smoother import (
    HIGHEST_CUTOFF,
    cutoff_of_ratio,
    filtered,
    likeliest_ratio,
    likeliest_variance,
)
from steelyard.runs.smoothing.zero_phase_filters import (
    Bank,
    Butterworth,
    Designed,
    butterworth,
    continued_at_ends,
    settling,
)
from steelyard.runs.spectrum_and_period import find_period, folded, mean_period, moving_span

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

    @property
    def choice(self) -> str:
        """The filters in words: low-passes, and whose mean period is taken."""
        kinds = (("positions", self.cutoffs), ("velocities", self.velocity_cutoffs))
        parts = [
            f"{kind} at {', '.join(f'{value:g}' for value in values)} Hz"
            for kind, values in kinds
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

        def inner(extended: Array, own: int) -> Array:
            return extended[:, halo - own : extended.shape[1] - halo + own]

        def local(q: Array, dq: Array | None) -> Array:
            result = np.empty((3, len(q), q.shape[1] - 2 * halo))
            if 3 not in low or (dq is not None and 2 not in low):
                velocity = None if dq is None else inner(dq, wide_halo)
                result[:] = wide(inner(q, wide_halo), velocity)
            if 3 in low:
                used = slice(0, 3 if dq is None else 1)
                result[used] = low[3](inner(q, low[3].halo))[used]
            if dq is not None and 2 in low:
                result[1:] = low[2](inner(dq, low[2].halo))
            return result

        if self.period is None or self.cutoffs is None:
            return Designed(local, halo)
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
        if dq is not None and velocity is None:
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
        self.halo = max(settling(cutoff, rate, order) for cutoff in cutoffs)
        low = [butterworth(cutoff, rate, order) for cutoff in cutoffs]
        self.banks = [Bank.derivatives(one, self.halo, rate, order - 1) for one in low]

    def __call__(self, extended: Array) -> Array:
        """Channels `(n, N + 2 halo)` to values and derivatives, `(order, n, N)`."""
        if len(extended) != len(self.banks):
            raise LogError(
                f"there are {len(self.banks)} cut-offs for {len(extended)} joints",
                where="method 'auto' of [processing]",
                fix="give one per joint, or leave them out",
            )
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
