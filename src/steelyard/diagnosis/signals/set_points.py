"""Are positions and efforts measured, or set-points of the controller?"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.signal_overview import look, with_rows
from steelyard.diagnosis.signals.computed import NOISE_FREE, noise_shares
from steelyard.diagnosis.signals.other_efforts import other_columns
from steelyard.robot_file.column_names import Column, Quantity

SMOOTH = 1e-7
"""Noise or rounding of positions, over their variation, below which no encoder measured them. Least
of the joints' largest on seven real robots, two resampled logs aside: 1e-5."""


@dataclass(frozen=True)
class SetPoints:
    """Columns whose names speak of set-points, and positions without noise beside noisy efforts."""

    name: ClassVar[str] = "set points"
    question: ClassVar[str] = "Are signals measured, or set-points of the controller?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(_found(case, evidence) for evidence in with_rows(case))


def _found(case: Case, evidence: Evidence) -> Finding:
    named = list(_named(evidence))
    if named:
        says = "; ".join(says for says, _ in named) + ": commanded by their names, not measured"
        instead = "; ".join(instead for _, instead in named if instead)
        fix = Fix("declare the columns that hold measurements under [signals]" + instead)
        return Finding(SetPoints.name, evidence.name, Severity.DOUBTFUL, says, "", fix=fix)
    if not look(case, evidence).moves:
        says = "no declared column is called a set-point; nothing moves"
        return Finding(SetPoints.name, evidence.name, Severity.OK, says, "")
    effort, position = noise_shares(case, evidence)
    worst = float(np.nanmax(position, initial=0.0))
    figure = (
        f"noise of positions up to {worst:.1g} of their variation, at least {SMOOTH:g} required"
    )
    noisy = bool(np.nanmax(effort, initial=0.0) > NOISE_FREE)
    if noisy and np.isfinite(position).any() and worst < SMOOTH:
        says = (
            "undecided: efforts have measurement noise, and positions are noise-free: commanded "
            "positions, low-passed ones, or those of a simulation"
        )
        return Finding(SetPoints.name, evidence.name, Severity.OK, says, figure, answered=False)
    says = "no declared column is called a set-point, and positions have measurement noise"
    return Finding(SetPoints.name, evidence.name, Severity.OK, says, figure)


def measured_instead(evidence: Evidence) -> tuple[str, ...]:
    """Patterns of effort columns that may be measured, where the declared ones are set-points."""
    declared = evidence.recording.signals.effort
    targets = any(Column(name).of_target for name in declared)
    return other_columns(evidence, declared, "effort") if targets else ()


def _named(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Declared columns that are called set-points, and those that may be taken instead."""
    signals = evidence.recording.signals
    declared: tuple[tuple[Quantity, tuple[str, ...]], ...] = (
        ("position", signals.position),
        ("velocity", signals.velocity or ()),
        ("effort", signals.effort),
    )
    for quantity, columns in declared:
        targets = [name for name in columns if Column(name).of_target]
        if not targets:
            continue
        more = f" and {len(targets) - 1} more" * (len(targets) > 1)
        others = ", ".join(f"'{one}'" for one in other_columns(evidence, columns, quantity))
        yield (
            f"{quantity} column '{targets[0]}'{more}",
            f"; this log has {others} too" if others else "",
        )
