r"""Uncertainty from the residuals themselves: scores by windows of time, samples beside rests.

A joint that stands still is held by whatever balances it, not by its friction times the sign of a
speed. Samples at rest are left out, but the low-pass takes their share into those beside. At every
reversal that error has the same sign, so it does not average out: it is a bias.

The same fit without the samples beside rests estimates it. In coordinates whose noise is white,
$z = R\phi + \epsilon$, these samples left out give the normal matrix $A \preceq 1$ and vector $a$,
and $\delta = A^{-1} a - z$. Chance alone gives $\delta$ in an eigendirection of $A$ the variance
$\nu\,(1/\lambda - 1)$ [Hausman1978], $\nu$ that of $\epsilon$; what is beyond counts as an error of
$z$ with the covariance $\delta\delta^T$. The estimate stays.

A covariance counts on residuals that are white behind the parallel filter. Model error, drift and
coloured noise are not; neighbouring residuals are then alike for longer than the filter, and there
are fewer independent ones. The scores of windows show it,
$g_{wj} = A_{wj}^T (b - A\hat\phi)_{wj} / \sigma_j^2$: over windows longer than the correlation
they scatter as much as the estimate really does [Newey1987] [Cameron2015].

The full sandwich $K (\sum_w g_w g_w^T) K$, $K$ the inverse of the normal matrix, needs many more
windows than parameters: with 4 to 19 windows and 8 to 40 parameters its 95 % intervals hold in 83
to 89 % of cases. One factor per effort row, all columns together, is estimated from four windows:

$$\varphi_j = \frac{\sum_w g_{wj}^T K g_{wj}}
{\sum_w \mathrm{tr}\,(K G_{wj} - (K G_{wj})^2)}, \qquad
C = K \Big(\sum_j \varphi_j G_j\Big) K,$$

with $G_{wj} = A_{wj}^T A_{wj} / \sigma_j^2$; the square is what the fit took from the scores. Its
intervals hold in 93 to 96 % of cases, from white noise to drift over seconds.

It is below one where the noise lies in the upper part of the low-pass, as that of accelerations
does, and the motion in the lower: 0.2 to 0.6 on simulated arms. Chance must not narrow an interval,
so it then counts with one standard deviation of its own more, and with one at most. Weights of
estimates count it with one at least.

Rows that are combinations of all rows of a sample share errors; one factor counts for all of them.

What changes from run to run (another day, a motion that the model describes less well) scatters
between runs more than between windows. With several runs, the larger of the two factors counts:
that of windows, and that of whole runs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array, places_of
from steelyard.estimate.least_squares.normal_equations import (
    Eliminated,
    Fit,
    scores_of,
    shared_map,
    solve,
    unit_length,
)

LEAST_EIGENVALUE_AWAY = 0.01  # of `A`, that identifies a direction away from rests


def moved(fit: Fit, weights: Array, root: Array, columns: Sequence[int], noise: Array) -> Array:
    r"""How far the samples beside rests move a fit, beyond chance: $\delta$, shape `(rank,)`.

    `root` leads from normal vectors over `columns` to white coordinates, shape `(rank, c)`, whose
    covariance is `noise`, `(rank, rank)`. Zeros where nothing is beside rests.
    """
    if fit.data.whole.beside is None:
        return np.zeros(len(root))
    _, whole, _, _ = fit.data.normal(weights)
    matrix, vector, _, _ = fit.data.without_beside().normal(weights)
    values, vectors = np.linalg.eigh(root @ matrix[np.ix_(columns, columns)] @ root.T)
    resolved = values > LEAST_EIGENVALUE_AWAY
    values = np.where(resolved, np.minimum(values, 1.0), 1.0)
    shift = (vectors.T @ (root @ vector[columns])) / values - vectors.T @ (root @ whole[columns])
    variances = np.einsum("ki,kl,li->i", vectors, noise, vectors)
    chance = np.maximum(variances, 0.0) * (1.0 / values - 1.0)
    beyond = np.maximum(1.0 - chance / np.maximum(np.square(shift), 1e-300), 0.0)
    return np.asarray(vectors @ np.where(resolved, np.sqrt(beyond) * shift, 0.0))


def moved_scores(fit: Fit, weights: Array, scores: Array) -> Array:
    """The same as an error of the normal vector, of which `scores` `(k, k)` is the covariance."""
    kept = fit.kept
    if fit.data.whole.beside is None:
        return np.zeros(len(kept))
    root, back = _root(fit, weights)
    return np.asarray(back @ moved(fit, weights, root, kept, root @ scores @ root.T))


def away(fit: Fit) -> Fit | None:
    """The same fit to samples that are not beside rests; `None` if they do not identify all."""
    data, weights, kept = fit.data.without_beside(), 1.0 / fit.variances, fit.kept
    root, _ = _root(fit, weights)
    matrix, _, _, _ = data.normal(weights)
    if np.linalg.eigvalsh(root @ matrix[np.ix_(kept, kept)] @ root.T)[0] <= LEAST_EIGENVALUE_AWAY:
        return None
    return replace(solve(data, weights, fit), variances=fit.variances)


def _root(fit: Fit, weights: Array) -> tuple[Array, Array]:
    """From normal vectors over the columns `fit.kept` to white coordinates, and back.

    A direction that rounding hides has coordinate zero.
    """
    kept = fit.kept
    unit, lengths = unit_length(fit.data.normal(weights)[0][np.ix_(kept, kept)])
    values, vectors = np.linalg.eigh(unit)
    roots = np.sqrt(np.where(values > len(kept) * np.finfo(float).eps * values[-1], values, 0.0))
    inverse = np.divide(1.0, roots, out=np.zeros_like(roots), where=roots > 0.0)
    return (vectors * inverse).T / lengths, lengths[:, None] * vectors * roots


WINDOWS = 24  # windows that all runs together are cut into; more make them shorter, without a gain
FEWEST = 2  # windows of a run that are kept apart, however many runs there are
FREEDOM = 2.0  # expected squares of scores below which they are too few
NOTED = 1.5  # factor on the width of intervals from which on there is a note


def inflations(fit: Fit) -> Array:
    r"""How many times more the estimate scatters than by white residuals, for weights of rows.

    $\varphi_j$ of a weighted fit, but at least 1, shape `(rows,)`; 1 where the windows are too few.
    """
    return np.maximum(_over_runs(fit), 1.0)


def scatter(fit: Fit) -> Array:
    """The same for covariances: less than 1 where that is significant, and away from rests.

    At least 1 where windows, or samples away from rests, are too few to tell. What samples beside
    rests add is counted apart, see `moved`.
    """
    if fit.data.whole.beside is None:
        return _over_runs(fit)
    part = away(fit)
    return inflations(fit) if part is None else _over_runs(part)


def _over_runs(fit: Fit) -> Array:
    r"""$\varphi_j$ of windows, or of whole runs where that is larger, shape `(rows,)`."""
    runs = len(fit.data.whole.windows_of_runs)
    factors = _scatter(fit, max(FEWEST, WINDOWS // max(runs, 1)))
    return np.maximum(factors, _scatter(fit, 1)) if runs > 1 else factors


def _scatter(fit: Fit, most: int) -> Array:
    r"""$\varphi_j$ of scores in at most so many windows per run, shape `(rows,)`."""
    mixed = fit.data.whole.layout.mixed
    found, expected, squares = np.zeros((3, 1 if mixed else len(fit.variances)))
    windows = scores_of_windows(fit, most)
    for own, row, columns, grams, scores in _mixed(windows) if mixed else windows:
        known, inverse = own.joined(fit.kept, fit.inverse)
        mine = places_of(columns, known)
        inverse = inverse[np.ix_(mine, mine)]
        taken = inverse @ grams
        found[row] += np.sum((scores @ inverse) * scores)
        square = np.sum(taken * taken.transpose(0, 2, 1))
        expected[row] += np.trace(taken, axis1=1, axis2=2).sum() - square
        squares[row] += square
    enough = expected >= (FREEDOM if len(fit.data.whole.windows) > 1 else np.inf)
    expected = np.where(enough, expected, 1.0)
    factors, chance = found / expected, np.sqrt(2.0 * squares) / expected
    low = np.minimum(factors * (1.0 + chance), 1.0)
    factors = np.where(enough, np.where(factors < 1.0, low, factors), 1.0)
    return np.asarray(np.broadcast_to(factors, len(fit.variances)))


Scores = tuple[Eliminated, int, list[int], Array, Array]


def _mixed(windows: Iterator[Scores]) -> Iterator[Scores]:
    """Sums over the rows of each run, which share errors; all of them see the same columns."""
    found: Scores | None = None
    for own, row, columns, grams, scores in windows:
        if found is not None and row == 0:
            yield found
            found = None
        if found is not None:
            grams, scores = found[3] + grams, found[4] + scores
        found = own, 0, columns, grams, scores
    if found is not None:
        yield found


def covariances(
    fit: Fit, noise: Array, weights: Array | None = None
) -> tuple[Array, tuple[Array, ...]]:
    """Covariance of the shared parameters by noise, and per run that of its own.

    The noise is the variance of the residuals times the square of their weight, per row. What
    samples beside rests move is added where rows have weights.
    """
    kept, inverse = fit.kept, fit.inverse
    scores = scores_of(fit.data, fit.locals, kept, noise)
    covariance = inverse @ scores @ inverse
    if weights is not None:
        shift = inverse @ moved_scores(fit, weights, scores)
        covariance += np.outer(shift, shift)
    each = []
    for run, own in zip(fit.data.runs, fit.locals, strict=True):
        slopes, mine = own.slopes[:, kept], own.inverse @ run.normal(noise)[0][list(own.columns)]
        cross = mine @ shared_map(own, kept) @ inverse @ slopes.T
        alone = mine[:, list(own.columns)] @ own.inverse
        each.append(alone + slopes @ covariance @ slopes.T + cross + cross.T)
    return covariance, tuple(each)


def honest_covariance(fit: Fit, inverse: Array, prior: Array | None = None) -> Array:
    r"""Covariance of the shared parameters that are kept, $K (\sum_j \varphi_j G_j + s s^T + P) K$.

    $s$ is what samples beside rests add to the normal vector, see `moved_scores`. $K$ is the
    inverse of the second derivative of what was minimised, of which $P$, that of the prior, is part
    in a regularised estimate.
    """
    middle = score_covariance(fit, scatter(fit), 1.0 / fit.variances)
    covariance = inverse @ (middle if prior is None else middle + prior) @ inverse
    return np.asarray(0.5 * (covariance + covariance.T))


def score_covariance(fit: Fit, factors: Array, weights: Array) -> Array:
    r"""Covariance of the normal vector, $\sum_j w_j^2 \sigma_j^2 \varphi_j A_j^T A_j + s s^T$.

    With weights of the rows, `(rows,)`; $s$ see `moved_scores`.
    """
    noise = factors * fit.variances * np.square(weights)
    middle = scores_of(fit.data, fit.locals, fit.kept, noise)
    shift = moved_scores(fit, weights, middle)
    return np.asarray(middle + np.outer(shift, shift))


def note_of(rows: Sequence[str], factors: Array) -> tuple[str, ...]:
    """For people to read: where intervals became much wider."""
    wide = [
        f"{row} x {np.sqrt(factor):.1f}"
        for row, factor in zip(rows, factors, strict=True)
        if factor > NOTED**2
    ]
    if not wide:
        return ()
    return (
        "residuals are correlated for longer than the filter, or runs disagree (model error, "
        f"drift), so intervals are wider: {', '.join(wide)}",
    )


def scores_of_windows(fit: Fit, most: int) -> Iterator[Scores]:
    """Per run and row, in at most so many windows of the run: the columns that have a value there.

    With the Gram matrices of these in every window, and their products with the residuals, both
    over the row's variance.
    """
    whole = fit.data.whole
    for run, own in zip(fit.data.runs, fit.locals, strict=True):
        mine = sorted(k for name in run.windows_of_runs for k in whole.windows_of_runs[name])
        windows, values = whole.of(mine).merged(most), own.among(fit.values)
        known = {*fit.kept, *own.columns}
        for row, seen in enumerate(windows.layout.sees):
            grams = windows.row_grams(row) / fit.variances[row]
            places = [k for k, column in enumerate(seen) if column in known]
            scores = grams[:, :-1] @ np.append(-values[list(seen)], 1.0)
            some = grams[:, :-1, :-1][np.ix_(range(len(grams)), places, places)]
            yield own, row, [seen[k] for k in places], some, scores[:, places]
