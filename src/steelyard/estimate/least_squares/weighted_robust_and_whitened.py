r"""Ordinary, weighted, recursive and robust least squares; information as a whitened problem.

Weights are one per effort row, $1/\sigma_j^2$, found by iteration: fit, take each row's residuals,
fit again [Gautier1997]. Information counts filtered samples for what they are worth, as many as
there are independent ones, so the covariance is right for white residuals behind a low-pass; where
windows of time show that they are alike for longer or for less, it follows (see
`covariance_from_residuals`), and what samples beside rests move is added.

Rows are weighted by the variance of their residuals in weighted least squares, widened where
residuals are alike for longer than the filter; parameters of single runs are eliminated, and what
is left is compressed to as many rows as the data have rank.

Minimises $\sum_i \rho(r_i / s_j)$, with $s_j$ the scale of row $j$'s residuals, by weighting each
sample by $w(u) = \psi(u) / u$, $u = r / s$, $\psi = \rho'$, and fitting again [Huber1981]. The
scale is the median of $|r|$ over 0.6745 [Hampel1974], right for normal residuals and untouched by
outliers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.covariance_from_residuals import (
    covariances,
    inflations,
    moved,
    note_of,
    scatter,
)
from steelyard.estimate.least_squares.normal_equations import (
    Eliminated,
    Fit,
    Runs,
    described,
    inverse_of_gram,
    lengths_of,
    refuse_few,
    scores_of,
    solve,
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
        fit = solve(data, ones)
        factors = scatter(WeightedLeastSquares(per_run=self.per_run).fit(information))
        both = covariances(fit, factors * fit.variances, ones)
        estimate = described("ordinary least squares", fit, *both)
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
        both = covariances(fit, factors / fit.variances, 1.0 / fit.variances)
        estimate = described("weighted least squares", fit, *both)
        return replace(estimate, notes=note_of(information.layout.rows, factors))

    def fit(self, information: Information) -> Fit:
        """Values and converged weights, without covariances."""
        data = Runs.of(information, self.per_run)
        energy = information.effort_squares() / np.maximum(information.n_samples, 1.0)
        logs = np.log(np.where(energy > 0.0, energy, 1.0))
        points, changes = list[Array](), list[Array]()
        fit: Fit | None = None
        for _ in range(self.rounds):
            fit = solve(data, np.exp(-logs), fit)
            points.append(logs)
            changes.append(np.log(fit.variances) - logs)
            if np.abs(changes[-1]).max() < self.tolerance:
                break
            logs = mixed(points, changes)
        assert fit is not None
        return fit


MOST_WINDOWS_APART = 48  # windows that are kept apart, for the correlation of residuals


@dataclass(frozen=True)
class Recursive:
    r"""Weighted least squares window by window, of parameters that may drift [Ljung1999].

    What was learned fades as $\lambda^{\Delta t}$ with the time of the windows after it. Kept are
    the faded sums of products, not an inverse: nothing has to be guessed before the first window,
    and the size is constant however long it goes on.
    """

    # weight, after a second of further data, of what was learned before, above 0 and up to 1; with
    # 1 nothing fades, and the estimate is that of weighted least squares of all windows
    forgetting: float = 1.0

    def __call__(self, information: Information) -> Estimate:
        """The estimate after all windows, in their order."""
        faded = squared = information.of(())
        for number, window in enumerate(information.windows):
            keep = self.forgetting ** max(window.stop - window.start, 0.0)
            part = information.of([number])
            faded, squared = after(faded, keep, part), after(squared, keep**2, part)
        found = WeightedLeastSquares()(faded)
        found = replace(found, estimator=f"recursive {found.estimator}")
        if self.forgetting == 1.0:
            return found
        # samples are weighted by their age: in what noise does these weights enter squared
        variances, names = np.square(np.maximum(found.sigma, 1e-300)), found.parameters.names
        inverse = inverse_of_gram(faded.select(names).normal(1.0 / variances)[0])
        noise = squared.select(names).normal(1.0 / variances)[0]
        covariance = inverse @ noise @ inverse
        note = f"data {-1.0 / np.log(self.forgetting):.3g} s old have weight 1/e"
        return replace(
            found, covariance=frozen(0.5 * (covariance + covariance.T)), notes=(*found.notes, note)
        )


def after(before: Information, keep: float, new: Information) -> Information:
    """Sums that have faded, and new ones; neighbours merge when there get too many."""
    both = before.with_effective_samples(1.0 / keep) + new
    count = len(both.windows)
    if count <= MOST_WINDOWS_APART:
        return both
    return both.grouped([range(k, min(k + 2, count)) for k in range(0, count, 2)])


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


NORMAL = 0.6744897501960817  # median of |x| of a standard normal x
FLOOR = 1e-12  # scale of residuals over the effort's root mean square that is rounding


@dataclass(frozen=True)
class Huber:
    """Squares up to $k$ scales, straight lines beyond [Huber1981]."""

    # beyond which a residual counts less; 1.345 keeps 95 % of the efficiency of least squares on
    # normal residuals
    k: float = 1.345
    convex = True

    def weight(self, u: Array) -> Array:
        r"""$\min(1, k / |u|)$."""
        return np.asarray(self.k / np.maximum(np.abs(u), self.k))

    def curvature(self, u: Array) -> Array:
        """1 within, 0 beyond."""
        return (np.abs(u) <= self.k).astype(np.float64)


@dataclass(frozen=True)
class Tukey:
    """The biweight: residuals beyond $c$ scales do not count at all [Beaton1974]."""

    # beyond which nothing counts; 4.685 keeps 95 % of the efficiency of least squares
    c: float = 4.685
    convex = False

    def weight(self, u: Array) -> Array:
        r"""$(1 - (u / c)^2)^2$ within, 0 beyond."""
        return np.square(np.maximum(1.0 - np.square(u / self.c), 0.0))

    def curvature(self, u: Array) -> Array:
        r"""$(1 - (u/c)^2)(1 - 5 (u/c)^2)$ within, 0 beyond."""
        v = np.square(u / self.c)
        return np.where(v < 1.0, (1.0 - v) * (1.0 - 5.0 * v), 0.0)


Weigh = Huber | Tukey  # a loss; one that is not convex begins where Huber's ends


@dataclass(frozen=True)
class Reweighted:
    r"""Iteratively reweighted fits, each by an inner estimator.

    The covariance is that of M-estimation, $H^{-1} M H^{-1}$ with
    $H = \sum \omega \psi'(u)\, a a^T$ and $M = \sum \omega^2 s^2 \psi(u)^2\, a a^T$, $\omega$ a
    row's weight, every sample counted as the independent ones that it is worth. The curvature is
    averaged over each row, and $M$ allows for residuals alike over windows by `inflations`.
    Inner estimators other than least squares keep their own covariance.
    """

    weigh: Weigh = field(default_factory=Huber)
    inner: Estimator[Information] = field(default_factory=WeightedLeastSquares)
    rounds: int = 100  # most iterations
    # change of the parameters, in standard deviations, at which they have converged
    tolerance: float = 1e-6

    def __call__(self, samples: FilteredSamples) -> Estimate:
        """Estimate all columns that the data see."""
        estimate = self.inner(samples.information())
        refuse_few(samples.information(), len(estimate.parameters), FREEDOM)
        for loss in (self.weigh,) if self.weigh.convex else (Huber(), self.weigh):
            estimate, scales, convergence = self._converged(samples, estimate, loss)
        u = _standardised(samples, estimate, scales)
        taken = 1.0 - np.mean(self.weigh.weight(np.concatenate(u)))
        found = replace(
            estimate,
            estimator=f"{type(self.weigh).__name__} weights, {estimate.estimator}",
            sigma=frozen(scales),
            n_samples=frozen(samples.information().n_samples),
            notes=(
                *estimate.notes,
                convergence,
                f"{100.0 * taken:.3g} % of the samples' weight removed",
            ),
        )
        if not isinstance(self.inner, WeightedLeastSquares | OrdinaryLeastSquares):
            return found
        return replace(found, covariance=self._covariance(samples, estimate, scales, u))

    def _converged(
        self, samples: FilteredSamples, estimate: Estimate, loss: Weigh
    ) -> tuple[Estimate, Array, str]:
        """Fit until convergence; the estimate, the rows' scales, and whether they converged."""
        scales, exact = _scales(samples, estimate)
        for count in range(1, self.rounds + 1):
            u = _standardised(samples, estimate, scales)
            new = self.inner(samples.information([loss.weight(x) for x in u]))
            change, before = np.inf, scales
            if new.parameters.names == estimate.parameters.names:
                moved = np.abs(new.parameters.values - estimate.parameters.values)
                change = float(np.max(moved / np.maximum(new.std, 1e-300)))
            estimate, (scales, exact) = new, _scales(samples, new)
            still = np.allclose(scales, before, rtol=self.tolerance, atol=0.0)
            if exact or (change < self.tolerance and still):
                return estimate, scales, f"converged after {count} rounds"
        return estimate, scales, f"not converged after {self.rounds} rounds"

    def _covariance(
        self, samples: FilteredSamples, estimate: Estimate, scales: Array, u: Sequence[Array]
    ) -> Array:
        """Covariance of the parameters; of those of single runs as the inner estimator says."""
        own = {name for one in estimate.per_run for name in one.parameters.names}
        names = [name for name in estimate.parameters.names if name not in own]
        place = [estimate.parameters.names.index(name) for name in names]
        weighted = samples.information([self.weigh.weight(x) for x in u])
        plain = WeightedLeastSquares(per_run=tuple(sorted(own)))
        omega, factors = 1.0 / np.square(estimate.sigma), inflations(plain.fit(weighted))
        if isinstance(self.inner, OrdinaryLeastSquares):
            omega = np.ones(len(omega))
        curvatures = [self.weigh.curvature(x) for x in u]
        # kept away from zero, where the loss says nothing any more
        bent = [np.full(len(x), max(float(x.mean()), 0.05) if len(x) else 1.0) for x in curvatures]
        scores = [np.square(self.weigh.weight(x) * x) for x in u]
        h = samples.information(bent).select(names).normal(omega)[0]
        m = samples.information(scores).select(names).normal(factors * np.square(omega * scales))[0]
        inverse = inverse_of_gram(h)
        worth = float(samples.information().n_samples.sum())
        covariance = estimate.covariance.copy()
        covariance[np.ix_(place, place)] = inverse @ m @ inverse
        covariance *= worth / max(worth - len(names), 1.0)
        return frozen(0.5 * (covariance + covariance.T))


def residuals_of(samples: FilteredSamples, estimate: Estimate) -> tuple[Array, ...]:
    """Residuals with each run's own parameters, times the root of their weight, `(N_j,)`."""
    known = estimate.parameters.as_dict()
    own = {one.run: one.parameters.as_dict() for one in estimate.per_run}
    result = tuple(np.zeros(len(at)) for at in samples.at)
    for number, source in enumerate(samples.sources):
        mine = {**known, **own.get(source.run, {})}
        values = np.array([mine.get(name, 0.0) for name in samples.layout.columns])
        for row, found in enumerate(samples.residuals(values)):
            here = samples.source[samples.at[row]] == number
            result[row][here] = found[here]
    if samples.layout.mixed:
        return result  # as large as others, whatever is left of their rows
    return tuple(r * np.sqrt(w) for r, w in zip(result, samples.weights, strict=True))


def _standardised(samples: FilteredSamples, estimate: Estimate, scales: Array) -> list[Array]:
    """Residuals in units of their row's scale, `(N_j,)` each."""
    return [r / s for r, s in zip(residuals_of(samples, estimate), scales, strict=True)]


def _scales(samples: FilteredSamples, estimate: Estimate) -> tuple[Array, bool]:
    """Scale of each row's residuals, shape `(rows,)`, and whether all of them are rounding."""
    scales, floors = [], []
    for found, row in zip(residuals_of(samples, estimate), samples.rows, strict=True):
        size = float(np.sqrt(np.mean(np.square(row[:, -1])))) if len(row) else 0.0
        floors.append(FLOOR * size or 1.0)
        scales.append(float(np.median(np.abs(found))) / NORMAL if len(found) else 0.0)
    least = np.array(floors)
    return np.maximum(scales, least), bool((np.array(scales) <= least).all())
