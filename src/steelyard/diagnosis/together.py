"""One robot file for all logs: what one log asks for must not contradict the others."""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np

from steelyard.diagnosis.finding import Edit, Finding, Judgement, Mend

DIGITS = 4
APART = "the other logs agree with the robot file as it is: give this one a robot file of its own"


def together(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of one suspicion with mends that serve all logs.

    A log that is wrong while others are fine has no line in a robot file they share. Numbers that
    several logs ask for become their median.
    """
    fine = [f.log for f in findings if f.judgement == Judgement.OK and f.answered and f.log]
    wanted: dict[tuple[str, ...], list[Any]] = {}
    for finding in findings:
        for edit in finding.mend.edits if finding.mend else ():
            wanted.setdefault(edit.path, []).append(edit.value)
    return tuple(_shared(finding, wanted, bool(fine)) for finding in findings)


def _shared(
    finding: Finding, wanted: dict[tuple[str, ...], list[Any]], contradicted: bool
) -> Finding:
    mend = finding.mend
    if mend is None or not mend.edits:
        return finding
    if contradicted and finding.log and finding.judgement == Judgement.WRONG:
        return replace(finding, mend=_apart(mend))
    edits = tuple(Edit(edit.path, _middle(wanted[edit.path])) for edit in mend.edits)
    return replace(finding, mend=replace(mend, edits=edits))


def whole(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of all suspicions; edits that were tried as one change stay together or go.

    Args:
        findings: What `together` made of the findings of each suspicion.
    """
    lost = {f.log for f in findings if f.mend is not None and f.mend.jointly and not f.mend.edits}
    return tuple(
        replace(f, mend=_apart(f.mend))
        if f.mend is not None and f.mend.jointly and f.mend.edits and f.log in lost
        else f
        for f in findings
    )


def _apart(mend: Mend) -> Mend:
    """The advice without edits: the robot file that the logs share cannot be changed so."""
    return replace(mend, says=f"{mend.says}; {APART}", edits=())


def _middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or of lists of as many numbers; the first of anything else."""
    first = values[0]
    if all(value == first for value in values):
        return first
    if all(_is_number(value) for value in values):
        return _rounded(float(np.median(values)))
    lists = all(isinstance(v, list) and all(map(_is_number, v)) for v in values)
    if not lists or len({len(v) for v in values}) > 1:
        return first
    return [_rounded(float(x)) for x in np.median(np.array(values, dtype=np.float64), axis=0)]


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | int)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
