"""Extremes of efforts: are they cut off there, and do they change their sign?"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity
from steelyard.diagnosis.pictures import of_joints, trace
from steelyard.diagnosis.signal_overview import MOVED, SignalOverview, look, with_rows
from steelyard.measurement.rows.outliers import stretches

STAYS = 5
"""Stays of usual length that a stay at the highest or lowest value must be long at least."""
OFTEN = 0.005
"""Share of all rows there from which on an effort is cut off, too."""
BESIDE = 5
"""Steps of the sensor next to an extreme, for the usual length of a stay at one level."""
RATIO = 8.0
r"""Stay at the extreme over the mean stay beside it, at least. A smooth peak that fills its highest
level stays $2\sqrt2$ there and $\sqrt{k+1} - \sqrt k$ on each side of the levels below it: a ratio
of 6.9 for $k = 1 ... 5$, and a row more by rounding."""
REACH = BESIDE + 0.5
"""The same with room for rounding."""
GAP = 0.15
"""Distance to the next level over the range, from which on an effort is switched, not cut off."""
FEWEST = 2
"""Joints whose effort touches zero and keeps its sign, from which on chance does not explain it."""
TOUCHING = 0.05
"""Share of an effort's greatest size that the least must come below. One that carries a weight
throughout stays away from zero."""


@dataclass(frozen=True)
class _Stay:
    """How long an effort stays at an extreme: its value, the rows, and those that are cut off."""

    value: float
    rows: int
    bound: float

    @property
    def share(self) -> float:
        """Rows over the bound: 1 or more of what is cut off."""
        return self.rows / self.bound


@dataclass(frozen=True)
class Saturation:
    """Efforts that stay at exactly their highest or lowest value."""

    name: ClassVar[str] = "saturation"
    question: ClassVar[str] = "Are efforts saturated?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        overview = look(case, evidence)
        stays = [_stay(column) for column in overview.effort.T]
        cut = [j for j, stay in enumerate(stays) if stay.share >= 1.0]
        worst = max(range(len(stays)), key=lambda j: stays[j].share)
        names = tuple(case.joints[j] for j in cut)
        unit = evidence.recording.signals.effort_units
        clauses = [
            f"the effort of {case.joints[j]} stays at {stays[j].value:.4g} {unit[j]} "
            f"for {stays[j].rows} rows"
            for j in cut
        ]
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if cut else Severity.OK,
            "; ".join(clauses) or "no effort stays at its extreme",
            f"{stays[worst].rows} rows at an extreme ({case.joints[worst]})"
            + (
                f", fewer than {stays[worst].bound:.0f} required"
                if np.isfinite(stays[worst].bound)
                else ""
            ),
            joints=names,
            fix=Fix("move slower or with less load, or raise the range of the effort measurement")
            if cut
            else None,
            picture=_picture(case, evidence, overview, worst) if cut else None,
        )


def _stay(effort: Array) -> _Stay:
    """The more striking of the stays at the highest and at the lowest value."""
    high, low = _highest(effort), _highest(-effort)
    return high if high.share >= low.share else replace(low, value=-low.value)


def _highest(effort: Array) -> _Stay:
    """The longest stay at the highest value, or all of them, whichever is more striking."""
    levels = np.unique(effort)[::-1]
    top, stays = levels[0], _stays(effort, levels[0])
    once = _Stay(float(top), int(stays.max()), np.inf)
    if len(levels) <= BESIDE or top - levels[1] > GAP * (top - levels[-1]):
        return once
    near = levels[1 : 1 + BESIDE]
    beside = [_stays(effort, level) for level in near]
    step = float(np.abs(np.diff(levels[: 1 + BESIDE])).min())
    close = [own for own, level in zip(beside, near, strict=True) if top - level < REACH * step]
    usual = STAYS * float(np.median(np.concatenate(beside)))
    mean = sum(float(np.square(own).sum() / own.sum()) for own in close) / BESIDE
    often = OFTEN * len(effort), RATIO * sum(int(own.sum()) for own in close) / BESIDE
    once = replace(once, bound=float(np.ceil(max(usual, RATIO * mean))))
    many = replace(once, rows=int(stays.sum()), bound=float(np.ceil(max(usual, *often))))
    return many if many.share >= 1.0 else once


def _stays(effort: Array, level: float) -> NDArray[np.intp]:
    """Lengths of the stays at a level, in rows."""
    return np.array([stop - start for start, stop in stretches(effort == level)])


def _picture(case: Case, evidence: Evidence, overview: SignalOverview, joint: int) -> Picture:
    unit = evidence.recording.signals.effort_units[joint]
    effort = trace(case.joints[joint], overview.t - overview.t[0], overview.effort[:, joint])
    return Picture("time [s]", f"effort [{unit}]", (effort,))


@dataclass(frozen=True)
class Signed:
    """Efforts of all joints keep one sign, and those of some touch zero."""

    name: ClassVar[str] = "signed efforts"
    question: ClassVar[str] = "Do efforts change their sign?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        overview = look(case, evidence)
        effort, size = overview.effort, np.abs(overview.effort)
        low, high = effort.min(axis=0), effort.max(axis=0)
        moves = (np.ptp(overview.q, axis=0) > MOVED) & (high > low)
        one_sign = moves & ((low >= 0.0) | (high <= 0.0))
        touching = one_sign & (size.min(axis=0) <= TOUCHING * size.max(axis=0))
        unsigned = bool(touching.sum() >= FEWEST and (one_sign == moves).all())
        joints = tuple(j for j, is_one in zip(case.joints, one_sign, strict=True) if is_one)
        figure = f"{len(joints)} of {int(moves.sum())} joints that move have efforts of one sign"
        if not unsigned:
            says = "efforts change their sign, or carry a weight"
            return Finding(self.name, evidence.name, Severity.OK, says, figure)
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL,
            "efforts of all joints that move keep one sign and touch zero, as absolute values do",
            figure,
            joints,
            Fix("log torques or currents with their sign"),
            of_joints("logged effort", [("least", low, "points"), ("greatest", high, "points")]),
        )
