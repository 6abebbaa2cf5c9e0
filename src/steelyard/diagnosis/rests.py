"""How much of a log is rest, and where?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Judgement, Mend, Picture
from steelyard.diagnosis.pictures import trace
from steelyard.diagnosis.sight import look
from steelyard.diagnosis.units import driven, motion, reading

REST_SHARE = 0.01
"""Speed of a joint at rest, over the speed that it exceeds 1 % of the time."""
MOSTLY = 0.8
"""Share of the time at rest from which on a log is doubtful."""


@dataclass(frozen=True)
class Rests:
    """Time in which no joint moves: friction is anywhere in its dead zone there."""

    name: ClassVar[str] = "rests"
    asks: ClassVar[str] = "How much of the log is rest?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log in which something moves."""
        found = []
        for evidence in case.logs:
            if driven(case, evidence).any() and look(case, evidence).moves:
                found.append(self._look(case, evidence))
        return tuple(found)

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        slope, clock = motion(case, evidence), look(case, evidence).clock
        second = reading(case, evidence).second
        speed = np.abs(slope.v[driven(case, evidence)])
        share = speed / np.quantile(speed, 0.99, axis=1)[:, None]
        moves = (share > REST_SHARE).any(axis=0)
        at = np.flatnonzero(moves)
        t = (slope.t - clock[0]) * second
        rest = 1.0 - float(moves.mean())
        start, stop = float(t[at[0]]), float((clock[-1] - clock[0]) * second - t[at[-1]])
        often = rest > MOSTLY
        return Finding(
            self.name,
            evidence.name,
            Judgement.DOUBTFUL if often else Judgement.OK,
            f"{100.0 * rest:.2g} % of the time no joint moves: {start:.1f} s at the start, "
            f"{stop:.1f} s at the end",
            f"{100.0 * rest:.2g} % at rest, bound {100.0 * MOSTLY:g} %",
            mend=Mend("cut the rests off (LOG@START:STOP), and record more motion")
            if often
            else None,
            picture=_picture(t, share.max(axis=0)),
        )


def _picture(t: Array, speed: Array) -> Picture:
    """The fastest joint's speed over time."""
    return Picture(
        "time [s]",
        "speed of the busiest joint over its highest",
        (trace("speed", t, speed), trace("rest", t, np.full(len(t), REST_SHARE))),
    )
