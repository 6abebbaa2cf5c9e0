"""Leave one out: how well a model predicts what it was not fitted to, from information alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimator
from steelyard.estimation.fold_errors import FEWEST, FOLDS
from steelyard.measurement.run import Run
from steelyard.regression.information import Information, Window

LEAST = 0.005
"""Gain of an error that is worth another parameter, relative to it."""

STILL = 0.05
"""Speed of a joint in a run, over its greatest in any, up to which it does not move there."""

Fold = Callable[[Window], bool]
"""Whether a window belongs to a fold."""


def folds_of(runs: Sequence[Run]) -> tuple[Fold, ...]:
    """One fold per run; a single run is divided into `FOLDS` stretches of equal length.

    Raises:
        DataError: Two runs have one name: what is left out would be fitted with the other.
    """
    _refuse_one_name(runs)
    if len(runs) > 1:
        return tuple(_of_run(run.name) for run in runs)
    return tuple(_between(part.start, part.stop) for part in stretches_of(runs[0]))


def _refuse_one_name(runs: Sequence[Run]) -> None:
    names = [run.name for run in runs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise DataError(
            f"{names.count(twice[0])} runs are called '{twice[0]}'",
            where="runs of the cross-validation",
            fix="give every run a name of its own",
        )


@dataclass(frozen=True)
class Folding:
    """How data are divided into parts that are left out in turn.

    Attributes:
        left_out: Whether a part is a run, or a stretch of every run.
        longest: Length of windows that parts can be made of [s].
    """

    left_out: Literal["run", "segment"]
    longest: float

    def parts(self, moving: Information) -> tuple[Fold, ...]:
        """The parts with motion: runs, or stretches with as much of it each.

        Args:
            moving: What runs say where joints move, in windows that are short enough.
        """
        names = tuple(dict.fromkeys(window.run for window in moving.windows))
        if self.left_out == "run":
            return tuple(_of_run(name) for name in names)
        edges = {name: _edges(moving, name) for name in names}
        parts = (
            _of_stretches({name: found[k : k + 2] for name, found in edges.items()})
            for k in range(FOLDS)
        )
        return tuple(part for part in parts if any(map(part, moving.windows)))


def folding(runs: Sequence[Run]) -> Folding:
    """Parts of which each leaves motion of every joint to be fitted.

    Where a joint moves in one run only, without that run nothing identifies its friction: then a
    stretch of every run is left out.

    Raises:
        DataError: Two runs have one name.
    """
    _refuse_one_name(runs)
    speeds = np.array([run.quality.max_speed for run in runs])
    once = ((speeds > STILL * speeds.max(axis=0)).sum(axis=0) == 1).any()
    if len(runs) > 1 and not once:
        return Folding("run", float("inf"))
    return Folding("segment", min(longest_window([run]) for run in runs))


def _edges(moving: Information, run: str) -> list[float]:
    """Times that divide a run into stretches with as much motion each."""
    mine = [k for k, window in enumerate(moving.windows) if window.run == run]
    before = np.cumsum([0.0, *moving.counts[mine].sum(axis=1)])
    at = np.searchsorted(before, before[-1] * np.arange(1, FOLDS) / FOLDS)
    starts = [moving.windows[k].start for k in mine] + [np.inf]
    return [-np.inf, *(starts[k] for k in at), np.inf]


def _of_stretches(edges: Mapping[str, Sequence[float]]) -> Fold:
    def has(window: Window) -> bool:
        start, stop = edges.get(window.run, (np.inf, np.inf))
        return start <= 0.5 * (window.start + window.stop) < stop

    return has


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
        DataError: There is nothing in a fold, or less than two folds.
    """
    groups = [[k for k, w in enumerate(information.windows) if fold(w)] for fold in folds]
    if len(groups) < FEWEST or not all(groups):
        raise too_short(information)
    return information.grouped(groups)


class TooShortError(DataError):
    """There is nothing in a part of a run that is to be left out."""


def too_short(information: Information) -> TooShortError:
    """What to say where nothing can be left out."""
    return TooShortError(
        "the run is too short to leave a part of it out",
        where=", ".join(dict.fromkeys(w.run for w in information.windows)),
        fix='log longer or several runs, or name the friction laws instead of "auto"',
    )


def values_by(estimator: Estimator[Information]) -> Callable[[Information], Array]:
    """Values of an information's columns that an estimator finds, zero of what it does not see."""

    def values(information: Information) -> Array:
        known = estimator(information).parameters.as_dict()
        return np.array([known.get(name, 0.0) for name in information.layout.columns])

    return values


def left_out_errors(
    fitted: Information,
    tested: Information,
    values: Callable[[Information], Array],
    only: Sequence[int] | None = None,
) -> Array:
    r"""Relative errors of each fold, predicted from all others, shape `(folds, rows)` [%].

    $100\,\|y - A\hat\phi\| / \|y\|$ per effort row behind the parallel filter.

    Args:
        fitted: One window per fold, to fit.
        tested: The same folds, to be predicted; its columns are those fitted.
        values: Values of an information's columns, fitted to it.
        only: Folds that are predicted; all if `None`.
    """
    count = len(fitted.windows)
    wanted = range(count) if only is None else only
    errors = np.empty((len(wanted), len(tested.layout.rows)))
    for place, fold in enumerate(wanted):
        known = values(fitted.of([k for k in range(count) if k != fold]))
        left_out = tested.of([fold])
        sizes = left_out.effort_squares()
        shares = left_out.residual_squares(known) / np.where(sizes > 0.0, sizes, np.inf)
        errors[place] = 100.0 * np.sqrt(shares)
    return frozen(errors)


def _of_run(name: str) -> Fold:
    return lambda window: window.run == name


def _between(start: float, stop: float) -> Fold:
    return lambda window: start <= 0.5 * (window.start + window.stop) < stop
