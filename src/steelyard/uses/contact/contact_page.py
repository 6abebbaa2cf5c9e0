"""The page of `steelyard contact`, and the same in the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import Array
from steelyard.estimate.external.contact_thresholds import RANGES, ContactThresholds
from steelyard.estimate.scores.residual_traces_and_band_calibration import ResidualTrace
from steelyard.report.page import figures, notes, page_of
from steelyard.report.page_figures import Figure, Group, Key, area, line
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table, table_of
from steelyard.report.words import NONE, signed, significant

if TYPE_CHECKING:
    from steelyard.uses.contact.contact import ContactEvent, SuspectedContact

MOST_POINTS_OF_RESIDUAL = 4000  # of a line; every one is the largest of those that it stands for

TERMINAL_COLUMNS = (0, 1, 2, 3, 4, 5)  # those for which a terminal has room

THRESHOLD_HEADINGS = ("joint", "unit", RANGES[0], "change", *RANGES[1:])

UNCHANGED = 1e-9  # speed of positions that never change, but for rounding [rad/s; m/s]
LEAST_LASTING_SHARE = 0.5  # share of the log from which on events mean that something lasts


@dataclass(frozen=True, eq=False, repr=False)
class Contacts(Result):
    """Contacts in a log."""

    robot: str
    joints: Sequence[str]
    units: Sequence[str]
    trace: ResidualTrace
    thresholds: ContactThresholds  # to be exceeded by a contact; evaluable sample by sample
    events: tuple[ContactEvent, ...]  # the contacts, in the order of time
    sigma: Array  # standard deviation of the residuals of the fit, shape `(n,)` [Nm; N]
    usual: Array  # root mean square effort of the fitted runs, likewise; 0 where not known
    source: str  # what the thresholds were calibrated on
    carried: str | None  # a payload that explains lasting residuals, for people to read
    suspected: tuple[SuspectedContact, ...]  # stretches of the calibration that contain contact
    wanted: float | None  # false alarms per hour that were asked for; `None` for the default
    fitted: bool
    notes: tuple[str, ...]
    details: tuple[str, ...]
    json_name = "contact.json"

    @property
    def stands(self) -> bool:
        """Whether no joint moves in the log."""
        return not (self.trace.fastest > self.thresholds.edges[:, :1]).any()

    @property
    def headline(self) -> str:
        """How many contacts there are, and whether the robot moves."""
        count, duration = len(self.events), self.trace.duration
        many = {0: "No contact", 1: "1 contact"}.get(count, f"{count} contacts")
        blind, every = len(self.blind), len(self.joints)
        if not count and (self.frozen or blind == every):
            many, blind = "Cannot decide on contact", 0
        stands = ", in which the robot stands" if self.stands else ""
        where = f", at {every - blind} of {every} joints" if blind else ""
        return f"{many} in {duration:.1f} s of {self.trace.run}{stands}{where}"

    @property
    def frozen(self) -> bool:
        """Whether no position of the log ever changes."""
        return not (self.trace.fastest > UNCHANGED).any()

    @property
    def levels(self) -> Array:
        """Threshold of each joint in half of the log at least, NaN without, `(n,)` [Nm; N]."""
        ranges = self.trace.ranges(self.thresholds.edges)
        level = self.thresholds.at(ranges)
        level = np.where(ranges == 0, np.fmin(level, self.thresholds.changes[:, None]), level)
        level = np.sort(np.where(np.isnan(level), np.inf, level), axis=1)
        return np.asarray(level[:, level.shape[1] // 2])

    @property
    def shown(self) -> Array:
        """Greatest effort of each joint in the log, or usual one of fitted runs, `(n,)`."""
        return np.asarray(np.maximum(np.abs(self.trace.measured).max(axis=1), self.usual))

    @property
    def blind(self) -> tuple[str, ...]:
        """Joints at which only a push larger than all efforts that they show would be seen."""
        return tuple(np.array(self.joints)[self.levels > self.shown].tolist())

    @property
    def busy(self) -> float:
        """Share of the log in which residuals exceed their thresholds."""
        return sum(event.end - event.start for event in self.events) / self.trace.duration

    @property
    def claim(self) -> str:
        """What the thresholds promise, and what that rests on."""
        rate, minutes = self.thresholds.rate, self.thresholds.duration / 60.0
        expected = rate * self.trace.duration / 3600.0
        return (
            f"Thresholds for at most {rate:.3g} false alarms per hour of such motion "
            f"({expected:.2g} in a log as long as this), from {minutes:.1f} min of free motion: "
            f"{self.source}."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What qualifies the result."""
        found = list(self.notes)
        if self.frozen:
            found.append(
                "positions never change: either brakes hold the joints, which bear every push, or "
                "the positions are not measured ones"
            )
        if self.stands:
            found.append(self._visible_at_rest)
        if self.blind:
            sizes = self.levels.tolist(), self.shown.tolist()
            listed = ", ".join(
                f"{joint} ({significant(level, 2)} {unit}, efforts up to {significant(most, 2)})"
                for joint, unit, level, most in zip(self.joints, self.units, *sizes, strict=True)
                if joint in self.blind
            )
            found.append(
                f"cannot decide where thresholds are above all efforts: {listed}; a model with "
                "smaller errors, or more free motion with --calibrate, lowers them"
            )
        if self.wanted is None and self.thresholds.rate > 1.0:
            found.append(
                "1 false alarm per hour is more than this calibration supports: for it, give "
                f"{self.thresholds.duration / 60.0 * self.thresholds.rate:.0f} min of free motion "
                "with --calibrate"
            )
        if self.fitted:
            found.append("the model was fitted to this log: its residuals are too small")
        if self.busy > LEAST_LASTING_SHARE:
            found.append(
                f"residuals exceed their thresholds in {100.0 * self.busy:.0f} % of the log: a "
                "payload, another tool or other efforts than the model's are likelier than "
                "contact; run steelyard check with this log"
            )
        if self.carried is not None:
            found.append(self.carried)
        without = np.isnan(self.thresholds.limits).all(axis=1)
        if without.any():
            unknown = ", ".join(np.array(self.joints)[without])
            found.append(f"no threshold, no free motion: {unknown}")
        return tuple(found)

    @property
    def _visible_at_rest(self) -> str:
        """Pushes that show where the robot stands."""
        limits = np.fmin(self.thresholds.limits[:, 0], self.thresholds.changes)
        each = zip(self.joints, limits.tolist(), self.units, strict=True)
        known = [f"{joint} {significant(x, 2)} {unit}" for joint, x, unit in each if isfinite(x)]
        pushes = ", ".join(known)
        return f"no joint moves: at rest only pushes above these thresholds are visible: {pushes}"

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        words = f"{self.headline}. {self.claim}"
        tables = [events_table(self)] if self.events else []
        sections = (
            figures("contacts", "Contacts", words=words, tables=tables),
            notes("notes", "Limits of this result", self.warnings),
            figures(
                "residuals",
                "Residuals and thresholds over time",
                legend=[
                    Key("--measured", "residual"),
                    Key("--rest", "within the thresholds", "area"),
                    Key("--vermillion", "contact", "line"),
                ],
                groups=[Group([_figure(self, j) for j in range(len(self.joints))], columns="one")],
                note=f"At most {MOST_POINTS_OF_RESIDUAL} points a line: the largest residual of "
                "each interval.",
            ),
            figures("thresholds", "Thresholds", tables=[thresholds_table(self, relative=True)]),
            notes("details", "Notes", self.details, folded=True),
        )
        return page_of(f"{self.robot}: contacts in {self.trace.run}", self.robot, sections)

    def to_dict(self) -> dict[str, Any]:
        """Events, thresholds and what they rest on as JSON values."""
        return {
            "log": self.trace.run,
            "duration_s": self.trace.duration,
            "events": [event.to_dict() for event in self.events],
            "thresholds": self.thresholds.to_dict(),
            "calibration": {
                "from": self.source,
                "minutes": self.thresholds.duration / 60.0,
                "suspected_contact": [
                    {"log": one.run, **one.event.to_dict()} for one in self.suspected
                ],
            },
            "joints": list(self.joints),
            "undecided": list(self.joints if self.frozen else self.blind),
            "payload": self.carried,
            "notes": list(self.notes),
        }

    def show(self, console: Console) -> None:
        """Print the events and what the thresholds rest on."""
        warnings, events = self.warnings, events_table(self)
        print_verdict(console, self.headline, self.claim, warnings)
        if self.events:
            console.print(narrow_table(events, TERMINAL_COLUMNS))
            if events.words:
                console.print(Text(events.words))
        if warnings or self.events:
            console.print()
        console.print(Text("Thresholds"))
        console.print(narrow_table(thresholds_table(self, relative=False)))
        for words in _footnotes(self.thresholds):
            console.print(Text(words))


def events_table(content: Contacts) -> PlainTable:
    """One row per event."""
    columns: dict[str, Callable[[ContactEvent], str]] = {
        "start [s]": lambda x: f"{x.start:.2f}",
        "length [s]": lambda x: f"{x.end - x.start:.2f}",
        "largest at": lambda x: x.joints[0].joint,
        "residual": lambda x: (
            f"{signed(x.joints[0].peak)} {x.joints[0].unit}" + " *" * x.joints[0].change
        ),
        "size": lambda x: f"{x.joints[0].sigmas:.0f} σ",
        "link": lambda x: x.place,
        "× threshold": lambda x: f"{x.joints[0].ratio:.2g}",
        "joints": lambda x: f"{len(x.joints)}",
    }
    changed = any(event.joints[0].change for event in content.events)
    words = "* change of the residual while the robot rests" * changed
    return table_of(content.events, columns, words=words, text=(2, 5))


def thresholds_table(content: Contacts, *, relative: bool) -> PlainTable:
    """One row per joint; thresholds in standard deviations of the fit's residuals too."""

    def cell(limit: float, sigma: float) -> str:
        shown = f"{significant(limit)} {limit / sigma:.0f}σ" if relative else significant(limit)
        return shown if np.isfinite(limit) else NONE

    rows, thresholds = [], content.thresholds
    for j, (joint, unit) in enumerate(zip(content.joints, content.units, strict=True)):
        sigma = float(content.sigma[j])
        limits = zip(thresholds.limits[j].tolist(), thresholds.own[j], strict=True)
        cells = [f"{cell(limit, sigma)}{'' if mine else ' *'}" for limit, mine in limits]
        cells.insert(1, cell(float(thresholds.changes[j]), sigma))
        rows.append(Row((joint, unit, *cells)))
    words = (
        "A residual (measured minus predicted effort after a first-order low-pass of "
        f"{thresholds.cutoff:.3g} Hz) beyond its threshold is contact. At rest friction "
        "has any value within ± the breakaway friction; change: of the residual while all joints "
        "rest, against its mean of the last seconds; turning: the joint starts, stops or reverses. "
        "* too few visits in the calibration: largest threshold of the joint, and its friction."
    )
    return PlainTable("", words, THRESHOLD_HEADINGS, rows, (0, 1))


def _footnotes(thresholds: ContactThresholds) -> Iterator[str]:
    if not all(map(all, thresholds.own)):
        yield "* too few visits in the calibration: the joint's largest threshold and its friction"
    if np.isnan(thresholds.changes).all():
        yield (
            "no change is tested (too little rest in the calibration): of pushes at rest, only "
            "those beyond the threshold of rest are found; logs with rest help (--calibrate)"
        )


def _figure(content: Contacts, j: int) -> Figure:
    trace, thresholds, size = content.trace, content.thresholds, np.abs(content.trace.residual[j])
    step = max(1, -(-len(size) // MOST_POINTS_OF_RESIDUAL))
    starts = np.arange(0, len(size), step)  # of each stretch the largest residual is drawn
    at = np.array([a + int(np.argmax(size[a : a + step])) for a in starts], dtype=np.intp)
    t, residual = trace.t[at], trace.residual[j, at]
    # residuals that are no contact; zero where none is known
    level = np.nan_to_num(thresholds.at(trace.ranges(thresholds.edges))[j, at])
    mean = residual - trace.changes(thresholds.edges)[j, at]
    change = thresholds.changes[j]
    low, high = np.fmax(-level, mean - change), np.fmin(level, mean + change)
    inside = np.zeros(len(t), dtype=bool)
    joint = content.joints[j]
    for event in content.events:
        if any(load.joint == joint for load in event.joints):
            inside |= (t >= event.start) & (t <= event.end)
    traces = [
        area("within the thresholds", t, low, high, "--rest"),
        line("residual", t, residual, "--measured", width=1.2),
        line("contact", t, np.where(inside, residual, np.nan), "--vermillion", width=2.5),
    ]
    label = f"Residual of {joint} over time, with thresholds"
    y, layout = f"residual [{content.units[j]}]", {"showlegend": False}
    return Figure(joint, label, "time [s]", y, traces, layout)
