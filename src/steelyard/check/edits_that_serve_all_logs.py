"""Edits of the robot file that all logs ask for; those that contradict each other are refused."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from steelyard.check.finding import Edit, Finding, Severity

SHARED_DIGITS = 4
DIFFERENT_FACTORS = 3.0  # standard deviations by which factors of two logs differ if not one number
SAME_NUMBERS = 0.1  # difference of numbers without an accuracy up to which they are one, relative

Path = tuple[str, ...]


def edits_that_serve_all_logs(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of all checks with those edits that every log asks for.

    Numbers become their median; those that differ by more than their accuracy are doubtful, and
    none is written. Edits that were tried on a log as one change stay together or go.
    """
    logs = dict.fromkeys(f.log for f in findings if f.log)
    wanted: dict[Path, dict[str, Edit]] = {}
    groups: dict[tuple[str, int], set[Path]] = {}
    for number, f in enumerate(findings):
        if f.log and f.fix is not None and f.fix.edits:
            group = groups.setdefault((f.log, -1 if f.fix.jointly else number), set())
            for edit in f.fix.edits:
                wanted.setdefault(edit.path, {})[f.log] = edit
                group.add(edit.path)
    apart = {path: why for path, edits in wanted.items() if (why := _unlike(edits))}
    refused = {
        path: apart.get(path) or _asked_by_some(edits, [log for log in logs if log not in edits])
        for path, edits in wanted.items()
        if path in apart or len(edits) < len(logs)
    }
    for _ in groups:  # what was tried together with something that is refused
        for paths in groups.values():
            if why := next((refused[path] for path in paths if path in refused), ""):
                refused |= {path: why for path in paths if path not in refused}
    return tuple(_shared(f, wanted, refused, apart) for f in findings)


def _shared(
    f: Finding,
    wanted: Mapping[Path, Mapping[str, Edit]],
    refused: Mapping[Path, str],
    apart: Mapping[Path, str],
) -> Finding:
    """A finding with the edits that all logs share, or with why there are none."""
    if not f.log or f.fix is None or not f.fix.edits:
        return f
    paths = [edit.path for edit in f.fix.edits]
    if why := next((refused[path] for path in paths if path in refused), ""):
        doubtful = any(path in apart for path in paths)
        fix = replace(f.fix, says=f"{f.fix.says}; {why}", edits=())
        return replace(f, fix=fix, severity=Severity.DOUBTFUL if doubtful else f.severity)
    edits = (
        replace(edit, value=_middle([one.value for one in wanted[edit.path].values()]))
        for edit in f.fix.edits
    )
    return replace(f, fix=replace(f.fix, edits=tuple(edits)))


def _asked_by_some(edits: Mapping[str, Edit], others: Sequence[str]) -> str:
    key = ".".join(next(iter(edits.values())).path)
    return (
        f"{', '.join(others)} {'does' if len(others) == 1 else 'do'} not require another {key}: no "
        f"line is written; give {', '.join(edits)} a robot file of "
        f"{'its' if len(edits) == 1 else 'their'} own"
    )


def _unlike(edits: Mapping[str, Edit]) -> str:
    """The values of several logs that are not one; empty if they may be."""
    if not any(_differ(a, b) for a, b in combinations(edits.values(), 2)):
        return ""
    listed = ", ".join(
        str(e.value).replace("'", '"')
        + (f" ± {200.0 * e.spread:.2g} %" if e.spread > 0.0 else "")
        + f" ({log})"
        for log, e in edits.items()
    )
    accuracy = "; 95 %" * any(e.spread > 0.0 for e in edits.values())
    key = next(iter(edits.values())).path[-1]
    return f"the logs require different values ({key}: {listed}{accuracy}): none is written"


def _differ(a: Edit, b: Edit) -> bool:
    if a.value == b.value:
        return False
    first, second = (np.atleast_1d(np.array(e.value)) for e in (a, b))
    if first.shape != second.shape or {first.dtype.kind, second.dtype.kind} != {"f"}:
        return True
    if not (a.spread > 0.0 and b.spread > 0.0):
        size = float(np.max(np.abs([first, second])))
        return bool(np.any(np.abs(first - second) > SAME_NUMBERS * size))
    if np.any(first * second <= 0.0):
        return True
    far = float(np.max(np.abs(np.log(first / second))))
    accuracy = DIFFERENT_FACTORS * float(np.hypot(a.spread, b.spread))
    return far > accuracy + 2.0 * 10.0**-SHARED_DIGITS


def _middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or of lists of as many numbers; what all are, of anything else."""
    first = values[0]
    if all(value == first for value in values):
        return first
    middle = np.atleast_1d(np.median(np.array(values), axis=0))
    rounded = [float(f"{x:.{SHARED_DIGITS}g}") for x in middle]
    return rounded if isinstance(first, list) else rounded[0]
