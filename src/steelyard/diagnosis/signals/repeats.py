"""Do rows repeat positions, or efforts, although the robot moves?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Fix, Picture, Severity, Trace, percent_of
from steelyard.diagnosis.signal_overview import SignalOverview, look
from steelyard.diagnosis.signals.hold import Hold, hold, mean_age, old_rows
from steelyard.measurement.rows.stale import LONGEST_STALE

SPAN = 10
"""Rows in which a joint must get far for the row in the middle to be one in motion."""
FAR = 2.0
"""Steps of the sensor per row that are far."""
OFTEN = 0.2
"""Share of repeated rows from which on a log is doubtful."""
LATE = 2e-3
"""Mean age of held samples from which on a log is doubtful [s]."""


@dataclass(frozen=True)
class Repeats:
    """Rows with old positions or efforts: a controller that was read too often."""

    name: ClassVar[str] = "repeats"
    question: ClassVar[str] = "Do rows repeat earlier positions or efforts?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that moves fast enough, another where efforts are held."""
        found = (f for evidence in case.logs for f in self._both(case, evidence))
        return tuple(finding for finding in found if finding is not None)

    def _both(self, case: Case, evidence: Evidence) -> tuple[Finding | None, ...]:
        overview = look(case, evidence)
        if len(overview.t) <= 2 * SPAN:
            return ()
        c = overview.channels
        positions = hold(overview.q, overview.resolution[c.q])
        efforts = hold(overview.effort, overview.resolution[c.effort])
        rows = np.ones(len(overview.t), dtype=np.bool_)
        if evidence.processing.bridge_repeats and 0 < positions.every - 1 <= LONGEST_STALE:
            rows = ~old_rows(overview.q)
        age = mean_age(overview.q, positions, rows) * overview.step
        late = mean_age(overview.effort, efforts, rows) * overview.step - age
        return (
            self._irregular(evidence, overview)
            if positions.every == 1
            else self._positions(evidence, overview, positions, round(age, 5)),
            None
            if efforts.every == 1
            else self._efforts(evidence, overview, efforts, round(late, 5) + 0.0),
        )

    def _positions(
        self, evidence: Evidence, overview: SignalOverview, updates: Hold, left: float
    ) -> Finding:
        """Positions that are new every n-th row, and their mean age once rows are bridged [s]."""
        age = 0.5 * (updates.every - 1) * overview.step
        doubtful = round(age, 4) > LATE or updates.every - 1 > LONGEST_STALE
        does = (
            f"they are {1e3 * left:.2g} ms late on average, and rows are not interpolated"
            if left > 0.0
            else "repeated rows are interpolated"
        )
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if doubtful else Severity.OK,
            f"positions are updated {_every(overview, updates)}: {does}",
            f"{updates.value_text}; {1e3 * age:.3g} ms old on average, at most {1e3 * LATE:g} ms "
            f"and {LONGEST_STALE} repeated rows allowed",
            fix=Fix(
                "log at the update rate of positions, "
                f"{1.0 / overview.step / updates.every:.3g} Hz, or update them at the rate of the "
                "log"
            )
            if doubtful
            else None,
            picture=updates.picture,
        )

    def _efforts(
        self, evidence: Evidence, overview: SignalOverview, updates: Hold, late: float
    ) -> Finding:
        """Efforts that are new every n-th row, and how much older than positions they are [s]."""
        stated = evidence.recording.signals.effort_delay
        doubtful = round(late - stated, 4) > LATE
        does = (
            f"they are {1e3 * late:.2g} ms late on average"
            if late > 0.0
            else "no later than positions"
        )
        known = f" ([signals.effort] delay compensates {1e3 * stated:g} ms)" if stated else ""
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if doubtful else Severity.OK,
            f"efforts are updated {_every(overview, updates)}: {does}{known}",
            f"{updates.value_text}; {1e3 * late:.3g} ms later than positions, "
            f"at most {1e3 * LATE:g} ms allowed",
            fix=Fix(
                f"log efforts as they are measured, or state the mean delay, {1e3 * late:.3g} ms",
                (Edit(("signals", "effort", "delay"), late),),
            )
            if doubtful
            else None,
            picture=updates.picture,
        )

    def _irregular(self, evidence: Evidence, overview: SignalOverview) -> Finding | None:
        """Rows in motion that repeat positions now and then."""
        q, step = overview.q, overview.resolution[overview.channels.q]
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
            Severity.DOUBTFUL if often else Severity.OK,
            f"{count} rows in motion repeat the positions of the row before"
            if count
            else "no row in motion repeats the previous one",
            f"{count} of {total} rows around which a joint moves by more than {FAR:g} sensor "
            f"steps a row ({percent_of(share)}), at most "
            f"{100.0 * OFTEN:g} % allowed",
            fix=Fix(f"log at the update rate of positions, about {1.0 - share:.2g} of this one")
            if often
            else None,
            picture=_picture(overview.t[SPAN // 2 + 1 :][: len(again)] - overview.t[0], again)
            if count
            else None,
        )


def _every(overview: SignalOverview, updates: Hold) -> str:
    """How often samples are new."""
    rate = 1.0 / overview.step
    return f"every {updates.every} rows ({rate / updates.every:.3g} Hz of {rate:.3g} Hz)"


def _picture(t: Array, again: NDArray[np.bool_]) -> Picture:
    """Repeated rows over time."""
    count, edges = np.histogram(t[again], bins=100, range=(float(t[0]), float(t[-1])))
    bars = Trace("repeated rows", 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")
    return Picture("time [s]", "repeated rows", (bars,))
