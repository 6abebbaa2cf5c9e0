"""Which constraints would have to be widened, and by how much, for a motion to be possible."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.problem import Problem
from steelyard.excitation.search.starts import NoMotion, postures

SIZE = 0.1
"""Size of a motion that is worth its name, over the largest that the limits of joints allow."""

_POSTURES = 12
_TRIES = 4
_SPARE = 1.05


@dataclass(frozen=True, eq=False)
class Lack:
    """By how much a constraint is missed.

    Attributes:
        constraint: The constraint.
        label: Which of its margins.
        amount: Positive, in its unit.
    """

    constraint: Constraint
    label: str
    amount: float

    def __str__(self) -> str:
        return f"{self.label} (violated by {self.amount:.3g} {self.constraint.unit})"

    @property
    def widened(self) -> str:
        """What would be enough."""
        return f"'{self.label}' by {rounded_up(_SPARE * self.amount)} {self.constraint.unit}"


def lacking(problem: Problem, places: Iterable[Array]) -> tuple[Lack, ...]:
    """What a small motion lacks that lacks as little as can be, worst first.

    A witness: with everything widened by that much, it is a motion that keeps all samples.

    Args:
        problem: What is designed.
        places: Postures to move about, each `(n,)`; a start that is given takes their place.
    """
    inequalities, random = problem.inequalities, np.random.default_rng(0)
    best: tuple[float, tuple[Lack, ...]] | None = None
    for place in places:
        still = problem.basis.still(place)
        room = inequalities.limit_margins(still)
        for _ in range(_TRIES):
            change = random.standard_normal(still.shape)
            rates = inequalities.margin_rates(change)
            most = np.min(room / np.maximum(-rates, 1e-12), axis=1)
            lacks = _lacks(problem, still + SIZE * most[:, None] * change)
            size = sum(lack.amount / _room(lack) for lack in lacks)
            if best is None or size < best[0]:
                best = size, lacks
    return () if best is None else best[1]


def explained(problem: Problem, error: NoMotion) -> DataError:
    """An error that no motion was found, with what would have to be widened if that is known."""
    random = np.random.default_rng(0)
    drawn = [p.posture for p in postures(problem.limits, problem.constraints, random, _POSTURES)]
    lacks = lacking(problem, drawn)
    if not lacks:
        return error
    return DataError(
        f"{error.wrong}; a motion of {SIZE:.0%} of the joints' ranges violates: "
        + "; ".join(str(lack) for lack in lacks[:4]),
        where="[excitation] " + names(lacks),
        fix=widen(lacks),
    )


def names(lacks: Sequence[Lack]) -> str:
    """Names of the constraints."""
    return " and ".join(dict.fromkeys(lack.constraint.name for lack in lacks))


def widen(lacks: Sequence[Lack]) -> str:
    """What to do about it."""
    return f"widen {' and '.join(lack.widened for lack in lacks)}, or more"


def rounded_up(value: float) -> str:
    """Three digits, rounded upwards."""
    digits = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return f"{np.ceil(value / digits) * digits:.3g}"


def _lacks(problem: Problem, x: Array) -> tuple[Lack, ...]:
    state = problem.inequalities.state(x)
    found = []
    for constraint in problem.constraints:
        least = constraint.margins(*state).values.min(axis=0)
        short = zip(constraint.labels, least, strict=True)
        found += [Lack(constraint, label, -float(v)) for label, v in short if v < 0.0]
    return tuple(sorted(found, key=lambda lack: -lack.amount / _room(lack)))


def _room(lack: Lack) -> float:
    return float(lack.constraint.activation_distance[lack.constraint.labels.index(lack.label)])
