"""How much the result hangs on the cut-offs."""

from typing import ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.sections.tables import PlainTable, Row
from steelyard.report.text.words import significant
from steelyard.validation.sensitivity import Sensitivity

NAMED = 10
"""Parameters that are named: those that move most."""


class SensitivitySection:
    """Fits with other cut-offs, and the parameters that move most between them."""

    name: ClassVar[str] = "sensitivity"
    title: ClassVar[str] = "Sensitivity to the cut-offs"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Two tables, if it was asked for."""
        if content.sensitivity is None:
            return None
        tables = [fits_table(content.sensitivity), _moved(content.sensitivity)]
        return {"tables": tables, "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("tables.html", numbers)


def fits_table(found: Sensitivity) -> PlainTable:
    """One row per fit."""
    rows = []
    for v in found.rows:
        shift = "" if v.values is None else significant(float(np.median(found.shift(v))))
        cells = (
            f"x {v.factor:g}",
            f"{v.motion:g} Hz",
            f"{v.matched:g} Hz",
            v.failed or _percent(v.fitted),
            _percent(v.unseen),
            shift,
        )
        rows.append(Row(cells, v is found.result))
    return PlainTable(
        "Fits with other cut-offs",
        "The same laws, fields and gains; errors are of the kind and the band of the verdict's "
        "headline in every row. A result that other "
        "cut-offs move by many standard deviations hangs on a choice, not on the data alone.",
        ("Cut-offs", "Motion", "Matched", "Error fitted", "Error unseen", "Median shift [std]"),
        rows,
    )


def _moved(found: Sensitivity) -> PlainTable:
    order = np.argsort(-found.spread)[:NAMED]
    rows = [Row((found.parameters.names[k], significant(float(found.spread[k])))) for k in order]
    return PlainTable(
        "Parameters that move most",
        "Largest distance of any of these fits from the result, in standard deviations.",
        ("Parameter", "Largest shift [std]"),
        rows,
    )


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} %"
