"""Errors and predicted efforts of several models on the same logs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rich.console import RenderableType
from rich.text import Text

from steelyard.estimate.scores.effort_errors import EffortError
from steelyard.estimate.scores.model_comparison import ModelComparison
from steelyard.identify.page.efforts_and_their_parts import drawn_efforts
from steelyard.report.page import FigureSection, Numbers, PageContent
from steelyard.report.page_figures import (
    Figure,
    Group,
    Key,
    Traced,
    dots,
    drawn,
    figure_of_rows,
    from_origin,
    line,
)
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, count, percent, significant

MODEL_COLOURS = ("--vermillion", "--blue", "--green", "--purple", "--amber", "--arm")
MODEL_SYMBOLS = ("diamond", "circle", "square", "x", "triangle-up", "cross")
MODEL_DASHES = ("solid", "dash", "dot", "dashdot")  # of lines, changed when the colours begin again


def colour(number: int) -> str:
    """Name in the style sheet of a model's colour."""
    return MODEL_COLOURS[number % len(MODEL_COLOURS)]


def legend(found: ModelComparison, shape: Literal["line", "point"]) -> list[Key]:
    """Colours of models by name."""
    return [Key(colour(k), model.name, shape) for k, model in enumerate(found.models)]


def model_dots(
    number: int, name: str, known: Mapping[str, float], half_widths: Sequence[float] | None = None
) -> Traced:
    """One mark of a model per named row."""
    symbol = MODEL_SYMBOLS[number % len(MODEL_SYMBOLS)]
    values, rows = list(known.values()), list(known)
    return dots(name, values, rows, colour(number), symbol=symbol, size=9, half_widths=half_widths)


FITTED_MARK = "*"  # behind errors on logs that the model was identified from
MOST_TERMINAL_COLUMNS = 6  # columns of a table that the terminal has room for


@dataclass(frozen=True, kw_only=True)
class ModelsContent(PageContent):
    """What the page of `steelyard compare-models` shows: identified models side by side."""

    models: ModelComparison


class ModelErrorsSection(
    FigureSection, name="model-errors", title="Errors of predicted efforts", template="models.html"
):
    """A table per log, one of all logs, and a picture of the shares."""

    def numbers(self, content: ModelsContent) -> Numbers:
        """Tables and the picture."""
        found = content.models
        return {
            "headline": models_headline(found),
            "tables": error_tables(found),
            "groups": [Group([_errors_figure(found)], columns="one")],
            "legend": legend(found, "point"),
        }

    def to_dict(self, content: ModelsContent) -> dict[str, Any]:
        """Errors of every model, log and joint, and those of all joints together."""
        found = content.models
        return {
            "errors": [
                {"run": run.run, "model": model.name, "fitted": run.fitted, "mae": mae}
                | _rmse_dict(joint)
                for model in found.models
                for run in model.runs
                for joint, mae in zip(run.errors.joints, run.mae.tolist(), strict=True)
            ],
            "all_joints": [
                {"model": model.name} | _rmse_dict(one)
                for model in found.models
                for one in found.all_joints(model)
            ],
            "pooled_runs": [found.runs[k] for k in found.pooled_runs],
        }

    def printed(self, content: ModelsContent) -> Iterable[RenderableType]:
        """The headline and the errors in all logs together."""
        yield Text(models_headline(content.models), style="bold")
        first, *_ = error_tables(content.models)
        yield from _printed([first])
        yield Text(first.note)

    def detailed(self, content: ModelsContent) -> Iterable[RenderableType]:
        """The errors in every log, if there are several."""
        return _printed(error_tables(content.models)[1:])


def _rmse_dict(one: EffortError) -> dict[str, Any]:
    return {("rmse" if key == "error" else key): x for key, x in one.to_dict().items()}


def _printed(given: Sequence[PlainTable]) -> Iterable[RenderableType]:
    """Tables for the terminal, under their captions; wide ones without the effort used."""
    for table in given:
        yield Text(table.caption)
        columns = range(len(table.headings))
        yield narrow_table(
            table, columns if len(columns) <= MOST_TERMINAL_COLUMNS else [0, *columns[2:]]
        )


def models_headline(found: ModelComparison) -> str:
    """The errors of all joints together, one model after the other."""
    each = []
    for model in found.models:
        errors = (
            f"{significant(one.error)} {one.unit} ({percent(one.percent_of_used)})"
            for one in found.all_joints(model)
        )
        each.append(f"{model.name} {' and '.join(errors)}")
    return f"RMS error of all joints: {', '.join(each)}"


def error_tables(found: ModelComparison) -> list[PlainTable]:
    """All logs together, then one by one if there are several."""
    if len(found.runs) == 1:
        return [_of_run(found, 0)]
    each = [replace(_of_run(found, k), words="") for k in range(len(found.runs))]
    return [_of_all(found), *each]


def _of_run(found: ModelComparison, k: int) -> PlainTable:
    """One log: a row per joint."""
    errors = zip(*(model.runs[k].errors.joints for model in found.models), strict=True)
    rows = [_row(found, joints[0].joint, joints, (k,)) for joints in errors]
    return _table(found, found.runs[k], rows)


def _of_all(found: ModelComparison) -> PlainTable:
    """All pooled logs: a row per joint, and one of all joints per unit of effort."""
    logs = found.pooled_runs
    each = zip(*map(found.each_joint, found.models), strict=True)
    every = zip(*map(found.all_joints, found.models), strict=True)
    rows = [
        _row(found, name, joints, logs) for name, joints in zip(found.joints, each, strict=True)
    ]
    rows += [_row(found, "all joints", errors, logs, total=True) for errors in every]
    unseen = f"{count(len(logs), 'log')} that no model was identified from"
    total = len(found.runs)
    return _table(found, f"All {total} logs" if len(logs) == total else unseen.capitalize(), rows)


def _row(
    found: ModelComparison,
    name: str,
    errors: Sequence[EffortError | None],
    logs: Sequence[int],
    *,
    total: bool = False,
) -> Row:
    """The error of every model, marked where one of the logs was fitted, with what was used."""
    cells = [
        _size(one) + FITTED_MARK * any(model.runs[k].fitted for k in logs)
        for model, one in zip(found.models, errors, strict=True)
    ]
    first, joints = errors[0], found.models[0].runs[0].errors.joints
    unit = joints[found.joints.index(name)].unit if first is None else first.unit
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


def _size(one: EffortError | None) -> str:
    """An error with its share of the effort used; that of a joint at rest has none."""
    if one is None:
        return NONE
    share = f"{significant(one.percent_of_used, 2)}\u00a0%" if one.counted else "at rest"
    return f"{significant(one.error)} ({share})"


def _errors_figure(found: ModelComparison) -> Figure:
    """Shares of the effort used, all logs together: a row per joint."""
    traces = []
    for k, model in enumerate(found.models):
        joints = zip(found.joints, found.each_joint(model), strict=True)
        known = {name: one.percent_of_used for name, one in joints if one}
        traces.append(model_dots(k, model.name, known))
    label = "Error of every model and joint as a share of the effort used"
    x = "share of the effort used [%]"
    return figure_of_rows(label, x, found.joints, traces, 30, xaxis={"rangemode": "tozero"})


MEASURED_COLOUR = "--ink"


class ModelEffortsSection(FigureSection, name="model-efforts", title="Efforts over time"):
    """A picture per joint, the logs one after the other."""

    def numbers(self, content: ModelsContent) -> Numbers:
        """Efforts."""
        found = content.models
        count, most = drawn_efforts(len(found.joints) * (len(found.models) + 1), len(found.runs))
        left_out = found.runs[count:]
        cutoff = found.models[0].runs[0].errors.cutoff
        return {
            "words": f"Measured and predicted below {cutoff:g} Hz.",
            "groups": [
                Group([_efforts_figure(found, k, j, most) for j in range(len(found.joints))], name)
                for k, name in enumerate(found.runs[:count])
            ],
            "legend": [Key(MEASURED_COLOUR, "measured"), *legend(found, "line")],
            "note": f"Not drawn: {', '.join(left_out)}." if left_out else "",
        }


def _efforts_figure(found: ModelComparison, run: int, joint: int, most: int) -> Figure:
    """Efforts of one joint in one log."""
    first = found.models[0].runs[run]
    t, time = from_origin(first.t)
    own = first.errors.joints[joint]
    x, y = drawn(t, first.measured[:, joint], most)
    traces = [line("measured", x, y, MEASURED_COLOUR, width=1.6)]
    shares = []
    for k, model in enumerate(found.models):
        errors = model.runs[run]
        x, y = drawn(t, errors.predicted[:, joint], most)
        dash = MODEL_DASHES[k // len(MODEL_COLOURS) % len(MODEL_DASHES)]
        traces.append(line(model.name, x, y, colour(k), width=1.2, dash=dash))
        shares.append(f"{model.name} {percent(errors.errors.joints[joint].percent_of_used)}")
    label = f"Measured and predicted effort of {own.joint} in {first.run}"
    y_title = f"effort [{own.unit}]"
    return Figure(own.joint, label, time, y_title, traces, {"showlegend": False}, ", ".join(shares))
