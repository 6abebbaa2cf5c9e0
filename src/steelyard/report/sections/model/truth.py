"""Of a simulated robot: its true base parameters beside the identified ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.estimation.estimate import Z95
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, dots, row_height
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.table import rows
from steelyard.report.text.words import alike, count, significant

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass(frozen=True)
class Compared:
    """One base parameter with an interval.

    Attributes:
        name: Its name.
        unit: Its unit.
        truth: Value of the simulated robot.
        value: Estimate.
        half_width: Of the 95 % interval.
    """

    name: str
    unit: str
    truth: float
    value: float
    half_width: float

    @property
    def distance(self) -> float:
        """Estimate minus truth in half-widths."""
        return (self.value - self.truth) / self.half_width

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the 95 % interval."""
        return abs(self.distance) <= 1.0


class TruthSection(FigureSection):
    """One row per base parameter."""

    name: ClassVar[str] = "truth"
    title: ClassVar[str] = "Simulated robot: truth and estimate"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Truth, estimates and distances, if the truth is known."""
        found = compared(content)
        if not found:
            return None
        return {
            "words": f"{_sentence(found)} Of 100 such intervals, 95 hold the truth on average, if "
            "the model lacks nothing.",
            "legend": [
                Key("--green", "truth inside the 95 % interval", "point"),
                Key("--vermillion", "outside", "point"),
                Key("--rest", "95 % interval", "area"),
            ],
            "groups": [Group([_figure(found)], columns="one")],
            "tables": [_table(found)],
            "folded": "Values of all parameters",
            "note": "The robot of this report is simulated. A real robot has no known truth: "
            "validation runs and the checks of the residuals take its place.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Truth and estimates."""
        found = compared(content)
        return {"truth": [vars(one) | {"inside": one.inside} for one in found] or None}

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """How many intervals hold the truth."""
        from rich.text import Text

        if found := compared(content):
            yield Text(_sentence(found))


def compared(content: ReportContent) -> list[Compared]:
    """Base parameters with intervals beside their true values; none without a truth."""
    if content.identified is None or content.truth is None:
        return []
    base, known = content.identified.base, content.truth.as_dict()
    true = dict(
        zip(base.base_names, base.base_values([known[name] for name in base.names]), strict=True)
    )
    return [
        Compared(row.name, row.unit, float(true[row.name]), row.value, Z95 * row.std)
        for row in rows(content.identified)
        if row.name in true and row.value is not None and row.std is not None and row.std > 0.0
    ]


def _sentence(found: Sequence[Compared]) -> str:
    inside = sum(one.inside for one in found)
    total = count(len(found), "base parameter")
    return f"Simulated robot: the true values of {inside} of {total} lie in the 95 % intervals."


def _table(found: Sequence[Compared]) -> PlainTable:
    table = [
        Row(
            (
                one.name,
                alike(one.truth, one.half_width),
                alike(one.value, one.half_width),
                f"± {significant(one.half_width, 2)}",
                one.unit,
                "yes" if one.inside else "no",
            )
        )
        for one in found
    ]
    headings = ("Parameter", "Truth", "Estimate", "95 % interval", "Unit", "Truth inside")
    return PlainTable("", "", headings, table, (0, 4, 5))


def _figure(found: Sequence[Compared]) -> Figure:
    """Distances from the truth in half-widths."""
    band = {"type": "rect", "xref": "x", "yref": "paper", "x0": -1, "x1": 1, "y0": 0, "y1": 1}
    names = [one.name for one in found]
    traces = [
        dots(
            words,
            [one.distance for one in found if one.inside == inside],
            [one.name for one in found if one.inside == inside],
            colour,
            symbol="circle" if inside else "diamond",
        )
        for words, inside, colour in (
            ("inside", True, "--green"),
            ("outside", False, "--vermillion"),
        )
    ]
    layout = {
        "showlegend": False,
        "shapes": [band | {"fillcolor": "--rest", "line": {"width": 0}, "layer": "below"}],
        "xaxis": {"zeroline": True},
        "yaxis": {
            "type": "category",
            "categoryorder": "array",
            "categoryarray": names[::-1],
            "tickfont": {"size": 10},
            "dtick": 1,
        },
    }
    label = "Distance of every estimate from the truth"
    x = "estimate minus truth [half-widths]"
    return Figure("", label, x, "", traces, layout, height=row_height(len(found), 14))
