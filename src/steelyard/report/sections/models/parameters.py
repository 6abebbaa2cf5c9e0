"""Base parameters of several models in a common set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.estimation.estimate import Z95
from steelyard.report.content import ReportContent
from steelyard.report.sections.model.bodies import solids
from steelyard.report.sections.section import TableSection
from steelyard.report.sections.tables import PlainTable, Row, narrow_table
from steelyard.report.text.words import NONE, alike, count, significant
from steelyard.terms.register import description_of
from steelyard.validation.friction.mixes import mix_name

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.validation.model_comparison import (
        CommonParameter,
        ComparedModel,
        ModelComparison,
        ParameterValue,
    )

WORDS = (
    "Base parameters of all models with 95 % intervals. A value is given where the model's own "
    "base parameters determine it; what a model does not have is zero in it."
)
SHORT = {
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
        return (PlainTable("", WORDS, headings, rows, (0, len(headings) - 1)),)

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
    invalid = [link.name for link in solids(model.identified) if link.margin <= 0.0]
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
        "bodies_valid": all(x.margin > 0.0 for x in solids(identified)) if standard else None,
        "condition_normalised": estimate.condition_normalised,
        "runs": list(identified.provenance.runs),
    }


def _value(one: ParameterValue) -> str:
    if one.value is None or one.status == "removed":
        return SHORT[one.status]
    if one.std is None:
        return f"{significant(one.value)} (bound)"
    half = Z95 * one.std
    return f"{alike(one.value, half)} ± {significant(half, 2)}"


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
