"""The page of `steelyard compare-models`, with parameters and link masses of the models."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from steelyard.base.arrays import Z95
from steelyard.estimate.friction.friction_mixes_and_curves import mix_name
from steelyard.estimate.scores.model_comparison import (
    ComparedModel,
    ModelComparison,
    ParameterValue,
)
from steelyard.identify.comparison.model_errors_and_efforts_sections import (
    ModelEffortsSection,
    ModelErrorsSection,
    ModelsContent,
    legend,
    model_dots,
)
from steelyard.identify.page.link_inertias_and_ellipsoids import (
    IdentifiedLink,
    identified_links,
    link_dict,
)
from steelyard.identify.page.settings_quality_and_checks import QualitySection, SettingsSection
from steelyard.model.laws.register import description_of
from steelyard.report.page import FigureSection, Numbers, Section, TableSection
from steelyard.report.page_figures import Group, figure_of_rows
from steelyard.report.tables import PlainTable, Row, narrow_table, table_of
from steelyard.report.words import NONE, count, fixed, significant, with_interval

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
        rows = [
            Row((one.name, *(_value(value) for value in one.values), one.unit))
            for one in found.parameters
        ]
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


def _invalid(model: ComparedModel) -> list[str] | None:
    """Links that are not physically consistent; `None` if the links are not estimated."""
    if model.identified.estimate.standard is None:
        return None
    return [link.name for link in identified_links(model.identified) if link.margin <= 0.0]


def _bodies(model: ComparedModel) -> str:
    invalid = _invalid(model)
    if invalid is None:
        return "not estimated"
    return f"{', '.join(invalid)} invalid" if invalid else "all valid"


def _model_dict(model: ComparedModel) -> dict[str, Any]:
    identified, estimate, invalid = model.identified, model.identified.estimate, _invalid(model)
    return {
        "model": model.name,
        "estimator": estimate.estimator,
        "terms": [description_of(term) for term in identified.model.terms],
        "parameters": len(estimate.parameters),
        "removed": [removed.name for removed in estimate.removed],
        "bodies_valid": None if invalid is None else not invalid,
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
        masses, centres = (
            [Row((name, *(of(own.get(name)) for own in links.values()))) for name in names]
            for of in (_mass, _centre)
        )
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
        figure = figure_of_rows(label, "mass [kg]", names, traces, 34, xaxis=axis)
        return {
            "words": MODEL_MASSES_WORDS,
            "tables": [
                PlainTable("Mass [kg]", "", headings, masses),
                PlainTable(caption, "", headings, centres, range(len(headings))),
            ],
            "legend": [key for key in legend(found, "point") if key.words in links],
            "groups": [Group([figure], columns="one")],
        }

    def to_dict(self, content: ModelsContent) -> dict[str, Any]:
        """One row per link and model."""
        of_one_model = ("mass_file", "centre_file", "data_share")
        return {
            "bodies": [
                {"model": model}
                | {key: x for key, x in link_dict(link).items() if key not in of_one_model}
                for model, own in _links(content.models).items()
                for link in own.values()
            ]
        }


def _links(found: ModelComparison) -> Links:
    own = {
        model.name: {x.name: x for x in identified_links(model.identified)}
        for model in found.models
    }
    return {name: links for name, links in own.items() if links}


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
    QualitySection(),
    SettingsSection(),
)
