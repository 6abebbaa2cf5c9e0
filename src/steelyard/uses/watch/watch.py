"""External torque, contact and payload on a stream: what `steelyard watch` does and reports."""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from math import isinf, isnan
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np

from steelyard.base.arrays import Array, json_values
from steelyard.base.errors import DataError, LogError
from steelyard.base.files import explained
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.changes_from_model import LocalParameters
from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED, ContactThresholds
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import PER_PERIOD
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.scores import residual_traces_and_band_calibration as residual_noise
from steelyard.identify.runs_and_notes_of_logs import fitted_before, processing_of
from steelyard.logs.contents import windowed
from steelyard.logs.formats import open_log
from steelyard.report.words import signed, significant
from steelyard.robot.robot import refuse_floating
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of
from steelyard.runs.sample_stream import SampleStream
from steelyard.uses.contact import contact
from steelyard.uses.contact.contact import ContactEvent, ContactStart, JointLoad
from steelyard.uses.payload import pick_up_and_put_down as picking
from steelyard.uses.payload.payload import mass_with_interval, rounded_mass
from steelyard.uses.watch import watcher_and_events as watching
from steelyard.uses.watch.parameters_of_stream import ParameterStream, StreamParameters


def record_of(event: watching.StreamEvent) -> dict[str, Any]:
    """As JSON values; `event` says what it is."""
    match event:
        case ContactStart():
            return {
                "event": "contact",
                "time_s": event.time,
                "known_s": event.known,
                **vars(event.joint),
                "links": list(event.links),
            }
        case ContactEvent():
            return {"event": "contact_end", **event.to_dict()}
        case picking.PayloadEvent():
            return {
                "event": "payload",
                "kind": event.kind,
                "time_s": event.time,
                "earliest_s": event.earliest,
                "latest_s": event.latest,
                "mass_kg": event.mass,
                "mass_half_width_kg": event.mass_half_width,
                "over_threshold": event.ratio,
            }
        case watching.StreamNote():
            return {"event": "note", "time_s": event.time, "text": event.text}
        case StreamParameters():
            return {"event": "parameters", "time_s": event.time, **json_values(event)}
    record: dict[str, Any] = {
        "event": "estimate",
        "time_s": event.time,
        "torque": event.torque.tolist(),
        "torque_half_width": event.half_width.tolist(),
    }
    if event.wrench is not None and event.wrench_half_width is not None:
        record["wrench"] = event.wrench.tolist()
        record["wrench_half_width"] = event.wrench_half_width.tolist()
    return record


def event_line(event: watching.StreamEvent) -> str:
    """One line of a terminal."""
    time = event.end if isinstance(event, ContactEvent) else event.time
    match event:
        case ContactStart():
            what, text = "contact", f"{_load(event.joint)}, {event.place}"
        case ContactEvent():
            largest, lasted = _load(event.joints[0]), event.end - event.start
            what, text = "released", f"after {lasted:.2f} s; largest {largest}, {event.place}"
        case picking.PayloadEvent():
            mass, half = rounded_mass(event.mass, event.mass_half_width)
            between = f"between {event.earliest:.2f} and {event.latest:.2f} s"
            what, text = event.kind, f"{mass} ± {half} kg ({between})"
        case watching.StreamNote():
            what, text = "note", event.text
        case StreamParameters():
            what, text = "changes", parameters_words(event)
        case watching.StreamEstimate():
            what, text = "estimate", f"torque {' '.join(f'{x:.3g}' for x in event.torque)}"
            if event.wrench is not None:
                text += f"; wrench {' '.join(f'{x:.3g}' for x in event.wrench)}"
    return f"{time:9.2f} s  {what:9}  {text}"


def parameters_words(event: StreamParameters) -> str:
    """Changes from the model whose intervals exclude zero, and what the motion has not shown."""
    changed = [one for one in event.shown if abs(one.value) > one.half_width]
    words = [
        f"{one.quantity} of {one.joint} {signed(one.value)} ± {significant(one.half_width, 2)} "
        f"{one.unit}"
        if one.unit
        else f"{one.quantity} of {one.joint} {100.0 * one.value:+.1f} ± "
        f"{significant(100.0 * one.half_width, 2)} %"
        for one in changed
    ]
    text = "; ".join(words) or "none"
    same = len(event.shown) - len(changed)
    text += f" ({same} others as in the model"
    if event.stays:
        text += f"; not shown, so they stay: {', '.join(event.stays)}"
    return f"{text}; from {event.seconds:.0f} s)"


def _load(load: JointLoad) -> str:
    change = " change" if load.change else ""
    ratio = significant(load.ratio)
    return f"{load.joint} {signed(load.peak)} {load.unit}{change}, {ratio} × threshold"


def state_line(watcher: watching.Watcher) -> str:
    """What a watcher sees now, for a line that is written again and again."""
    if not watcher.observer.steps:
        return "waiting for samples"
    parts = [f"{watcher.time:.1f} s"]
    if not isnan(watcher.ratio):
        parts.append(f"largest residual {significant(watcher.ratio)} × threshold")
    if watcher.frame is not None:
        force, half = watcher.observer.wrench[:3], watcher.observer.half_width[:3]
        parts.append(f"force {np.linalg.norm(force):.0f} ± {np.linalg.norm(half):.0f} N")
    payload = watcher.payload
    if payload is not None and payload.state is not None:
        mass, half_width = rounded_mass(payload.state.mass, payload.state.half_width)
        carried = f"{mass} ± {half_width} kg" if half_width else "none"
        least = payload.state.least_mass
        changes = "no changes" if isinf(least) else f"changes of {least:.2g} kg or more"
        parts.append(f"payload {carried} ({changes} visible)")
    return "   ".join(parts)


def summary_lines(
    summary: Mapping[str, Any], joints: Sequence[str], units: Sequence[str]
) -> Iterator[str]:
    """The end of a stream, see `Watcher.summary`."""
    duration, samples, least = (summary[x] for x in ("duration_s", "samples", "least_mass_kg"))
    yield (
        f"{duration:.1f} s, {_counted(samples, 'sample')} "
        f"({samples / duration if duration else 0.0:.0f} a second): "
        f"{_counted(summary['contacts'], 'contact')}, "
        f"{_counted(summary['payload_changes'], 'change')} of the payload"
    )
    largest = zip(joints, summary["largest_torque"], units, strict=True)
    sizes = ", ".join(f"{joint} {significant(size)} {unit}" for joint, size, unit in largest)
    yield f"largest external torque: {sizes}"
    if summary["doubt"]:
        yield summary["doubt"]
    if summary["dropped_rows"]:
        rows = ", ".join(f"{count} for {why}" for why, count in summary["dropped_rows"].items())
        yield f"rows left out: {rows}"
    if summary["gaps"]:
        yield f"pauses after which the observer restarted: {summary['gaps']}"
    if summary["carried_kg"] is not None:
        mass = mass_with_interval(summary["carried_kg"], summary["carried_half_width_kg"])
        yield f"payload at the last search: {mass} kg"
    if least is not None:
        yield (
            "no change of the payload would have been seen: too little motion"
            if isinf(least)
            else "smallest change of the payload's mass that would be detected: "
            f"{least:.2g} kg (for a mass at the frame's origin, in half of the searches)"
        )
    if failed := summary["payload_not_sought"]:
        yield f"the last search for changes of the payload was not possible: {failed}"


def _counted(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'s' * (count != 1)}"


EVENT_COLUMNS = (
    "event", "time_s", "end_s", "what", "value", "half_width", "unit", "over_threshold", "place",
)  # fmt: skip

WRENCH_COLUMNS = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")  # entries of a wrench


def event_row(
    event: ContactEvent | picking.PayloadEvent | watching.StreamNote,
) -> dict[str, str | float]:
    """Cells of the table of events by `EVENT_COLUMNS`."""
    row: dict[str, str | float]
    match event:
        case ContactEvent():
            load = event.joints[0]
            row = {"event": "contact", "time_s": event.start, "end_s": event.end}
            row |= {"what": load.joint, "value": load.peak, "unit": load.unit}
            return row | {"over_threshold": load.ratio, "place": event.place}
        case picking.PayloadEvent():
            row = {"event": event.kind, "time_s": event.time, "what": "payload", "unit": "kg"}
            row |= {"value": event.mass, "half_width": event.mass_half_width}
            return row | {"over_threshold": event.ratio}
    return {"event": "note", "time_s": event.time, "what": event.text}


EVENTS, ESTIMATES = "events.csv", "estimates.csv"


class StreamFiles:
    """`events.csv` and `estimates.csv`, complete up to the last `flush`."""

    def __init__(self, events: TextIO, estimates: TextIO) -> None:
        self._files = events, estimates
        self._events, self._estimates = (csv.writer(x, lineterminator="\n") for x in self._files)

    @classmethod
    @contextmanager
    def opened(cls, folder: Path, joints: Sequence[str], wrench: bool) -> Iterator[Self]:
        """New files in a new folder, closed at the end of the block."""
        with explained(folder), ExitStack() as stack:
            folder.mkdir(parents=True)
            files: list[Any] = [
                stack.enter_context((folder / name).open("x", encoding="utf-8", newline=""))
                for name in (EVENTS, ESTIMATES)
            ]
            tables = cls(*files)
            tables._events.writerow(EVENT_COLUMNS)
            both = [*WRENCH_COLUMNS, *(f"half_width.{x}" for x in WRENCH_COLUMNS)] if wrench else []
            torques = (f"{what}.{joint}" for what in ("torque", "half_width") for joint in joints)
            tables._estimates.writerow(["time_s", *torques, *both])
            tables.flush()
            yield tables

    def take(self, event: watching.StreamEvent) -> None:
        """Write what belongs into the tables: contacts when they end."""
        if isinstance(event, watching.StreamEstimate):
            both = (event.torque, event.half_width, event.wrench, event.wrench_half_width)
            known = (x for part in both if part is not None for x in part.tolist())
            self._estimates.writerow(_short([event.time, *known]))
        elif isinstance(event, ContactEvent | picking.PayloadEvent | watching.StreamNote):
            row = event_row(event)
            self._events.writerow(_short([row.get(name, "") for name in EVENT_COLUMNS]))

    def flush(self) -> None:
        """Hand all rows to the system."""
        for file in self._files:
            file.flush()


def _short(row: Sequence[str | float]) -> list[str]:
    """Cells, numbers with nine digits."""
    return [cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row]


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
    identify: bool = False,
    forget: float = 600.0,
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
        identify: Estimate changes of bodies, friction and offsets from the model, too, recursively;
            they are published every minute of motion without contact, where it has shown them.
        forget: Time constant with which that estimate forgets [s].
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, there is no such frame, or the calibration does not
            support the rate.
    """
    identified = load_model(model)
    refuse_floating(identified.robot, "watching")
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
            f"{rate_words(thresholds, contact.left_out_words(identified))}; these logs were "
            "smoothed, and abrupt stops cause larger residuals in a stream: calibrate with logs "
            "that were recorded like the stream (--calibrate)"
        ]
    elif rate is not None:
        wrong = "a rate of false alarms is given, but there is nothing to calibrate thresholds with"
        fix = "give logs of motion without contact with --calibrate"
        raise DataError(wrong, where="--rate", fix=fix)
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
    parameters = parameter_stream(identified, forget) if identify else None
    found = thresholds, payload, period, parameters
    watcher = watching.Watcher(identified, observer, frame, *found)
    return WatchStart(watcher, identified, tuple(notes))


def payload_stream(identified: IdentifiedModel, frame: str | None) -> watching.PayloadStream:
    """What finds changes of a payload in consecutive rows of a stream."""
    carrier(identified.model.robot, frame)
    signals, processing = identified.signals, processing_of(identified)
    regressor = base_regressor(identified.model)

    def detect(rows: Array) -> picking.PayloadEvents:
        log = LogInMemory(Path("stream"), signals.columns, rows)
        run = prepare(Recording(log, signals).unwrapped(), processing)
        samples = gather_samples(regressor, run)
        return picking.find_payload_events(identified, samples, frame)

    return watching.PayloadStream(detect)


def parameter_stream(identified: IdentifiedModel, forget: float) -> ParameterStream:
    """What estimates changes from the model from consecutive rows of a stream."""
    signals, processing = identified.signals, processing_of(identified)
    rest = watching.rests_of(identified)
    if (rest > 0.0).all():  # noise of a joint that rests is no motion: its friction is anywhere
        processing = replace(processing, rest_speed=tuple(rest.tolist()))
    regressor, rests = base_regressor(identified.model), identified.model.has_memory

    def of_rows(rows: Array) -> Information:
        log = LogInMemory(Path("stream"), signals.columns, rows)
        run = prepare(Recording(log, signals).unwrapped(), processing)
        return gather(regressor, run, rests=rests)

    return ParameterStream(LocalParameters(identified, regressor.layout), of_rows, forget)


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
        wrong = "all calibration logs were fitted: their residuals say nothing of other motion"
        fix = "give logs of other motion without contact, or leave --calibrate out"
        raise DataError(wrong, where="--calibrate", fix=fix)
    traces = []
    for number, log in enumerate(unseen):
        report_progress(progress, "calibrating thresholds", number, len(unseen))
        traces.append(stream_trace(identified, log, cutoff))
    rest = contact.common_rest_speed(identified, [np.full(identified.robot.n, np.inf)])
    peaks, suspected = contact.peaks_of_free_motion(identified, traces, rest, cutoff, None)
    thresholds = residual_noise.thresholds_of(identified, peaks, rate)
    count = f"{len(unseen)} calibration {'log' if len(unseen) == 1 else 'logs'}"
    return thresholds, [
        rate_words(thresholds, count),
        *(one.text for one in suspected),
        *(contact.fitted_note(log.path.name) for log in logs if log not in unseen),
    ]


def stream_trace(
    identified: IdentifiedModel, log: LogArgument, cutoff: float
) -> residual_noise.ResidualTrace:
    """Residuals of a finished log as a stream of its rows shows them, behind a cut-off [Hz]."""
    signals, observer = identified.signals, identified.observe(bandwidth=cutoff)
    stream, rest = SampleStream(signals, identified.robot), watching.rests_of(identified)
    t, residual, speed = [], [], []
    for rows in windowed(open_log(log.path), stream.columns, log.cut):
        for sample in stream.samples(rows):
            moving = watching.velocity_of(sample.dq, rest)
            observer.step(sample.t, sample.q, moving, signals.gains * sample.effort)
            t.append(sample.t)
            residual.append(-observer.torque)
            speed.append(np.abs(sample.dq))
    name = f"{log.path.stem}{log.cut.text}"
    first = int(np.searchsorted(t, residual_noise.FORGOTTEN / (2.0 * np.pi * cutoff)))
    if len(t) < first + 2:
        wrong = "the log is too short for the residual's low-pass"
        fix = "log for longer, or give a higher bandwidth"
        raise LogError(wrong, where=name, fix=fix)
    step = float(np.median(np.diff(t)))
    speeds = np.array(speed).T
    slowest = -residual_noise.greatest(-speeds, round(HOLD / step) + 1)
    fastest = residual_noise.greatest(speeds, round(SETTLED / step) + 1)
    none = np.zeros((3, identified.robot.n, len(t)))
    found = (np.array(residual).T, slowest, fastest, none[0], none[1:])
    return residual_noise.ResidualTrace(name, np.array(t), step, *found).of(slice(first, None))
