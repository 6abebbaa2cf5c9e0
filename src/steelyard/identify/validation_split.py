"""Which logs, or parts of one, are fitted and which validate; no rows do both."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf

import numpy as np

from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import silent
from steelyard.identify.repeated_motion import repeat_of, repeat_within
from steelyard.logs.log_and_errors import Cut, parse_log_argument
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.runs.recording import Recording
from steelyard.runs.rows.clock_and_row_scan import learn_clock
from steelyard.runs.run import Run, motion_samples
from steelyard.runs.runs_of_named_logs import log_files, recording_of, runs_of, signals_of

FITTED_SHARE = 0.7  # share of a single log that is fitted; the rest validates
SHORTEST_CUT_LOG = 5.0  # duration from which on a log is long enough for that [s]
NEAR_END = 2.0  # time before a log's end up to which the end of its motion is not reported [s]
MOST_STEPS = 3.0  # duration over rows times median step: a last time beyond is not believed


@dataclass(frozen=True)
class ProposedCut:
    """Logs and windows of them as arguments of a command."""

    logs: tuple[str, ...]  # logs to identify from; the last one validates, if there are several
    ends: str = ""  # why the last window ends before the log does; empty if it does not


def propose_cut(loaded: LoadedRobot, logs: Sequence[str]) -> ProposedCut:
    """Logs to identify from, the last to validate: of a single one two windows in its own seconds.

    A single log is left whole if it is cut by rows, or its motion is shorter than
    `SHORTEST_CUT_LOG`. The second window ends with the motion, and where the motion is repeated,
    with its first round: a motion that was fitted validates nothing.
    """
    if len(logs) != 1:
        return ProposedCut(tuple(logs))
    log, *more = log_files(logs)
    if more:  # episodes of a dataset, together as two windows of rows
        rows = [parse_log_argument(one.text)[1].rows for one in (log, *more)]
        first, end = rows[0][0], rows[-1][1] or rows[-1][0]
        middle = first + FITTED_SHARE * (end - first)
        border = min((row for row, _ in rows[1:]), key=lambda row: abs(row - middle))
        return ProposedCut((f"{log.path}#{first}:{border}", f"{log.path}#{border}:{end}"))
    cut = parse_log_argument(log.text)[1]
    if cut.rows != Cut().rows:
        return ProposedCut((log.text,))
    signals = signals_of(loaded, log)[0]
    start = max(0.0, cut.seconds[0])
    stop = min(cut.seconds[1], _duration(recording_of(log, signals)))
    if not SHORTEST_CUT_LOG <= stop - start < inf:
        return ProposedCut((log.text,))
    begin, ends = start, ""
    try:
        ((run,), _) = runs_of(loaded, signals, [log], (), silent)
    except SteelyardError:
        pass
    else:
        begin = max(begin, run.span[0])
        whole, moves = stop, min(stop, run.span[1])
        stop, shift = moves, inf
        while shift > 0.0:  # the motion ends where it begins anew
            repeat = repeat_within(run, begin + FITTED_SHARE * (stop - begin), stop)
            shift = 0.0 if repeat is None or repeat.shift >= stop - begin else repeat.shift
            stop = begin + shift if shift > 0.0 else stop
        if stop < whole - NEAR_END:
            why = "the motion repeats" if stop < moves else "no joint moves"
            ends = f"rows after {0.1 * ceil(10.0 * stop):.10g} s are left out: {why}"
    if stop - begin < SHORTEST_CUT_LOG:
        return ProposedCut((log.text,))
    middle = begin + FITTED_SHARE * (stop - begin)
    a, b, c = floor(10.0 * start), floor(10.0 * middle), ceil(10.0 * stop)
    windows = ((a, b), (b, c))
    return ProposedCut(tuple(f"{log.path}@{0.1 * m:.10g}:{0.1 * n:.10g}" for m, n in windows), ends)


def _duration(recording: Recording) -> float:
    """Time from the first good row to the last row with a time [s]; infinite if that is absurd."""
    signals, clock, rows, last = recording.signals, learn_clock(recording), 0, 0.0
    for part in recording.log.parts((signals.time,)):
        times = part[np.isfinite(part[:, 0]), 0]
        rows += len(part)
        last = float(times[-1]) if len(times) else last
    duration = last * signals.time_scale - clock.origin
    return duration if duration < MOST_STEPS * rows * clock.step else inf


def refuse_same_rows(fitted: Sequence[Run], unseen: Sequence[Run]) -> None:
    """The same rows neither count twice in a fit nor test it, whatever their log is called."""
    known = motion_samples(fitted)
    pairs = [
        (run, known[:number], "they would count twice in the fit")
        for number, run in enumerate(fitted)
    ]
    pairs += [(run, known, "they would be both fitted and validated") for run in unseen]
    for run, others, role in pairs:
        repeat = repeat_of(others, run)
        if repeat is not None and repeat.same:
            raise LogError(
                f"'{run.name}' holds the same samples as '{repeat.run}': {role}",
                where=f"{run.name} {repeat.words}",
                fix="give every part once; cut a log with LOG@START:STOP",
            )
