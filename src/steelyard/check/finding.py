"""What a check found: a severity, evidence with a picture, and an edit of the robot file."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Literal, Self

import numpy as np

from steelyard.base.arrays import Array
from steelyard.robot.file.toml_edits import Edit as Edit

MOST_NAMED = 4  # most logs, joints or places that a sentence names
MOST_LISTED = 6  # most parameters, bounds or hypotheses that are listed
WRITTEN_DIGITS = 4  # significant digits of numbers that are written into a robot file
PICTURE_TIME = 10.0  # length of what pictures of a signal show [s]
OPEN_WORD = "open"  # the word for a question that could not be answered
SURE_DEVIATIONS = 6.0  # standard deviations from which on what is fitted is there for certain
LEAST_PRINTED_PERCENT = 0.01  # least share that is printed [%]


class Severity(IntEnum):
    """How bad it is; the worst one is the exit code of `steelyard check`."""

    OK = 0
    DOUBTFUL = 1
    WRONG = 2

    @property
    def word(self) -> str:
        """As it is printed."""
        return self.name.lower()


@dataclass(frozen=True)
class Fix:
    """What to do about a finding."""

    says: str  # in one sentence
    edits: tuple[Edit, ...] = ()  # of the robot file; none where it cannot correct it
    # whether all such edits of a log were tried as one change: one without the others is untested,
    # and none is written where another one cannot be
    jointly: bool = False
    command: str = ""  # that goes on from here; MODEL, ROBOT and LOG stand for paths


@dataclass(frozen=True, eq=False)
class Trace:
    """One line, or one set of points or bars, of a picture: `x` and `y` of equal length."""

    name: str
    x: Array
    y: Array
    kind: Literal["line", "points", "bars"] = "line"


@dataclass(frozen=True, eq=False)
class Picture:
    """The plot that shows the evidence."""

    x: str  # title of the horizontal axis, with its unit
    y: str  # title of the vertical axis, with its unit
    traces: tuple[Trace, ...]  # what is drawn; at most `TRACE_POINTS` points each


@dataclass(frozen=True)
class ComparedHypothesis:
    """One explanation of the data beside others."""

    says: str  # what it supposes, in a few words: "as declared", "joint 2 has the other sign"
    misfit: float  # relative error of the prediction under it [%]
    log_likelihood: float  # against the best of its hypotheses, which is at 0 [natural units]
    declared: bool = False  # whether it is what the robot file declares


@dataclass(frozen=True, eq=False)
class Finding:
    """What one check found."""

    check: str  # name of the check
    log: str  # name of the log; empty if it is about all logs together
    severity: Severity  # how bad it is
    says: str  # what was found, in one sentence
    figure: str = ""  # the evidence as a number with its unit, and what it is compared with
    joints: tuple[str, ...] = ()  # those concerned; empty if it is about all or none
    fix: Fix | None = None  # what to do; `None` if nothing need be done
    picture: Picture | None = None  # the evidence as a plot, if there is one to show
    hypotheses: tuple[ComparedHypothesis, ...] = ()  # that were compared, the likeliest first
    nominal: bool = False  # whether by the masses of a model file, not of a reference
    answered: bool = True  # whether the question could be answered; what is open is not suspicious
    hidden: bool = False  # whether open for a large misfit that other link inertias leave too
    headline: bool = False  # whether it stands beside the headline though it is ok
    brief: str = ""  # what was found, for a line of a terminal; empty where `says` is short

    @classmethod
    def of(cls, severity: Severity, says: str, *more: Any, log: str = "", **named: Any) -> Self:
        """A finding without the name of its check, which the check itself fills in."""
        return cls("", log, severity, says, *more, **named)

    @classmethod
    def ok(cls, says: str, *more: Any, **named: Any) -> Self:
        """One that is ok, or open."""
        return cls.of(Severity.OK, says, *more, **named)

    @classmethod
    def doubtful(cls, says: str, *more: Any, **named: Any) -> Self:
        """One that is doubtful."""
        return cls.of(Severity.DOUBTFUL, says, *more, **named)

    @classmethod
    def doubtful_if(
        cls, bad: bool, says: str, figure: str, fix: Fix, joints: Sequence[str] = (), **named: Any
    ) -> Self:
        """One that is doubtful, with what to do about which joints, or else ok."""
        if not bad:
            return cls.ok(says, figure, **named)
        return cls.doubtful(says, figure, tuple(joints), fix, **named)

    @classmethod
    def wrong(cls, says: str, *more: Any, **named: Any) -> Self:
        """One that is wrong."""
        return cls.of(Severity.WRONG, says, *more, **named)

    def by(self, check: str) -> Self:
        """The finding of a check."""
        return replace(self, check=check)

    @property
    def word(self) -> str:
        """The severity, or that the question is open."""
        return OPEN_WORD if not self.severity and not self.answered else self.severity.word

    @property
    def place(self) -> str:
        """The log and the few joints that it is about, unless its sentence names these."""
        few = self.joints if len(self.joints) <= MOST_NAMED else ()
        if all(re.search(rf"(?<!\w){re.escape(joint)}(?!\w)", self.says) for joint in few):
            few = ()
        return ": ".join(part for part in (self.log, ", ".join(few)) if part)


def percent_of(share: float) -> str:
    """A share in percent, like `0.52 %`, `below 0.01 %` or `100 %`."""
    percent = 100.0 * share
    if 0.0 < percent < LEAST_PRINTED_PERCENT:
        return f"below {LEAST_PRINTED_PERCENT} %"
    return f"{percent:.2g} %" if percent < 99.5 else f"{percent:.0f} %"


TRACE_POINTS = 2000  # points of a trace


def trace(name: str, x: Array, y: Array, kind: Literal["line", "points", "bars"] = "line") -> Trace:
    """A trace of at most `TRACE_POINTS` points."""
    step = max(1, -(-len(x) // TRACE_POINTS))
    return Trace(name, np.array(x[::step], dtype=np.float64), np.array(y[::step]), kind)


def histogram(name: str, values: Array, bins: int = 60) -> Trace:
    """How often values occur; the rarest 0.1 % on each side are counted in the outer bars."""
    low, high = np.quantile(values, [0.001, 0.999])
    spread = max(float(high - low), 1e-3 * abs(float(high)), 1e-12)
    edges = np.linspace(low - 0.1 * spread, high + 0.1 * spread, bins + 1)
    count, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    return Trace(name, 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")


def of_joints(y: str, rows: Sequence[tuple[str, Array, Literal["bars", "points"]]]) -> Picture:
    """One number per joint, for some names."""
    traces = (Trace(n, np.arange(1.0, len(v) + 1.0), np.array(v), kind) for n, v, kind in rows)
    return Picture("joint", y, tuple(traces))
