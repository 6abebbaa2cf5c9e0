"""Where a single log is cut into a part to identify from and one that validates."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf

import numpy as np

from steelyard.errors import SteelyardError
from steelyard.formats import Cut, parse_log_argument
from steelyard.identification.named_logs import log_files, recording_of, runs_of, signals_of
from steelyard.measurement import Recording, Run
from steelyard.measurement.rows.clock import learn_clock
from steelyard.progress import silent
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.validation.repeated_motion import repeat_within

FITTED_SHARE = 0.7
"""Share of a single log that is fitted; the rest validates."""
SHORTEST_PARTED = 5.0
"""Duration from which on a log is long enough for that [s]."""
NEAR_END = 2.0
"""Time before a log's end up to which the end of its motion is not reported [s]."""
MOST_STEPS = 3.0
"""Duration over rows times the median step, beyond which a log's last time is not believed."""


@dataclass(frozen=True)
class Parted:
    """Logs and windows of them as arguments of a command.

    Attributes:
        logs: Logs to identify from; the last one validates, if there are several.
        ends: Why the last window ends before the log does; empty if it does not.
    """

    logs: tuple[str, ...]
    ends: str = ""


def parted(loaded: LoadedRobot, logs: Sequence[str]) -> Parted:
    """Logs to identify from, the last to validate: of a single one two windows in its own seconds.

    A single log is left whole if it is cut by rows, or its motion is shorter than
    `SHORTEST_PARTED`. The second window ends with the motion, and where the motion is repeated,
    with its first round: a motion that was fitted validates nothing.
    """
    if len(logs) != 1:
        return Parted(tuple(logs))
    (log,) = log_files(logs)
    cut = parse_log_argument(log.text)[1]
    if cut.rows != Cut().rows:
        return Parted((log.text,))
    signals = signals_of(loaded, log)[0]
    start = max(0.0, cut.seconds[0])
    stop = min(cut.seconds[1], _duration(recording_of(log, signals)))
    if not SHORTEST_PARTED <= stop - start < inf:
        return Parted((log.text,))
    begin, ends = start, ""
    try:
        ((run,), _) = runs_of(loaded, signals, [log], (), silent)
    except SteelyardError:
        pass
    else:
        begin = max(begin, run.span[0])
        whole, moves = stop, min(stop, run.span[1])
        stop = _end_of_first_round(run, begin, moves)
        if stop < whole - NEAR_END:
            why = "the motion repeats" if stop < moves else "no joint moves"
            ends = f"rows after {0.1 * ceil(10.0 * stop):.10g} s are left out: {why}"
    if stop - begin < SHORTEST_PARTED:
        return Parted((log.text,))
    a, b, c = floor(10.0 * start), floor(10.0 * _middle(begin, stop)), ceil(10.0 * stop)
    windows = ((a, b), (b, c))
    return Parted(tuple(f"{log.path}@{0.1 * m:.10g}:{0.1 * n:.10g}" for m, n in windows), ends)


def _middle(begin: float, stop: float) -> float:
    """Where the second window begins, of a motion between two times [s]."""
    return begin + FITTED_SHARE * (stop - begin)


def _end_of_first_round(run: Run, begin: float, stop: float) -> float:
    """Where the motion begins anew, or `stop` if it never does [s]."""
    repeat = repeat_within(run, _middle(begin, stop), stop)
    if repeat is None or not 0.0 < repeat.shift < stop - begin:
        return stop
    return _end_of_first_round(run, begin, begin + repeat.shift)


def _duration(recording: Recording) -> float:
    """Time from the first good row to the last row with a time [s]; infinite if that is absurd."""
    signals, clock, rows, last = recording.signals, learn_clock(recording), 0, 0.0
    for part in recording.log.parts((signals.time,)):
        times = part[np.isfinite(part[:, 0]), 0]
        rows += len(part)
        last = float(times[-1]) if len(times) else last
    duration = last * signals.time_scale - clock.origin
    return duration if duration < MOST_STEPS * rows * clock.step else inf
