r"""Runs whose bodies disagree, a last link too heavy, and forces that act for a while, as a hand.

Friction and offsets differ from day to day and are fitted to every run by itself in both. Bodies do
not: where those of each run by itself leave clearly less than those of all runs together, runs are
of two robots, or one carried a load. A load adds the ten numbers of a body at the last link, in
that run alone; where these bring residuals down to those of the runs by themselves, it is a load.

All logs of a loaded robot agree with each other, and their model predicts them all; only what is
known of the links beforehand can show the load. A model file's masses are often wrong, and often
all of them alike: the last link is therefore compared with the others.

While a contact or a hand pushes, efforts are not those of free motion; before and after they are,
with the same parameters. For every stretch of neighbouring windows each effort row is fitted to
all others of the run, and its efforts in the stretch are predicted: with the mean squared residuals
$\sigma_o^2$ of the fit and $\sigma_i^2$ of the prediction from $n_o$ and $n_i$ samples the
likeliest stretch has the least $\sum_j n_o \ln \sigma_{o,j}^2 + n_i \ln \sigma_{i,j}^2$. Windows of
a shorter length then say when it begins and ends.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError
from steelyard.check.cases_and_checks import case_check
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.hypotheses.nuisance_fit_and_score import MISFIT_FLOOR
from steelyard.check.hypotheses.signs_and_delay_by_friction import (
    FEWEST_WINDOWS,
    LEAST_ROW_FREEDOM,
    own_fit,
    whitened_columns,
)
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.payload.runs_with_payload import carrier, drifting, load_case
from steelyard.runs.recording import LeftOut

DISAGREEING_RESIDUAL = 2.0
"""Residual of common bodies over that of each run's own from which on runs disagree, root mean
square over joints: 1.02 on seven runs of the UR10e over two weeks, 14 of an arm whose bodies differ
by a fifth from the other's."""
EXPLAINED_BY_LOAD = 1.3  # the same with a load in one run that explains it


@case_check("runs")
def runs_disagree_check(case: FittedCase) -> Iterable[Finding]:
    """Runs of two robots, or of one with and without a load, in one fit."""
    whole = case.information
    if whole is None or len(whole.windows_of_runs) < 2:
        return ()
    try:
        runs = [whole.of(group) for group in whole.windows_of_runs.values()]
        own = np.array([WeightedLeastSquares().fit(run).variances for run in runs])
        times = residual_of_common_bodies(case.identified, runs, own)
        if times < DISAGREEING_RESIDUAL:
            return ()
        return (_disagreement_finding(case.identified, runs, own, times),)
    except DataError:
        return ()


def residual_of_common_bodies(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array
) -> float:
    """Residual of common bodies over that of each run's own, root mean square over rows.

    The residual variances of runs by themselves, `own`, have the shape `(runs, rows)`.
    """
    whole = reduce(add, runs)
    columns = whole.layout.columns
    free = tuple(columns[k] for k in drifting(identified.model, columns))
    return _times(WeightedLeastSquares(per_run=free).fit(whole).variances, runs, own)


def _times(variances: Array, runs: Sequence[Information], own: Array) -> float:
    counts = np.array([run.n_samples for run in runs])
    separate = np.sum(counts * own, axis=0) / np.maximum(counts.sum(axis=0), 1e-300)
    return float(np.sqrt(np.mean((variances / np.maximum(separate, 1e-300))[separate > 0.0])))


def _disagreement_finding(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, times: float
) -> Finding:
    """The load in one run that explains it, or else that the robots differ."""
    figure = f"a common fit has {times:.1f} times the residuals of separate fits"
    loads = [_load_in_one_run(identified, runs, own, number) for number in range(len(runs))]
    left, mass, half, name = min(loads)
    if left <= EXPLAINED_BY_LOAD:
        others = "the other run does" if len(runs) == 2 else "the other runs do"
        return Finding.wrong(
            f"it carries a payload of {mass:.3g} ± {half:.1g} kg that {others} not: the model is "
            "valid neither with nor without it",
            figure,
            fix=Fix("Leave this log out, or give it as --loaded"),
            log=name,
        )
    # whose bodies differ: those of the run without which the others agree, or all
    names = [run.runs for run in runs]
    who = f"{' and '.join(names)} differ"
    if len(runs) > 2:
        kept = [[k for k in range(len(runs)) if k != number] for number in range(len(runs))]
        rests = [residual_of_common_bodies(identified, [runs[k] for k in x], own[x]) for x in kept]
        if min(rests) < DISAGREEING_RESIDUAL:
            who = f"{names[int(np.argmin(rests))]} differ from the others'"
    return Finding.wrong(
        f"these logs are of two robots, or the robot was modified: the link inertias of {who}",
        figure,
        fix=Fix("Identify each robot separately"),
    )


def _load_in_one_run(
    identified: IdentifiedModel, runs: Sequence[Information], own: Array, number: int
) -> tuple[float, float, float, str]:
    """What a load in one run leaves, its mass and half-width [kg], and the run's name."""
    name = runs[number].runs
    others, model = [run for k, run in enumerate(runs) if k != number], identified.model
    if not others[0].windows or "m." + model.robot.bodies[-1].name not in identified.base.names:
        return np.inf, 0.0, 0.0, name
    frame, loaded = carrier(model.robot), [runs[number]]
    case = load_case(model, identified.base, frame, others, loaded, first_deviates=False)
    known = WeightedLeastSquares()(case.information)
    mass = known.parameters.as_dict().get("m.payload", -np.inf)
    if mass <= 0.0:
        return np.inf, 0.0, 0.0, name
    spread = dict(zip(known.parameters.names, known.std.tolist(), strict=True))["m.payload"]
    return _times(np.square(known.sigma), runs, own), mass, Z95 * spread, name


HEAVIER_LAST_LINK = 2.0
"""Mass over the model file's, relative to the median of the other links, from which on it is
reported. Links that are invented off by a quarter reach 1.5."""
KNOWN_MASS_SHARE = 0.5  # of a mass's knowledge that must come from the data


@case_check("last link")
def last_link_check(case: FittedCase) -> Iterable[Finding]:
    """A last link far heavier than the model file says, in fitted runs that agree, with masses."""
    standard, bodies = case.identified.estimate.standard, case.identified.model.robot.bodies
    if not case.fitted or standard is None:
        return
    # mass, standard deviation and the model file's mass of links that the data identify [kg]
    masses: dict[str, tuple[float, float, float]] = {}
    place = {name: k for k, name in enumerate(standard.parameters.names)}
    for body in bodies:
        k, nominal = place.get(f"m.{body.name}"), body.inertia.mass
        if k is None or not body.known or nominal <= 0.0 or standard.learned[k] < KNOWN_MASS_SHARE:
            continue
        values = float(standard.parameters.values[k]), float(standard.std[k])
        masses[body.name] = (*values, nominal)
    link = bodies[-1].name
    found = masses.pop(link, None)
    if found is None or not masses:
        return
    mass, std, nominal = found
    usual = float(np.median([one / known for one, _, known in masses.values()]))
    least, half = max(usual, 1.0) * nominal, Z95 * std
    if mass < HEAVIER_LAST_LINK * least or mass - half < least or runs_disagree_check(case):
        return
    yield Finding.doubtful(
        f"the last link ({link}) is estimated {mass - nominal:.2g} kg heavier than in the model "
        "file: the robot carries a payload or tool in all logs, or the model file is wrong",
        f"{mass:.3g} ± {half:.2g} kg for {nominal:.3g} kg, {mass / nominal:.1f} times, the other "
        f"links {usual:.1f} times",
        fix=Fix("Log without the load, or add the tool to the model file"),
    )


FINE_WINDOW = 0.25  # length of the windows that give its start and end [s]


LONGEST_SHARE = 0.4  # share of a run's windows that it takes at most
UNEVEN = 3.0  # greatest squared residual of a window over the median, at least
LEAST_FALL = 10.0  # factor by which the squared residual of a row falls where the force acts
LEAST_EXCESS = 25.0  # squared residual within over that of the other windows, at least, there
MOST_LEVERAGE = 1.0  # variance of what is predicted over that of the residuals, at most
PUSHED = 9.0  # squared residual of such a window over that of the others from which on it is pushed
LONGEST_PAUSE = 2  # windows in a row without force within one stretch

PASSING = "a force acted for a while, as by a contact"


@dataclass(frozen=True, eq=False)
class PassingForce:
    """A stretch of a run in which efforts are not those of its other motion."""

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
    own, effort, square = own_fit(out)
    free = many - own.shape[1]
    left = max(square / max(free, 1.0), 1e-12 * float(out[-1, -1]) / max(many, 1.0), 1e-300)
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
