"""Constraints that cannot hold together: found, and named."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.conic import Block, Conic, Unsolved, solved
from steelyard.estimate.consistent.penalties import ONE, ORDER, SCALE_WITHOUT_PRIOR, ten_map
from steelyard.estimate.prior.prior import Knowledge, Row
from steelyard.estimate.prior.prior_constraint import in_words
from steelyard.robot.rigid_body import INERTIAL_NAMES

MARGIN = 1e-4
"""What is still a body: least eigenvalue of a body's pseudo-inertia in the scale of its prior."""

_NEARLY = 1e-6


def refuse_contradictions(knowledge: Knowledge) -> None:
    """Stop at constraints that cannot hold together, with a set of which all are needed."""
    if labels := contradictions(knowledge):
        raise contradicting(labels)


def contradicting(labels: Sequence[str]) -> DataError:
    """The error for constraints that cannot hold together."""
    if len(labels) == 1:
        wrong, fix = f"no physical body satisfies this: {labels[0]}", "correct it, or leave it out"
    else:
        wrong = f"these constraints are infeasible together: {'; '.join(labels)}"
        fix = "correct one of them, or leave it out"
    return DataError(wrong, where="prior constraints", fix=fix)


def contradictions(knowledge: Knowledge) -> tuple[str, ...]:
    """Labels of constraints and bounds that cannot hold together for any bodies.

    They can if any one is left out; empty if all can hold, or the solver cannot decide.
    """
    bodies = _Bodies(knowledge)
    rows = (*_bounds(knowledge), *knowledge.rows)
    if not knowledge.rows or bodies.allow(rows):
        return ()
    return tuple(dict.fromkeys(row.label for row in irreducible(rows, bodies.allow)))


def irreducible(
    rows: Sequence[Row], feasible: Callable[[tuple[Row, ...]], bool]
) -> tuple[Row, ...]:
    """Rows that cannot hold together, but can if any one label's are left out [Chinneck1991].

    Rows with one label are one constraint and stay together. Many are left out at once, and a half
    of them where that is too many; earlier ones first. `feasible`, whether rows can hold, is called
    about `2 k log2(n / k)` times for `k` of `n` labels. Empty if not even no row can hold.
    """
    kept, parts = tuple(rows), [tuple(dict.fromkeys(row.label for row in rows))]
    while parts:
        part = parts.pop()
        others = tuple(row for row in kept if row.label not in part)
        if not feasible(others):
            kept = others
        elif len(part) > 1:
            half = len(part) // 2
            parts += [part[half:], part[:half]]
    return kept


def _bounds(knowledge: Knowledge) -> tuple[Row, ...]:
    """Bounds of the parameters but those of bodies."""
    bodies = {f"{kind}.{name}" for kind in INERTIAL_NAMES for name in knowledge.bodies}
    bounds = zip(knowledge.names, knowledge.lower.tolist(), knowledge.upper.tolist(), strict=True)
    return tuple(
        Row(f"'{name}' is {in_words((low, high))} by its law", {name: 1.0}, low, high)
        for name, low, high in bounds
        if name not in bodies and (np.isfinite(low) or np.isfinite(high))
    )


@dataclass(frozen=True, eq=False)
class _Bodies:
    r"""What physically consistent bodies allow: the least slack with which all rows hold.

    Each row, in units of its length, may fail by $s$, and so may $X \succeq \delta 1$ of every
    body's pseudo-inertia $L X L^T$ in the scale $L$ of its prior. Such values always exist, so the
    solver never has to prove that there are none.
    """

    knowledge: Knowledge

    def allow(self, rows: tuple[Row, ...]) -> bool:
        """Whether rows can hold."""
        if not rows:
            return True
        count = self._scale.shape[1]
        blocks = (self._planes(rows), *map(self._body, range(len(self.knowledge.bodies))))
        least = Conic(np.zeros(count + 1), np.eye(count + 1)[count], blocks)
        try:
            return bool(solved(least, "prior constraints")[count] < _NEARLY)
        except Unsolved:
            return True

    def _planes(self, rows: tuple[Row, ...]) -> Block:
        """All rows with slack, and a slack that is not below -1."""
        names = self.knowledge.names
        matrix = np.array([[row.coefficients.get(name, 0.0) for name in names] for row in rows])
        matrix = matrix @ self._scale
        sizes = np.linalg.norm(matrix, axis=1)
        matrix = matrix / sizes[:, None]
        lower, upper = np.array([(row.lower, row.upper) for row in rows]).T / sizes
        above, below = np.isfinite(lower), np.isfinite(upper)
        planes = np.vstack([-matrix[above], matrix[below], np.zeros(matrix.shape[1])])
        offset = np.concatenate([-lower[above], upper[below], [1.0]])
        planes = np.column_stack([planes, -np.ones(len(planes))])
        return Block("nonnegative", np.arange(planes.shape[1]), planes, offset)

    def _body(self, body: int) -> Block:
        """A physically consistent body, with slack."""
        columns = np.array([*range(10 * body, 10 * body + 10), self._scale.shape[1]])
        matrix = -np.column_stack([np.diag(np.sqrt(2.0 - ONE)), ONE])
        return Block("semidefinite", columns, matrix, -MARGIN * ONE, ORDER)

    @cached_property
    def _scale(self) -> Array:
        """Parameters per unknown: entries of every `X`, then the others as they are."""
        count = len(self.knowledge.bodies)
        tens = [self.knowledge.tens(body) for body in range(count)]
        inside = {k for ten in tens for k in ten}
        others = [k for k in range(len(self.knowledge.names)) if k not in inside]
        scale = np.zeros((len(self.knowledge.names), 10 * count + len(others)))
        for body, ten in enumerate(tens):
            part = ten_map(self.knowledge.priors[body] or SCALE_WITHOUT_PRIOR)
            scale[ten, 10 * body : 10 * body + 10] = part
        scale[others, 10 * count + np.arange(len(others))] = 1.0
        return scale
