"""Errors on parts of the data that are left out in turn: one value per part, its standard error."""

import numpy as np

from steelyard.arrays import Array

FOLDS = 5
"""Stretches that a single run is divided into."""

FEWEST = 2
"""Parts that must be left out."""


def logarithms(errors: Array, sizes: Array) -> Array:
    """One figure per fold: between the typical joint's error and that of all joints together.

    The former alone would let joints that carry next to nothing decide, the latter would leave
    all but the strongest out.

    Args:
        errors: Relative errors, shape `(folds, rows)`.
        sizes: Squares of the efforts, shape `(folds, rows)`; zero of rows that do not count.

    Returns:
        Logarithms of relative errors, shape `(folds,)`.
    """
    least, known = 1e-12, sizes > 0.0
    each = np.where(known, np.log(np.maximum(errors, least)), 0.0)
    typical = each.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    pooled = np.sqrt((np.square(errors) * sizes).sum(axis=1) / sizes.sum(axis=1))
    return np.asarray(0.5 * (typical + np.log(np.maximum(pooled, least))))


def standard_error(values: Array) -> float:
    """Standard error of a mean."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0
