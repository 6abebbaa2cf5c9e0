r"""Backward elimination: which base parameter is removed next; errors of a path on left-out data.

All states of a path share the weights of the full model's rows, $1/\sigma_j^2$ or all the same:
with weights that followed each removal, a row that lost a parameter would count less, and the next
removal there would seem cheaper than it is.

Per fold the whole path is made again from the other folds: a parameter that was removed because
the left-out fold does not need it would make that fold's error too small [Hastie2009].
"""

from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Removed, Unidentifiable
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import scatter, score_covariance
from steelyard.estimate.least_squares.normal_equations import condition_of, unit_length
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores import cross_validation


@dataclass(frozen=True, eq=False)
class FullModel:
    """The data of a full model, and the weights that its least squares found."""

    information: Information  # the data, in the columns that they show, `p` of them
    # residual variance per effort row of the full model, or their mean if rows weigh the same
    variances: Array  # `(rows,)`
    factors: Array  # how many times more the estimate scatters than by white residuals, `(rows,)`
    matrix: Array  # normal matrix $A^T W A$, columns of unit length, `(p, p)`
    vector: Array  # $A^T W b$ of the same columns, `(p,)`
    scores: Array  # covariance of that vector with the factors, `(p, p)`
    lengths: Array  # lengths of the weighted columns, `(p,)`
    blind: tuple[Unidentifiable, ...]  # columns that the data do not show; they have no value

    @property
    def method(self) -> str:
        """How it is estimated, in words."""
        if len(self.variances) > 1 and np.ptp(self.variances) == 0.0:
            return "ordinary least squares (all joints weigh the same)"
        return "weighted least squares"

    @classmethod
    def of(cls, information: Information, *, equal: bool = False) -> "FullModel":
        """Weighted least squares of all columns that the data show; `equal` weighs rows alike."""
        blind = WeightedLeastSquares().fit(information).blind
        hidden = {one.name for one in blind}
        shown = [name for name in information.layout.columns if name not in hidden]
        seen = information.select(shown) if blind else information
        fit = WeightedLeastSquares().fit(seen)
        factors = scatter(fit)
        variances, counts = fit.variances, seen.n_samples
        if equal:
            variances = np.full(len(counts), variances @ counts / counts.sum())
        matrix, vector, _ = seen.normal(1.0 / variances)
        unit, lengths = unit_length(matrix)
        return cls(
            seen,
            variances,
            factors,
            frozen(unit),
            frozen(vector / lengths),
            frozen(score_covariance(fit, factors, 1.0 / variances) / lengths[:, None] / lengths),
            frozen(lengths),
            blind,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that the data show."""
        return self.information.layout.columns

    @cached_property
    def norms(self) -> Array:
        """Norms of the unweighted columns over all rows and samples, shape `(p,)`."""
        matrix, _, _ = self.information.normal()
        return np.sqrt(np.maximum(np.diag(matrix), 0.0))

    @cached_property
    def means(self) -> Array:
        """Means of |column| over all rows and samples, shape `(p,)`."""
        return np.asarray(self.information.absolute_sums() / self.information.n_samples.sum())


@dataclass(frozen=True, eq=False)
class State:
    """A reduced model, all other columns being zero."""

    full: FullModel
    active: tuple[int, ...]  # indices of the columns that are left, ascending, `k` of them

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are left."""
        return tuple(self.full.names[k] for k in self.active)

    @cached_property
    def _inverse(self) -> Array:
        """Inverse normal matrix of columns of unit length, shape `(k, k)`."""
        return frozen(np.linalg.inv(self.full.matrix[np.ix_(self.active, self.active)]))

    @cached_property
    def _unit_values(self) -> Array:
        return np.asarray(self._inverse @ self.full.vector[list(self.active)])

    @property
    def values(self) -> Array:
        """Values of the parameters that are left, shape `(k,)`."""
        return self._unit_values / self.full.lengths[list(self.active)]

    @property
    def all_values(self) -> Array:
        """Values of all columns, zero where removed, shape `(p,)`."""
        values = np.zeros(len(self.full.names))
        values[list(self.active)] = self.values
        return values

    @cached_property
    def ratios(self) -> Array:
        r"""$|\theta_i| / \sigma_i$ with white residuals, shape `(k,)`."""
        return np.abs(self._unit_values) / np.sqrt(np.diag(self._inverse))

    @cached_property
    def losses(self) -> Array:
        r"""Rise of $\chi^2$ by each removal, $\theta_i^2 / C_{ii}$, shape `(k,)`.

        All others are refitted; $C$ counts the correlation of residuals, so that a parameter that
        is zero in truth has a loss of one on average.
        """
        inverse = self._inverse
        scores = self.full.scores[np.ix_(self.active, self.active)]
        variances = np.einsum("ij,jk,ki->i", inverse, scores, inverse, optimize=True)
        return np.asarray(np.square(self._unit_values) / np.maximum(variances, 1e-300))

    @cached_property
    def squares(self) -> Array:
        """Sum of squared residuals per effort row, shape `(rows,)`."""
        return self.full.information.residual_squares(self.all_values)

    @property
    def rms(self) -> Array:
        """Root mean square of the residuals per effort row, shape `(rows,)` [Nm; N]."""
        return np.sqrt(self.squares / np.maximum(self.full.information.n_samples, 1.0))

    @cached_property
    def condition(self) -> float:
        """Condition number of the weighted columns at unit length."""
        return condition_of(self.full.matrix[np.ix_(self.active, self.active)])

    @property
    def chi_square(self) -> float:
        """Squared residuals in variances that count their correlation."""
        full = self.full
        return float(np.sum(self.squares / (full.variances * np.maximum(full.factors, 1.0))))


@dataclass(frozen=True)
class Criterion:
    """A measure of what a parameter is worth to a model."""

    name: str  # short name, as options know it
    about: str  # what it is, in a few words
    heading: str  # what a table calls its values
    # worth of each parameter that is left, `(k,)`; the least one is removed
    worth: Callable[[State], Array]


def _contribution(state: State) -> Array:
    r"""$|p_j|\,\|w_j\|$ over their sum."""
    torque = np.abs(state.values) * state.full.norms[list(state.active)]
    return np.asarray(torque / max(float(torque.sum()), 1e-300))


CRITERIA: tuple[Criterion, ...] = (
    Criterion(
        "loss", "rise of χ² by the removal, residuals correlated", "Loss", lambda s: s.losses
    ),
    Criterion(
        "contribution",
        "relative torque contribution [Wang], eqs. 6 to 9",
        "Relative contribution",
        _contribution,
    ),
    Criterion(
        "mean_column",
        "mean absolute column of the regressor [Volkmann], eq. 10",
        "Mean |column|",
        lambda s: s.full.means[list(s.active)],
    ),
    Criterion(
        "deviation", "value over standard deviation [Pham1991]", "Value / std", lambda s: s.ratios
    ),
)
"""All criteria, the default one first."""

Accepts = Callable[[State, State], bool]  # whether the full model may shrink to the other


@dataclass(frozen=True, eq=False)
class Path:
    """Models from the first one, without what was requested to go, to the smallest."""

    states: tuple[State, ...]  # the models; each has one parameter less than the one before
    steps: tuple[Removed, ...]  # what was removed from each but the last
    essential: tuple[str, ...]  # parameters without which a model was refused, or that had to stay
    requested: tuple[Removed, ...] = ()  # what the first model lacks already, whatever it is worth

    @property
    def full(self) -> FullModel:
        """The full model."""
        return self.states[0].full

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of parameters of each model."""
        return tuple(len(state.active) for state in self.states)


def backward(
    full: FullModel,
    criterion: Criterion,
    *,
    keep: Collection[str] = (),
    drop: Collection[str] = (),
    accepts: Accepts = lambda full, smaller: True,
) -> Path:
    """Backward stepwise selection, [Volkmann] algorithm 1 for any criterion.

    In each step the parameter that is worth least, and is not essential, is removed and the
    others are refitted. Where `accepts` refuses the smaller model, the parameter becomes essential
    instead. The path ends where all parameters that are left are essential, or one is left.
    Parameters to drop are removed first, whatever they are worth.
    """
    complete = state = State(full, tuple(range(len(full.names))))
    essential, wanted = dict.fromkeys(keep), set(drop)
    if wanted.issuperset(full.names):
        wrong = "all parameters that the data show are to be removed"
        fix = "remove fewer"
        raise DataError(wrong, where=", ".join(full.names[:4]), fix=fix)
    requested, steps = list[Removed](), list[Removed]()
    while free := [name for name in state.names if name in wanted]:
        step, state = _without_least(state, free, criterion)
        requested.append(step)
    states = [state]
    while len(state.active) > 1:
        if not (free := [name for name in state.names if name not in essential]):
            break
        step, smaller = _without_least(state, free, criterion)
        if accepts(complete, smaller):
            state = smaller
            states.append(state)
            steps.append(step)
        else:
            essential[step.name] = None
    return Path(tuple(states), tuple(steps), tuple(essential), tuple(requested))


def _without_least(
    state: State, free: Collection[str], criterion: Criterion
) -> tuple[Removed, State]:
    """The removal of the parameter that is worth least of some, and the model without it."""
    worth = criterion.worth(state)
    place = min((state.names.index(name) for name in free), key=lambda k: worth[k])
    name, number = state.names[place], len(state.full.names) - len(state.active) + 1
    cost, own = float(state.losses[place]), float(worth[place])
    step = Removed(name, number, cost, criterion.name, own)
    return step, State(state.full, (*state.active[:place], *state.active[place + 1 :]))


PathOf = Callable[[FullModel], Path]  # the path of a full model


@dataclass(frozen=True, eq=False)
class LeftOutErrors:
    """Errors on left-out folds by the number of parameters."""

    sizes: tuple[int, ...]
    errors: Array  # relative error of each fold and effort row, `(folds, sizes, rows)` [%]
    # one value per fold and size: the mean of the logarithms of a typical row's error and of that
    # of all rows together, `(folds, sizes)`
    logarithms: Array
    # how many folds had removed a parameter before the smallest model, by name and size
    removed: tuple[Counter[str], ...]
    folds: tuple[str, ...]  # what was left out in turn

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
        return np.array([cross_validation.standard_error(column) for column in apart.T])

    @property
    def rise(self) -> Array:
        """Mean difference of the logarithms to those of the best size, shape `(sizes,)`."""
        means = self.logarithms.mean(axis=0)
        return np.asarray(means - means[self.best])

    @property
    def joint_rise(self) -> Array:
        """Relative rise of each row's error to the largest model's, shape `(sizes, rows)`.

        Geometric means over folds, so that a joint with hardly any effort in a fold does not hide
        what becomes worse in the others.
        """
        means = np.log(np.maximum(self.errors, 1e-9)).mean(axis=0)
        return np.asarray(np.expm1(means - means[0]))

    def worse(self, size: int, tolerance: float) -> tuple[tuple[int, float], ...]:
        """Rows whose error rises by more than the tolerance, and by how much, at a size."""
        rises = self.joint_rise[self.sizes.index(size)] if size in self.sizes else ()
        return tuple((k, float(rise)) for k, rise in enumerate(rises) if rise > tolerance)


RISE = 0.05  # relative rise of a joint's left-out error that a removal may cost by default


def folds_of(information: Information) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Windows of every run or, where there is one run, of stretches of it, with their names."""
    windows, parts = information.windows, cross_validation.windows_of_folds(information)
    if len(parts) < cross_validation.FEWEST:
        fix = "log longer or several runs, or reduce to a number of parameters"
        raise cross_validation.too_short(information.runs or "no run", fix)
    if len(information.windows_of_runs) > 1:
        return tuple((windows[part[0]].run, part) for part in parts)
    names = (f"{windows[p[0]].start:.3g} to {windows[p[-1]].stop:.3g} s" for p in parts)
    return tuple(zip(names, parts, strict=True))


def left_out_errors(
    information: Information, path_of: PathOf, *, equal: bool = False
) -> LeftOutErrors:
    """Errors of the models of a path, each fold predicted by a path of the others."""
    folds = folds_of(information)
    results = []
    for _name, mine in folds:
        others = [k for k in range(len(information.windows)) if k not in set(mine)]
        path = path_of(FullModel.of(information.of(others), equal=equal))
        results.append((path, path_errors(path, information.of(mine))))
    shared = set.intersection(*(set(path.sizes) for path, _ in results))
    sizes = tuple(sorted(shared, reverse=True))
    errors, logs, removed = [], [], [Counter[str]() for _ in sizes]
    for path, (found, squares) in results:
        at = [path.sizes.index(size) for size in sizes]
        errors.append(found[at])
        logs.append(cross_validation.logarithms(found[at], np.tile(squares, (len(at), 1))))
        for place, count in zip(at, removed, strict=True):
            count.update(step.name for step in path.steps[:place])
    return LeftOutErrors(
        sizes,
        frozen(np.stack(errors)),
        frozen(np.stack(logs)),
        tuple(removed),
        tuple(name for name, _ in folds),
    )


def path_errors(path: Path, tested: Information) -> tuple[Array, Array]:
    """Relative errors of a path's models on other data `(states, rows)` [%]; efforts' squares."""
    place = [tested.layout.columns.index(name) for name in path.full.names]
    errors = np.empty((len(path.states), len(tested.layout.rows)))
    for k, state in enumerate(path.states):
        values = np.zeros(len(tested.layout.columns))
        values[place] = state.all_values
        errors[k] = tested.relative_errors(values)
    return errors, tested.effort_squares()
