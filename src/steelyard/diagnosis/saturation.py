"""Do efforts stay at an extreme, as if something were cut off?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Judgement, Mend, Picture
from steelyard.diagnosis.noise import LEVELS
from steelyard.diagnosis.pictures import trace
from steelyard.diagnosis.sight import Sight, look, with_rows

STAYS = 5
"""Rows in succession at exactly the highest or lowest value from which on it is cut off."""
OFTEN = 0.005
"""Share of all rows there, at least `STAYS` of them, from which on it is too."""


@dataclass(frozen=True)
class Saturation:
    """Efforts that stay at exactly their highest or lowest value."""

    name: ClassVar[str] = "saturation"
    asks: ClassVar[str] = "Are efforts cut off?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        sight = look(case, evidence)
        stays = np.array([_stay(column) for column in sight.effort.T])
        cut = np.flatnonzero(stays >= STAYS)
        worst = int(np.argmax(stays))
        names = tuple(case.joints[j] for j in cut)
        unit = evidence.recording.signals.effort_units
        said = [
            f"the effort of {case.joints[j]} stays at {_extreme(sight.effort[:, j]):.4g} {unit[j]} "
            f"for {stays[j]} rows"
            for j in cut
        ]
        return Finding(
            self.name,
            evidence.name,
            Judgement.DOUBTFUL if len(cut) else Judgement.OK,
            "; ".join(said) or "no effort stays at its extreme",
            f"{stays[worst]} rows at an extreme ({case.joints[worst]}), bound {STAYS}",
            joints=names,
            mend=Mend("move slower or with less load, or raise the range of what measures efforts")
            if len(cut)
            else None,
            picture=_picture(case, evidence, sight, worst) if len(cut) else None,
        )


def _stay(effort: Array) -> int:
    """Rows at the highest or lowest value; 0 if there are few values at all."""
    if len(np.unique(effort)) < LEVELS:
        return 0
    return max(_rows(effort == effort.max()), _rows(effort == effort.min()))


def _rows(extreme: NDArray[np.bool_]) -> int:
    """Rows in succession, or all of them if they are many."""
    count = int(np.count_nonzero(extreme))
    return count if count >= max(STAYS, OFTEN * len(extreme)) else longest(extreme)


def longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run of `True`."""
    change = np.diff(np.concatenate(([0], mask.astype(np.int8), [0])))
    starts, stops = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return int((stops - starts).max()) if len(starts) else 0


def _extreme(effort: Array) -> float:
    """The extreme at which it stays longer."""
    high, low = float(effort.max()), float(effort.min())
    return high if longest(effort == high) >= longest(effort == low) else low


def _picture(case: Case, evidence: Evidence, sight: Sight, joint: int) -> Picture:
    unit = evidence.recording.signals.effort_units[joint]
    effort = trace(case.joints[joint], sight.t - sight.t[0], sight.effort[:, joint])
    return Picture("time [s]", f"effort [{unit}]", (effort,))
