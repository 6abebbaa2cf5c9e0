"""Do rows repeat positions although the robot moves?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Judgement, Mend, Picture, Trace
from steelyard.diagnosis.sight import look

SPAN = 10
"""Rows in which a joint must get far for the row in the middle to be one in motion."""
FAR = 2.0
"""Steps of the sensor per row that are far."""
OFTEN = 0.2
"""Share of repeated rows from which on a log is doubtful."""


@dataclass(frozen=True)
class Repeats:
    """Rows with all positions of the row before, in motion: a bus that was read too often."""

    name: ClassVar[str] = "repeats"
    asks: ClassVar[str] = "Do rows repeat old positions?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves fast enough to tell."""
        found = (self._look(case, evidence) for evidence in case.logs)
        return tuple(finding for finding in found if finding is not None)

    def _look(self, case: Case, evidence: Evidence) -> Finding | None:
        sight = look(case, evidence)
        if len(sight.t) <= 2 * SPAN:
            return None
        q, step = sight.q, sight.resolution[sight.channels.q]
        far = np.abs(q[SPAN:] - q[:-SPAN]) > FAR * SPAN * step
        fast: NDArray[np.bool_] = np.any(far & (step > 0.0), axis=1)
        if not fast.any():
            return None
        same = np.all(q[1:] == q[:-1], axis=1)
        again: NDArray[np.bool_] = same[SPAN // 2 : SPAN // 2 + len(fast)] & fast
        count, total = int(again.sum()), int(fast.sum())
        share = count / total
        often = share > OFTEN
        return Finding(
            self.name,
            evidence.name,
            Judgement.DOUBTFUL if often else Judgement.OK,
            f"{count} rows in motion repeat the positions of the row before"
            if count
            else "no row in motion repeats the one before",
            f"{count} of {total} rows in motion ({100.0 * share:.2g} %), bound {100.0 * OFTEN:g} %",
            mend=Mend(
                f"log at the rate at which positions are new, about {1.0 - share:.2g} of this one"
            )
            if often
            else None,
            picture=_picture(sight.t[SPAN // 2 + 1 :][: len(again)] - sight.t[0], again)
            if count
            else None,
        )


def _picture(t: Array, again: NDArray[np.bool_]) -> Picture:
    """Repeated rows over time."""
    count, edges = np.histogram(t[again], bins=100, range=(float(t[0]), float(t[-1])))
    bars = Trace("repeated rows", 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")
    return Picture("time [s]", "repeated rows", (bars,))
