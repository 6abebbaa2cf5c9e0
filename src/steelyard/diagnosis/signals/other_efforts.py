"""Columns of a log that hold efforts by their names, beside those that the robot file declares."""

import re

from steelyard.diagnosis.case import Evidence
from steelyard.diagnosis.finding import Fix
from steelyard.robot_file.column_names import Column, by_number


def other_efforts(evidence: Evidence) -> tuple[str, ...]:
    """Patterns of columns, one per joint, such as `current{}_A`."""
    declared = set(evidence.recording.signals.effort)
    columns = [Column(name) for name in evidence.log.columns if name not in declared]
    groups = by_number(len(declared), [c for c in columns if c.quantity == "effort"])
    return tuple(re.sub(r"\d+(?=\D*$)", "{}", group[0].name) for group in groups)


def with_others(fix: Fix, evidence: Evidence) -> Fix:
    """The advice, with the columns that may be taken instead."""
    others = ", ".join(f"'{pattern}'" for pattern in other_efforts(evidence))
    return Fix(f"{fix.says}; this log has {others} too", fix.edits) if others else fix
