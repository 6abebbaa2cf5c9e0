"""The page of `steelyard compare-models`, with parameters and link masses of the models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.estimate.estimate import Z95
from steelyard.estimate.friction.mixes import mix_name
from steelyard.identify.comparison.model_errors import (
    ModelEffortsSection,
    ModelErrorsSection,
    colour,
    legend,
    symbol,
)
from steelyard.identify.page.content import ReportContent
from steelyard.identify.page.link_inertias import IdentifiedLink, identified_links
from steelyard.identify.page.logs_and_settings import QualitySection, SettingsSection
from steelyard.model.laws.register import description_of
from steelyard.report.figures import Figure, Group, dots, row_height
from steelyard.report.page import (
    FigureSection,
    Numbers,
    Section,
    TableSection,
    page_of,
    rounded,
    shown_sections,
)
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, count, fixed, rounded_to_uncertainty, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.estimate.scores.model_comparison import (
        CommonParameter,
        ComparedModel,
        ModelComparison,
        ParameterValue,
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


class ModelsSection(TableSection):
    """One row per model: how it was identified."""

    name: ClassVar[str] = "models"
    title: ClassVar[str] = "Models"

    def tables(self, content: ReportContent) -> Sequence[PlainTable]:
        """The table, if models were compared."""
        if content.models is None:
            return ()
        headings = (
            "Model",
            "Estimator",
            "Base parameters",
            "Removed",
            "Link inertias",
            "Condition",
            "Terms beside the links",
            "Identified from",
        )
        rows = [Row(_cells(model)) for model in content.models.models]
        return (PlainTable("", "", headings, rows, (0, 1, 4, 6, 7)),)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The models."""
        if content.models is None:
            return {}
        return {"models": [_model_dict(model) for model in content.models.models]}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """A line per model."""
        from rich.text import Text

        if content.models is not None:
            yield Text("\n".join(_words(model) for model in content.models.models))


class ModelParametersSection(TableSection):
    """One row per base parameter, one column per model."""

    name: ClassVar[str] = "model-parameters"
    title: ClassVar[str] = "Parameters"

    def tables(self, content: ReportContent) -> Sequence[PlainTable]:
        """The table, if models were compared."""
        found = content.models
        if found is None:
            return ()
        headings = ("Parameter", *(model.name for model in found.models), "Unit")
        rows = [
            Row((one.name, *(_value(value) for value in one.values), one.unit))
            for one in found.parameters
        ]
        return (PlainTable("", MODEL_PARAMETERS_WORDS, headings, rows, (0, len(headings) - 1)),)

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The table."""
        yield from (narrow_table(table) for table in self.tables(content))

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """One row per base parameter and model."""
        found = content.models
        if found is None:
            return {}
        return {"parameters": [x for one in found.parameters for x in _parameter_rows(one, found)]}


def _cells(model: ComparedModel) -> tuple[str, ...]:
    estimate = model.identified.estimate
    return (
        model.name,
        estimate.estimator,
        str(len(estimate.parameters)),
        str(len(estimate.removed)),
        _bodies(model),
        significant(estimate.condition_normalised),
        mix_name([term for term in model.identified.model.terms if term.role != "body"]),
        ", ".join(model.identified.provenance.runs),
    )


def _words(model: ComparedModel) -> str:
    """A model in a line of the terminal."""
    estimate = model.identified.estimate
    removed = f" ({len(estimate.removed)} removed)" if estimate.removed else ""
    return (
        f"{model.name}: {estimate.estimator}, {count(len(estimate.parameters), 'base parameter')}"
        f"{removed}, link inertias {_bodies(model)}"
    )


def _bodies(model: ComparedModel) -> str:
    """Whether the links are physically consistent."""
    if model.identified.estimate.standard is None:
        return "not estimated"
    invalid = [link.name for link in identified_links(model.identified) if link.margin <= 0.0]
    return f"{', '.join(invalid)} invalid" if invalid else "all valid"


def _model_dict(model: ComparedModel) -> dict[str, Any]:
    identified = model.identified
    estimate = identified.estimate
    standard = estimate.standard is not None
    return {
        "model": model.name,
        "estimator": estimate.estimator,
        "terms": [description_of(term) for term in identified.model.terms],
        "parameters": len(estimate.parameters),
        "removed": [removed.name for removed in estimate.removed],
        "bodies_valid": all(x.margin > 0.0 for x in identified_links(identified))
        if standard
        else None,
        "condition_normalised": estimate.condition_normalised,
        "runs": list(identified.provenance.runs),
    }


def _value(one: ParameterValue) -> str:
    if one.value is None or one.status == "removed":
        return STATUS_CELLS[one.status]
    if one.std is None:
        return f"{significant(one.value)} (bound)"
    half = Z95 * one.std
    return f"{rounded_to_uncertainty(one.value, half)} ± {significant(half, 2)}"


def _parameter_rows(one: CommonParameter, found: ModelComparison) -> list[dict[str, Any]]:
    return [
        {
            "parameter": one.name,
            "group": one.group,
            "unit": one.unit,
            "model": model.name,
            "value": value.value,
            "std": value.std,
            "status": value.status,
        }
        for model, value in zip(found.models, one.values, strict=True)
    ]


MODEL_MASSES_WORDS = (
    "Masses and centres of mass with 95 % intervals, of the models that estimate all link inertias."
)

Links = dict[str, dict[str, IdentifiedLink]]
"""Links by name, by the name of their model."""


class ModelMassesSection(FigureSection):
    """A picture of the masses, tables of masses and centres."""

    name: ClassVar[str] = "model-masses"
    title: ClassVar[str] = "Masses and centres"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Masses and centres, if a model knows them."""
        found = content.models
        links = {} if found is None else _links(found)
        if found is None or not links:
            return None
        names = _names(links)
        keys = legend([model.name for model in found.models], "point")
        return {
            "words": MODEL_MASSES_WORDS,
            "tables": [_masses(links, names), _centres(links, names)],
            "legend": [key for key in keys if key.words in links],
            "groups": [Group([_figure(found, links, names)], columns="one")],
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """One row per link and model."""
        if content.models is None:
            return {}
        links = _links(content.models)
        rows = [_row(model, link) for model, own in links.items() for link in own.values()]
        return {"bodies": rows}


def _links(found: ModelComparison) -> Links:
    own = {
        model.name: {x.name: x for x in identified_links(model.identified)}
        for model in found.models
    }
    return {name: links for name, links in own.items() if links}


def _names(links: Links) -> list[str]:
    """Names of all links, in the order of the models."""
    return list(dict.fromkeys(name for own in links.values() for name in own))


def _half(link: IdentifiedLink) -> float:
    return float(Z95 * np.sqrt(np.maximum(link.covariance[0, 0], 0.0)))


def _masses(links: Links, names: list[str]) -> PlainTable:
    rows = [Row((name, *(_mass(own.get(name)) for own in links.values()))) for name in names]
    return PlainTable("Mass [kg]", "", ("Link", *links), rows)


def _mass(link: IdentifiedLink | None) -> str:
    if link is None:
        return NONE
    return (
        f"{rounded_to_uncertainty(link.inertia.mass, _half(link))} ± {significant(_half(link), 2)}"
    )


def _centres(links: Links, names: list[str]) -> PlainTable:
    rows = [Row((name, *(_centre(own.get(name)) for own in links.values()))) for name in names]
    caption = "Centre of mass in the link's frame: x, y, z [mm]"
    return PlainTable(caption, "", ("Link", *links), rows, range(len(links) + 1))


def _centre(link: IdentifiedLink | None) -> str:
    if link is None or not link.inertia.mass:
        return NONE
    pairs = zip(1e3 * link.inertia.com, 1e3 * Z95 * link.com_std, strict=True)
    return ", ".join(f"{fixed(x, 1)} ± {fixed(half, 1)}" for x, half in pairs)


def _figure(found: ModelComparison, links: Links, names: list[str]) -> Figure:
    traces = [
        dots(
            model.name,
            [link.inertia.mass for link in own.values()],
            list(own),
            colour(k),
            symbol=symbol(k),
            size=9,
            half_widths=[_half(link) for link in own.values()],
        )
        for k, model in enumerate(found.models)
        if (own := links.get(model.name))
    ]
    layout = {
        "showlegend": False,
        "xaxis": {"rangemode": "tozero"},
        "yaxis": {
            "type": "category",
            "categoryorder": "array",
            "categoryarray": names[::-1],
            "dtick": 1,
        },
    }
    label = "Masses of all links in every model"
    return Figure("", label, "mass [kg]", "", traces, layout, height=row_height(len(names), 34))


def _row(model: str, link: IdentifiedLink) -> dict[str, Any]:
    return {
        "model": model,
        "link": link.name,
        "mass": rounded(link.inertia.mass),
        "mass_half_width": rounded(_half(link)),
        "centre": [rounded(x) for x in link.inertia.com],
        "centre_half_width": [rounded(Z95 * x) for x in link.com_std],
        "margin": float(significant(link.margin, 4)),
    }


COMPARE_MODELS_SECTIONS: tuple[Section, ...] = (
    ModelErrorsSection(),
    ModelsSection(),
    ModelEffortsSection(),
    ModelParametersSection(),
    ModelMassesSection(),
    QualitySection(),
    SettingsSection(),
)


def render_models(content: ReportContent) -> str:
    """The page as HTML text, to be written as UTF-8."""
    shown = shown_sections(COMPARE_MODELS_SECTIONS, content)
    return page_of(content.title, content.robot, "compared", version("steelyard"), shown)
