"""The error of reduced models on data that neither their values nor their choice has seen.

Per fold the whole path is made again from the other folds: a parameter that was removed because
the left-out fold does not need it would make that fold's error too small [Hastie2009].
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.fold_errors import FEWEST, FOLDS, logarithms, standard_error
from steelyard.estimation.reduction.path import Path
from steelyard.estimation.reduction.state import FullModel
from steelyard.regression.information import Information

PathOf = Callable[[FullModel], Path]
"""The path of a full model."""


@dataclass(frozen=True, eq=False)
class LeftOutErrors:
    """Errors on left-out folds by the number of parameters.

    Attributes:
        sizes: Numbers of parameters, descending.
        errors: Relative error of each fold and effort row, shape `(folds, sizes, rows)` [%].
        logarithms: One value per fold and size: the mean of the logarithms of a typical row's
            error and of that of all rows together, shape `(folds, sizes)`.
        removed: How many folds had removed a parameter before the smallest model, by name and size.
        folds: What was left out in turn.
    """

    sizes: tuple[int, ...]
    errors: Array
    logarithms: Array
    removed: tuple[Counter[str], ...]
    folds: tuple[str, ...]

    @property
    def mean(self) -> Array:
        """Mean over folds and rows per size, shape `(sizes,)` [%]."""
        return np.asarray(self.errors.mean(axis=(0, 2)))

    @property
    def best(self) -> int:
        """Place of the size with the least error."""
        return int(np.argmin(self.logarithms.mean(axis=0)))

    @property
    def spread(self) -> Array:
        """Standard error over folds of the difference to the best size, shape `(sizes,)`.

        Of logarithms; folds differ far more from each other than sizes do within a fold, so the
        differences are what tells sizes apart.
        """
        apart = self.logarithms - self.logarithms[:, [self.best]]
        return np.array([standard_error(column) for column in apart.T])

    @property
    def rise(self) -> Array:
        """Mean difference of the logarithms to those of the best size, shape `(sizes,)`."""
        means = self.logarithms.mean(axis=0)
        return np.asarray(means - means[self.best])


def folds_of(information: Information) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Windows of every run, or of stretches with as many windows each where there is one run.

    Returns:
        Name and windows of each fold.

    Raises:
        DataError: There are too few windows to leave some out.
    """
    runs = list(dict.fromkeys(window.run for window in information.windows))
    places = range(len(information.windows))
    if len(runs) > 1:
        return tuple(
            (run, tuple(k for k in places if information.windows[k].run == run)) for run in runs
        )
    parts = [part for part in np.array_split(np.array(places), FOLDS) if len(part)]
    if len(parts) < FEWEST:
        raise DataError(
            "the run is too short to leave a part of it out",
            where=", ".join(runs) or "no run",
            fix="log longer or several runs, or reduce to a number of parameters",
        )
    names = (
        f"{information.windows[part[0]].start:.3g} to {information.windows[part[-1]].stop:.3g} s"
        for part in parts
    )
    return tuple((name, tuple(part.tolist())) for name, part in zip(names, parts, strict=True))


def left_out_errors(information: Information, path_of: PathOf) -> LeftOutErrors:
    """Errors of the models of a path, each fold predicted by a path of the others.

    Args:
        information: All data.
        path_of: The path that is followed.

    Raises:
        DataError: There are too few windows, or a fold needs all others to be fitted.
    """
    folds = folds_of(information)
    results = []
    for _name, mine in folds:
        others = [k for k in range(len(information.windows)) if k not in set(mine)]
        path = path_of(FullModel.of(information.of(others)))
        results.append((path, path_errors(path, information.of(mine))))
    sizes = _shared_sizes([path for path, _ in results])
    errors, logs, removed = [], [], [Counter[str]() for _ in sizes]
    for path, (found, squares) in results:
        at = [path.sizes.index(size) for size in sizes]
        errors.append(found[at])
        logs.append(logarithms(found[at], np.tile(squares, (len(at), 1))))
        for place, count in zip(at, removed, strict=True):
            count.update(step.name for step in path.steps[:place])
    return LeftOutErrors(
        sizes,
        frozen(np.stack(errors)),
        frozen(np.stack(logs)),
        tuple(removed),
        tuple(name for name, _ in folds),
    )


def _shared_sizes(paths: Sequence[Path]) -> tuple[int, ...]:
    """Sizes that all paths have, the greatest first."""
    shared = set(paths[0].sizes).intersection(*(path.sizes for path in paths))
    return tuple(sorted(shared, reverse=True))


def path_errors(path: Path, tested: Information) -> tuple[Array, Array]:
    """Relative errors of the models of a path on other data.

    Returns:
        Errors `(states, rows)` [%], and the squares of the rows' efforts `(rows,)`.
    """
    squares = tested.effort_squares()
    size = np.where(squares > 0.0, squares, np.inf)
    place = [tested.layout.columns.index(name) for name in path.full.names]
    errors = np.empty((len(path.states), len(squares)))
    for k, state in enumerate(path.states):
        values = np.zeros(len(tested.layout.columns))
        values[place] = state.all_values
        errors[k] = 100.0 * np.sqrt(tested.residual_squares(values) / size)
    return errors, squares
