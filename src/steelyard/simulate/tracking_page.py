"""What `steelyard track` finds: errors of every joint and of the tool, as a page and a text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.arrays import Array, finite_json, records
from steelyard.report.page import Shown, figures, fill, page_of
from steelyard.report.page_figures import Figure, Group, Key, evenly, line, thin
from steelyard.report.result import Result
from steelyard.report.tables import PlainTable, Row, text_table
from steelyard.report.words import NONE, significant

if TYPE_CHECKING:
    from steelyard.robot.robot import Coordinate
    from steelyard.simulate.track import TrackedRun, Tracking

ERROR_UNITS = {"rad": ("°", 180.0 / np.pi), "m": ("mm", 1e3)}
"""Units of joint errors for people, by that of the joint, and their factors."""


@dataclass(frozen=True, eq=False, repr=False)
class TrackingComparison(Result):
    """A motion run under control with and without a model."""

    robot: str
    tracking: Tracking  # errors of the joints and of the tool
    settings: tuple[tuple[str, str], ...]  # what the results depend on, labelled
    notes: tuple[str, ...] = ()
    page_name, json_name = "tracking.html", "tracking.json"

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        found = self.tracking
        errors = {"headline": headline(found), "tables": tables(found)}
        told = {"settings": self.settings, "notes": self.notes, "origin": None}
        name, legend = "Tracking errors", legend_of(found)
        sections = (
            Shown("tracking", name, fill("tracking.html", {"title": name, **errors})),
            figures("tool-path", "Path of the tool", groups=[_paths(found)], legend=legend),
            figures(
                "errors-over-time",
                "Errors over time",
                groups=[_errors_over_time(found)],
                legend=legend[1:],
            ),
            Shown("settings", "Notes and settings", fill("settings.html", told), folded=True),
        )
        return page_of(f"Tracking of {self.robot}", self.robot, sections, "simulated")

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, SI units, as `steelyard track --json` prints them."""
        found = self.tracking
        joints = found.robot.coordinates
        return {
            "robot": self.robot,
            "settings": dict(self.settings),
            "headline": headline(found),
            "random_truth": found.random_truth,
            "controllers": [_run_values(found, run, joints) for run in found.runs],
            "notes": list(self.notes),
        }

    def show(self, console: Console) -> None:
        """Print the errors."""
        words = Text(headline(self.tracking), style="bold")
        for part in (words, *(text_table(table, "") for table in tables(self.tracking))):
            console.print(part)
            console.print()
        for note in self.notes:
            console.print(f"note: {note}", markup=False)


def headline(found: Tracking) -> str:
    """The mean error of the joints of the last run over that without a model, and the truth."""
    last = found.runs[-1]
    if last is found.reference:
        return f"Tool: RMS {_mm(last.tool_rms)} mm under {last.name}{_random_truth_note(found)}"
    ratios = found.ratios(last)
    mean = float(np.nanmean(ratios)) if np.isfinite(ratios).any() else float("nan")
    return (
        f"{last.name}: RMS error of the joints {significant(100.0 * mean)} % of that without a "
        f"model (mean), tool {_mm(last.tool_rms)} instead of {_mm(found.reference.tool_rms)} mm"
        f"{_random_truth_note(found)}"
    )


def _random_truth_note(found: Tracking) -> str:
    """That the simulated robot is not the one of the logs; empty if its truth is given."""
    if not found.random_truth:
        return ""
    robot = ". The simulated robot has random true parameters near the nominal ones"
    if len(found.runs) == 1:
        return f"{robot}; give the true ones with --truth"
    return (
        f"{robot}, the model was identified from other logs: this does not judge the model; "
        "give the true parameters with --truth"
    )


def tables(found: Tracking) -> list[PlainTable]:
    """Root mean square and largest errors, a row per joint and one for the tool."""
    names = [run.name for run in found.runs]
    headings, text = ("Joint", *names, "Unit"), (0, len(names) + 1)
    words = f"In brackets: divided by that under {names[0]}." if len(names) > 1 else ""
    made = []
    kinds = ("RMS error", "rms", "tool_rms"), ("Largest error", "largest", "tool_largest")
    for caption, of_joints, of_tool in kinds:
        rows, values = [], [getattr(run, of_joints) for run in found.runs]
        for j, joint in enumerate(found.robot.coordinates):
            unit, factor = ERROR_UNITS[joint.unit]
            rows.append(_row(joint.name, unit, [factor * float(x[j]) for x in values]))
        tool = [1e3 * getattr(run, of_tool) for run in found.runs]
        rows.append(_row(f"tool ({found.frame.name})", "mm", tool, total=True))
        made.append(PlainTable(caption, words, headings, rows, text, words))
    return made


def _row(name: str, unit: str, values: Sequence[float], *, total: bool = False) -> Row:
    first = values[0]
    ratios = [NONE if first == 0.0 else f"{value / first:.2f}" for value in values[1:]]
    rest = [f"{significant(x)} ({ratio})" for x, ratio in zip(values[1:], ratios, strict=True)]
    return Row((name, significant(first), *rest, unit), total=total)


def _run_values(found: Tracking, run: TrackedRun, joints: Sequence[Coordinate]) -> dict[str, Any]:
    return {
        "name": run.name,
        "joints": records(
            name=(joint.name for joint in joints),
            unit=(joint.unit for joint in joints),
            rms=run.rms,
            largest=run.largest,
            ratio=finite_json(found.ratios(run)),
        ),
        "tool": {
            "frame": found.frame.name,
            "unit": "m",
            "rms": run.tool_rms,
            "largest": run.tool_largest,
        },
    }


def _mm(metres: float) -> str:
    return significant(1e3 * metres)


DESIRED_COLOUR = "--ink"
RUN_COLOURS = ("--vermillion", "--blue", "--green", "--purple")  # without a model first
PATH_POINTS = 4000  # points of a path
ENLARGED_SHARE = 0.05  # share of the path's width that the largest deviation is drawn with


def _paths(found: Tracking) -> Group:
    """Two pictures in the plane in which the path is widest."""
    axes, factor = plane(found), magnification(found)
    words = f"deviations {factor:g} times as large"
    figures = [
        _path_figure(found, axes, 1.0, "as run", "zoom in to see the deviations"),
        _path_figure(found, axes, factor, "enlarged", words),
    ]
    return Group(figures)


def legend_of(found: Tracking) -> list[Key]:
    """Colours of the runs."""
    keys = [Key(DESIRED_COLOUR, "desired")]
    return keys + [Key(run_colour(k), run.name) for k, run in enumerate(found.runs)]


def run_colour(number: int) -> str:
    """Name in the style sheet of a run's colour."""
    return RUN_COLOURS[min(number, len(RUN_COLOURS) - 1)]


def plane(found: Tracking) -> tuple[int, int]:
    """The two axes along which the path is widest, in their order."""
    first, second = sorted(np.argsort(-np.ptp(found.desired, axis=0), kind="stable")[:2].tolist())
    return first, second


def magnification(found: Tracking) -> float:
    """Factor 1, 2 or 5 times a power of ten by which deviations are drawn larger."""
    largest = max(run.tool_largest for run in found.runs)
    width = float(np.ptp(found.desired, axis=0).max())
    if largest == 0.0 or width == 0.0:
        return 1.0
    wanted = max(ENLARGED_SHARE * width / largest, 1.0)
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted))


def _path_figure(
    found: Tracking, axes: tuple[int, int], factor: float, title: str, caption: str
) -> Figure:
    """Desired path and all runs, both scales alike."""
    a, b = axes
    rows = evenly(len(found.t), PATH_POINTS)
    desired = found.desired[rows]
    traces: list[dict[str, Any]] = [
        line("desired", desired[:, a], desired[:, b], DESIRED_COLOUR, width=1, hoverinfo="skip")
    ]
    for k, run in enumerate(found.runs):
        tool = desired + factor * (run.tool[rows] - desired)
        traces.append(line(run.name, tool[:, a], tool[:, b], run_colour(k), width=1.5))
    layout = {
        "yaxis": {"scaleanchor": "x", "constrain": "domain"},
        "xaxis": {"constrain": "domain"},
        "showlegend": False,
    }
    label = f"Path of the tool, {title}: desired and {len(found.runs)} runs"
    names = [f"{'xyz'[axis]} [m]" for axis in axes]
    return Figure(title, label, names[0], names[1], traces, layout, caption, 460)


ERROR_LINE_POINTS = 1500  # most points of a line
ERROR_POINTS_BUDGET = 120_000  # points of all lines together


def _errors_over_time(found: Tracking) -> Group:
    """The tool's deviation, and a picture per joint."""
    lines = (found.robot.n + 1) * len(found.runs)
    most = max(min(ERROR_LINE_POINTS, ERROR_POINTS_BUDGET // lines), 50)
    tool = [1e3 * run.deviation for run in found.runs]
    figures = [_error_figure(found, f"tool ({found.frame.name})", "distance [mm]", tool, most)]
    for j, joint in enumerate(found.robot.coordinates):
        unit, factor = ERROR_UNITS[joint.unit]
        errors = [factor * run.error[:, j] for run in found.runs]
        figures.append(_error_figure(found, joint.name, f"desired − true [{unit}]", errors, most))
    return Group(figures)


def _error_figure(found: Tracking, name: str, y: str, errors: Sequence[Array], most: int) -> Figure:
    """One line per run."""
    traces: list[dict[str, Any]] = []
    for k, (run, error) in enumerate(zip(found.runs, errors, strict=True)):
        rows = thin(error, most)
        traces.append(line(run.name, found.t[rows], error[rows], run_colour(k), width=1.3))
    label = f"Tracking error of {name} over time"
    return Figure(name, label, "time [s]", y, traces, {"showlegend": False})
