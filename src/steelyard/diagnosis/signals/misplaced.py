"""Declared position columns that hold velocities: by their values, or by their names."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import EXCERPT, Case, Evidence
from steelyard.diagnosis.signal_overview import look, once
from steelyard.diagnosis.signals.agreement import ALIKE
from steelyard.diagnosis.signals.slopes import slope, smooth
from steelyard.diagnosis.signals.units import reading
from steelyard.robot_file.column_names import Column

RATES = ("s", "rpm", "rads", "degs")
"""Last words of the units of velocities."""


@dataclass(frozen=True)
class Misplaced:
    """A position column that holds velocities.

    Attributes:
        joint: Number of its joint.
        column: Its name.
        correlation: With the derivative of `position`; 0 where only the name says so.
        position: The column that holds the positions; empty if none is known.
    """

    joint: int
    column: str
    correlation: float
    position: str

    @property
    def sure(self) -> bool:
        """Whether its values, or the unit in its name, are those of a velocity."""
        return self.correlation > 0.0 or Column(self.column).unit_words[-1:] in [
            (w,) for w in RATES
        ]


@once
def misplaced(case: Case, evidence: Evidence) -> tuple[Misplaced, ...]:
    """Position columns that are derivatives of a column beside them, or are called velocities.

    Columns beside one are called alike but for words of positions, velocities and units.
    """
    signals = evidence.recording.signals
    beside = [_beside(name, evidence.log.columns) for name in signals.position]
    if not any(beside) and not any(map(_called_velocity, signals.position)):
        return ()
    found = []
    for joint, (name, others) in enumerate(zip(signals.position, beside, strict=True)):
        own, of_own = _correlations(case, evidence, joint, others)
        best = int(np.argmax(own)) if len(own) else 0
        either = len(own) > 0 and of_own[best] >= ALIKE  # motion of one frequency
        if len(own) and own[best] >= ALIKE and (not either or _called_velocity(name)):
            found.append(Misplaced(joint, name, float(own[best]), others[best]))
        elif _called_velocity(name) and not (of_own >= ALIKE).any():
            free = [c for c in others if c not in signals.columns]
            positions = [c for c in free if Column(c).quantity == "position"]
            found.append(Misplaced(joint, name, 0.0, positions[0] if len(positions) == 1 else ""))
    return tuple(found)


def _called_velocity(name: str) -> bool:
    return Column(name).quantity == "velocity"


def _beside(name: str, columns: Sequence[str]) -> list[str]:
    """Positions and velocities that are called as a column is."""
    stem = Column(name).stem
    others = [Column(c) for c in columns if c != name]
    return [c.name for c in others if c.quantity in ("position", "velocity") and c.stem == stem]


def _correlations(
    case: Case, evidence: Evidence, joint: int, others: Sequence[str]
) -> tuple[Array, Array]:
    """Of a joint's positions with the others' derivatives, and size of the derivative's with them.

    In motion of one frequency positions are opposite to derivatives of their velocities, so the
    sign of the former counts. Zero where positions are of motors behind coupled gears, or nothing
    moves.
    """
    overview, start = look(case, evidence), evidence.window[0]
    none = np.zeros(len(others)), np.zeros(len(others))
    if not others or evidence.recording.signals.position_map is not None:
        return none
    rows = (start, start + len(overview.kept))
    values = np.concatenate(list(evidence.log.parts(others, rows, EXCERPT)))[overview.kept]
    values = np.where(np.isfinite(values), values, 0.0)
    mine = overview.q[:, joint : joint + 1]
    even, rate = overview.even(
        np.concatenate((mine, values), axis=1), reading(case, evidence).second
    )
    if not even:
        return none
    x = np.concatenate([smooth(part, rate) for part in even], axis=1)
    v = np.concatenate([slope(part, rate) for part in even], axis=1)
    return _alike(x[:1], v[1:]), np.abs(_alike(v[:1], x[1:]))


def _alike(one: Array, others: Array) -> Array:
    """Correlation of one signal `(1, N)` with others `(m, N)`, shape `(m,)`."""
    a, b = (x - x.mean(axis=1, keepdims=True) for x in (one, others))
    size = np.sqrt(np.square(a).sum(axis=1) * np.square(b).sum(axis=1))
    found: Array = np.divide((a * b).sum(axis=1), size, out=np.zeros(len(b)), where=size > 0.0)
    return found
