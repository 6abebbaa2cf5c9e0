"""Masses and centres of mass of the links: in the model file, and identified."""

from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Z95
from steelyard.parameters import Parameters
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, Traced, dots, row_height
from steelyard.report.html import rounded
from steelyard.report.sections.model.bodies import Solid, solids
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.text.words import significant
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia

AXES = ("x", "y", "z")

PRIOR = {"text": "prior [%]", "standoff": 6}

WORDS = (
    "Mass of each link in the model file and as identified from data and prior, and the shift of "
    "its centre of mass against the file, in the link's frame. Only sums of these numbers affect "
    "the torque, so the prior determines how they are divided among links: an estimate with a "
    "large share of the prior is near the file because it started there, not because the data "
    "confirm it."
)


class MassesSection(FigureSection):
    """One figure of the masses, three of the centres."""

    name: ClassVar[str] = "masses"
    title: ClassVar[str] = "Masses and centres, before and after"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Masses and centres, if the estimate knows all standard parameters."""
        links = _links(content)
        if not links:
            return None
        true = _true(links, content.truth)
        groups = [Group([_masses(links, true)], columns="one")]
        known = [link for link in links if link.nominal is not None and link.inertia.mass]
        if known:
            figures = [_shifts(known, axis, true) for axis in range(3)]
            groups.append(Group(figures, columns="three"))
        return {
            "words": WORDS,
            "legend": [
                Key("--measured", "model file", "point"),
                Key("--predicted", "identified, with 95 % interval", "point"),
                *([Key("--green", "truth (simulated robot)", "point")] if true else []),
                Key("--arm", "share of the prior in the estimate", "area"),
            ],
            "groups": groups,
            "note": "Share of the prior: mean over the ten inertial parameters of a link.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Masses and centres."""
        return {"bodies": [_link_dict(link) for link in _links(content)] or None}


def _links(content: ReportContent) -> list[Solid]:
    return [] if content.identified is None else list(solids(content.identified))


def _true(links: list[Solid], truth: Parameters | None) -> dict[str, Inertia]:
    """True mass properties by link, of a simulated robot."""
    if truth is None:
        return {}
    known = truth.as_dict()
    return {
        link.name: Inertia.from_ten([known[f"{kind}.{link.name}"] for kind in INERTIAL_NAMES])
        for link in links
    }


def _truth(true: dict[str, Inertia], x: list[float]) -> list[Traced]:
    """Crosses, if the truth is known."""
    return [dots("truth", x, list(true), "--green", symbol="x", size=6)] if true else []


def _half_mass(link: Solid) -> float:
    return float(Z95 * np.sqrt(np.maximum(link.covariance[0, 0], 0.0)))


def _categories(links: list[Solid]) -> dict[str, Any]:
    """The first link stands above."""
    names = [link.name for link in links]
    return {"type": "category", "categoryorder": "array", "categoryarray": names[::-1], "dtick": 1}


def _masses(links: list[Solid], true: dict[str, Inertia]) -> Figure:
    names = [link.name for link in links]
    known = [link for link in links if link.nominal is not None]
    prior = [100.0 * (1.0 - link.learned) for link in links]
    bars: Traced = {
        "name": "prior",
        "kind": "points",
        "x": [rounded(share) for share in prior],
        "y": names,
        "more": {
            "type": "bar",
            "orientation": "h",
            "xaxis": "x2",
            "marker": {"color": "--arm"},
            "hovertemplate": "%{y}: %{x:.0f} % from the prior<extra></extra>",
        },
    }
    traces = [
        _file([link.nominal.mass for link in known if link.nominal], [one.name for one in known]),
        dots(
            "identified",
            [link.inertia.mass for link in links],
            names,
            "--predicted",
            symbol="diamond",
            size=9,
            half_widths=[_half_mass(link) for link in links],
        ),
        *_truth(true, [body.mass for body in true.values()]),
        bars,
    ]
    layout = {
        "showlegend": False,
        "xaxis": {"domain": [0.0, 0.68], "rangemode": "tozero"},
        "xaxis2": {
            "domain": [0.76, 1.0],
            "range": [0, 100],
            "title": PRIOR,
        },
        "yaxis": _categories(links),
        "bargap": 0.5,
    }
    label = "Masses of all links in the model file and as identified"
    return Figure("", label, "mass [kg]", "", traces, layout, height=row_height(len(links), 34))


def _shifts(links: list[Solid], axis: int, true: dict[str, Inertia]) -> Figure:
    """Identified minus nominal centre along one axis of the link's frame [mm]."""
    names = [link.name for link in links]
    shift = [1e3 * (link.inertia.com - _centre(link))[axis] for link in links]
    half = [1e3 * Z95 * link.com_std[axis] for link in links]
    real = {link.name: true[link.name] for link in links if link.name in true}
    off = [1e3 * (true[x.name].com - _centre(x))[axis] for x in links if x.name in true]
    traces = [
        _file([0.0 for _ in links], names),
        dots(
            "identified",
            shift,
            names,
            "--predicted",
            symbol="diamond",
            size=8,
            half_widths=half,
        ),
        *_truth(real, off),
    ]
    layout = {"showlegend": False, "yaxis": _categories(links)}
    label = f"Shift of the centres of mass along {AXES[axis]}"
    x = f"shift along {AXES[axis]} [mm]"
    return Figure("", label, x, "", traces, layout, height=row_height(len(links), 28))


def _file(x: list[float], names: list[str]) -> Traced:
    return dots("model file", x, names, "--measured", symbol="circle-open", size=10)


def _centre(link: Solid) -> Array:
    """Centre of mass in the model file, shape `(3,)` [m]."""
    return np.zeros(3) if link.nominal is None else link.nominal.com


def _link_dict(link: Solid) -> dict[str, Any]:
    file = link.nominal
    return {
        "link": link.name,
        "mass": rounded(link.inertia.mass),
        "mass_half_width": rounded(_half_mass(link)),
        "mass_file": None if file is None else rounded(file.mass),
        "centre": [rounded(x) for x in link.inertia.com],
        "centre_half_width": [rounded(Z95 * x) for x in link.com_std],
        "centre_file": None if file is None else [rounded(x) for x in file.com],
        "data_share": rounded(link.learned),
        "margin": float(significant(link.margin, 4)),
    }
