r"""A force that acts for a while within a run, such as a contact or a hand.

While a contact or a hand pushes, efforts are not those of free motion; before and after they are,
with the same parameters. For every stretch of neighbouring windows each effort row is fitted to
all others of the run, and its efforts in the stretch are predicted: with the mean squared residuals
$\sigma_o^2$ of the fit and $\sigma_i^2$ of the prediction from $n_o$ and $n_i$ samples the
likeliest stretch has the least $\sum_j n_o \ln \sigma_{o,j}^2 + n_i \ln \sigma_{i,j}^2$. Windows of
a shorter length then say when it begins and ends.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.nuisance_fit_and_score import MISFIT_FLOOR
from steelyard.check.hypotheses.signs_and_delay_by_friction import whitened_columns
from steelyard.estimate.information.information import Information
from steelyard.runs.recording import LeftOut

FEWEST_WINDOWS = 6  # windows of a run in which a stretch is looked for
LONGEST_SHARE = 0.4  # share of a run's windows that it takes at most
UNEVEN = 3.0  # greatest squared residual of a window over the median, at least
LEAST_FALL = 10.0  # factor by which the squared residual of a row falls where the force acts
LEAST_EXCESS = 25.0  # squared residual within over that of the other windows, at least, there
MOST_LEVERAGE = 1.0  # variance of what is predicted over that of the residuals, at most
PUSHED = 9.0  # squared residual of such a window over that of the others from which on it is pushed
LONGEST_PAUSE = 2  # windows in a row without force within one stretch
LEAST_ROW_FREEDOM = 20.0  # degrees of freedom that a row needs

PASSING = "a force acted for a while, as by a contact"


@dataclass(frozen=True, eq=False)
class PassingForce:
    """A stretch of a run in which efforts are not those of its other motion."""

    run: str
    start: float  # [s]
    stop: float  # [s]
    rows: tuple[int, ...]  # numbers of the joints that bear it
    sizes: tuple[float, ...]  # root mean square of what it adds to their efforts [Nm; N]
    explained: float  # share of the squared residual, geometric mean over all rows

    @property
    def when(self) -> str:
        """Its time."""
        return f"from {self.start:.3g} to {self.stop:.3g} s"

    @property
    def stretch(self) -> LeftOut:
        """What is to be left out of the run."""
        return LeftOut(self.start, self.stop, PASSING, self.rows)


@dataclass(frozen=True, eq=False)
class _Apart:
    """Each row's fit to the windows outside a stretch, and how it predicts those within."""

    coefficients: tuple[Array, ...]
    outside: Array  # mean squared residuals, shape `(rows,)`
    inside: Array  # of the prediction
    leverage: Array  # variance of the prediction over that of the residuals, infinite if unseen
    counts: Array  # samples outside and inside, shape `(2, rows)`

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the likelihood, but for a constant."""
        used = self.counts.min(axis=0) > 0.0
        logs = np.log([self.outside[used], self.inside[used]])
        return float(np.sum(self.counts[:, used] * logs))


def passing_force(
    run: Information, values: Array, finely: Callable[[], Information]
) -> PassingForce | None:
    """The force of one run that is beyond doubt; `None` if there is none.

    `values` are those of a fit, for a first look; `finely` gathers the run in short windows.
    """
    count, rows = len(run.windows), range(len(run.layout.rows))
    if count < FEWEST_WINDOWS or not _uneven(run, values):
        return None
    grams = [run.row_grams(row) for row in rows]
    whole = _apart(run, grams, slice(0, 0))
    lengths = range(1, int(LONGEST_SHARE * count) + 1)
    parts = (slice(k, k + length) for length in lengths for k in range(count - length + 1))
    found = [(_apart(run, grams, part), part) for part in parts]
    best, part = min(found, key=lambda one: one[0].cost)
    fall = whole.outside / best.outside
    judged = np.isfinite(best.leverage) & (best.leverage <= MOST_LEVERAGE)
    squares = np.array([gram[:, -1, -1].sum() for gram in grams])
    squares = squares / np.maximum(run.counts.sum(axis=0), 1.0)
    expected = np.maximum(best.outside, MISFIT_FLOOR**2 * squares)
    pushed = judged & (fall >= LEAST_FALL) & (best.inside >= LEAST_EXCESS * expected)
    if not pushed.any():
        return None
    fine = finely()
    squares = np.array([_residuals(fine, row, best.coefficients[row]) for row in rows])
    ratio = squares / np.maximum(expected, 1e-300)[:, None]
    about = run.windows[part.start].start, run.windows[part.stop - 1].stop
    hit = _hull(np.asarray((ratio[pushed] > PUSHED).any(axis=0)), fine, about)
    if hit is None:
        return None
    sizes = np.sqrt(squares[:, hit].mean(axis=1))
    bears = tuple(np.flatnonzero(pushed | (ratio[:, hit].mean(axis=1) > PUSHED)).tolist())
    share = 1.0 - float(np.exp(np.mean(np.log(np.minimum(best.outside / whole.outside, 1.0)))))
    times = [fine.windows[k] for k in np.flatnonzero(hit)]
    return PassingForce(
        run.windows[0].run,
        times[0].start,
        times[-1].stop,
        bears,
        tuple(float(sizes[row]) for row in bears),
        share,
    )


def _uneven(run: Information, values: Array) -> bool:
    """Whether the residuals of some window are far above those of most."""
    found = []
    for row in range(len(run.layout.rows)):
        mean = _residuals(run, row, values[list(run.layout.sees[row])])
        seen = mean[run.counts[:, row] > 0.0]
        found.append(seen.max() / max(float(np.median(seen)), 1e-300) if len(seen) else 0.0)
    return max(found) >= UNEVEN


def _residuals(run: Information, row: int, values: Array) -> Array:
    """Mean squared residual of a row in each window, shape `(w,)`."""
    weights = np.append(-values, 1.0)
    squares = np.einsum("i,wij,j->w", weights, run.row_grams(row), weights)
    return np.asarray(np.maximum(squares, 0.0) / np.maximum(run.counts[:, row], 1.0))


def _apart(run: Information, grams: list[Array], part: slice) -> _Apart:
    """Fits to all windows but those of a part."""
    within = np.zeros(len(run.windows), dtype=np.bool_)
    within[part] = True
    fits = [_row(gram, run.counts[:, row], within) for row, gram in enumerate(grams)]
    coefficients, outside, inside, leverage, *counts = zip(*fits, strict=True)
    return _Apart(coefficients, *map(np.array, (outside, inside, leverage, counts)))


def _row(
    gram: Array, counts: Array, within: NDArray[np.bool_]
) -> tuple[Array, float, float, float, float, float]:
    """One row: coefficients, residuals outside and inside, leverage, samples outside and inside."""
    out, ins = gram[~within].sum(axis=0), gram[within].sum(axis=0)
    many, few = float(counts[~within].sum()), float(counts[within].sum())
    own = whitened_columns(out[:-1, :-1])
    effort = own.T @ out[:-1, -1]
    free = many - own.shape[1]
    left = float(out[-1, -1] - effort @ effort) / max(free, 1.0)
    left = max(left, 1e-12 * float(out[-1, -1]) / max(many, 1.0), 1e-300)
    values = own @ effort
    weights = np.append(-values, 1.0)
    inner = max(float(weights @ ins @ weights) / max(few, 1.0), 1e-300)
    if free < LEAST_ROW_FREEDOM or few == 0.0:
        return values, left, inner, np.inf, 0.0, 0.0
    seen = np.trace(own.T @ ins[:-1, :-1] @ own) / few
    both = whitened_columns((out + ins)[:-1, :-1])
    leverage = seen if both.shape[1] == own.shape[1] else np.inf
    return values, left, inner, float(leverage), many, few


def _hull(
    pushed: NDArray[np.bool_], fine: Information, about: tuple[float, float]
) -> NDArray[np.bool_] | None:
    """The fine windows of one force: pushed ones about a time [s], short pauses included."""
    inside = np.array([w.stop > about[0] and w.start < about[1] for w in fine.windows])
    at = np.flatnonzero(pushed & inside)
    if not len(at):
        return None
    first, last = int(at[0]), int(at[-1])
    every = np.flatnonzero(pushed)
    while len(near := every[(every < first) & (every >= first - 1 - LONGEST_PAUSE)]):
        first = int(near[0])
    while len(near := every[(every > last) & (every <= last + 1 + LONGEST_PAUSE)]):
        last = int(near[-1])
    hit = np.zeros(len(pushed), dtype=np.bool_)
    hit[first : last + 1] = True
    return None if hit[0] or hit[-1] else hit  # what lasts to an end may be a load, or a jump
