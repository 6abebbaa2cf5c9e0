"""Leave one out: how well a model predicts what it was not fitted to, from information alone."""

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.measurement.run import Run
from steelyard.regression.information import Information, Window

FOLDS = 5
"""Stretches that a single run is divided into."""

Fold = Callable[[Window], bool]
"""Whether a window belongs to a fold."""


def folds_of(runs: Sequence[Run]) -> tuple[Fold, ...]:
    """One fold per run; a single run is divided into `FOLDS` stretches of equal length.

    Raises:
        DataError: Two runs have one name: what is left out would be fitted with the other.
    """
    names = [run.name for run in runs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise DataError(
            f"{names.count(twice[0])} runs are called '{twice[0]}'",
            where="runs that are left out in turn",
            mend="give every run a name of its own",
        )
    if len(runs) > 1:
        return tuple(_of_run(name) for name in names)
    return tuple(_between(part.start, part.stop) for part in stretches_of(runs[0]))


def stretches_of(run: Run) -> tuple[Window, ...]:
    """Stretches of equal length; the first and the last have no outer end."""
    edges = np.linspace(*run.span, FOLDS + 1).tolist()
    edges[0], edges[-1] = -np.inf, np.inf
    return tuple(Window(run.name, a, b) for a, b in zip(edges[:-1], edges[1:], strict=True))


def longest_window(runs: Sequence[Run]) -> float:
    """Length of windows that folds can be made of [s]."""
    if len(runs) > 1:
        return float("inf")
    return (runs[0].span[1] - runs[0].span[0]) / (8.0 * FOLDS)


def per_fold(information: Information, folds: Sequence[Fold]) -> Information:
    """One window per fold, in their order.

    Raises:
        DataError: There is nothing in a fold.
    """
    groups = [[k for k, w in enumerate(information.windows) if fold(w)] for fold in folds]
    if not all(groups):
        raise DataError(
            "a run is too short to leave a part of it out",
            where=", ".join(dict.fromkeys(w.run for w in information.windows)),
            mend='log longer or several runs, or name the friction laws instead of "auto"',
        )
    return information.grouped(groups)


def left_out_errors(
    fitted: Information,
    tested: Information,
    estimator: Callable[[Information], Estimate],
) -> Array:
    r"""Relative errors of each fold, predicted from all others, shape `(folds, rows)` [%].

    $100\,\|y - A\hat\phi\| / \|y\|$ per effort row behind the matched filter.

    Args:
        fitted: One window per fold, to fit.
        tested: The same folds, to be predicted; its columns are those fitted.
        estimator: The estimator.
    """
    count = len(fitted.windows)
    errors = np.empty((count, len(tested.layout.rows)))
    for fold in range(count):
        estimate = estimator(fitted.of([k for k in range(count) if k != fold]))
        known = estimate.parameters.as_dict()
        values = np.array([known.get(name, 0.0) for name in tested.layout.columns])
        held = tested.of([fold])
        sizes = held.effort_squares()
        shares = held.residual_squares(values) / np.where(sizes > 0.0, sizes, np.inf)
        errors[fold] = 100.0 * np.sqrt(shares)
    return frozen(errors)


def _of_run(name: str) -> Fold:
    return lambda window: window.run == name


def _between(start: float, stop: float) -> Fold:
    return lambda window: start <= 0.5 * (window.start + window.stop) < stop
