"""Errors and predicted efforts of several models on the same logs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from steelyard.identify.page.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, dots, drawn, line, row_height
from steelyard.report.page import FigureSection, Numbers
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, count, percent, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimate.scores.joint_errors import JointError, PooledError
    from steelyard.estimate.scores.model_comparison import ModelComparison


MODEL_COLOURS = ("--vermillion", "--blue", "--green", "--purple", "--amber", "--arm")
MODEL_SYMBOLS = ("diamond", "circle", "square", "x", "triangle-up", "cross")
MODEL_DASHES = ("solid", "dash", "dot", "dashdot")
"""Of lines, changed when the colours begin again."""


def colour(number: int) -> str:
    """Name in the style sheet of a model's colour."""
    return MODEL_COLOURS[number % len(MODEL_COLOURS)]


def symbol(number: int) -> str:
    """Of a model's marks."""
    return MODEL_SYMBOLS[number % len(MODEL_SYMBOLS)]


def dash(number: int) -> str:
    """Of a model's lines."""
    return MODEL_DASHES[number // len(MODEL_COLOURS) % len(MODEL_DASHES)]


def legend(names: Sequence[str], shape: Literal["line", "point"]) -> list[Key]:
    """Colours of models by name."""
    return [Key(colour(k), name, shape) for k, name in enumerate(names)]


FITTED_MARK = "*"
"""Behind errors on logs that the model was identified from."""

MOST_TERMINAL_COLUMNS = 6
"""Columns of a table that the terminal has room for."""


class ModelErrorsSection(FigureSection):
    """A table per log, one of all logs, and a picture of the shares."""

    name: ClassVar[str] = "model-errors"
    title: ClassVar[str] = "Errors of predicted efforts"
    template: ClassVar[str] = "models.html"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Tables and the picture, if models were compared."""
        found = content.models
        if found is None:
            return None
        return {
            "headline": models_headline(found),
            "tables": error_tables(found),
            "groups": [Group([_errors_figure(found)], columns="one")],
            "legend": legend([model.name for model in found.models], "point"),
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Errors of every model, log and joint, and those of all joints together."""
        found = content.models
        if found is None:
            return {}
        return {
            "errors": [
                {
                    "run": run.run,
                    "model": model.name,
                    "fitted": run.fitted,
                    "mae": mae,
                    **{("rmse" if k == "error" else k): v for k, v in joint.to_dict().items()},
                }
                for model in found.models
                for run in model.runs
                for joint, mae in zip(run.errors.joints, run.mae.tolist(), strict=True)
            ],
            "all_joints": [
                {
                    "model": model.name,
                    **{("rmse" if k == "error" else k): v for k, v in one.to_dict().items()},
                }
                for model in found.models
                for one in found.all_joints(model)
            ],
            "pooled_runs": [found.runs[k] for k in found.pooled_runs],
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The headline and the errors in all logs together."""
        from rich.text import Text

        if content.models is not None:
            yield Text(models_headline(content.models), style="bold")
            first, *_ = error_tables(content.models)
            yield from _printed([first])
            yield Text(first.note)

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The errors in every log, if there are several."""
        if content.models is not None:
            yield from _printed(error_tables(content.models)[1:])


def _printed(given: Sequence[PlainTable]) -> Iterable[RenderableType]:
    """Tables for the terminal, under their captions; wide ones without the effort used."""
    from rich.text import Text

    for table in given:
        yield Text(table.caption)
        columns = range(len(table.headings))
        yield narrow_table(
            table, columns if len(columns) <= MOST_TERMINAL_COLUMNS else [0, *columns[2:]]
        )


def models_headline(found: ModelComparison) -> str:
    """The errors of all joints together, one model after the other."""
    each = (
        f"{model.name} {' and '.join(_with_unit(one) for one in found.all_joints(model))}"
        for model in found.models
    )
    return f"RMS error of all joints: {', '.join(each)}"


def error_tables(found: ModelComparison) -> list[PlainTable]:
    """All logs together, then one by one if there are several."""
    if len(found.runs) == 1:
        return [_of_run(found, 0)]
    each = [replace(_of_run(found, k), words="") for k in range(len(found.runs))]
    return [_of_all(found), *each]


def _of_run(found: ModelComparison, k: int) -> PlainTable:
    rows = []
    for j, name in enumerate(found.joints):
        joints = [model.runs[k].errors.joints[j] for model in found.models]
        cells = [
            _cell(joint) + _mark(model.runs[k].fitted)
            for model, joint in zip(found.models, joints, strict=True)
        ]
        rows.append(Row((name, significant(joints[0].reference), *cells, joints[0].unit)))
    return _table(found, found.runs[k], rows)


def _of_all(found: ModelComparison) -> PlainTable:
    rows = []
    for j, name in enumerate(found.joints):
        joints = [found.joint(model, j) for model in found.models]
        unit = found.models[0].runs[0].errors.joints[j].unit
        rows.append(_pooled_row(found, name, joints, unit))
    for k, one in enumerate(found.all_joints(found.models[0])):
        every = [found.all_joints(model)[k] for model in found.models]
        rows.append(_pooled_row(found, "all joints", every, one.unit, total=True))
    logs, total = len(found.pooled_runs), len(found.runs)
    unseen = f"{count(logs, 'log')} that no model was identified from"
    return _table(found, f"All {total} logs" if logs == total else unseen.capitalize(), rows)


def _pooled_row(
    found: ModelComparison,
    name: str,
    joints: Sequence[PooledError | None],
    unit: str,
    *,
    total: bool = False,
) -> Row:
    marks = [_mark(any(model.runs[k].fitted for k in found.pooled_runs)) for model in found.models]
    cells = [
        (NONE if one is None else _size(one)) + mark
        for one, mark in zip(joints, marks, strict=True)
    ]
    first = joints[0]
    used = NONE if first is None else significant(first.reference)
    return Row((name, used, *cells, unit), total=total)


def _table(found: ModelComparison, caption: str, rows: Sequence[Row]) -> PlainTable:
    cutoff = found.models[0].runs[0].errors.cutoff
    words = (
        f"RMS of measured minus predicted effort below {cutoff:g} Hz where the joint moves; in "
        "brackets: share of the effort used (RMS, at least a quarter of that in the fitted runs)."
    )
    marked = " * identified from this log: no validation."
    stars = any(FITTED_MARK in cell for row in rows for cell in row.cells[2:])
    note = words + (marked if stars else "")
    if any(run.fitted for model in found.models for run in model.runs):
        words += marked
    headings = ("Joint", "Effort used", *(model.name for model in found.models), "Unit")
    return PlainTable(caption, words, headings, rows, (0, len(headings) - 1), note)


def _cell(joint: JointError) -> str:
    size = significant(joint.error)
    return f"{size} ({_share(joint.percent_of_used)})" if joint.counted else f"{size} (at rest)"


def _size(one: PooledError) -> str:
    return f"{significant(one.error)} ({_share(one.percent_of_used)})"


def _share(value: float) -> str:
    return f"{significant(value, 2)}\u00a0%"


def _with_unit(one: PooledError) -> str:
    return f"{significant(one.error)} {one.unit} ({percent(one.percent_of_used)})"


def _mark(fitted: bool) -> str:
    return FITTED_MARK if fitted else ""


def _errors_figure(found: ModelComparison) -> Figure:
    """Shares of the effort used, all logs together: a row per joint."""
    traces = []
    for k, model in enumerate(found.models):
        known = [(j, one) for j in range(len(found.joints)) if (one := found.joint(model, j))]
        traces.append(
            dots(
                model.name,
                [one.percent_of_used for _, one in known],
                [found.joints[j] for j, _ in known],
                colour(k),
                symbol=symbol(k),
                size=9,
            )
        )
    layout = {
        "showlegend": False,
        "xaxis": {"rangemode": "tozero"},
        "yaxis": {
            "type": "category",
            "categoryorder": "array",
            "categoryarray": list(found.joints)[::-1],
            "dtick": 1,
        },
    }
    label = "Error of every model and joint as a share of the effort used"
    height = row_height(len(found.joints), 30)
    return Figure("", label, "share of the effort used [%]", "", traces, layout, height=height)


MOST_POINTS_OF_MODEL_EFFORT = 1500
"""Most points of a line."""

LEAST_POINTS_OF_MODEL_EFFORT = 200
"""Points of a line below which rather a whole log is left out."""

MOST_POINTS_OF_MODEL_EFFORTS = 170_000
"""Points of all lines together."""

MEASURED_COLOUR = "--ink"


class ModelEffortsSection(FigureSection):
    """A picture per joint, the logs one after the other."""

    name: ClassVar[str] = "model-efforts"
    title: ClassVar[str] = "Efforts over time"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Efforts, if models were compared."""
        found = content.models
        if found is None:
            return None
        of_run = len(found.joints) * (len(found.models) + 1)
        runs = found.runs[
            : max(MOST_POINTS_OF_MODEL_EFFORTS // (of_run * LEAST_POINTS_OF_MODEL_EFFORT), 1)
        ]
        most = max(
            min(MOST_POINTS_OF_MODEL_EFFORT, MOST_POINTS_OF_MODEL_EFFORTS // (of_run * len(runs))),
            LEAST_POINTS_OF_MODEL_EFFORT,
        )
        left_out = found.runs[len(runs) :]
        cutoff = found.models[0].runs[0].errors.cutoff
        return {
            "words": f"Measured and predicted below {cutoff:g} Hz.",
            "groups": [
                Group([_efforts_figure(found, k, j, most) for j in range(len(found.joints))], name)
                for k, name in enumerate(runs)
            ],
            "legend": [
                Key(MEASURED_COLOUR, "measured"),
                *legend([model.name for model in found.models], "line"),
            ],
            "note": f"Not drawn: {', '.join(left_out)}." if left_out else "",
        }


def _efforts_figure(found: ModelComparison, run: int, joint: int, most: int) -> Figure:
    """Efforts of one joint in one log."""
    first = found.models[0].runs[run]
    origin = float(first.t[0]) if len(first.t) and abs(first.t[-1]) > 1e5 else 0.0
    own = first.errors.joints[joint]
    x, y = drawn(first.t - origin, first.measured[:, joint], most)
    traces = [line("measured", x, y, MEASURED_COLOUR, width=1.6)]
    shares = []
    for k, model in enumerate(found.models):
        errors = model.runs[run]
        x, y = drawn(errors.t - origin, errors.predicted[:, joint], most)
        traces.append(line(model.name, x, y, colour(k), width=1.2, dash=dash(k)))
        shares.append(f"{model.name} {percent(errors.errors.joints[joint].percent_of_used)}")
    label = f"Measured and predicted effort of {own.joint} in {first.run}"
    time = f"time from {origin:.3f} s [s]" if origin else "time [s]"
    y_title = f"effort [{own.unit}]"
    layout = {"showlegend": False}
    return Figure(own.joint, label, time, y_title, traces, layout, ", ".join(shares))
