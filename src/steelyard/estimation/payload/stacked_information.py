"""Information of several runs about different but related parameters, as one problem.

A run with a payload and one without see the same arm, but the payload in one only and friction of
their own day: old parameters of a run = its transform @ shared parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.regression.information import Information, Window, packed
from steelyard.regression.regressor import Layout

SEEN = 1e-10
"""Share of a parameter's information, left when all others are free, below which none is left."""

TOUCHED = 1e-4
"""Component along a direction that the data do not see, from which on a parameter is not seen."""

RANK = 1e-13
"""Relative eigenvalue of a scaled normal matrix below which a direction is left at zero."""


@dataclass(frozen=True, eq=False)
class Part:
    """One run, and how its columns' parameters follow from the shared ones.

    Attributes:
        information: What the run says.
        transform: Shape `(columns, shared)`.
    """

    information: Information
    transform: Array


def joined(parts: Sequence[Part], names: Sequence[str], units: Sequence[str]) -> Information:
    """All parts as information about the shared parameters, one window each.

    Sums of |column| are not known in the result.

    Raises:
        DataError: The parts differ in model, columns, effort unit or filters.
    """
    first = parts[0].information
    for part in parts[1:]:
        first.of(()) + part.information.of(())
    rows, sees = range(len(first.layout.rows)), []
    for row in rows:
        seen = list(first.layout.sees[row])
        touched = [np.any(part.transform[seen] != 0.0, axis=0) for part in parts]
        sees.append(tuple(int(k) for k in np.flatnonzero(np.any(touched, axis=0))))
    layout = Layout(tuple(names), tuple(units), first.layout.rows, tuple(sees))
    grams = [
        np.concatenate([packed(_mapped(part, row, sees[row])) for row in rows]) for part in parts
    ]
    windows = tuple(_window(part.information) for part in parts)
    signature = type(first.signature)(
        first.signature.model, tuple(names), first.signature.effort, first.signature.filters
    )
    return Information(
        layout,
        signature,
        windows,
        np.array(grams),
        np.full((len(parts), sum(layout.widths)), np.nan),
        np.array([part.information.n_samples for part in parts]),
    )


def _mapped(part: Part, row: int, seen: Sequence[int]) -> Array:
    """One row's Gram matrix of the shared parameters it sees, and the effort."""
    old = list(part.information.layout.sees[row])
    transform = np.zeros((len(old) + 1, len(seen) + 1))
    transform[:-1, :-1] = part.transform[np.ix_(old, list(seen))]
    transform[-1, -1] = 1.0
    return np.asarray(transform.T @ part.information.row_gram(row) @ transform)


def _window(information: Information) -> Window:
    runs = ", ".join(dict.fromkeys(w.run for w in information.windows))
    if not information.windows:
        raise DataError(
            "the run has no usable samples",
            where="information of a run",
            fix="leave the run out, or log a motion in which the joints move",
        )
    return Window(runs, information.windows[0].start, information.windows[-1].stop)


def inverse(matrix: Array) -> Array:
    """Inverse of a symmetric, non-negative matrix; directions without information stay at zero."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
    kept = values > RANK * values.max(initial=1e-300) * len(values)
    part = vectors[:, kept] / scale[:, None]
    return np.asarray((part / values[kept]) @ part.T)


def marginal(matrix: Array, chosen: Sequence[int]) -> Array:
    r"""Information left about some parameters when all others are free.

    The Schur complement $A_{cc} - A_{co} A_{oo}^{-1} A_{oc}$.
    """
    mine = list(chosen)
    others = [k for k in range(len(matrix)) if k not in set(mine)]
    cross = matrix[np.ix_(mine, others)]
    left = matrix[np.ix_(mine, mine)] - cross @ inverse(matrix[np.ix_(others, others)]) @ cross.T
    return np.asarray((left + left.T) / 2.0)


def seen_information(matrix: Array, chosen: Sequence[int]) -> Array:
    """The same without directions that the data do not see, which rounding leaves in it."""
    mine = list(chosen)
    size = np.sqrt(np.maximum(np.diag(matrix)[mine], 1e-300))
    values, vectors = np.linalg.eigh(marginal(matrix, mine) / size[:, None] / size)
    kept = vectors[:, values >= SEEN] * size[:, None]
    return np.asarray((kept * values[values >= SEEN]) @ kept.T)


def covariance_of(matrix: Array, chosen: Sequence[int]) -> Array:
    """Covariance of some parameters; rows of those that the data do not see are not numbers.

    Args:
        matrix: Information about all parameters, shape `(p, p)`.
        chosen: Those of interest, `c` of them.

    Returns:
        Shape `(c, c)`.
    """
    mine = list(chosen)
    size = np.sqrt(np.maximum(np.diag(matrix)[mine], 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(marginal(matrix, mine) / scale[:, None] / scale)
    null = values < SEEN
    kept = vectors[:, ~null] / scale[:, None]
    covariance = np.asarray((kept / values[~null]) @ kept.T)
    blind = np.linalg.norm(vectors[:, null], axis=1) > TOUCHED
    covariance[blind, :] = covariance[:, blind] = np.nan
    return covariance
