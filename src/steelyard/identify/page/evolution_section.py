"""Section of the search by a genetic algorithm: errors over its generations, and its bounds."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.console import RenderableType

from steelyard.base.arrays import json_values
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import FigureSection, Numbers
from steelyard.report.page_figures import Figure, Group, Key, line
from steelyard.report.tables import PlainTable, table_of, text_table
from steelyard.report.words import significant

WORDS = (
    "Root mean square error over all samples of all joints, the objective of the genetic "
    "algorithm: of the best individual, and its mean over the individuals of each generation. The "
    "dashed line is that of least squares without bounds, below which no individual can be. If the "
    "best one still falls at the end, more generations or individuals, or narrower bounds, help."
)


class EvolutionSection(FigureSection, name="evolution", title="Genetic algorithm"):
    """The objective over generations, and the bounds of the search."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """A figure and a table, if the estimate is from a genetic algorithm."""
        found = content.identified.estimate.evolution
        if found is None:
            return None
        count = np.arange(1.0, len(found.best) + 1.0)
        units = "; ".join(dict.fromkeys(content.identified.model.robot.effort_units))
        figure = Figure(
            "",
            "Best and mean root mean square error over the generations",
            "generation",
            f"root mean square error [{units}]",
            [
                line("mean", count, found.mean, "--measured"),
                line("best", count, found.best, "--predicted"),
                line(
                    "least squares without bounds",
                    count,
                    np.full(len(count), found.least_squares),
                    "--green",
                    dash="dash",
                ),
            ],
            {"yaxis": {"type": "log"}},
        )
        keys = [
            Key("--measured", "mean of the individuals"),
            Key("--predicted", "best individual"),
            Key("--green", "least squares without bounds"),
        ]
        return {
            "words": WORDS,
            "legend": keys,
            "groups": [Group([figure], columns="one")],
            "tables": (_bounds(content),),
            "folded": "Bounds of the search",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Bounds, best and mean error of every generation, and that of least squares."""
        return {"evolution": json_values(content.identified.estimate.evolution)}

    def detailed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The bounds."""
        if content.identified.estimate.evolution is not None:
            yield text_table(_bounds(content), self.title)


def _bounds(content: ReportContent) -> PlainTable:
    estimate = content.identified.estimate
    found, known = estimate.evolution, estimate.parameters
    assert found is not None
    values, units = known.as_dict(), dict(zip(known.names, known.units, strict=True))
    return table_of(
        zip(found.names, found.lower.tolist(), found.upper.tolist(), strict=True),
        {
            "Parameter": lambda row: row[0],
            "Lower": lambda row: significant(row[1]),
            "Value": lambda row: significant(values[row[0]]),
            "Upper": lambda row: significant(row[2]),
            "Unit": lambda row: units[row[0]],
        },
        caption="Bounds of the search",
        words="From [[knowledge]], the laws, and for links from the masses of the prior: up to "
        "twice the mass and the second moments.",
        text=(0, 4),
        marked=lambda row: row[0] in estimate.at_bound,
        note="bold: at a bound" if estimate.at_bound else "",
    )
