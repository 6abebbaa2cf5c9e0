"""Parameters that a bound holds, and what is known before the data that the data contradict."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.consistent.program import ConicConstraints, Program

NEAR, BEYOND = 1e-3, 1e-3
"""Distance to a bound, and distance beyond it at the data's optimum, in standard deviations, at
which it counts as active."""

CONTRADICTED = 2.0
"""Standard deviations by which data violate a constraint that they contradict."""

FAR = 1e3
"""Size of a constraint to be checked, in units of a body's prior or of the whole effort."""

NAMED = 3
"""Constraints that are named: those that the data contradict most."""


@dataclass(frozen=True, eq=False)
class ActiveBounds:
    """Unknowns with those that a bound holds put onto it, and those not identifiable to zero.

    Attributes:
        u: The unknowns.
        names: Standard parameters that a bound holds.
    """

    u: Array
    names: tuple[str, ...]


def active_bounds(program: Program, u: Array, covariance: Array) -> ActiveBounds:
    """Find the parameters that a bound of their own holds.

    Args:
        program: The program.
        u: Its optimum, shape `(m,)`.
        covariance: Of the unknowns, shape `(m, m)`.
    """
    known, constraints = program.unknowns, program.constraints
    slope = known.matrix.T @ (known.matrix @ u - known.vector) + known.weak * u
    own = (np.count_nonzero(constraints.matrix, axis=1) == 1) & ~constraints.equal
    first = 10 * len(known.priors)
    at, names = u.copy(), []
    for number in np.flatnonzero(own):
        k = int(np.argmax(np.abs(constraints.matrix[number])))
        if k < first:
            continue
        sign, std = constraints.matrix[number, k], float(np.sqrt(max(covariance[k, k], 0.0)))
        for bound, outward in ((constraints.lower[number], 1.0), (constraints.upper[number], -1.0)):
            slack = outward * (sign * u[k] - bound)
            if slack <= NEAR * std and outward * sign * slope[k] * std >= BEYOND:
                at[k] = sign * bound
                names.append(known.names[known.terms[k - first]])
    for k in _unidentifiable(program):
        alone = constraints.matrix[:, k] != 0.0
        both = np.array([constraints.lower[alone], constraints.upper[alone]])
        edges = np.sort(both / constraints.matrix[alone, k], axis=0)
        at[k] = np.clip(0.0, edges[0].max(initial=-np.inf), edges[1].min(initial=np.inf))
    return ActiveBounds(at, tuple(dict.fromkeys(names)))


def _unidentifiable(program: Program) -> list[int]:
    """Unknowns of terms that neither data nor constraints on several parameters identify."""
    several = program.constraints.matrix[np.count_nonzero(program.constraints.matrix, axis=1) > 1]
    identified = np.any(program.unknowns.matrix != 0.0, axis=0) | np.any(several != 0.0, axis=0)
    first = 10 * len(program.unknowns.priors)
    return [k for k in range(first, len(identified)) if not identified[k]]


def contradicted(program: Program, free: Array, covariance: Array) -> tuple[str, ...]:
    """Constraints of the user that the data contradict, with the values without them.

    Args:
        program: The program with the constraints.
        free: The unknowns at the optimum without them, shape `(m,)`.
        covariance: Of these, shape `(m, m)`.
    """
    constraints, known = program.constraints, program.unknowns
    found: dict[str, tuple[float, float]] = {}
    values = constraints.matrix @ free
    squares = np.einsum("rm,mn,rn->r", constraints.matrix, covariance, constraints.matrix)
    stds = np.sqrt(np.maximum(squares, 0.0))
    standard = dict(zip(known.names, known.standard(free).tolist(), strict=True))
    for row, value, std, low, high in zip(
        constraints.rows, values, stds, constraints.lower, constraints.upper, strict=True
    ):
        missed = max(low - value, value - high)
        if missed <= CONTRADICTED * std or missed <= 0.0:
            continue
        worth = missed / max(std, 1e-300)
        data = sum(factor * standard[name] for name, factor in row.coefficients.items())
        if row.label not in found or worth > found[row.label][0]:
            found[row.label] = (worth, data)
    order = sorted(found, key=lambda label: -found[label][0])
    return _named(order, [found[label][1] for label in order])


def far_constraints(constraints: ConicConstraints) -> tuple[str, ...]:
    """Constraints of sizes that hardly any parameter has, for messages."""
    sizes = np.where(np.isfinite(constraints.lower), np.abs(constraints.lower), 0.0)
    sizes = np.maximum(
        sizes, np.where(np.isfinite(constraints.upper), np.abs(constraints.upper), 0.0)
    )
    found = [row.label for row, size in zip(constraints.rows, sizes, strict=True) if size > FAR]
    return tuple(dict.fromkeys(found))[:NAMED]


def _named(labels: Sequence[str], values: Sequence[float]) -> tuple[str, ...]:
    """The first few with what the data would have."""
    lines = [
        f"{label}: {value:.4g} without it"
        for label, value in list(zip(labels, values, strict=True))[:NAMED]
    ]
    rest = len(labels) - NAMED
    return (*lines, *([f"and {rest} more"] if rest > 0 else []))
