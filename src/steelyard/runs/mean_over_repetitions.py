r"""Runs that are the mean over repetitions of one motion, which are aligned by position.

Over R repetitions the mean effort has the variance $\sigma^2 / R$ at every time step, with the
sample variance $\sigma^2$ (p2, eq 7); its inverse is the weight of the time step (p2, eqs 8 and
9). The fit finds the scale of the noise itself, so only the weights' course over time counts.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import Cut
from steelyard.runs.first_pass_over_recording import Survey, no_joint_moves, survey
from steelyard.runs.processing_chain import evenly_sampled
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.rows.clock_and_row_scan import RowScan
from steelyard.runs.spectrum_and_period import (
    STANDING_RANGE_SHARE,
    Repetitions,
    find_period,
    moving_span,
)

ALIGNMENT_ROUNDS = 4  # rounds of the alignment
MOST_SHIFT = 0.02  # how far a repetition may be moved in a round, in its own lengths
MOST_DEVIATION = 0.05
"""Distance from the mean, over the size of the motion, at which a repetition is none."""
DEVIATION_OVER_SCATTER = 6.0
"""Least distance of another effort from the median, over what `USUAL_SHARE` of the repetitions do
not exceed, which noise alone keeps far from."""
USUAL_SHARE = 0.75
LAG_OF_NOISE = 0.01  # share of a repetition over which noise of two repetitions is taken to change
KEY = "repetitions of [processing]"


@dataclass(frozen=True, eq=False)
class Averaged:
    """The mean over R repetitions."""

    mean: Array  # mean channels of one repetition, with context, shape `(C, P + 2 context)`
    variance: Array  # sample variance of one repetition about the mean, likewise (p2, eq 7)
    starts: Array  # where the repetitions start, in samples of their logs, shape `(R,)`
    apart: Array  # rms distance of each repetition's positions from the mean, shape `(R,)`


def average_aligned(
    logs: Sequence[Array],
    starts: Sequence[Array],
    length: int,
    positions: slice,
    context: int = 0,
    *,
    efforts: Mapping[int, str] | None = None,
    where: Sequence[str] = (),
) -> Averaged:
    r"""Mean and sample variance, $\frac{1}{R - 1} \sum_k (x_k - \bar x)^2$, over repetitions.

    Args:
        logs: Channels of each log, shape `(C, N)`, all at one rate.
        starts: Where the repetitions in each log start, about, in samples.
        length: Samples of a repetition, P.
        positions: Which channels are positions; repetitions are moved until these lie on each
            other.
        context: Samples before and after a repetition that are averaged too. Beyond a log's ends
            its first and last values go on.
        efforts: Channels that must repeat themselves too, and what they are called.
        where: What the logs are called.

    Raises:
        LogError: There are fewer than two repetitions, or one is another motion, or has other
            efforts.
    """
    from scipy.interpolate import make_interp_spline

    which = [log for log, places in enumerate(starts) for _ in places]
    if len(which) < 2:
        raise LogError(
            "there are fewer than two whole repetitions of the motion",
            where=", ".join((*where[:1], KEY)),
            fix="record more of them, drop fewer, or leave repetitions out",
        )
    at = np.concatenate(starts).astype(np.float64)
    ends = [x.shape[1] - 1 for x in logs]
    curves = [make_interp_spline(np.arange(x.shape[1]), x, k=3, axis=1) for x in logs]

    def read(first: int, stop: int) -> Iterator[Array]:
        """Channels `(C, stop - first)` of every repetition, from its start plus `first` on."""
        for log, start in zip(which, at, strict=True):
            places = np.clip(start + np.arange(first, stop), 0.0, ends[log])
            yield np.asarray(curves[log](places))

    for _ in range(ALIGNMENT_ROUNDS):
        drawn = np.array([x[positions] for x in read(0, length)])
        at = at + _shifts(drawn, MOST_SHIFT * length)
    places = [", ".join((*where[log : log + 1], KEY)) for log in which]
    _require_same_motion(drawn, places)
    middle = np.median(drawn, axis=0)
    moving = np.ptp(middle, axis=1) >= STANDING_RANGE_SHARE * np.ptp(middle, axis=1).max()
    for (channel, name), moves in zip((efforts or {}).items(), moving, strict=False):
        if moves:
            _require_same_effort(np.array([x[channel] for x in read(0, length)]), name, places)
    mean = np.zeros((len(logs[0]), length + 2 * context))
    for x in read(-context, length + context):
        mean += x / len(at)
    inside = slice(context, context + length)
    squares, apart = np.zeros_like(mean), []
    for x in read(-context, length + context):
        squares += np.square(x - mean)
        apart.append(np.sqrt(np.square((x - mean)[positions, inside]).sum(axis=0).mean()))
    return Averaged(mean, squares / (len(at) - 1), at, np.array(apart))


def _shifts(q: Array, most: float) -> Array:
    """How much later each repetition `(R, n, P)` must be read to lie on the mean, `(R,)`."""
    mean = q.mean(axis=0)
    slope = np.gradient(mean, axis=1)
    late = -np.einsum("rnp,np->r", q - mean, slope) / max(float(np.square(slope).sum()), 1e-300)
    return np.asarray(np.clip(late - late.mean(), -most, most))


def _require_same_motion(q: Array, where: Sequence[str]) -> None:
    """Raise if a repetition is not the same motion as the others, `(R, n, P)`."""
    middle = np.median(q, axis=0)
    size = np.sqrt(np.square(middle - middle.mean(axis=1, keepdims=True)).sum(axis=0).mean())
    apart = np.sqrt(np.square(q - middle).sum(axis=1).mean(axis=1))
    worst = int(np.argmax(apart))
    if apart[worst] > MOST_DEVIATION * size:
        raise LogError(
            f"repetition {worst + 1} of {len(q)} differs from the others: it deviates by "
            f"{100.0 * apart[worst] / size:.2g} % of the motion's range",
            where=where[worst],
            fix="correct the period, cut the log to the repetitions (LOG@5:65), or drop more at "
            "its start and end",
        )


def _require_same_effort(efforts: Array, name: str, where: Sequence[str]) -> None:
    """Raise if one repetition of an effort `(R, P)` is another one, and no more of the same noise.

    It deviates from the median repetition by more than `MOST_DEVIATION` of that one's range, and
    by more than `DEVIATION_OVER_SCATTER` times what repetitions usually do, which of two, whose
    deviations are equal, is what they change over `LAG_OF_NOISE`.
    """
    middle = np.median(efforts, axis=0)
    apart = np.sqrt(np.square(efforts - middle).mean(axis=1))
    size, worst = float(np.ptp(middle)), int(np.argmax(apart))
    usual = float(np.quantile(apart, USUAL_SHARE, method="lower"))
    if len(efforts) == 2:
        lag, both = max(1, round(LAG_OF_NOISE * len(middle))), efforts[1] - efforts[0]
        usual = float(np.sqrt(0.125 * np.square(both[lag:] - both[:-lag]).mean()))
    if apart[worst] > max(MOST_DEVIATION * size, DEVIATION_OVER_SCATTER * usual):
        raise LogError(
            f"the effort '{name}' of repetition {worst + 1} of {len(efforts)} differs from the "
            f"others: it deviates by {100.0 * apart[worst] / max(size, 1e-300):.3g} % of its range",
            where=where[worst],
            fix="leave that repetition out: cut the log (LOG@5:65), or drop more at its start "
            "and end",
        )


CONTEXT_SECONDS = 4.0  # time around the mean repetition that filters may look at [s]
SLOW_ENDS = 0.15  # what start and end of the motion may hide of it, in periods: they are slow
FREEDOM_OF_VARIANCE = 100
"""Degrees of freedom that a variance is averaged to have, over neighbouring time steps."""
LEAST_VARIANCE_SHARE = 1e-3  # least variance over its median over time


@dataclass(frozen=True, eq=False)
class Importance:
    """Weights over time, shape `(n, P)`, mean 1 per joint; of a clock from `start` on [s]."""

    start: float
    rate: float
    weights: Array

    def at(self, t: Array) -> Array:
        """The weights nearest to times, shape `(n, len(t))`."""
        place = np.rint((t - self.start) * self.rate).astype(np.intp)
        return np.ascontiguousarray(self.weights[:, np.clip(place, 0, self.weights.shape[1] - 1)])


@dataclass(frozen=True, eq=False)
class MeanMotion:
    """The mean over repetitions, as a recording of its own."""

    recording: Recording
    importance: Importance
    averaged: Averaged
    words: str


def mean_of_periods(recording: Recording, wanted: Repetitions) -> MeanMotion:
    """The mean over the periods in one log."""
    loaded = recording.in_memory()
    x, rate = _evenly_sampled(loaded)
    q = x[loaded.channels.q]
    start, stop = moving_span(q)
    if start == stop:
        raise no_joint_moves(recording)
    period = find_period(q, rate) if wanted.period is None else wanted.period
    if period is None:
        raise LogError(
            "no period was found in this log: the motion does not return to its start",
            where=recording.where,
            fix="state it: repetitions = {period = ...} under [processing], or leave it out",
        )
    length = period * rate
    one = q[:, start : start + int(length)]
    pause = one.shape[1] - moving_span(one)[1]  # the rest behind each, which the span lacks
    count = int((stop - start + pause) / length + SLOW_ENDS)
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
    return _mean_motion([loaded], [x], [starts], length, rate)


def mean_of_logs(recordings: Sequence[Recording]) -> MeanMotion:
    """The mean over logs that hold the same motion once."""
    if not recordings:
        raise LogError("there is no log to average", where="logs", fix="give two or more")
    loaded = [recording.in_memory() for recording in recordings]
    first, rate = _evenly_sampled(loaded[0])
    logs = [first, *(_evenly_sampled(one, rate)[0] for one in loaded[1:])]
    q = loaded[0].channels.q
    start, stop = moving_span(first[q])
    places = [float(start), *(start + _lag(first[q], x[q]) for x in logs[1:])]
    return _mean_motion(loaded, logs, [np.array([x]) for x in places], stop - start, rate)


def _lag(reference: Array, q: Array) -> float:
    """Samples by which a motion comes later than a reference, both `(n, N)`."""
    from scipy.signal import correlate

    pairs = zip(q, reference, strict=True)
    match = np.sum([correlate(x - x[0], y - y[0], method="fft") for x, y in pairs], axis=0)
    return float(np.argmax(match) - (reference.shape[1] - 1))


def _evenly_sampled(recording: Recording, rate: float | None = None) -> tuple[Array, float]:
    """All channels of a recording's longest segment on a uniform clock, and its rate [Hz]."""
    found: Survey = survey(recording)
    longest = max(found.segments, key=lambda s: s.stop - s.start).number
    pieces = [p for p in RowScan(found.clock, recording).pieces() if p.segment == longest]
    chosen, channels = found.rate if rate is None else rate, slice(0, recording.channels.count)
    return evenly_sampled(pieces, channels, chosen, found.row_checks), chosen


def _mean_motion(
    recordings: Sequence[Recording],
    logs: list[Array],
    starts: list[Array],
    samples: float,
    rate: float,
) -> MeanMotion:
    recording, length = recordings[0], round(samples)
    c, context = recording.channels, min(length, int(CONTEXT_SECONDS * rate))
    efforts = dict(enumerate(recording.signals.effort, start=c.effort.start))
    where = [one.where for one in recordings]
    mean = average_aligned(logs, starts, length, c.q, context, efforts=efforts, where=where)
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
    return MeanMotion(
        Recording(log, plain, window),
        Importance(0.0, rate, frozen(weights_of(mean.variance[c.effort], len(mean.starts)))),
        mean,
        f"mean of {len(mean.starts)} repetitions of {samples / rate:.4g} s, which deviate up to "
        f"{mean.apart.max():.2g} rad or m from it",
    )


def weights_of(variance: Array, count: int) -> Array:
    """Weights from sample variances `(n, P)` over repetitions, mean 1 over time.

    Few repetitions estimate a variance badly, so it is averaged over neighbouring time steps until
    it has `FREEDOM_OF_VARIANCE` degrees of freedom.
    """
    from scipy.ndimage import uniform_filter1d

    span = min(2 * (FREEDOM_OF_VARIANCE // max(count - 1, 1) // 2) + 1, variance.shape[1])
    smooth = uniform_filter1d(variance, span, axis=1, mode="nearest")
    least = LEAST_VARIANCE_SHARE * np.median(smooth, axis=1, keepdims=True)
    weights = 1.0 / np.maximum(smooth, np.maximum(least, 1e-300))
    return np.asarray(weights / weights.mean(axis=1, keepdims=True))
