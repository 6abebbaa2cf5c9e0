"""Masses and centres of mass of the links in several models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.estimation.estimate import Z95
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, dots, row_height
from steelyard.report.html import rounded
from steelyard.report.sections.model.bodies import Solid, solids
from steelyard.report.sections.models.colours import colour, legend, symbol
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import NONE, alike, fixed, significant

if TYPE_CHECKING:
    from steelyard.validation.model_comparison import ModelComparison

WORDS = (
    "Masses and centres of mass with 95 % intervals, of the models that estimate all link inertias."
)

Links = dict[str, dict[str, Solid]]
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
            "words": WORDS,
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
    own = {model.name: {x.name: x for x in solids(model.identified)} for model in found.models}
    return {name: links for name, links in own.items() if links}


def _names(links: Links) -> list[str]:
    """Names of all links, in the order of the models."""
    return list(dict.fromkeys(name for own in links.values() for name in own))


def _half(link: Solid) -> float:
    return float(Z95 * np.sqrt(np.maximum(link.covariance[0, 0], 0.0)))


def _masses(links: Links, names: list[str]) -> PlainTable:
    rows = [Row((name, *(_mass(own.get(name)) for own in links.values()))) for name in names]
    return PlainTable("Mass [kg]", "", ("Link", *links), rows)


def _mass(link: Solid | None) -> str:
    if link is None:
        return NONE
    return f"{alike(link.inertia.mass, _half(link))} ± {significant(_half(link), 2)}"


def _centres(links: Links, names: list[str]) -> PlainTable:
    rows = [Row((name, *(_centre(own.get(name)) for own in links.values()))) for name in names]
    caption = "Centre of mass in the link's frame: x, y, z [mm]"
    return PlainTable(caption, "", ("Link", *links), rows, range(len(links) + 1))


def _centre(link: Solid | None) -> str:
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


def _row(model: str, link: Solid) -> dict[str, Any]:
    return {
        "model": model,
        "link": link.name,
        "mass": rounded(link.inertia.mass),
        "mass_half_width": rounded(_half(link)),
        "centre": [rounded(x) for x in link.inertia.com],
        "centre_half_width": [rounded(Z95 * x) for x in link.com_std],
        "margin": float(significant(link.margin, 4)),
    }
