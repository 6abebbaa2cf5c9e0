"""What the predicted effort of every joint consists of, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.regression.gather import Mask
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, line
from steelyard.report.html import rounded
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant
from steelyard.report.thin import gaps
from steelyard.validation.torque_parts import PARTS, TorqueParts

if TYPE_CHECKING:
    from steelyard.robot.robot import Coordinate
    from steelyard.validation.score import RunScore

POINTS = 1000
"""Most points of one line."""

BUDGET = 60_000
"""Points of all lines together: about 0.6 MB of the page."""

NOTHING = 1e-9
"""Share of the measured effort below which a part is round-off."""

WORDS = {
    "gravity": "gravity",
    "coriolis": "Coriolis",
    "inertia": "inertia",
    "friction": "friction",
    "other": "springs, offsets",
}
STYLES = {
    "gravity": ("--purple", "solid"),
    "coriolis": ("--arm", "dot"),
    "inertia": ("--amber", "solid"),
    "friction": ("--green", "dash"),
    "other": ("--soft", "dashdot"),
}
"""Colour and dash of each part."""


class TorqueSplitSection(FigureSection):
    """A table of sizes, and one folded figure per joint."""

    name: ClassVar[str] = "torque-split"
    title: ClassVar[str] = "Effort by cause"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Parts of one run, one that was not fitted if there is one."""
        found = _run(content)
        if content.identified is None or found is None:
            return None
        score, kind = found
        parts, joints = score.parts, content.identified.model.robot.coordinates
        if parts is None:
            return None
        sizes = _sizes(parts, parts.moving)
        present = _sizes(parts, np.ones_like(parts.moving))
        points = min(POINTS, BUDGET // ((2 + len(PARTS)) * len(joints)))
        groups = [
            Group(
                [_figure(parts, j, joint, present, points)],
                joint.name,
                _caption(sizes, j, joint),
                "one",
            )
            for j, joint in enumerate(joints)
        ]
        return {
            "words": f"Run {score.run} ({kind}). Efforts at the joints below {score.cutoff:g} Hz, "
            "the validation band; the parts add up to the predicted effort. Root mean squares are "
            "of the samples in which the joint moves; of all samples if it rests throughout.",
            "tables": [_table(sizes, joints)],
            "groups": groups,
            "note": "Coriolis: with centrifugal efforts. Inertia: mass matrix times acceleration, "
            "with rotors. A part that is small throughout is hardly identifiable from this motion. "
            f"Each line has at most {points} evenly spaced points. Click an entry of a legend to "
            "hide it.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """RMS of the parts per joint, where it moves."""
        found = _run(content)
        if content.identified is None or found is None or found[0].parts is None:
            return {"torque_split": None}
        sizes = _sizes(found[0].parts, found[0].parts.moving)
        joints = content.identified.joints
        return {
            "torque_split": {
                "run": found[0].run,
                "joints": [
                    {"joint": joint, **{name: rounded(size[j]) for name, size in sizes.items()}}
                    for j, joint in enumerate(joints)
                ],
            }
        }


def _run(content: ReportContent) -> tuple[RunScore, str] | None:
    """The first run with parts, and its kind; those that were not fitted come first."""
    scores = [(score, "not fitted") for score in content.scores]
    scores += [(score, "fitted") for score in content.fitted]
    return next(((score, kind) for score, kind in scores if score.parts is not None), None)


def _sizes(parts: TorqueParts, chosen: Mask) -> dict[str, Array]:
    """RMS per joint of each part, of the measured effort and of the residual, `(n,)` [Nm; N].

    Args:
        parts: The samples.
        chosen: Which of them count for each joint, shape `(N, n)`; all where there is none.
    """
    weights = np.where(chosen.any(axis=0), chosen, True)
    signals = dict(zip(PARTS, parts.parts, strict=True))
    signals |= {"measured": parts.measured, "residual": parts.residual}
    sizes = {
        name: np.sqrt(np.average(np.square(x), axis=0, weights=weights))
        for name, x in signals.items()
    }
    least = NOTHING * sizes["measured"]
    return {name: np.where(size <= least, 0.0, size) for name, size in sizes.items()}


def _caption(sizes: dict[str, Array], j: int, joint: Coordinate) -> str:
    """The two largest parts."""
    largest = sorted(PARTS, key=lambda name: -sizes[name][j])[:2]
    unit = joint.effort_unit
    return "mostly " + ", ".join(
        f"{WORDS[name]} {significant(float(sizes[name][j]), 2)} {unit}" for name in largest
    )


def _table(sizes: dict[str, Array], joints: tuple[Coordinate, ...]) -> PlainTable:
    rows = [
        Row(
            (
                joint.name,
                *(significant(float(size[j]), 3) for size in sizes.values()),
                joint.effort_unit,
            )
        )
        for j, joint in enumerate(joints)
    ]
    headings = ("Joint", *(_capital(WORDS.get(name, name)) for name in sizes), "Unit")
    return PlainTable("Root mean squares", "", headings, rows, (0, len(headings) - 1))


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]


def _figure(
    parts: TorqueParts, j: int, joint: Coordinate, present: dict[str, Array], points: int
) -> Figure:
    """Measured and predicted effort above, the parts below; those that are zero are left out."""
    at, t = _drawn(parts.t, points)
    hover = f"%{{y:.3g}} {joint.effort_unit}"

    def trace(name: str, signal: Array, **more: Any) -> dict[str, Any]:
        values = np.where(at < 0, np.nan, signal[at])
        return line(name, t, values, hovertemplate=hover, **more)

    traces = [
        trace("measured", parts.measured[:, j], colour="--measured", width=4.2),
        trace("predicted", parts.predicted[:, j], colour="--predicted", width=1.6, dash="8px,5px"),
    ]
    traces += [
        trace(
            WORDS[name],
            part[:, j],
            colour=STYLES[name][0],
            width=1.8,
            dash=STYLES[name][1],
            yaxis="y2",
        )
        for name, part in zip(PARTS, parts.parts, strict=True)
        if present[name][j]
    ]
    title = {"text": joint.effort_unit, "standoff": 4}
    layout = {
        "hovermode": "x unified",
        "xaxis": {"anchor": "y2"},
        "yaxis": {"domain": [0.6, 1.0]},
        "yaxis2": {"domain": [0.0, 0.52], "title": title, "zeroline": True},
    }
    label = f"Effort of {joint.name} by cause over time"
    return Figure("", label, "time [s]", joint.effort_unit, traces, layout, height=460)


def _drawn(t: Array, points: int) -> tuple[Array, Array]:
    """Indices of the samples to draw, -1 at a gap of time, and their times, `(points,)` at most."""
    breaks = gaps(t)[: points // 4]
    step = max(1, -(-len(t) // (points - len(breaks))))
    at = np.arange(0, len(t), step)
    places = np.searchsorted(at, breaks, side="right")
    return np.insert(at, places, -1), np.insert(t[at], places, np.nan)
