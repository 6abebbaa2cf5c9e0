"""What was found in a fleet: text, page, JSON, and a line a robot for monitoring."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import by_key
from steelyard.estimate.changes_from_model import OF_JOINT
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.logs_left_out import LeftOut
from steelyard.fleet.changes_over_days import FleetChange, FleetDays, RobotLevel, half_width
from steelyard.report.page import figures, notes, page_of
from steelyard.report.page_figures import Figure, Group, Key, area, line, points
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import count, significant
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

QUANTITIES = ("bodies", "dry friction", "viscous friction", "offset")
MOST_LISTED = 12  # robots and logs that the terminal lists
MOST_FIGURES = 40  # changes that the page draws
FEW_DIFFERENCES = 10  # between days, of which scatter is not known well
LARGE_INFLATION = 4.0  # of a cause's test, above which changes of most robots may hide
SEEN_CHANGE = 4.0  # square of a change by 100 % over its standard deviation that would be seen

Status = Literal["changed", "was changed", "unusual", "same", "one day", "no log"]
ORDER: tuple[Status, ...] = get_args(Status)


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
            text += f", {self.damaged} damaged in the store and made again"
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
        left = "nothing: all is remembered"
        if self.left:
            left = f"{count(self.left, 'part')}, {_bytes(self.bytes_left)}; the others, and the "
            left += "first model, are done and remembered"
        lines = [f"logs      {robots}, {days}, {count(self.parts, 'part')}, {_bytes(self.bytes)}"]
        lines.append(f"left      {left}")
        if self.left:
            one = self.seconds * self.processes
            where = f"{self.processes} {'process' if self.processes == 1 else 'processes'}"
            lines += [
                f"time      about {_duration(self.seconds)} in {where} of this machine, as one "
                f"part took; {_duration(one)} of one worker in all",
                f"memory    up to {self.memory / 2**30:.1f} GiB in {where}",
            ]
        return "\n".join(lines)


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
        remarks: What qualifies the whole result.
        work: How much was done.
    """

    robot: str
    model: IdentifiedModel
    days: FleetDays
    changes: tuple[FleetChange, ...]
    levels: tuple[RobotLevel, ...]
    left_out: tuple[LeftOut, ...]
    remarks: tuple[str, ...]
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
        mine = self._by_robot.get(robot.robot, [])
        if mine:
            return "was changed" if all(change.until for change in mine) else "changed"
        if self.levels[number].unusual:
            return "unusual"
        return "same" if len(robot.days) > 1 else "one day"

    @cached_property
    def without_log(self) -> tuple[str, ...]:
        """Robots of which no log counts."""
        known = {robot.robot for robot in self.days.robots}
        return tuple(dict.fromkeys(x.robot for x in self.left_out if x.robot not in known))

    @property
    def changed(self) -> tuple[str, ...]:
        """Robots that are changed at their last day."""
        numbers = range(len(self.days.robots))
        return tuple(self.days.robots[k].robot for k in numbers if self.status(k) == "changed")

    @property
    def headline(self) -> str:
        """How many robots changed."""
        n, robots = len(self.days.robots), self.days.robots
        over = f"of {count(n, 'robot')} over {count(self.days.n_days, 'day')}"
        if self.days.n_days == 1 or all(len(robot.days) == 1 for robot in robots):
            return f"Nothing can be said of changes {over}"
        every = [self.status(k) for k in range(n)]
        words = {"changed": "changed", "was changed": "was changed and is no more",
                 "unusual": "differ from the others without a change"}  # fmt: skip
        found = [f"{every.count(x)} {text}" for x, text in words.items() if x in every]
        found += [f"{len(self.without_log)} without a log that counts"] * bool(self.without_log)
        if not {"changed", "was changed"} & set(every):
            return "; ".join([f"No change found {over}", *found])
        return f"{over.removeprefix('of ').capitalize()}: {', '.join(found)}"

    @property
    def claim(self) -> str:
        """What counts as a change."""
        scatter, rate = self.days.scatter, self.days.false_alarms
        warm = "Temperature is logged, and its effect subtracted" if scatter.slope.any() else (
            "Temperature is not known: its effect is part of the scatter"
        )  # fmt: skip
        return (
            f"About {rate:g} false {'change' if rate == 1.0 else 'changes'} a year in the whole "
            f"fleet {'is' if rate == 1.0 else 'are'} to be expected, judged from "
            f"{scatter.differences} differences between days. {warm}. A slow drift "
            "appears as steps."
        )

    @property
    def limits(self) -> tuple[str, ...]:
        """What qualifies the result."""
        found = list(self.remarks)
        wrong = [one for one in self.left_out if not one.at_rest]
        for (words, fix), mine in by_key(((one.wrong, one.fix), one) for one in wrong).items():
            more = f", and {len(mine) - 1} more (see left_out in fleet.json)" * (len(mine) > 1)
            found.append(f"does not count: {mine[0].log}{more}: {words}; {fix}")
        if rest := [one for one in self.left_out if one.at_rest]:
            more = f", and {len(rest) - 1} more" * (len(rest) > 1)
            found.append(f"at rest, and not judged: {rest[0].log}{more}")
        for causes, robots in by_key((causes, robot) for robot, causes in self.blind).items():
            which = f"{robots[0]}{f' and {len(robots) - 1} more' * (len(robots) > 1)}"
            everyone = "all robots" if len(robots) == len(self.days.robots) else which
            found.append(f"no change would be seen, as the motion does not show it: {everyone}: "
                         f"{', '.join(causes)}")  # fmt: skip
        scatter = self.days.scatter
        if scatter.inflation.max() > LARGE_INFLATION:
            k = int(np.argmax(scatter.inflation))
            found.append(
                f"days differ more than their scatter explains ({self.days.causes[k].what} "
                f"{self.days.causes[k].joint}: {scatter.inflation[k]:.0f} times): smaller changes "
                "are hidden, also where most robots changed"
            )
        if scatter.differences < FEW_DIFFERENCES:
            found.append(
                f"{count(scatter.differences, 'difference')} between days: only large changes can "
                "be told from scatter"
            )
        return tuple(found)

    @cached_property
    def blind(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Robots whose motion would not show a change by 100 %, each with the causes."""
        days, found = self.days, list[tuple[str, tuple[str, ...]]]()
        expected = days.local.expected(days.friction)
        for robot in days.robots:
            total = np.sum([one.matrix for one in robot.equations], axis=0)
            unseen = []
            for cause in days.causes:
                own = cause.directions[:, 0]
                if float(own @ total @ own) * float(expected @ np.abs(own)) ** 2 < SEEN_CHANGE:
                    unseen.append(f"{cause.what} {cause.joint}".strip())
            if unseen:
                found.append((robot.robot, tuple(unseen)))
        return tuple(found)

    def _rows(self, number: int) -> list[Row]:
        """A row a change; one for a robot without any."""
        robot, status = self.days.robots[number], self.status(number)
        begin = robot.robot, str(len(robot.days)), status
        mine = self._by_robot.get(robot.robot, [])
        if status == "unusual":
            each = [("", f"differs from the others in {x}") for x in self._unusual(number)]
        else:
            each = [(when_words(c, robot.days), f"{words_of_cause(c)} {self.size_words(c)}")
                    for c in mine] or [("", "")]  # fmt: skip
        marked = status in ("changed", "was changed")
        rows = [Row((*begin, *each[0]), marked)]
        return rows + [Row(("", "", "", *more), marked) for more in each[1:]]

    def _unusual(self, number: int) -> list[str]:
        """What of a robot differs from the median robot, and how far."""
        local, level = self.days.local, self.levels[number]
        joints, found = local.joints, list[str]()
        for k in level.unusual:
            value, half = float(level.away[k]), float(half_width(level.spread[k]))
            if k < OF_JOINT * len(joints):
                row, part = divmod(k, OF_JOINT)
                unit = local.units[row] if part == OF_JOINT - 1 else ""
                found.append(f"{QUANTITIES[part]} of {joints[row]} {_with_unit(value, half, unit)}")
            else:
                found.append("what the last link carries")
        return list(dict.fromkeys(found))

    def size_words(self, change: FleetChange) -> str:
        """The size with its interval; of a payload its mass and centre."""
        half = half_width(change.std)
        words = _with_unit(float(change.size[0]), float(half[0]), change.cause.unit)
        mass = float(change.size[0])
        if change.cause.what == "payload" and abs(mass) > half[0]:
            centre = ", ".join(f"{float(x) / mass + 0.0:.3f}" for x in change.size[1:4])
            link = self.model.robot.bodies[-1].name
            words += f" at ({centre}) m of {link}"
        return words

    @cached_property
    def table(self) -> PlainTable:
        """A row a robot, those that changed first."""
        numbers = sorted(
            range(len(self.days.robots)), key=lambda k: (ORDER.index(self.status(k)), k)
        )
        headings = ("robot", "days", "status", "since (95 %)", "what")
        rows = [row for k in numbers for row in self._rows(k)]
        rows += [Row((robot, "0", "no log", "", "no log counts")) for robot in self.without_log]
        return PlainTable("", "", headings, rows, (0, 2, 3, 4))

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        drawn = self.changes[:MOST_FIGURES]
        groups = [
            Group([self._figure(c)], f"{c.robot}: {words_of_cause(c)}",
                  f"{self.size_words(c)} since {when_words(c, self._days_of[c.robot])}")
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
        return page_of(f"{self.robot}: fleet", self.robot, sections)

    @cached_property
    def _days_of(self) -> dict[str, tuple[str, ...]]:
        return {robot.robot: robot.days for robot in self.days.robots}

    def _figure(self, change: FleetChange) -> Figure:
        number = [r.robot for r in self.days.robots].index(change.robot)
        value, std = self.days.singly(number, change.cause)
        days = np.arange(len(value), dtype=np.float64)
        percent = 1.0 if change.cause.unit else 100.0
        factor, unit = change.factor * percent, change.cause.unit or "%"
        value, half = factor * value, abs(factor) * half_width(std)
        at = self.days.robots[number].days.index(change.day)
        names = self._days_of[change.robot]
        gone = names.index(change.until) if change.until else len(names)
        level = np.where((days >= at) & (days < gone), percent * change.size[0], 0.0)
        level += float(np.median((value - level)[:at])) if at else 0.0
        traces = [
            area("95 %", days, value - half, value + half, "--interval"),
            points("day", days, value, "--measured", 5.0),
            line("step", days, level, "--predicted", line={"shape": "hv", "width": 2}),
        ]
        label = f"{words_of_cause(change)} of {change.robot} over its days"
        ticks = list(range(0, len(names), max(1, len(names) // 8)))
        axis = {"xaxis": {"tickvals": ticks, "ticktext": [names[k] for k in ticks]}}
        return Figure("", label, "day", f"change [{unit}]", traces, {"showlegend": False} | axis)

    def robots_json(self) -> list[dict[str, Any]]:
        """A JSON object a robot."""
        joints, found, unseen = self.days.local.joints, list[dict[str, Any]](), dict(self.blind)
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
                    "not_seen": list(unseen.get(robot.robot, ())),
                    "changes": [change_dict(c) for c in self._by_robot.get(robot.robot, [])],
                    "level_and_half_width": own,
                }
            )
        found += [{"robot": robot, "days": 0, "status": "no log"} for robot in self.without_log]
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
        rows = [row for row in self.table.rows if row.cells[2] not in ("same", "one day")]
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


def when_words(change: FleetChange, days: Sequence[str]) -> str:
    """The first day of a change, with its interval where that is longer, and how it ended."""
    first, last = change.interval
    words = change.day if first == last else f"{change.day} ({first} to {last})"
    if change.until:
        return f"{words}, gone on {change.until}"
    return f"{words}, that day alone so far" if change.day == days[-1] else words


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
        "gone_on": change.until or None,
        "parameters": list(INERTIAL_NAMES) if change.cause.what == "payload" else None,
        "size": change.size.tolist(),
        "half_width": half_width(change.std).tolist(),
        "p": change.p,
    }
