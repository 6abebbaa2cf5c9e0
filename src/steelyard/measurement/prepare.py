"""From a recording to a run: survey, cut-offs, rests, quality."""

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import LogError
from steelyard.formats.cut import Cut
from steelyard.measurement.clean import Verdict
from steelyard.measurement.convolve import Bank
from steelyard.measurement.defaults import (
    DEPARTED,
    SHORTEST,
    Cutoffs,
    Processing,
    cutoffs,
    default_rest_speed,
    given_rest_speed,
    noise_gain,
)
from steelyard.measurement.derivative import smooth_derivatives
from steelyard.measurement.quality import Quality, Segment
from steelyard.measurement.recording import Recording
from steelyard.measurement.resample import sample_count
from steelyard.measurement.rest import SpeedHistogram
from steelyard.measurement.run import Run, filtered
from steelyard.measurement.survey import Survey, survey


def prepare(recording: Recording, processing: Processing | None = None) -> Run:
    """Look through a recording and decide how to read it.

    Args:
        recording: Raw rows.
        processing: What is not left to the data.

    Raises:
        LogError: The log holds no motion that can be used; the message says why.
    """
    processing = Processing() if processing is None else processing
    held = recording.held()
    found = survey(held)
    if found.band.frequency == 0.0:
        raise _static(recording)
    cut = cutoffs(processing, found.band.frequency, found.rate, recording.where)
    _long_enough(recording, found, cut)
    held, wide = _with_context(held, found, cut)
    segments = _long_enough(recording, wide, cut)
    given = given_rest_speed(processing, recording.channels.joints)
    speeds = _speeds(held, found, cut, segments, given)
    if given is None:
        given = speeds.edge_above(_rest_speed(recording, found, cut, speeds.quantile(0.99)))
    return Run(
        recording=replace(held, log=recording.log),
        name=recording.name,
        clock=found.clock,
        rate=found.rate,
        segments=segments,
        motion_cutoff=cut.motion,
        matched_cutoff=cut.matched,
        rest_speed=frozen(given),
        span=_span(recording, cut, speeds, given),
        quality=_quality(recording, found, cut, given, speeds.highest),
    )


def _static(recording: Recording) -> LogError:
    return LogError(
        "no joint moves in this log",
        where=recording.where,
        mend="record a motion of all joints; rest tells too little about a robot",
    )


def _speeds(
    recording: Recording,
    found: Survey,
    cut: Cutoffs,
    segments: tuple[Segment, ...],
    given: Array | None,
) -> SpeedHistogram:
    """Speeds in the window, without the ends of segments, which the filter has to guess beyond."""
    n = recording.channels.joints
    speeds = SpeedHistogram(np.ones(n) if given is None else given)
    window = found.segments[0].start, found.segments[-1].stop
    by_number = {s.number: s for s in segments}
    bent = 1.0 / cut.motion
    for number, first, signals in filtered(
        recording, found.clock, found.rate, cut.motion, tuple(by_number)
    ):
        segment = by_number[number]
        at = segment.start + np.arange(first, first + signals.shape[1]) / found.rate
        inside = at >= max(window[0], segment.start + bent)
        inside &= at <= min(window[1], segment.stop - bent)
        speeds.add(at[inside], signals[n : 2 * n, inside])
    return speeds


def _span(
    recording: Recording, cut: Cutoffs, speeds: SpeedHistogram, rest_speed: Array
) -> tuple[float, float]:
    """Times of the first and last motion of any joint."""
    span = speeds.moving(DEPARTED * rest_speed)
    if span is None:
        raise _static(recording)
    need = SHORTEST / cut.matched
    if span[1] - span[0] < need:
        raise LogError(
            f"the motion in this log is shorter than its filter: {span[1] - span[0]:.2g} s, where "
            f"a cut-off of {cut.matched:g} Hz needs {need:.2g} s",
            where=recording.where,
            mend="record a longer motion, or raise matched_cutoff in [processing] of the robot "
            "file",
        )
    return span


def _with_context(recording: Recording, found: Survey, cut: Cutoffs) -> tuple[Recording, Survey]:
    """The recording with its window widened by what the motion's filter looks at, if it is cut.

    Where the log goes on beyond the window, the filter of the motion sees it: at a cut in the
    middle of a motion any guessed continuation would bend the accelerations.
    """
    if recording.cut == Cut():
        return recording, found
    samples = smooth_derivatives(cut.motion, found.rate, 2).halo
    seconds, rows = recording.cut.seconds, recording.cut.rows
    more = samples / found.rate
    spare = int(np.ceil(1.2 * more / found.clock.step)) + 1
    wider = Cut(
        seconds=(seconds[0] - more, seconds[1] + more),
        rows=(max(0, rows[0] - spare), None if rows[1] is None else rows[1] + spare),
    )
    wide = replace(recording, cut=wider)
    return wide, replace(survey(wide), rate=found.rate)


def _long_enough(recording: Recording, found: Survey, cut: Cutoffs) -> tuple[Segment, ...]:
    need = SHORTEST / cut.matched
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
            mend="record for longer, widen the window, or raise matched_cutoff in [processing] "
            "of the robot file",
        )
    return segments


def _rest_speed(recording: Recording, found: Survey, cut: Cutoffs, fast: Array) -> Array:
    """The default rest speed of each joint, shape `(n,)`."""
    c = recording.channels
    bank: Bank = smooth_derivatives(cut.motion, found.rate, 1)
    if found.velocity_noise is None:
        noise = np.sqrt(found.band.noise) * noise_gain(bank, 1, found.rate)
        step_speed = found.resolution[c.q] * found.rate * bank.taps[0].max()
    else:
        noise = np.sqrt(found.velocity_noise) * noise_gain(bank, 0, found.rate)
        step_speed = found.resolution[c.dq]
    return default_rest_speed(fast, noise, step_speed)


def _quality(
    recording: Recording,
    found: Survey,
    cut: Cutoffs,
    rest_speed: Array,
    highest: Array,
) -> Quality:
    c = recording.channels
    segments = _long_enough(recording, found, cut)
    counts = {v: found.counts[v] for v in Verdict if v != Verdict.KEPT and found.counts[v]}
    mean, spread, least, most = found.steps
    return Quality(
        rows=sum(found.counts),
        kept=found.counts[Verdict.KEPT],
        dropped={verdict.reason: count for verdict, count in counts.items()},
        repeated=found.counts[Verdict.REPEATED],
        backward=found.counts[Verdict.BACKWARD],
        gaps=tuple(s.stop for s in found.segments[:-1]),
        short=len(found.segments) - len(segments),
        rate=found.rate,
        step_mean=mean,
        step_std=spread,
        step_min=least,
        step_max=most,
        duration=found.duration,
        resolution=frozen(found.resolution[c.q]),
        effort_resolution=frozen(found.resolution[c.effort]),
        max_speed=frozen(highest),
        losses=_losses(found, segments),
        notes=_choices(found, cut, rest_speed),
    )


def _losses(found: Survey, segments: tuple[Segment, ...]) -> tuple[str, ...]:
    """What of the log could not be used."""
    losses = []
    lost = [(v, found.counts[v]) for v in Verdict if v != Verdict.KEPT and found.counts[v]]
    if lost:
        losses.append(
            f"dropped {sum(n for _, n in lost)} of {sum(found.counts)} rows: "
            + ", ".join(f"{n} with {v.reason}" for v, n in lost)
        )
    if len(found.segments) > 1:
        at = ", ".join(f"{s.stop:.2f} s" for s in found.segments[:5][: len(found.segments) - 1])
        losses.append(f"{len(found.segments) - 1} gaps split the run, the first after {at}")
    if short := len(found.segments) - len(segments):
        losses.append(f"{short} stretches between gaps are shorter than the filter and left out")
    return tuple(losses)


def _choices(found: Survey, cut: Cutoffs, rest_speed: Array) -> tuple[str, ...]:
    """What was decided from the data."""
    mean, _, least, most = found.steps
    return (
        f"resampled to {found.rate:g} Hz (steps {1e3 * mean:.4g} ms mean, {1e3 * least:.4g} to "
        f"{1e3 * most:.4g} ms)",
        f"motion below {found.band.frequency:.2g} Hz: motion cut-off {cut.motion:g} Hz, "
        f"matched cut-off {cut.matched:g} Hz",
        "rest below " + " ".join(f"{s:.2g}" for s in rest_speed) + " rad/s or m/s",
    )
