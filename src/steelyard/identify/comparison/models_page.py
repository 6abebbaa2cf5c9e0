"""The page of `steelyard compare-models`: errors, efforts, parameters and link masses of models."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Z95
from steelyard.estimate.friction.friction_mixes_and_curves import mix_name
from steelyard.estimate.scores.effort_errors import EffortError
from steelyard.estimate.scores.model_comparison import (
    ComparedModel,
    ModelComparison,
    ParameterValue,
)
from steelyard.identify.page import gains_offsets_search_and_settings as sections
from steelyard.identify.page.efforts_their_parts_and_residuals import drawn_efforts
from steelyard.identify.page.link_inertias_and_ellipsoids import (
    IdentifiedLink,
    identified_links,
    link_dict,
)
from steelyard.model.laws.register import description_of
from steelyard.report import page_figures as plots
from steelyard.report.page import FigureSection, Numbers, PageContent, Section, TableSection
from steelyard.report.tables import PlainTable, Row, narrow_table, table_of
from steelyard.report.words import NONE, count, fixed, percent, significant, with_interval

MODEL_COLOURS = ("--vermillion", "--blue", "--green", "--purple", "--amber", "--arm")
MODEL_SYMBOLS = ("diamond", "circle", "square", "x", "triangle-up", "cross")
MODEL_DASHES = ("solid", "dash", "dot", "dashdot")  # of lines, changed when the colours begin again


def colour(number: int) -> str:
    """Name in the style sheet of a model's colour."""
    return MODEL_COLOURS[number % len(MODEL_COLOURS)]


def legend(found: ModelComparison, shape: Literal["line", "point"]) -> list[plots.Key]:
    """Colours of models by name."""
    return [plots.Key(colour(k), model.name, shape) for k, model in enumerate(found.models)]


def model_dots(
    number: int, name: str, known: Mapping[str, float], half_widths: Sequence[float] | None = None
) -> plots.Traced:
    """One mark of a model per named row."""
    symbol = MODEL_SYMBOLS[number % len(MODEL_SYMBOLS)]
    values, rows = list(known.values()), list(known)
    return plots.dots(
        name, values, rows, colour(number), symbol=symbol, size=9, half_widths=half_widths
    )


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
            "groups": [plots.Group([_errors_figure(found)], columns="one")],
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
        every = ((x, percent(x.percent_of_used)) for x in found.all_joints(model))
        errors = (f"{significant(x.error)} {x.unit} ({share})" for x, share in every)
        each.append(f"{model.name} {' and '.join(errors)}")
    return f"RMS error of all joints: {', '.join(each)}"


def error_tables(found: ModelComparison) -> list[PlainTable]:
    """All logs together, then one by one if there are several."""
    each = []
    for k, run in enumerate(found.runs):
        errors = zip(*(model.runs[k].errors.joints for model in found.models), strict=True)
        rows = [_row(found, joints[0].joint, joints, (k,)) for joints in errors]
        each.append(_table(found, run, rows))
    if len(each) == 1:
        return each
    return [_of_all(found), *(replace(one, words="") for one in each)]


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


def _errors_figure(found: ModelComparison) -> plots.Figure:
    """Shares of the effort used, all logs together: a row per joint."""
    traces = []
    for k, model in enumerate(found.models):
        joints = zip(found.joints, found.each_joint(model), strict=True)
        known = {name: one.percent_of_used for name, one in joints if one}
        traces.append(model_dots(k, model.name, known))
    label = "Error of every model and joint as a share of the effort used"
    x = "share of the effort used [%]"
    return plots.figure_of_rows(label, x, found.joints, traces, 30, xaxis={"rangemode": "tozero"})


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
                plots.Group(
                    [_efforts_figure(found, k, j, most) for j in range(len(found.joints))], name
                )
                for k, name in enumerate(found.runs[:count])
            ],
            "legend": [plots.Key(MEASURED_COLOUR, "measured"), *legend(found, "line")],
            "note": f"Not drawn: {', '.join(left_out)}." if left_out else "",
        }


def _efforts_figure(found: ModelComparison, run: int, joint: int, most: int) -> plots.Figure:
    first = found.models[0].runs[run]
    t, time = plots.from_origin(first.t)
    own = first.errors.joints[joint]
    x, y = plots.drawn(t, first.measured[:, joint], most)
    traces = [plots.line("measured", x, y, MEASURED_COLOUR, width=1.6)]
    shares = []
    for k, model in enumerate(found.models):
        errors = model.runs[run]
        x, y = plots.drawn(t, errors.predicted[:, joint], most)
        dash = MODEL_DASHES[k // len(MODEL_COLOURS) % len(MODEL_DASHES)]
        traces.append(plots.line(model.name, x, y, colour(k), width=1.2, dash=dash))
        shares.append(f"{model.name} {percent(errors.errors.joints[joint].percent_of_used)}")
    label = f"Measured and predicted effort of {own.joint} in {first.run}"
    y_title = f"effort [{own.unit}]"
    return plots.Figure(
        own.joint, label, time, y_title, traces, {"showlegend": False}, ", ".join(shares)
    )


MODEL_PARAMETERS_WORDS = (
    "Base parameters of all models with 95 % intervals. A value is given where the model's own "
    "base parameters determine it; what a model does not have is zero in it."
)
STATUS_CELLS = {
    "removed": "0, removed",
    "not identifiable": "not identifiable",
    "no such parameter": NONE,
}


class ModelsSection(TableSection, name="models", title="Models"):
    """One row per model: how it was identified."""

    def tables(self, content: ModelsContent) -> Sequence[PlainTable]:
        """The table."""
        columns: dict[str, Callable[[ComparedModel], str]] = {
            "Model": lambda x: x.name,
            "Estimator": lambda x: x.identified.estimate.estimator,
            "Base parameters": lambda x: str(len(x.identified.estimate.parameters)),
            "Removed": lambda x: str(len(x.identified.estimate.removed)),
            "Link inertias": _bodies,
            "Condition": lambda x: significant(x.identified.estimate.condition_normalised),
            "Terms beside the links": lambda x: mix_name(
                [term for term in x.identified.model.terms if term.role != "body"]
            ),
            "Identified from": lambda x: ", ".join(x.identified.provenance.runs),
        }
        return (table_of(content.models.models, columns, text=(0, 1, 4, 6, 7)),)

    def to_dict(self, content: ModelsContent) -> dict[str, Any]:
        """The models."""
        return {"models": [_model_dict(model) for model in content.models.models]}

    def printed(self, content: ModelsContent) -> Iterable[RenderableType]:
        """A line per model."""
        lines = []
        for model in content.models.models:
            estimate, words = model.identified.estimate, f", link inertias {_bodies(model)}"
            size = count(len(estimate.parameters), "base parameter")
            size += f" ({len(estimate.removed)} removed)" if estimate.removed else ""
            lines.append(f"{model.name}: {estimate.estimator}, {size}{words}")
        yield Text("\n".join(lines))


class ModelParametersSection(TableSection, name="model-parameters", title="Parameters"):
    """One row per base parameter, one column per model."""

    def tables(self, content: ModelsContent) -> Sequence[PlainTable]:
        """The table."""
        found = content.models
        headings = ("Parameter", *(model.name for model in found.models), "Unit")
        rows = [Row((x.name, *map(_value, x.values), x.unit)) for x in found.parameters]
        return (PlainTable("", MODEL_PARAMETERS_WORDS, headings, rows, (0, len(headings) - 1)),)

    def detailed(self, content: ModelsContent) -> Iterable[RenderableType]:
        """The table."""
        yield from (narrow_table(table) for table in self.tables(content))

    def to_dict(self, content: ModelsContent) -> dict[str, Any]:
        """One row per base parameter and model."""
        found = content.models
        return {
            "parameters": [
                {
                    "parameter": one.name,
                    "group": one.group,
                    "unit": one.unit,
                    "model": model.name,
                    "value": value.value,
                    "std": value.std,
                    "status": value.status,
                }
                for one in found.parameters
                for model, value in zip(found.models, one.values, strict=True)
            ]
        }


def _bodies(model: ComparedModel) -> str:
    if model.identified.estimate.standard is None:
        return "not estimated"
    invalid = [link.name for link in identified_links(model.identified) if link.margin <= 0.0]
    return f"{', '.join(invalid)} invalid" if invalid else "all valid"


def _model_dict(model: ComparedModel) -> dict[str, Any]:
    identified, estimate, bodies = model.identified, model.identified.estimate, _bodies(model)
    return {
        "model": model.name,
        "estimator": estimate.estimator,
        "terms": [description_of(term) for term in identified.model.terms],
        "parameters": len(estimate.parameters),
        "removed": [removed.name for removed in estimate.removed],
        "bodies_valid": None if estimate.standard is None else bodies == "all valid",
        "condition_normalised": estimate.condition_normalised,
        "runs": list(identified.provenance.runs),
    }


def _value(one: ParameterValue) -> str:
    if one.value is None or one.status == "removed":
        return STATUS_CELLS[one.status]
    if one.std is None:
        return f"{significant(one.value)} (bound)"
    return with_interval(one.value, Z95 * one.std)


MODEL_MASSES_WORDS = (
    "Masses and centres of mass with 95 % intervals, of the models that estimate all link inertias."
)

Links = dict[str, dict[str, IdentifiedLink]]  # links by name, by the name of their model


class ModelMassesSection(FigureSection, name="model-masses", title="Masses and centres"):
    """A picture of the masses, tables of masses and centres."""

    def numbers(self, content: ModelsContent) -> Numbers | None:
        """Masses and centres, if a model knows them."""
        found = content.models
        links = _links(found)
        if not links:
            return None
        names = list(dict.fromkeys(name for own in links.values() for name in own))
        headings = ("Link", *links)
        every = [(name, [own.get(name) for own in links.values()]) for name in names]
        masses, centres = ([Row((n, *map(of, x))) for n, x in every] for of in (_mass, _centre))
        caption = "Centre of mass in the link's frame: x, y, z [mm]"
        traces = [
            model_dots(
                k,
                model.name,
                {name: link.inertia.mass for name, link in own.items()},
                [link.mass_half_width for link in own.values()],
            )
            for k, model in enumerate(found.models)
            if (own := links.get(model.name))
        ]
        label, axis = "Masses of all links in every model", {"rangemode": "tozero"}
        figure = plots.figure_of_rows(label, "mass [kg]", names, traces, 34, xaxis=axis)
        return {
            "words": MODEL_MASSES_WORDS,
            "tables": [
                PlainTable("Mass [kg]", "", headings, masses),
                PlainTable(caption, "", headings, centres, range(len(headings))),
            ],
            "legend": [key for key in legend(found, "point") if key.words in links],
            "groups": [plots.Group([figure], columns="one")],
        }

    def to_dict(self, content: ModelsContent) -> dict[str, Any]:
        """One row per link and model."""
        of_one_model = ("mass_file", "centre_file", "data_share")
        links = ((model, x) for model, own in _links(content.models).items() for x in own.values())
        rows = [{"model": model, **link_dict(link)} for model, link in links]
        return {"bodies": [{k: x for k, x in row.items() if k not in of_one_model} for row in rows]}


def _links(found: ModelComparison) -> Links:
    each = ((x.name, {y.name: y for y in identified_links(x.identified)}) for x in found.models)
    return {name: links for name, links in each if links}


def _mass(link: IdentifiedLink | None) -> str:
    return NONE if link is None else with_interval(link.inertia.mass, link.mass_half_width)


def _centre(link: IdentifiedLink | None) -> str:
    if link is None or not link.inertia.mass:
        return NONE
    pairs = zip(1e3 * link.inertia.com, 1e3 * Z95 * link.com_std, strict=True)
    return ", ".join(f"{fixed(x, 1)} ± {fixed(half, 1)}" for x, half in pairs)


COMPARE_MODELS_SECTIONS: tuple[Section, ...] = (
    ModelErrorsSection(),
    ModelsSection(),
    ModelEffortsSection(),
    ModelParametersSection(),
    ModelMassesSection(),
    sections.QualitySection(),
    sections.SettingsSection(),
)
