"""External torque, contact and payload on a stream: what `steelyard watch` does."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED, ContactThresholds
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import PER_PERIOD
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.scores import residual_noise_and_traces as residual_noise
from steelyard.identify.runs_and_notes_of_logs import fitted_before, processing_of
from steelyard.logs.contents import windowed
from steelyard.logs.formats import open_log
from steelyard.logs.log_windows import parse_log_argument
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of
from steelyard.runs.sample_stream import SampleStream
from steelyard.uses.contact.contact import (
    common_rest_speed,
    fitted_note,
    left_out_words,
    peaks_of_free_motion,
)
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvents, find_payload_events
from steelyard.uses.watch import watcher_and_events as watching
from steelyard.uses.watch.stream_output import StreamFiles


@dataclass(frozen=True, eq=False)
class WatchStart:
    """A watcher; what its thresholds rest on, and what is not sought and why."""

    watcher: watching.Watcher
    model: IdentifiedModel
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        watcher, robot, known = self.watcher, self.model.robot, self.watcher.thresholds
        return {
            "event": "start",
            "robot": robot.name,
            "joints": list(robot.joint_names),
            "units": list(robot.effort_units),
            "bandwidth_hz": watcher.observer.bandwidth,
            "frame": watcher.frame,
            "thresholds": None if known is None else known.to_dict(),
            "notes": list(self.notes),
        }


def start_watch(
    model: str | Path | IdentifiedModel,
    frame: str | None = None,
    *,
    calibrate: str | Path | Iterable[str | Path] = (),
    rate: float | None = None,
    bandwidth: float | None = None,
    every: float | None = None,
    progress: Progress = silent,
) -> WatchStart:
    """Begin to watch a stream.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        frame: Estimate the wrench on this frame, along its axes.
        calibrate: Logs of motion without contact, not fitted, recorded like the stream, to
            calibrate thresholds of contact with; without any, the residuals of the cross-validation
            that are stored in the model.
        rate: False alarms per hour of all joints together; if `None` 1, or as few as the
            calibration supports.
        bandwidth: Bandwidth of the observer [Hz], a tenth of the sampling rate at most; if `None`,
            the cut-off at which the thresholds of contact were computed.
        every: Print estimates too, with this time between them [s] (also in estimates.csv).
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, there is no such frame, or the calibration does not
            support the rate.
    """
    identified = load_model(model)
    given = log_files(paths_of(calibrate))
    calibration = identified.calibration
    own = None if calibration is None else calibration.peaks
    cutoff = bandwidth or (identified.cutoffs.score if own is None else own.cutoff)
    observer = identified.observe(frame, bandwidth=cutoff)
    thresholds: ContactThresholds | None = None
    notes: list[str]
    if given:
        thresholds, notes = calibrated_thresholds(identified, given, cutoff, rate, progress)
    elif own is not None and own.cutoff == cutoff:
        thresholds = residual_noise.thresholds_of(identified, own, rate)
        notes = [
            f"{rate_words(thresholds, left_out_words(identified))}; these logs were smoothed, and "
            "abrupt stops cause larger residuals in a stream: calibrate with logs that were "
            "recorded like the stream (--calibrate)"
        ]
    elif rate is not None:
        raise DataError(
            "a rate of false alarms is given, but there is nothing to calibrate thresholds with",
            where="--rate",
            fix="give logs of motion without contact with --calibrate",
        )
    else:
        notes = [
            "contact is not sought: the model has no residuals of left-out motion "
            f"behind {cutoff:g} Hz; give logs of motion without contact with --calibrate"
        ]
    payload: watching.PayloadStream | None = None
    if identified.signals.effort_kind == "gravity_compensated_torque":
        notes.append("changes of the payload are not sought: efforts are gravity-compensated")
    else:
        payload = payload_stream(identified, frame)
    period = 1.0 / (PER_PERIOD * cutoff) if every is None else every
    watcher = watching.Watcher(identified, observer, frame, thresholds, payload, period)
    return WatchStart(watcher, identified, tuple(notes))


def payload_stream(identified: IdentifiedModel, frame: str | None) -> watching.PayloadStream:
    """What finds changes of a payload in consecutive rows of a stream."""
    carrier(identified.model.robot, frame)
    signals, processing = identified.signals, processing_of(identified)
    regressor = base_regressor(identified.model)

    def detect(rows: Array) -> PayloadEvents:
        log = LogInMemory(Path("stream"), signals.columns, rows)
        run = prepare(Recording(log, signals).unwrapped(), processing)
        samples = gather_samples(regressor, run)
        return find_payload_events(identified, samples, frame)

    return watching.PayloadStream(detect)


def watch_rows(
    watcher: watching.Watcher,
    arriving: Iterable[Array],
    emit: Callable[[watching.StreamEvent], None],
    files: StreamFiles | None = None,
    *,
    source: str,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Report what happens in rows as they arrive, until they end.

    A contact that is still going on is ended there, also where an error ends the rows.
    """

    def report(events: Iterable[watching.StreamEvent]) -> None:
        for event in events:
            if files is not None:
                files.take(event)
            emit(event)

    try:
        for rows in arriving:
            report(watcher.take(rows))
            if files is not None:
                files.flush()
            if stopped():
                break
        watcher.refuse_unusable(source)
    finally:
        if watcher.started:
            report(watcher.end())


def rate_words(thresholds: ContactThresholds, source: str) -> str:
    """What thresholds rest on, for people to read."""
    return (
        f"thresholds for at most {thresholds.rate:.3g} false alarms per hour, from "
        f"{thresholds.duration / 60.0:.1f} min of free motion: {source}"
    )


def calibrated_thresholds(
    identified: IdentifiedModel,
    logs: Sequence[LogArgument],
    cutoff: float,
    rate: float | None,
    progress: Progress,
) -> tuple[ContactThresholds, list[str]]:
    """Thresholds from residuals as the stream has them, and what they rest on."""
    unseen = [log for log in logs if not fitted_before(identified.provenance, log)]
    if not unseen:
        raise DataError(
            "all calibration logs were fitted: their residuals say nothing of other motion",
            where="--calibrate",
            fix="give logs of other motion without contact, or leave --calibrate out",
        )
    traces = []
    for number, log in enumerate(unseen):
        report_progress(progress, "calibrating thresholds", number, len(unseen))
        traces.append(stream_trace(identified, log, cutoff))
    rest = common_rest_speed(identified, [np.full(identified.robot.n, np.inf)])
    peaks, suspected = peaks_of_free_motion(identified, traces, rest, cutoff, None)
    thresholds = residual_noise.thresholds_of(identified, peaks, rate)
    count = f"{len(unseen)} calibration {'log' if len(unseen) == 1 else 'logs'}"
    return thresholds, [
        rate_words(thresholds, count),
        *(one.text for one in suspected),
        *(fitted_note(log.path.name) for log in logs if log not in unseen),
    ]


def stream_trace(
    identified: IdentifiedModel, log: LogArgument, cutoff: float
) -> residual_noise.ResidualTrace:
    """Residuals of a finished log as a stream of its rows shows them, behind a cut-off [Hz]."""
    path, cut = parse_log_argument(log.text)
    signals, observer = identified.signals, identified.observe(bandwidth=cutoff)
    stream, rest = SampleStream(signals, identified.robot), watching.rests_of(identified)
    t, residual, speed = [], [], []
    for rows in windowed(open_log(path), stream.columns, cut):
        for sample in stream.samples(rows):
            moving = watching.velocity_of(sample.dq, rest)
            observer.step(sample.t, sample.q, moving, signals.gains * sample.effort)
            t.append(sample.t)
            residual.append(-observer.torque)
            speed.append(np.abs(sample.dq))
    name = f"{path.stem}{cut.text}"
    first = int(np.searchsorted(t, residual_noise.FORGOTTEN / (2.0 * np.pi * cutoff)))
    if len(t) < first + 2:
        raise LogError(
            "the log is too short for the residual's low-pass",
            where=name,
            fix="log for longer, or give a higher bandwidth",
        )
    step = float(np.median(np.diff(t)))
    speeds = np.array(speed).T
    slowest = -residual_noise.greatest(-speeds, round(HOLD / step) + 1)
    fastest = residual_noise.greatest(speeds, round(SETTLED / step) + 1)
    none = np.zeros((3, identified.robot.n, len(t)))
    found = (np.array(residual).T, slowest, fastest, none[0], none[1:])
    return residual_noise.ResidualTrace(name, np.array(t), step, *found).of(slice(first, None))
