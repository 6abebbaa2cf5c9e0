"""How much of a log is rest, and where?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity
from steelyard.diagnosis.pictures import trace
from steelyard.diagnosis.signal_overview import look
from steelyard.diagnosis.signals.slopes import ENDS, width_of
from steelyard.diagnosis.signals.units import driven, motion, reading
from steelyard.measurement.rows.outliers import stretches

REST_SHARE = 0.01
"""Speed of a joint at rest, over the speed that it exceeds 1 % of the time."""
MOSTLY = 0.8
"""Share of the time at rest from which on a log is doubtful."""


@dataclass(frozen=True)
class Rests:
    """Time in which no joint moves: friction is anywhere in its dead zone there."""

    name: ClassVar[str] = "rests"
    question: ClassVar[str] = "How much of the log is standstill?"
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
        rests = _long((share <= REST_SHARE).all(axis=0), slope.rate)
        t = (slope.t - clock[0]) * second
        rest, often = float(rests.mean()), float(rests.mean()) > MOSTLY
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if often else Severity.OK,
            _says(rests, t, float(clock[-1] - clock[0]) * second),
            f"{100.0 * rest:.1f} % at rest, at most {100.0 * MOSTLY:g} % allowed",
            fix=Fix("cut off the standstill (LOG@START:STOP), and record more motion")
            if often
            else None,
            picture=_picture(t, share.max(axis=0)),
        )


def _long(still: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Stillness that lasts longer than the low-pass; shorter, joints turn round together."""
    kept = np.zeros_like(still)
    for start, stop in stretches(still):
        kept[start:stop] = stop - start > 2.0 * ENDS * width_of(rate) * rate
    return kept


def _says(rests: NDArray[np.bool_], t: Array, duration: float) -> str:
    """How much is rest; the ends, where the low-pass does not reach, are as what is next to them.

    Args:
        rests: Whether no joint moves, shape `(N,)`.
        t: Time since the log's start, shape `(N,)` [s].
        duration: Of the log [s].
    """
    if not rests.any():
        return "no standstill"
    moves = np.flatnonzero(~rests)
    start = float(t[moves[0]]) if rests[0] else 0.0
    stop = duration - float(t[moves[-1]]) if rests[-1] else 0.0
    return (
        f"{100.0 * float(rests.mean()):.1f} % of the time no joint moves, {start:.1f} s of it at "
        f"the start and {stop:.1f} s at the end"
    )


def _picture(t: Array, speed: Array) -> Picture:
    """The fastest joint's speed over time."""
    return Picture(
        "time [s]",
        "speed of the fastest joint relative to its maximum",
        (trace("speed", t, speed), trace("rest", t, np.full(len(t), REST_SHARE))),
    )
