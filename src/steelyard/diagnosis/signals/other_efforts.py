"""Columns of a log that hold a quantity by their names, beside those of the robot file."""

import re
from collections.abc import Sequence

from steelyard.diagnosis.case import Evidence
from steelyard.diagnosis.finding import Fix
from steelyard.robot_file.column_names import Column, Quantity, by_number


def other_efforts(evidence: Evidence) -> tuple[str, ...]:
    """Patterns of columns, one per joint, such as `current{}_A`."""
    return other_columns(evidence, evidence.recording.signals.effort, "effort")


def other_columns(
    evidence: Evidence, declared: Sequence[str], quantity: Quantity
) -> tuple[str, ...]:
    """Patterns of columns of a quantity, one per declared column, such as `current{}_A`."""
    columns = [Column(name) for name in evidence.log.columns if name not in declared]
    groups = by_number(len(declared), [c for c in columns if c.quantity == quantity])
    return tuple(re.sub(r"\d+(?=\D*$)", "{}", group[0].name) for group in groups)


def with_others(fix: Fix, evidence: Evidence) -> Fix:
    """The advice, with the columns that may be taken instead."""
    others = ", ".join(f"'{pattern}'" for pattern in other_efforts(evidence))
    return Fix(f"{fix.says}; this log has {others} too", fix.edits) if others else fix
