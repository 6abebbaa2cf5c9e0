r"""Runs that are the mean over repetitions of one motion, weighted by what these differ.

Over R repetitions the mean effort has the variance $\sigma^2 / R$ at every time step, with the
sample variance $\sigma^2$ (p2, eq 7); its inverse is the weight of the time step (p2, eqs 8 and
9). The fit finds the scale of the noise itself, so only the weights' course over time counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import LogError
from steelyard.formats.cut import Cut
from steelyard.measurement.inspection import Survey, survey
from steelyard.measurement.periods import Repetitions, find_period, moving_span
from steelyard.measurement.recording import LogInMemory, Recording
from steelyard.measurement.repetition.alignment import Averaged, averaged
from steelyard.measurement.rows.clock import Scan
from steelyard.measurement.rows.marking import Marking
from steelyard.measurement.rows.resample import uniform

CONTEXT = 4.0
"""Time around the mean repetition that filters may look at [s]."""
SLOW_ENDS = 0.15
"""What start and end of the motion may hide of it, in periods: they are slow."""
ENOUGH_FREEDOM = 100
"""Degrees of freedom that a variance is averaged to have, over neighbouring time steps."""
LEAST_SHARE = 1e-3
"""Least variance over its median over time."""


@dataclass(frozen=True, eq=False)
class Importance:
    """Weights over time.

    Attributes:
        start: Time of the first [s].
        rate: Of their clock [Hz].
        weights: Shape `(n, P)`, mean 1 per joint.
    """

    start: float
    rate: float
    weights: Array

    def at(self, t: Array) -> Array:
        """The weights nearest to times, shape `(n, len(t))`."""
        place = np.rint((t - self.start) * self.rate).astype(np.intp)
        return np.ascontiguousarray(self.weights[:, np.clip(place, 0, self.weights.shape[1] - 1)])


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean over repetitions, as a recording of its own.

    Attributes:
        recording: The mean repetition in a window, with context around it.
        importance: Weights of its efforts.
        averaged: Mean and variance of all channels, and how far repetitions lie apart.
        words: What was averaged, in a sentence.
    """

    recording: Recording
    importance: Importance
    averaged: Averaged
    words: str


def mean_of_periods(recording: Recording, wanted: Repetitions) -> MeanMotion:
    """The mean over the periods in one log.

    Raises:
        LogError: The motion does not repeat, or too seldom.
    """
    loaded = recording.in_memory()
    x, rate = _even(loaded)
    c = loaded.channels
    period = find_period(x[c.q], rate) if wanted.period is None else wanted.period
    if period is None:
        raise LogError(
            "no period was found in this log: the motion does not return to its start",
            where=recording.where,
            fix="state it: repetitions = {period = ...} under [processing], or leave it out",
        )
    start, stop = moving_span(x[c.q])
    length = period * rate
    count = int((stop - start) / length + SLOW_ENDS)
    first, last = wanted.drop_first, count - wanted.drop_last
    if last - first < 2:
        raise LogError(
            f"of {count} whole repetitions of {period:.5g} s in this log {max(last - first, 0)} "
            "are left",
            where=recording.where,
            fix="record more of them, or set drop_first and drop_last under [processing]",
        )
    begin = min(start, max(0.5 * (start + stop - count * length), 0.0))
    starts = begin + length * np.arange(first, last, dtype=np.float64)
    return _mean(loaded, [x], [starts], int(length), rate)


def mean_of_logs(recordings: Sequence[Recording]) -> MeanMotion:
    """The mean over logs that hold the same motion once.

    Raises:
        LogError: There are fewer than two of them, or they hold other motions.
    """
    if not recordings:
        raise LogError("there is no log to average", where="logs", fix="give two or more")
    loaded = [recording.in_memory() for recording in recordings]
    first, rate = _even(loaded[0])
    logs = [first, *(_even(one, rate)[0] for one in loaded[1:])]
    q = loaded[0].channels.q
    start, stop = moving_span(first[q])
    places = [float(start), *(start + _lag(first[q], x[q]) for x in logs[1:])]
    return _mean(loaded[0], logs, [np.array([x]) for x in places], stop - start, rate)


def _lag(reference: Array, q: Array) -> float:
    """Samples by which a motion comes later than a reference, both `(n, N)`."""
    size = reference.shape[1] + q.shape[1]
    spectra = [np.fft.rfft(x - x[:, :1], size) for x in (reference, q)]
    match = np.fft.irfft(np.conj(spectra[0]) * spectra[1], size).sum(axis=0)
    best = int(np.argmax(match))
    return float(best if best < q.shape[1] else best - size)


def _even(recording: Recording, rate: float | None = None) -> tuple[Array, float]:
    """All channels of a recording's longest segment on a uniform clock, and its rate [Hz]."""
    found: Survey = survey(recording)
    longest = max(found.segments, key=lambda s: s.stop - s.start).number
    pieces = Scan(found.clock, recording).pieces()
    rows = ((p.t, p.x) for p in pieces if p.segment == longest)
    marked = rows if found.row_checks.idle else Marking(found.row_checks).rows(rows)
    count, chosen = recording.channels.count, found.rate if rate is None else rate
    parts = list(uniform(((t, x[:, :count]) for t, x in marked), chosen))
    return np.concatenate(parts, axis=1), chosen


def _mean(
    recording: Recording, logs: list[Array], starts: list[Array], length: int, rate: float
) -> MeanMotion:
    c, context = recording.channels, min(length, int(CONTEXT * rate))
    mean = averaged(logs, starts, length, c.q, context)
    t = np.arange(mean.mean.shape[1]) / rate
    signals = recording.signals
    ones = frozen(np.ones(c.joints))
    plain = replace(
        signals,
        time_scale=1.0,
        position_scale=ones,
        velocity_scale=ones if c.velocities else None,
        effort_scale=ones,
        position_map=None,
        position_offset=None,
        effort_map=None,
    )
    log = LogInMemory(recording.log.path, signals.columns, np.column_stack((t, mean.mean.T)))
    window = Cut(seconds=(context / rate, (context + length - 0.5) / rate))
    variance = mean.variance[c.effort]
    return MeanMotion(
        Recording(log, plain, window),
        Importance(0.0, rate, frozen(weights_of(variance, mean.count))),
        mean,
        f"mean of {mean.count} repetitions of {length / rate:.4g} s, which deviate up to "
        f"{mean.apart.max():.2g} rad or m from it",
    )


def weights_of(variance: Array, count: int) -> Array:
    """Weights from sample variances over repetitions, mean 1 over time.

    Few repetitions estimate a variance badly, so it is averaged over neighbouring time steps until
    it has `ENOUGH_FREEDOM` degrees of freedom.

    Args:
        variance: Shape `(n, P)`.
        count: Number of repetitions.
    """
    span = min(2 * (ENOUGH_FREEDOM // max(count - 1, 1) // 2) + 1, variance.shape[1])
    padded = np.pad(variance, ((0, 0), (span // 2, span - 1 - span // 2)), mode="edge")
    sums = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
    smooth = (sums[:, span:] - sums[:, :-span]) / span
    least = LEAST_SHARE * np.median(smooth, axis=1, keepdims=True)
    weights = 1.0 / np.maximum(smooth, np.maximum(least, 1e-300))
    return np.asarray(weights / weights.mean(axis=1, keepdims=True))
