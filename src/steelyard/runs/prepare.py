"""From a recording to a run: survey, cut-offs, rests, quality."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import Cut
from steelyard.runs.first_pass_over_recording import Survey, no_joint_moves, survey
from steelyard.runs.mean_over_repetitions import MeanMotion, mean_of_periods
from steelyard.runs.motion_error_from_noise import motion_responses, noise_gain
from steelyard.runs.processing_chain import Chain
from steelyard.runs.processing_choices import (
    SHORTEST_SEGMENT,
    Cutoffs,
    Processing,
    cutoffs,
    require_windows_in_log,
)
from steelyard.runs.recording import Recording
from steelyard.runs.rows.bridged_rows_segments_and_quality import (
    COUNTS_OF_MARKS,
    Marked,
    Quality,
    Segment,
)
from steelyard.runs.rows.faulty_row_detectors import RowVerdict
from steelyard.runs.rows.resampling import sample_count
from steelyard.runs.run import Moves, Run, lost_ends
from steelyard.runs.sample_cache import KeptSamples, Source
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Butterworth,
    Choosing,
    Method,
)

BINS_PER_DECADE = 32
LOWEST_SPEED_DECADE, HIGHEST_SPEED_DECADE = -8, 4
"""Decades of speed, relative to the reference, that the histogram covers."""


class SpeedHistogram:
    """Speeds of all joints, in constant memory: logarithmic bins, 7.5 % wide.

    A speed per joint, `reference`, is the edge of a bin, beside the `highest` one; `(n,)`.
    """

    def __init__(self, reference: Array) -> None:
        bins = (HIGHEST_SPEED_DECADE - LOWEST_SPEED_DECADE) * BINS_PER_DECADE + 1
        self.reference = reference
        self.highest = np.zeros(len(reference))
        self._count = np.zeros((len(reference), bins), dtype=np.int64)
        self._first = np.full((len(reference), bins), np.inf)
        self._last = np.full((len(reference), bins), -np.inf)

    def add(self, t: Array, dq: Array) -> None:
        """Take in samples: time `(N,)` [s], increasing over calls, and velocity `(n, N)`."""
        if len(t) == 0:
            return
        for joint, velocity in enumerate(dq):
            self.highest[joint] = max(self.highest[joint], float(np.abs(velocity).max()))
            speed = np.maximum(np.abs(velocity) / self.reference[joint], 10.0**LOWEST_SPEED_DECADE)
            place = np.floor(_bin(speed)).astype(np.intp)
            np.clip(place, 0, self._count.shape[1] - 1, out=place)
            self._count[joint] += np.bincount(place, minlength=self._count.shape[1])
            first = np.full(self._count.shape[1], np.inf)
            first[place[::-1]] = t[::-1]  # of several assignments the last one stays
            self._first[joint] = np.minimum(self._first[joint], first)
            self._last[joint, place] = t

    def quantile(self, share: float) -> Array:
        """Speed per joint below which a share of the samples is, shape `(n,)`."""
        place = [np.searchsorted(row, share * row[-1]) for row in np.cumsum(self._count, axis=1)]
        return self.reference * self._edge(np.array(place) + 1)

    def edge_above(self, speed: Array) -> Array:
        """The lowest edges of bins that are not below `speed`, shape `(n,)`."""
        return self.reference * self._edge(np.ceil(_bin(speed / self.reference) - 1e-6))

    def moving(self, rest_speed: Array) -> tuple[float, float] | None:
        """First and last time at which any joint is faster than its rest speed (edges of bins)."""
        place = np.round(_bin(rest_speed / self.reference))
        start = np.clip(place, 0, self._count.shape[1] - 1).astype(int)
        first = min(row[s:].min() for row, s in zip(self._first, start, strict=True))
        last = max(row[s:].max() for row, s in zip(self._last, start, strict=True))
        return None if first == np.inf else (float(first), float(last))

    def _edge(self, place: Array) -> Array:
        return np.asarray(10.0 ** (place / BINS_PER_DECADE + LOWEST_SPEED_DECADE))


def _bin(speed: Array) -> Array:
    """The bin, counted in fractions, of a speed over the reference."""
    return np.asarray((np.log10(speed) - LOWEST_SPEED_DECADE) * BINS_PER_DECADE)


REST_SHARE = 0.005  # rest speed over the speed that a joint exceeds 1 % of the time
REST_SHARE_OF_FASTEST = 0.001
"""Rest speed over the same speed of the fastest joint: slower ones are dragged, not driven."""
REST_NOISE = 4.0  # rest speed over the standard deviation of the velocity's noise
REST_STEPS = 2.0  # rest speed over the speed that one step of the sensor's resolution seems to be
REST_LOWEST = 1e-4  # lowest default rest speed [rad/s; m/s]
MOVING_OVER_REST = 2.0
"""Speed over rest speed at which a run's motion starts and ends: noise does not reach it."""


def default_rest_speed(fast: Array, noise: Array, step_speed: Array) -> Array:
    """Speed up to which a joint rests, shape `(n,)`.

    Args:
        fast: Speed that each joint exceeds 1 % of the time.
        noise: Standard deviation of each velocity's noise.
        step_speed: Speed that one step of each sensor's resolution seems to be.
    """
    slow = np.maximum(REST_SHARE * fast, max(REST_SHARE_OF_FASTEST * fast.max(), REST_LOWEST))
    return np.maximum(slow, np.maximum(REST_NOISE * noise, REST_STEPS * step_speed))


def given_rest_speed(processing: Processing, joints: int) -> Array | None:
    """The requested rest speeds, shape `(n,)`, or `None`."""
    if processing.rest_speed is None:
        return None
    speeds = np.atleast_1d(np.asarray(processing.rest_speed, dtype=np.float64))
    known = (np.isfinite(speeds) & (speeds > 0.0)).all() or not speeds.any()
    if len(speeds) not in (1, joints) or not known:
        raise LogError(
            f"rest speed {processing.rest_speed} does not fit {joints} joints",
            where="processing",
            fix=f"give one speed for all joints, or {joints} of them; 0: no joint rests",
        )
    return frozen(np.broadcast_to(speeds, (joints,)))


def rest_speed_of_runs(speeds: Sequence[Array], usual: Array) -> Array:
    """Speed up to which joints rest in all of some runs, shape `(n,)` [rad/s; m/s].

    The speed of a run, `(n,)`, is infinite where nothing moves; there the usual one counts.
    """
    return np.asarray(np.max([np.where(np.isfinite(one), one, usual) for one in speeds], axis=0))


SAME_RATE = 1e-6  # relative difference up to which two rates are one
WHOLE_SAMPLES = 300_000
"""Rows up to which a log may be worked on as a whole where a method chooses to."""
SAME_TIME = 1e-6  # difference up to which two times are one, in samples


def prepare(
    recording: Recording,
    processing: Processing | None = None,
    *,
    at_rest: bool = False,
    before: Run | None = None,
) -> Run:
    """Look through a recording and decide how to read it.

    `processing` says what is not left to the data; `at_rest`, whether a log in which no joint
    moves is used, from its first row to its last. A run that was made `before` with other cut-offs
    only has been looked through.
    """
    requested = processing = Processing() if processing is None else processing
    if processing.repetitions is not None:
        mean = mean_of_periods(recording, processing.repetitions)
        return prepare_mean(mean, recording.name, processing)
    loaded = recording.in_memory()
    known = None if before is None else before.survey
    found = survey(loaded, processing) if known is None else known
    loaded, recording = (replace(one, left_out=found.left_out) for one in (loaded, recording))
    if found.band.frequency == 0.0 and not at_rest:
        raise no_joint_moves(recording)
    band = found.band
    cut = cutoffs(processing, band.frequency, found.rate, recording.where, band.floor)
    _long_enough(recording, found, cut)
    made = None if before is None else before.chain.processing.motion
    motion = made or _chosen_method(processing.motion, recording, found)
    processing = replace(processing, motion=motion)
    chain = _chain(processing, found, cut)
    loaded, wide = _with_context(loaded, found, chain)
    segments = _long_enough(recording, wide, cut)
    asked = replace(chain.processing, motion=requested.motion)
    require_windows_in_log(asked, found.rate, max(s.samples for s in segments), recording)
    c = recording.channels
    given = given_rest_speed(processing, c.joints - c.base)
    read = replace(loaded, log=recording.log)
    kept = KeptSamples()
    limited = given is not None and bool(given.any())
    references = [np.ones(c.joints - c.base)]
    if given is not None and limited:
        references.append(given)
    histograms, marked = _speeds(loaded, found, kept, Source(read, chain, segments), references)
    speeds = histograms[0]
    rest = speeds.edge_above(_rest_speed(recording, found, chain, speeds.quantile(0.99)))
    every = found.segments[0].start, found.segments[-1].stop
    whole = every if at_rest else None
    judged = used = _moves(speeds, rest, whole)
    if given is not None:
        used = _moves(histograms[-1], given, whole) if limited else Moves(given, every)
        judged = used if judged is None else judged
    if used is None or judged is None:
        raise no_joint_moves(recording)
    span = min(used.span[0], judged.span[0]), max(used.span[1], judged.span[1])
    used, judged = (one.beside(c.base) for one in (used, judged))
    return Run(
        recording=read,
        name=recording.name,
        chain=replace(chain, flagged=True) if marked.efforts else chain,
        segments=segments,
        rest_speed=used.rest_speed,
        span=_long_span(recording, cut, span),
        judged=judged,
        quality=_quality(
            recording, found, chain, requested, used.rest_speed[c.base :], speeds.highest, marked
        ),
        survey=replace(found, even=found.even[:, :0]),
        kept=kept,
    )


def prepare_mean(mean: MeanMotion, name: str, processing: Processing | None = None) -> Run:
    """The run of a mean over repetitions."""
    wanted = Processing() if processing is None else processing
    run = prepare(mean.recording, replace(wanted, repetitions=None))
    quality = replace(run.quality, notes=(mean.words, *run.quality.notes))
    chain = replace(run.chain, before=mean.words)
    return replace(run, name=name, chain=chain, importance=mean.importance, quality=quality)


def _chosen_method(method: Method, recording: Recording, found: Survey) -> Method:
    """The method with what it leaves to the log found there; a log at rest has nothing to find."""
    if found.band.frequency == 0.0:
        return Butterworth()
    if not isinstance(method, Choosing):
        return method
    c, even = recording.channels, found.even
    velocity = even[c.dq] if c.velocities else None
    whole = found.counts[RowVerdict.KEPT] <= WHOLE_SAMPLES
    return method.chosen(even[c.q], velocity, found.logged_rate, found.band.frequency, whole=whole)


def _chain(processing: Processing, found: Survey, cut: Cutoffs) -> Chain:
    """The chain with every choice made; nothing is flagged yet."""
    slower = found.rate < (1.0 - SAME_RATE) * found.logged_rate
    return Chain(
        processing=replace(processing, motion_cutoff=cut.motion, matched_cutoff=cut.matched),
        clock=found.clock,
        rate=found.rate,
        thinning=int(np.ceil(found.logged_rate / found.rate)) if slower else 1,
        row_checks=found.row_checks,
        flagged=False,
    )


def _speeds(
    recording: Recording,
    found: Survey,
    kept: KeptSamples,
    source: Source,
    references: Sequence[Array],
) -> tuple[list[SpeedHistogram], Marked]:
    """Speeds in the window, over each reference, and what was marked there; samples are kept.

    The ends of segments do not count, which the filter has to guess beyond.
    """
    chain = source.chain
    n, moved = recording.channels.joints, slice(recording.channels.base, None)
    histograms = [SpeedHistogram(reference) for reference in references]
    slip = SAME_TIME / chain.rate
    counted = found.segments[0].start, found.segments[-1].stop
    bent = 1.0 / chain.motion_cutoff
    early, late = lost_ends(recording.signals)
    marks = np.zeros(COUNTS_OF_MARKS)
    for part in kept.keeping(source, chain.parts(recording, source.segments, counted)):
        s, last = part.segment, part.first + part.signals.shape[1]
        at = s.start + np.arange(part.first, last) / chain.rate
        inside = at >= max(counted[0] - slip, s.start + bent + early)
        inside &= at <= min(counted[1] + slip, s.stop - bent - late)
        for speeds in histograms:
            speeds.add(at[inside], part.signals[n : 2 * n, inside][moved])
        marks += part.marks
    return histograms, Marked(*map(int, marks))


def _moves(
    speeds: SpeedHistogram, rest_speed: Array, whole: tuple[float, float] | None
) -> Moves | None:
    """Where joints move; where none does, the `whole` log at rest, if it is to be used."""
    span = speeds.moving(MOVING_OVER_REST * rest_speed)
    if span is not None:
        return Moves(frozen(rest_speed), span)
    return None if whole is None else Moves(frozen(np.full_like(rest_speed, np.inf)), whole)


def _long_span(
    recording: Recording, cut: Cutoffs, span: tuple[float, float]
) -> tuple[float, float]:
    """Times of the first and last motion of any joint, which must be long enough."""
    need = SHORTEST_SEGMENT / cut.matched
    if span[1] - span[0] < need:
        raise LogError(
            f"the motion in this log is shorter than its filter: {span[1] - span[0]:.2g} s, where "
            f"a cut-off of {cut.matched:g} Hz needs {need:.2g} s",
            where=recording.where,
            fix="record a longer motion, or raise matched_cutoff in [processing] of the robot file",
        )
    return span


def _with_context(recording: Recording, found: Survey, chain: Chain) -> tuple[Recording, Survey]:
    """The recording with its window widened by what the motion's filter looks at, if it is cut.

    Where the log goes on beyond the window, the filter of the motion sees it: at a cut in the
    middle of a motion any guessed continuation would bend the accelerations.
    """
    if recording.cut == Cut():
        return recording, found
    more = chain.context(recording)
    seconds, rows = recording.cut.seconds, recording.cut.rows
    spare = int(np.ceil(1.2 * more / found.clock.step)) + 1
    wider = Cut(
        seconds=(seconds[0] - more, seconds[1] + more),
        rows=(max(0, rows[0] - spare), None if rows[1] is None else rows[1] + spare),
    )
    wide = replace(recording, cut=wider)
    around = survey(wide, chain.processing, found)
    first, last = found.segments[0].start, found.segments[-1].stop
    # what lies beyond a gap is no context, but another part of the log, or another episode
    segments = tuple(s for s in around.segments if s.stop > first and s.start < last)
    around = replace(around, rate=found.rate, segments=segments)
    return replace(wide, left_out=around.left_out), around


def _long_enough(recording: Recording, found: Survey, cut: Cutoffs) -> tuple[Segment, ...]:
    need = SHORTEST_SEGMENT / cut.matched
    segments = tuple(
        replace(s, samples=sample_count(s.start, s.stop, found.rate))
        for s in found.segments
        if (s.stop - s.start) > need
    )
    if not segments:
        longest = max(s.stop - s.start for s in found.segments)
        raise LogError(
            f"the log is shorter than its filter: a cut-off of {cut.matched:g} Hz needs "
            f"{need:.2g} s without a gap, the log has {longest:.2g} s",
            where=recording.where,
            fix="record for longer, widen the window, or raise matched_cutoff in [processing] "
            "of the robot file",
        )
    return segments


def _rest_speed(recording: Recording, found: Survey, chain: Chain, fast: Array) -> Array:
    c, rate = recording.channels, chain.rate
    of_position, of_velocity = motion_responses(
        chain.processing.motion, chain.motion_cutoff, rate, c.joints
    )
    if found.velocity_noise is None:
        noise = np.sqrt(found.band.noise) * noise_gain(of_position[1], rate)
        step_speed = found.resolution[c.q] * rate * of_position[0].max(axis=-1)
    else:
        noise = np.sqrt(found.velocity_noise) * noise_gain(of_velocity[1], rate)
        step_speed = found.resolution[c.dq]
    return default_rest_speed(fast, noise[c.base :], step_speed[c.base :])


def _quality(
    recording: Recording,
    found: Survey,
    chain: Chain,
    requested: Processing,
    rest_speed: Array,
    highest: Array,
    marked: Marked,
) -> Quality:
    c = recording.channels
    segments = _long_enough(recording, found, Cutoffs(chain.motion_cutoff, chain.matched_cutoff))
    lost = [v for v in RowVerdict if v != RowVerdict.KEPT and found.counts[v]]
    starts = [*(s.start for s in segments), found.segments[-1].stop]
    stops = [found.segments[0].start, *(s.stop for s in segments)]
    return Quality(
        rows=sum(found.counts),
        kept=found.counts[RowVerdict.KEPT],
        dropped={verdict.reason: found.counts[verdict] for verdict in lost},
        gaps=tuple(s.stop for s in found.segments[:-1]),
        rate=found.rate,
        steps=found.steps,
        duration=found.duration,
        resolution=frozen(found.resolution[c.q]),
        effort_resolution=frozen(found.resolution[c.effort]),
        max_speed=frozen([*np.zeros(c.base), *highest]),
        losses=_losses(recording, found, segments, marked),
        notes=_choices_for_quality(found, chain, requested, rest_speed, marked),
        marked=marked,
        unexamined=tuple(
            (a, b) for a, b in zip(stops, starts, strict=True) if b - a > found.clock.gap
        ),
    )


def _losses(
    recording: Recording, found: Survey, segments: tuple[Segment, ...], marked: Marked
) -> tuple[str, ...]:
    losses = []
    if recording.wrapped:
        losses.append(f"positions {', '.join(recording.wrapped)} wrap after a turn: unwrapped")
    if len(found.segments) > 1:
        at = ", ".join(f"{s.stop:.2f} s" for s in found.segments[:5][: len(found.segments) - 1])
        losses.append(f"{len(found.segments) - 1} gaps split the run, the first after {at}")
    if short := len(found.segments) - len(segments):
        losses.append(f"{short} stretches between gaps are shorter than the filter and left out")
    if marked.words:
        losses.append(marked.words)
    columns = recording.signals.effort
    return (*losses, *(stretch.words(columns) for stretch in recording.left_out))


def _choices_for_quality(
    found: Survey, chain: Chain, requested: Processing, rest_speed: Array, marked: Marked
) -> tuple[str, ...]:
    mean, _, least, most = found.steps
    motion, matched = (
        "" if cutoff is None else " (not chosen from this log)"
        for cutoff in (requested.motion_cutoff, requested.matched_cutoff)
    )
    parallel = f"regression cut-off {chain.matched_cutoff:g} Hz{matched}"
    if not requested.parallel_filter:
        parallel = "no parallel filter"
    rests = "at rest below " + " ".join(f"{s:.2g}" for s in rest_speed) + " rad/s or m/s"
    return (
        f"resampled to {found.rate:g} Hz (steps {1e3 * mean:.4g} ms mean, {1e3 * least:.4g} to "
        f"{1e3 * most:.4g} ms)",
        f"motion up to {found.band.frequency:.2g} Hz, noise above {found.band.floor:.2g} Hz: "
        f"motion cut-off {chain.motion_cutoff:g} Hz{motion}, {parallel}",
        f"processing: {chain.words}; {marked.words or 'nothing corrected'}",
        rests if rest_speed.any() else "no joint counts as at rest",
    )
