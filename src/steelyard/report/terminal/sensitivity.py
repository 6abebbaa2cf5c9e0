"""Sensitivity to the cut-offs, in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.report.sections.sensitivity import fits_table

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.validation.sensitivity import Sensitivity

NAMED = 3
"""Parameters that are named: those that move most."""


def sensitivity_lines(found: Sensitivity, console: Console) -> None:
    """Print the fits, and which parameters move most between them."""
    from rich.table import Table

    shown = fits_table(found)
    table = Table(title=shown.caption, title_justify="left")
    for number, heading in enumerate(shown.headings):
        table.add_column(heading, justify="left" if number in shown.text else "right")
    for row in shown.rows:
        table.add_row(*row.cells, style="bold" if row.marked else "")
    console.print()
    console.print(table)
    order = np.argsort(-found.spread)[:NAMED]
    most = ", ".join(f"{found.parameters.names[k]} {found.spread[k]:.1f}" for k in order)
    console.print(f"parameters that move most, in standard deviations: {most}", markup=False)
