"""Scatter over windows of time, in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from steelyard.report.sections.bootstrap import FAR, ratios
from steelyard.report.text.words import count, significant

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.report.content import ReportContent

NAMED = 3
"""Parameters that are named: those that scatter most beside what was stated."""


def bootstrap_lines(content: ReportContent, console: Console) -> None:
    """Print how the scatter of drawn windows compares with the stated uncertainty."""
    found = content.bootstrap
    if found is None:
        raise ValueError("there is no bootstrap to show")
    over = ratios(content)
    names = found.parameters.names
    order = np.argsort(-np.nan_to_num(over))[:NAMED]
    most = ", ".join(f"{names[k]} {significant(float(over[k]))}" for k in order)
    lines = [
        f"bootstrap: {len(found.draws)} draws of {count(found.windows, 'window')} scatter by "
        f"{significant(float(np.nanmedian(over)))} of the stated standard deviation in the median",
        f"most: {most}; {int(np.sum(over > FAR))} of {len(over)} by more than {FAR:g}",
    ]
    if found.failed:
        lines.append(f"{count(found.failed, 'draw')} gave no estimate")
    console.print()
    for line in lines:
        console.print(line, markup=False)
