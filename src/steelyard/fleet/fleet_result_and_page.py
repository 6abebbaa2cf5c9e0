"""What was found in a fleet: text, page, JSON, and a line a robot for monitoring."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import by_key
from steelyard.estimate.changes_from_model import OF_JOINT
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.fleet.changes_over_days import FleetChange, FleetDays, RobotLevel, half_width
from steelyard.report.page import figures, inspected_page, notes
from steelyard.report.page_figures import Figure, Group, Key, area, line, points
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import count, significant

QUANTITIES = ("bodies", "dry friction", "viscous friction", "offset")
MOST_LISTED = 12  # robots and logs that the terminal lists
MOST_FIGURES = 40  # changes that the page draws

Status = Literal["changed", "unusual", "same", "one day"]


@dataclass(frozen=True)
class LeftOut:
    """A log, or a part of one, that does not count."""

    robot: str
    day: str
    log: str
    wrong: str
    fix: str
    at_rest: bool = False


@dataclass(frozen=True)
class Work:
    """How much was done: parts in all, made now, and entries of the store that were damaged."""

    parts: int
    made: int
    damaged: int
    samples: int = 0
    seconds: float = 0.0

    @property
    def words(self) -> str:
        """In one line."""
        left = self.parts - self.made
        text = f"{count(self.parts, 'part')} of logs, {self.samples:.3g} samples; {left} remembered"
        if self.damaged:
            text += f", {count(self.damaged, 'damaged entry')} of the store made again"
        return f"{text}; {self.seconds:.1f} s"


@dataclass(frozen=True)
class FleetPlan:
    """How much work there is: parts and bytes, those that are left, seconds and bytes of memory."""

    parts: int
    left: int
    robots: int
    days: int
    bytes: int
    bytes_left: int
    processes: int
    seconds: float
    memory: int

    def __str__(self) -> str:
        """In a few lines."""
        robots, days = count(self.robots, "robot"), count(self.days, "day")
        gib, on = self.memory / 2**30, count(self.processes, "process")
        return "\n".join(
            [
                f"logs      {robots}, {days}, {count(self.parts, 'part')}, {_bytes(self.bytes)}",
                f"left      {count(self.left, 'part')}, {_bytes(self.bytes_left)}; the others are "
                "remembered",
                f"time      about {_duration(self.seconds)} on {on} of this machine, as one part "
                "took; N workers of a cluster take this times "
                f"{self.processes} / N",
                f"memory    up to {gib:.1f} GiB for all of these processes",
            ]
        )


def _bytes(size: int) -> str:
    for unit, power in (("GB", 9), ("MB", 6), ("kB", 3)):
        if size >= 10**power:
            return f"{size / 10**power:.3g} {unit}"
    return f"{size} bytes"


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Result):
    """What robots share, and which changed, in what, since when.

    Attributes:
        robot: Name of the kind of robot.
        model: The model that all share, of the days before changes.
        days: The days of every robot, and their scatter.
        changes: Changes, robot by robot.
        levels: Every robot's changes from the model at its last days.
        left_out: Logs that do not count, and why.
        work: How much was done.
    """

    robot: str
    model: IdentifiedModel
    days: FleetDays
    changes: tuple[FleetChange, ...]
    levels: tuple[RobotLevel, ...]
    left_out: tuple[LeftOut, ...]
    work: Work
    json_name = "fleet.json"
    shared = (
        "Intervals of model.json contain noise and the scatter of robots and days; not errors that "
        "all logs share, as of smoothing or of what the model lacks."
    )

    @cached_property
    def _by_robot(self) -> dict[str, list[FleetChange]]:
        return by_key((change.robot, change) for change in self.changes)

    def status(self, number: int) -> Status:
        """What is said of a robot."""
        robot = self.days.robots[number]
        if robot.robot in self._by_robot:
            return "changed"
        if self.levels[number].unusual:
            return "unusual"
        return "same" if len(robot.days) > 1 else "one day"

    @property
    def headline(self) -> str:
        """How many robots changed."""
        robots = count(len(self.days.robots), "robot")
        over = f"of {robots} over {count(self.days.n_days, 'day')}"
        if not self.changes:
            return f"No change found {over}"
        return f"{len(self._by_robot)} {over} changed"

    @property
    def claim(self) -> str:
        """What counts as a change."""
        scatter = self.days.scatter
        warm = "Temperature is logged, and its effect subtracted" if scatter.slope.any() else (
            "Temperature is not known: its effect is part of the scatter"
        )  # fmt: skip
        times = f"{self.days.false_alarms:g} time{'s' * (self.days.false_alarms != 1.0)}"
        return (
            f"A change is a step that lasts; chance names one {times} in a year of the whole fleet "
            f"if days scatter around a level as {scatter.differences} differences between them "
            f"show. {warm}. A slow drift appears as steps."
        )

    @property
    def limits(self) -> tuple[str, ...]:
        """What qualifies the result."""
        found = []
        wrong = [one for one in self.left_out if not one.at_rest]
        for robot, mine in by_key((one.robot, one) for one in wrong).items():
            first = mine[0]
            more = f", and {count(len(mine) - 1, 'more log')}" if len(mine) > 1 else ""
            found.append(f"{robot}: {first.log} does not count: {first.wrong}{more}")
        if rest := [one for one in self.left_out if one.at_rest]:
            found.append(
                f"at rest, and not judged: {count(len(rest), 'log')}, such as {rest[0].log}"
            )
        if blind := self.blind:
            found.append(f"the motion shows no change of {', '.join(blind)}")
        if self.days.scatter.differences < 10:
            found.append(
                f"{count(self.days.scatter.differences, 'difference')} between days: only large "
                "changes can be told from scatter"
            )
        return tuple(found)

    @property
    def blind(self) -> tuple[str, ...]:
        """Causes that no robot's motion tells from no cause: not one of 100 % would be seen."""
        days, found = self.days, []
        total = sum(e.matrix for robot in days.robots for e in robot.equations)
        for cause in days.causes:
            information = cause.directions.T @ total @ cause.directions
            size = days.local.expected(days.friction) @ np.abs(cause.directions[:, 0])
            if information[0, 0] * size**2 < 4.0:
                found.append(f"{cause.what} {cause.joint}".strip())
        return tuple(found)

    def _row(self, number: int) -> Row:
        robot, status = self.days.robots[number], self.status(number)
        mine = self._by_robot.get(robot.robot, [])
        what = "; ".join(f"{words_of_cause(c)} {size_words(c)}" for c in mine)
        since = "; ".join(when_words(c) for c in mine)
        if status == "unusual":
            what = f"differs from the others in {', '.join(self._unusual(number))}"
        return Row((robot.robot, str(len(robot.days)), status, since, what), status == "changed")

    def _unusual(self, number: int) -> list[str]:
        joints = self.days.local.joints
        found, level = [], self.levels[number]
        for k in level.unusual:
            value, half = level.value[k], float(half_width(level.std[k]))
            if k < OF_JOINT * len(joints):
                row, part = divmod(k, OF_JOINT)
                unit = self.days.local.units[row] if part == 3 else ""
                size = _with_unit(value, half, unit)
                found.append(f"{QUANTITIES[part]} of {joints[row]} {size}")
            else:
                found.append("what the last link carries")
        return list(dict.fromkeys(found))

    @cached_property
    def table(self) -> PlainTable:
        """A row a robot, those that changed first."""
        order = {"changed": 0, "unusual": 1, "one day": 2, "same": 3}
        numbers = sorted(range(len(self.days.robots)), key=lambda k: (order[self.status(k)], k))
        headings = ("robot", "days", "status", "since (95 %)", "what")
        rows = [self._row(k) for k in numbers]
        return PlainTable("", "", headings, rows, (0, 2, 3, 4))

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        drawn = self.changes[:MOST_FIGURES]
        groups = [
            Group([self._figure(c)], f"{c.robot}: {words_of_cause(c)}",
                  f"{size_words(c)} since {when_words(c)}")
            for c in drawn
        ]  # fmt: skip
        sections = (
            figures("fleet", "Fleet", words=f"{self.headline}. {self.claim}", tables=[self.table]),
            notes("limits", "Limits of this result", self.limits),
            figures(
                "changes",
                "Changes over days",
                legend=[Key("--measured", "days"), Key("--interval", "95 % interval", "area")],
                groups=groups,
                note="Every day alone, corrected for temperature where it is known; intervals "
                "contain the scatter between days.",
            )
            if groups
            else None,
            notes("work", "Work", [self.work.words, self.shared], folded=True),
        )
        return inspected_page(f"{self.robot}: fleet", self.robot, sections)

    def _figure(self, change: FleetChange) -> Figure:
        number = [r.robot for r in self.days.robots].index(change.robot)
        value, std = self.days.singly(number, change.cause)
        days = np.arange(len(value), dtype=np.float64)
        factor, unit = (1.0, change.cause.unit) if change.cause.unit else (100.0, "%")
        value, half = factor * value, factor * half_width(std)
        at = self.days.robots[number].days.index(change.day)
        level = np.where(days >= at, factor * change.size[0], 0.0)
        level += float(np.median((value - level)[:at])) if at else 0.0
        traces = [
            area("95 %", days, value - half, value + half, "--interval"),
            points("day", days, value, "--measured", 5.0),
            line("step", days, level, "--predicted", line={"shape": "hv", "width": 2}),
        ]
        label = f"{words_of_cause(change)} of {change.robot} over its days"
        names = self.days.robots[number].days
        ticks = list(range(0, len(names), max(1, len(names) // 8)))
        axis = {"xaxis": {"tickvals": ticks, "ticktext": [names[k] for k in ticks]}}
        return Figure("", label, "day", f"change [{unit}]", traces, {"showlegend": False} | axis)

    def robots_json(self) -> list[dict[str, Any]]:
        """A JSON object a robot."""
        joints, found = self.days.local.joints, []
        for number, robot in enumerate(self.days.robots):
            level = self.levels[number]
            own = {
                joint: {
                    name: [float(level.value[k]), float(half_width(level.std[k]))]
                    for name, k in zip(
                        QUANTITIES, range(OF_JOINT * row, OF_JOINT * (row + 1)), strict=True
                    )
                }
                for row, joint in enumerate(joints)
            }
            found.append(
                {
                    "robot": robot.robot,
                    "days": len(robot.days),
                    "first_day": robot.days[0],
                    "last_day": robot.days[-1],
                    "status": self.status(number),
                    "changes": [change_dict(c) for c in self._by_robot.get(robot.robot, [])],
                    "level_and_half_width": own,
                }
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """What changed, every robot's level, and what does not count, as JSON values."""
        scatter, joints = self.days.scatter, self.days.local.joints
        spread = {
            joint: {
                name: {
                    "between_days": float(np.sqrt(scatter.day[k])),
                    "between_robots": float(np.sqrt(scatter.robot[k])),
                    "per_kelvin": float(scatter.slope[k]),
                    "per_kelvin_std": float(scatter.slope_std[k]),
                }
                for name, k in zip(
                    QUANTITIES, range(OF_JOINT * row, OF_JOINT * (row + 1)), strict=True
                )
            }
            for row, joint in enumerate(joints)
        }
        return {
            "headline": self.headline,
            "claim": self.claim,
            "warnings": list(self.limits),
            "false_alarms_a_year": self.days.false_alarms,
            "robots": self.robots_json(),
            "scatter": spread,
            "left_out": [vars(one) for one in self.left_out],
            "work": vars(self.work),
        }

    def write(self, folder: Path) -> None:
        """Page, numbers, a line a robot, and the model that robots share."""
        super().write(folder)
        lines = "".join(json.dumps(one, allow_nan=False) + "\n" for one in self.robots_json())
        (folder / "robots.jsonl").write_text(lines, encoding="utf-8")
        (folder / "model.json").write_text(self.model.text(), encoding="utf-8")

    def show(self, console: Console) -> None:
        """Print which robots changed."""
        print_verdict(console, self.headline, self.claim, self.limits)
        rows = [row for row in self.table.rows if row.cells[2] in ("changed", "unusual")]
        shown, table = rows[:MOST_LISTED], self.table
        if shown:
            console.print()
            few = PlainTable("", "", table.headings, shown, table.text)
            console.print(narrow_table(few))
        if len(rows) > len(shown):
            console.print(Text(f"and {len(rows) - len(shown)} more robots: see the page"))
        console.print(Text(f"\n{self.work.words}"))


def words_of_cause(change: FleetChange) -> str:
    """Like `dry friction of joint3`."""
    cause = change.cause
    return f"{cause.what} of {cause.joint}" if cause.joint else cause.what


def when_words(change: FleetChange) -> str:
    """The first day of a change, with its interval where that is longer."""
    first, last = change.interval
    return change.day if first == last else f"{change.day} ({first} to {last})"


def size_words(change: FleetChange) -> str:
    """The size with its interval; of a payload its mass and centre."""
    half = half_width(change.std)
    words = _with_unit(float(change.size[0]), float(half[0]), change.cause.unit)
    mass = float(change.size[0])
    if change.cause.what == "payload" and abs(mass) > half[0]:
        centre = ", ".join(f"{float(x) / mass:.3f}" for x in change.size[1:4])
        words += f" at ({centre}) m of the last link"
    return words


def _with_unit(value: float, half: float, unit: str) -> str:
    if not unit:
        return f"{100.0 * value:+.{_decimals(100.0 * half)}f} ± {significant(100.0 * half, 2)} %"
    return f"{value:+.{_decimals(half)}f} ± {significant(half, 2)} {unit}"


def _decimals(half: float) -> int:
    """Decimals of a number whose half-width has two digits."""
    return int(np.clip(1 - np.floor(np.log10(max(half, 1e-12))), 0, 9))


def change_dict(change: FleetChange) -> dict[str, Any]:
    """A change as JSON values."""
    return {
        "what": change.cause.what,
        "joint": change.cause.joint or None,
        "unit": change.cause.unit or None,
        "first_day": change.day,
        "first_day_interval": list(change.interval),
        "size": change.size.tolist(),
        "half_width": half_width(change.std).tolist(),
        "p": change.p,
    }
