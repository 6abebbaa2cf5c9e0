r"""Ordinary, weighted and recursive least squares, and information as a whitened problem.

Weights are one per effort row, $1/\sigma_j^2$, found by iteration: fit, take each row's residuals,
fit again [Gautier1997]. Information counts filtered samples for what they are worth, as many as
there are independent ones, so the covariance is right for white residuals behind a low-pass; where
windows of time show that they are alike for longer or for less, it follows (see `sandwich`), and
what samples beside rests move is added (see `beside_rests`).

Rows are weighted by the variance of their residuals in weighted least squares, widened where
residuals are alike for longer than the filter; parameters of single runs are eliminated, and what
is left is compressed to as many rows as the data have rank.

What was learned fades as $\lambda^{\Delta t}$ with the time of the windows after it, so parameters
that drift are followed [Ljung1999]. Kept are the faded sums of products, not an inverse: nothing
has to be guessed before the first window.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import (
    inflations,
    moved,
    note_of,
    scatter,
    spread_of,
)
from steelyard.estimate.least_squares.normal_equations import (
    Eliminated,
    Fit,
    Runs,
    Solution,
    described,
    inverse_of_gram,
    lengths_of,
    refuse_few,
    scores_of,
    solve,
    variances_of,
)

DEPTH = 4  # earlier points that are mixed
NEAR = 0.1  # change of a logarithm from which on earlier points are mixed
LONGEST = 1.0  # longest mixed step of a logarithm


@dataclass(frozen=True)
class OrdinaryLeastSquares:
    """All rows weigh the same, whatever their noise."""

    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        data = Runs.of(information, self.per_run)
        ones = np.ones(len(information.layout.rows))
        solution = solve(data, ones)
        fit = Fit(data, solution, variances=variances_of(data, solution, ones))
        factors = scatter(WeightedLeastSquares(per_run=self.per_run).fit(information))
        spread = spread_of(fit, factors * fit.variances, ones)
        estimate = described("ordinary least squares", fit, spread)
        return replace(estimate, notes=note_of(information.layout.rows, factors))


@dataclass(frozen=True)
class WeightedLeastSquares:
    """Every row weighs by the variance of its own residuals."""

    rounds: int = 50  # most iterations of the weights
    tolerance: float = 1e-6  # relative change of the weights at which they have converged
    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        fit = self.fit(information)
        factors = scatter(fit)
        spread = spread_of(fit, factors / fit.variances, 1.0 / fit.variances)
        estimate = described("weighted least squares", fit, spread)
        return replace(estimate, notes=note_of(information.layout.rows, factors))

    def fit(self, information: Information) -> Fit:
        """Values and converged weights, without covariances."""
        data = Runs.of(information, self.per_run)
        energy = information.effort_squares() / np.maximum(information.n_samples, 1.0)
        logs = np.log(np.where(energy > 0.0, energy, 1.0))
        points, changes = list[Array](), list[Array]()
        before: Solution | None = None
        for _ in range(self.rounds):
            weights = np.exp(-logs)
            solution = before = solve(data, weights, before)
            variances = variances_of(data, solution, weights)
            points.append(logs)
            changes.append(np.log(variances) - logs)
            if np.abs(changes[-1]).max() < self.tolerance:
                break
            logs = mixed(points, changes)
        return Fit(data, solution, variances)


def mixed(points: list[Array], changes: list[Array]) -> Array:
    """Anderson's mixing: the next point of a fixed-point iteration from the last few.

    That at which a linear model of the changes is zero, or the plain next one. The lists are of
    points and of what one plain step would add to each; points too far away are forgotten.
    """
    if float(np.abs(changes[-1]).max()) > NEAR:
        next_point = points[-1] + changes[-1]
        points.clear()
        changes.clear()
        return next_point
    del points[: -DEPTH - 1], changes[: -DEPTH - 1]
    slopes, change = np.diff(changes, axis=0).T, changes[-1]
    if not slopes.size:
        return points[-1] + change
    shares = np.linalg.lstsq(slopes, change, rcond=1e-8)[0]
    step = change - (np.diff(points, axis=0).T + slopes) @ shares
    return np.asarray(points[-1] + np.clip(step, -LONGEST, LONGEST))


RANK = 1e-11  # eigenvalue of the normal matrix, columns of unit length, below which it is rounding
FREEDOM = 2.0  # independent samples per parameter that a fit needs at least


@dataclass(frozen=True, eq=False)
class Whitened:
    """A least-squares problem in base parameters."""

    fit: Fit  # weighted least squares of the same data
    eliminated: tuple[Eliminated, ...]  # per run its own parameters, as functions of the others
    names: tuple[str, ...]  # base parameters, `c` of them; those of single runs are not among them
    matrix: Array  # `R`, `(rank, c)`
    vector: Array  # `z`, `(rank,)`
    noise: Array  # covariance of `z` from windows of time and samples beside rests, `(rank, rank)`
    effort: float  # root of the sum of squares of the whitened efforts


def whitened(
    information: Information, per_run: Sequence[str] = (), *, equal: bool = False
) -> Whitened:
    """Compress information; `equal` weighs all rows the same, by their mean variance."""
    refuse_few(information, len(information.layout.columns), FREEDOM)
    fit = WeightedLeastSquares(per_run=tuple(per_run)).fit(information)
    variances = fit.variances * inflations(fit)
    if equal:
        counts = information.n_samples
        variances = np.full(len(counts), variances @ counts / counts.sum())
    normal, right, eliminated, _ = fit.data.normal(1.0 / variances)
    columns = [k for k in range(len(right)) if k not in fit.data.local]
    normal, right = normal[np.ix_(columns, columns)], right[columns]
    scale = lengths_of(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / scale[:, None] / scale)
    kept = values > RANK * values[-1]
    roots, vectors = np.sqrt(values[kept]), vectors[:, kept]
    finite = np.where(np.isfinite(scale), scale, 0.0)
    effort = information.effort_squares() @ (1.0 / variances)
    names = tuple(information.layout.columns[k] for k in columns)
    matrix = (vectors * roots).T * finite
    if equal:
        # what ordinary least squares makes of the noise
        plain = OrdinaryLeastSquares(tuple(per_run))(information)
        theirs = [k for k, name in enumerate(plain.parameters.names) if name in names]
        mine = matrix[:, [names.index(plain.parameters.names[k]) for k in theirs]]
        noise = mine @ plain.covariance[np.ix_(theirs, theirs)] @ mine.T
    else:
        root = (vectors / scale[:, None]).T / roots[:, None]
        squared = fit.variances * scatter(fit) / np.square(variances)
        noise = root @ scores_of(fit.data, eliminated, columns, squared) @ root.T
        shift = moved(fit, 1.0 / variances, root, columns, noise)
        noise += np.outer(shift, shift)
    return Whitened(
        fit,
        eliminated,
        names,
        matrix,
        (vectors.T @ (right / scale)) / roots,
        noise,
        float(np.sqrt(effort)),
    )


MOST_WINDOWS_APART = 48  # windows that are kept apart, for the correlation of residuals

Inner = WeightedLeastSquares | OrdinaryLeastSquares


@dataclass(frozen=True)
class Recursive:
    """Estimates window by window."""

    # weight, after a second of further data, of what was learned before, above 0 and up to 1; with
    # 1 nothing fades, and the estimate is the inner one of all windows
    forgetting: float = 1.0
    inner: Inner = field(default_factory=WeightedLeastSquares)  # how rows are weighted

    def __post_init__(self) -> None:
        if not 0.0 < self.forgetting <= 1.0:
            raise DataError(
                f"a forgetting factor of {self.forgetting:g} per second is not valid",
                where="recursive least squares",
                fix="give a weight above 0 and up to 1, such as 0.98",
            )

    def __call__(self, information: Information) -> Estimate:
        """The estimate after all windows, in their order."""
        online = Online(self)
        online.add(information)
        return online.estimate()


class Online:
    """Recursive least squares on its way; constant in size however long it goes on."""

    def __init__(self, settings: Recursive) -> None:
        self._settings = settings
        self._faded: Information | None = None
        self._squared: Information | None = None

    def add(self, information: Information) -> None:
        """Take in the next windows, in order, of the same model, columns, units and filters."""
        for number, window in enumerate(information.windows):
            keep = self._settings.forgetting ** max(window.stop - window.start, 0.0)
            part = information.of([number])
            self._faded = _after(self._faded, keep, part)
            self._squared = _after(self._squared, keep**2, part)

    def estimate(self) -> Estimate:
        """What is known now; a `DataError` before any window, or without a visible parameter."""
        if self._faded is None or self._squared is None:
            raise DataError(
                "no window was added yet",
                where="recursive least squares",
                fix="add information before asking for an estimate",
            )
        found = self._settings.inner(self._faded)
        name = f"recursive {found.estimator}"
        if self._settings.forgetting == 1.0:
            return replace(found, estimator=name)
        memory = -1.0 / np.log(self._settings.forgetting)
        return replace(
            found,
            estimator=name,
            covariance=self._covariance(found, self._faded, self._squared),
            notes=(*found.notes, f"data {memory:.3g} s old have weight 1/e"),
        )

    def _covariance(self, found: Estimate, faded: Information, squared: Information) -> Array:
        """What noise does where samples are weighted by their age: its weights enter squared."""
        variances = np.square(np.maximum(found.sigma, 1e-300))
        ordinary = isinstance(self._settings.inner, OrdinaryLeastSquares)
        weights = np.ones(len(variances)) if ordinary else 1.0 / variances
        names = found.parameters.names
        normal = faded.select(names).normal(weights)[0]
        noise = squared.select(names).normal(np.square(weights) * variances)[0]
        inverse = inverse_of_gram(normal)
        covariance = inverse @ noise @ inverse
        return frozen(0.5 * (covariance + covariance.T))


def _after(before: Information | None, keep: float, new: Information) -> Information:
    """Sums that have faded, and new ones; neighbours merge when there get too many."""
    if before is None:
        return new
    both = before.with_effective_samples(1.0 / keep) + new
    count = len(both.windows)
    if count <= MOST_WINDOWS_APART:
        return both
    return both.grouped([range(k, min(k + 2, count)) for k in range(0, count, 2)])
