"""Are rows corrupt, or do they repeat earlier values?"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, log_check
from steelyard.check.finding import (
    MOST_NAMED,
    Edit,
    Finding,
    Fix,
    Picture,
    Severity,
    Trace,
    percent_of,
)
from steelyard.check.signals.motion_units import unit_reading
from steelyard.check.signals.time_stamps_and_scale import clock_of_log
from steelyard.check.signals.usable_rows import JUMP_FACTOR, JUMP_ROWS, SignalOverview
from steelyard.runs.first_pass_over_recording import MOVED
from steelyard.runs.rows.faulty_row_detectors import LONGEST_STALE, RowVerdict
from steelyard.runs.run import Run

DOUBTFUL_BROKEN_SHARE, WRONG_BROKEN_SHARE = 0.05, 0.3
"""Shares of broken rows from which on a log is doubtful, and wrong."""
END_ROWS = 100  # rows at the start that are a log's head, and at the end its tail
BROKEN_VERDICTS = (RowVerdict.UNREADABLE, RowVerdict.ABSURD, RowVerdict.JUMP)


@log_check("rows", "Are rows corrupt?")
def corrupt_rows_check(case: Case, log: CheckedLog) -> Finding:
    """Cells that are missing, no numbers, or garbage; and why a log cannot be made a run."""
    broken = log.overview.broken
    count, total = int(broken.sum()), len(broken)
    if isinstance(log.run, Run) and log.run.quality.rows > total:  # beyond the excerpt
        dropped, total = log.run.quality.dropped, log.run.quality.rows
        count = sum(dropped.get(verdict.reason, 0) for verdict in BROKEN_VERDICTS)
    share = count / max(total, 1)
    severity = Severity.DOUBTFUL if share > DOUBTFUL_BROKEN_SHARE else Severity.OK
    if share > WRONG_BROKEN_SHARE or total == 0:
        severity = Severity.WRONG
    fix = Fix("record or copy the log again") if severity else None
    says = f"{count} corrupt rows{_where_corrupt(broken)}, dropped" if count else "no corrupt rows"
    if isinstance(log.run, LogError):
        says += f"; as declared, the log cannot be used: {log.run.wrong}"
        # neither units, nor the clock, nor a motion that is missing explain it
        explained = unit_reading(case, log).cheaper or clock_of_log(case, log).severity
        if not explained and log.overview.moves:
            severity, fix = Severity.WRONG, Fix(log.run.fix)
    if not severity and (false := _false_positions(case, log)) is not None:
        return false
    picture = None
    if broken.any():
        where = np.flatnonzero(broken).astype(np.float64)
        picture = _counts_picture("row", "broken rows", where, (0.0, float(len(broken))))
    return Finding.of(
        severity,
        says,
        f"{count} of {total} rows ({percent_of(share)}), at most "
        f"{100.0 * DOUBTFUL_BROKEN_SHARE:g} % allowed",
        fix=fix,
        picture=picture,
        brief=f"{count} corrupt rows dropped" if count else "",
    )


def _where_corrupt(broken: NDArray[np.bool_]) -> str:
    at = np.flatnonzero(broken)
    if len(at) == 0:
        return ""
    if at[-1] < END_ROWS:
        return f" at the start (rows {at[0]} to {at[-1]})"
    if at[0] >= len(broken) - END_ROWS:
        return f" at the end (from row {at[0]})"
    return f" (the first is row {at[0]}, the last {at[-1]})"


def _counts_picture(title: str, name: str, x: Array, span: tuple[float, float]) -> Picture:
    """How many there are in each hundredth of a span."""
    count, edges = np.histogram(x, bins=100, range=span)
    bars = Trace(name, 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")
    return Picture(title, name, (bars,))


MOST_FROZEN = 0.5  # share of the rows in which encoders are frozen, from which on a log is wrong


def _false_positions(case: Case, log: CheckedLog) -> Finding | None:
    """Rows lost where all moving joints jump at once, encoders that froze, and other jumps."""
    overview = log.overview
    row_of = np.flatnonzero(overview.kept) + log.window[0]
    t, moving = overview.t - overview.t[:1], int(np.sum(np.ptp(overview.q, axis=0) > MOVED))
    found = [
        (
            first,
            f"{case.joints[j]} is at one position from row {row_of[first]} to {row_of[last]} "
            f"({t[first]:.4g} to {t[last]:.4g} s) and "
            + ("stops" if last == len(t) - 1 else "stops or starts")
            + " within one row: its encoder is frozen, and these rows are left out",
        )
        for j, first, last in overview.frozen
    ]
    released = {(last, j) for j, _, last in overview.frozen}
    joints = [j for j, _, _ in overview.frozen]
    for row in np.flatnonzero(overview.jumps.any(axis=1)).tolist():
        jumping = np.flatnonzero(overview.jumps[row]).tolist()
        at = f"at row {row_of[row + 1]} ({t[row + 1]:.4g} s)"
        if len(jumping) > 1 and 2 * len(jumping) >= moving:
            found.append((row, f"{case.listed(jumping)} jump {at}: rows are lost there"))
        elif others := [j for j in jumping if (row, j) not in released]:
            joints += others
            found.append((row, f"the position of {case.listed(others)} jumps {at}"))
    if not found:
        return None
    says = [words for _, words in sorted(found)]
    more = f"; and {len(says) - MOST_NAMED} more" * (len(says) > MOST_NAMED)
    still = np.zeros(len(t), dtype=np.bool_)
    for _, first, last in overview.frozen:
        still[first:last] = True
    share = float(still.mean())
    jumps = len(found) > len(overview.frozen)
    return Finding.of(
        Severity.WRONG if share > MOST_FROZEN else Severity.DOUBTFUL,
        "; ".join(says[:MOST_NAMED]) + more,
        f"frozen in {percent_of(share)} of the rows, at most {100.0 * MOST_FROZEN:g} % "
        f"allowed; a jump is {JUMP_FACTOR:g} times the changes in {JUMP_ROWS} rows on either side",
        joints=tuple(case.joints[j] for j in dict.fromkeys(joints)),
        fix=Fix(
            "leave the jumps out: give the parts between them as logs, LOG@START:STOP in seconds; "
            "or record again"
            if jumps
            else "repair the encoder or its line before the next log"
        ),
    )


HOLD_STEPS = 3.0
"""Steps of its sensor by which a channel changes before and after a stretch that counts: neither
rest nor a sensor too coarse for the motion makes such ones."""
FEWEST_HELD_ROWS, REGULAR_HOLD_SHARE = 100, 0.9
"""Fewest stretches, and the share of them that has one length where samples are held."""
LONGEST_SHOWN_HOLD = 20  # longest stretch that is shown [rows]


@dataclass(frozen=True, eq=False)
class ZeroOrderHold:
    """How long some channels keep a value."""

    lengths: NDArray[np.intp]  # of one value between two clear changes, of all channels [rows]
    every: int  # rows from one new sample to the next; 1 if samples are not held
    share: float  # of the stretches that have the commonest length, in [0, 1]

    @property
    def value_text(self) -> str:
        """The evidence in words."""
        return (
            f"{100.0 * self.share:.3g} % of {len(self.lengths)} clear changes come {self.every} "
            f"rows after the one before, regular from {100.0 * REGULAR_HOLD_SHARE:g} % on"
        )

    @property
    def picture(self) -> Picture:
        """How often each length occurs."""
        rows = np.arange(1, max(LONGEST_SHOWN_HOLD, 2 * self.every) + 1)
        count = np.bincount(np.minimum(self.lengths, rows[-1]), minlength=len(rows) + 1)[1:]
        bars = Trace("stretches", rows.astype(np.float64), count.astype(np.float64), "bars")
        return Picture("rows with one value", "stretches", (bars,))


def zero_order_hold(x: Array, step: Array) -> ZeroOrderHold:
    """How long channels `(N, c)`, with smallest changes `(c,)`, keep a value."""
    found = []
    for channel, least in zip(x.T, step, strict=True):
        change = np.abs(np.diff(channel))
        rows = np.flatnonzero(change)
        clear = change[rows] >= HOLD_STEPS * least
        found.append(np.diff(rows)[clear[1:] & clear[:-1]])
    lengths = np.concatenate(found)
    if len(lengths) < FEWEST_HELD_ROWS:
        return ZeroOrderHold(lengths, 1, 0.0)
    count = np.bincount(lengths)
    every = int(count.argmax())
    share = float(count[every]) / len(lengths)
    return ZeroOrderHold(lengths, every if share >= REGULAR_HOLD_SHARE else 1, share)


def _mean_age(x: Array, updates: ZeroOrderHold, rows: NDArray[np.bool_]) -> float:
    """How many rows ago values `(N, c)` were new on average, at rest left out [rows].

    Old values count in the given rows, shape `(N,)`.
    """
    row = np.arange(len(x))[:, None]
    new = np.concatenate((np.ones((1, x.shape[1]), dtype=np.bool_), x[1:] != x[:-1]))
    age = row - np.maximum.accumulate(np.where(new, row, 0), axis=0)
    return float(age[(age < updates.every) & (rows[:, None] | (age == 0))].mean())


REPEAT_SPAN = 10  # rows in which a joint must get far for the row in the middle to be one in motion
FAR_STEPS = 2.0  # steps of the sensor per row that are far
OFTEN_REPEATED = 0.2  # share of repeated rows from which on a log is doubtful
LATE_AGE = 2e-3  # mean age of held samples from which on a log is doubtful [s]


@case_check("repeats", "Do rows repeat earlier positions or efforts?")
def repeated_rows_check(case: Case) -> Iterable[Finding]:
    """Rows with old positions or efforts: a controller that was read too often.

    One finding per log that moves fast enough, another where efforts are held.
    """
    for log in case.logs:
        for found in _repeats(log, log.overview):
            yield replace(found, log=log.name)


def _repeats(log: CheckedLog, overview: SignalOverview) -> Iterable[Finding]:
    if len(overview.t) <= 2 * REPEAT_SPAN:
        return
    c = overview.channels
    positions = zero_order_hold(overview.q, overview.resolution[c.q])
    efforts = zero_order_hold(overview.effort, overview.resolution[c.effort])
    rows = np.ones(len(overview.t), dtype=np.bool_)
    if log.processing.bridge_repeats and 0 < positions.every - 1 <= LONGEST_STALE:
        rows[1:] = (overview.q[1:] != overview.q[:-1]).any(axis=1)
    age = _mean_age(overview.q, positions, rows) * overview.step
    late = _mean_age(overview.effort, efforts, rows) * overview.step - age
    if positions.every > 1:
        yield _held_positions(overview, positions, round(age, 5))
    elif (irregular := _irregular(overview)) is not None:
        yield irregular
    if efforts.every > 1:
        stated = log.recording.signals.effort_delay
        yield _held_efforts(stated, overview, efforts, round(late, 5) + 0.0)


def _held_positions(overview: SignalOverview, updates: ZeroOrderHold, left: float) -> Finding:
    """Positions that are new every n-th row, and their mean age once rows are bridged [s]."""
    age = 0.5 * (updates.every - 1) * overview.step
    does = (
        f"they are {1e3 * left:.2g} ms late on average, and rows are not interpolated"
        if left > 0.0
        else "repeated rows are interpolated"
    )
    return Finding.doubtful_if(
        round(age, 4) > LATE_AGE or updates.every - 1 > LONGEST_STALE,
        f"positions are updated {_every(overview, updates)}: {does}",
        f"{updates.value_text}; {1e3 * age:.3g} ms old on average, at most {1e3 * LATE_AGE:g} ms "
        f"and {LONGEST_STALE} repeated rows allowed",
        Fix(
            f"log at the update rate of positions, {1.0 / overview.step / updates.every:.3g} Hz, "
            "or update them at the rate of the log"
        ),
        picture=updates.picture,
    )


def _held_efforts(
    stated: float, overview: SignalOverview, updates: ZeroOrderHold, late: float
) -> Finding:
    """Efforts that are new every n-th row, and how much older than positions they are [s]."""
    says = (
        f"they are {1e3 * late:.2g} ms late on average" if late > 0.0 else "no later than positions"
    )
    known = f" ([signals.effort] delay compensates {1e3 * stated:g} ms)" if stated else ""
    return Finding.doubtful_if(
        round(late - stated, 4) > LATE_AGE,
        f"efforts are updated {_every(overview, updates)}: {says}{known}",
        f"{updates.value_text}; {1e3 * late:.3g} ms later than positions, at most "
        f"{1e3 * LATE_AGE:g} ms allowed",
        Fix(
            f"log efforts as they are measured, or state the mean delay, {1e3 * late:.3g} ms",
            (Edit(("signals", "effort", "delay"), late),),
        ),
        picture=updates.picture,
    )


def _irregular(overview: SignalOverview) -> Finding | None:
    q, step, half = overview.q, overview.resolution[overview.channels.q], REPEAT_SPAN // 2
    far = np.abs(q[REPEAT_SPAN:] - q[:-REPEAT_SPAN]) > FAR_STEPS * REPEAT_SPAN * step
    fast: NDArray[np.bool_] = np.any(far & (step > 0.0), axis=1)
    if not fast.any():
        return None
    again: NDArray[np.bool_] = np.all(q[1:] == q[:-1], axis=1)[half : half + len(fast)] & fast
    count, total = int(again.sum()), int(fast.sum())
    share, says, picture = count / total, "no row in motion repeats the previous one", None
    if count:
        says = f"{count} rows in motion repeat the positions of the row before"
        t = overview.t[half + 1 :][: len(again)] - overview.t[0]
        span = float(t[0]), float(t[-1])
        picture = _counts_picture("time [s]", "repeated rows", t[again], span)
    return Finding.doubtful_if(
        share > OFTEN_REPEATED,
        says,
        f"{count} of {total} rows around which a joint moves by more than {FAR_STEPS:g} sensor "
        f"steps a row ({percent_of(share)}), at most {100.0 * OFTEN_REPEATED:g} % allowed",
        Fix(f"log at the update rate of positions, about {1.0 - share:.2g} of this one"),
        picture=picture,
    )


def _every(overview: SignalOverview, updates: ZeroOrderHold) -> str:
    rate = 1.0 / overview.step
    return f"every {updates.every} rows ({rate / updates.every:.3g} Hz of {rate:.3g} Hz)"
