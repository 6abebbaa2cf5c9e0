"""Thresholds of contact for a stream, from residuals of finished logs as a stream shows them."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED, ContactThresholds
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.residual_noise_and_traces import (
    FORGOTTEN,
    ResidualTrace,
    greatest,
    thresholds_of,
)
from steelyard.identify.runs_for_model import fitted_before
from steelyard.logs.contents import windowed
from steelyard.logs.formats import open_log
from steelyard.logs.log_windows import parse_log_argument
from steelyard.runs.runs_of_named_logs import LogArgument
from steelyard.runs.sample_stream import SampleStream
from steelyard.uses.contact.contact import common_rest_speed, fitted_note, peaks_of_free_motion
from steelyard.uses.watch.watcher_and_events import rests_of, velocity_of


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
    unseen = [log for log in logs if not fitted_before(identified, log)]
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
    thresholds = thresholds_of(identified, peaks, rate)
    count = f"{len(unseen)} calibration {'log' if len(unseen) == 1 else 'logs'}"
    return thresholds, [
        rate_words(thresholds, count),
        *(one.text for one in suspected),
        *(fitted_note(log.path.name) for log in logs if log not in unseen),
    ]


def stream_trace(identified: IdentifiedModel, log: LogArgument, cutoff: float) -> ResidualTrace:
    """Residuals of a finished log as a stream of its rows shows them, behind a cut-off [Hz]."""
    path, cut = parse_log_argument(log.text)
    signals, observer = identified.signals, identified.observe(bandwidth=cutoff)
    stream, rest = SampleStream(signals, identified.robot), rests_of(identified)
    t, residual, speed = [], [], []
    for rows in windowed(open_log(path), stream.columns, cut):
        for sample in stream.samples(rows):
            moving = velocity_of(sample.dq, rest)
            observer.step(sample.t, sample.q, moving, signals.gains * sample.effort)
            t.append(sample.t)
            residual.append(-observer.torque)
            speed.append(np.abs(sample.dq))
    name = f"{path.stem}{cut.text}"
    first = int(np.searchsorted(t, FORGOTTEN / (2.0 * np.pi * cutoff)))
    if len(t) < first + 2:
        raise LogError(
            "the log is too short for the residual's low-pass",
            where=name,
            fix="log for longer, or give a higher bandwidth",
        )
    step = float(np.median(np.diff(t)))
    speeds = np.array(speed).T
    slowest = -greatest(-speeds, round(HOLD / step) + 1)
    fastest = greatest(speeds, round(SETTLED / step) + 1)
    none = np.zeros((3, identified.robot.n, len(t)))
    found = (np.array(residual).T, slowest, fastest, none[0], none[1:])
    return ResidualTrace(name, np.array(t), step, *found).of(slice(first, None))
