"""How finely are signals resolved, and how noisy are they?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity
from steelyard.diagnosis.pictures import trace
from steelyard.diagnosis.signal_overview import SignalOverview, look, with_rows
from steelyard.diagnosis.signals.other_efforts import with_others
from steelyard.diagnosis.signals.slopes import noise_of
from steelyard.diagnosis.signals.units import driven, reading

LEVELS = 50
"""Different values of an effort below which it is doubtful."""
ROWS = 500
"""Rows below which levels are not counted."""
NOISY = 0.7
"""Noise from row to row over all that varies, from which on an effort is doubtful."""
FINER = Fix(
    "leave these joints out (joints = [...], [robot.locked]), or log them with finer resolution"
)
CONSTANT = Fix("declare the columns that hold measured efforts under [signals.effort]")
BUSY = 20.0
"""Length of the picture [s]."""


@dataclass(frozen=True)
class Noise:
    """Resolution and noise of every signal; efforts of few levels are doubtful, of one wrong."""

    name: ClassVar[str] = "noise"
    question: ClassVar[str] = "Are resolution and noise sufficient?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log that has rows."""
        return tuple(self._look(case, evidence) for evidence in with_rows(case))

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        overview = look(case, evidence)
        move = driven(case, evidence)
        levels = np.array([len(np.unique(column)) for column in overview.effort.T])
        noise = noise_of(overview.effort)
        spread = overview.effort.std(axis=0)
        share = np.divide(noise, spread, out=np.zeros_like(noise), where=spread > 0.0)
        constant = move & (levels == 1)
        coarse = move & (levels < LEVELS) & (len(overview.t) >= ROWS) & ~constant
        loud = move & (share > NOISY) & ~coarse
        bad = np.flatnonzero(constant | coarse | loud)
        seen = np.flatnonzero(move) if move.any() else np.arange(len(move))
        least, loudest = seen[np.argmin(levels[seen])], seen[np.argmax(share[seen])]
        units = evidence.recording.signals.effort_units
        return Finding(
            self.name,
            evidence.name,
            Severity.WRONG if constant.any() else Severity(int(len(bad) > 0)),
            "; ".join(
                [
                    *_constant(case, evidence, constant),
                    *_blamed(case, overview, coarse, loud, levels),
                    _facts(case, overview, noise, units),
                ]
            ),
            f"{case.joints[least]}: {levels[least]} distinct effort values (at least {LEVELS} "
            f"required); {case.joints[loudest]}: noise is {100.0 * share[loudest]:.2g} % of the "
            f"effort's variation (at most {100.0 * NOISY:g} % allowed)"
            + ("" if move.any() else "; efforts of joints at rest are not judged"),
            joints=tuple(case.joints[j] for j in bad),
            fix=with_others(CONSTANT if constant.any() else FINER, evidence) if len(bad) else None,
            picture=_picture(case, evidence, overview, int(bad[0] if len(bad) else least)),
        )


def _constant(case: Case, evidence: Evidence, constant: NDArray[np.bool_]) -> list[str]:
    columns = evidence.recording.signals.effort
    names = ", ".join(f"{case.joints[j]} (column '{columns[j]}')" for j in np.flatnonzero(constant))
    return [f"the effort of {names} never changes: it is not measured"] if names else []


def _blamed(
    case: Case,
    overview: SignalOverview,
    coarse: NDArray[np.bool_],
    loud: NDArray[np.bool_],
    levels: NDArray[np.intp],
) -> list[str]:
    clauses = []
    steps = overview.resolution[overview.channels.effort]
    for joint in np.flatnonzero(coarse):
        clauses.append(
            f"the effort of {case.joints[joint]} has only {levels[joint]} levels, "
            f"{steps[joint]:.2g} apart"
        )
    if loud.any():
        names = ", ".join(case.joints[j] for j in np.flatnonzero(loud))
        clauses.append(f"the effort of {names} is mostly noise")
    return clauses


def _facts(case: Case, overview: SignalOverview, noise: Array, units: tuple[str, ...]) -> str:
    c = overview.channels
    q, positions = noise_of(overview.q), case.loaded.robot.coordinates
    worst, loudest = int(np.argmax(q)), int(np.argmax(noise))
    return (
        f"positions: steps {_range(overview.resolution[c.q])}, noise up to {q[worst]:.1g} "
        f"{positions[worst].unit}; efforts: steps {_range(overview.resolution[c.effort])}, "
        f"noise up to {noise[loudest]:.2g} {units[loudest]} ({case.joints[loudest]})"
    )


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.1g}" if high <= 1.01 * low else f"{low:.1g} to {high:.1g}"


def _picture(case: Case, evidence: Evidence, overview: SignalOverview, joint: int) -> Picture:
    """The joint's effort in the middle of the log."""
    middle = 0.5 * (overview.t[0] + overview.t[-1])
    at = np.abs(overview.t - middle) <= 0.5 * BUSY / reading(case, evidence).second
    unit = evidence.recording.signals.effort_units[joint]
    t, effort = overview.t[at] - overview.t[0], overview.effort[at, joint]
    return Picture("time [s]", f"effort [{unit}]", (trace(case.joints[joint], t, effort),))
