"""Errors on parts that are left out in turn, and the cut-off of regression that they choose.

A motion that is in the data twice (periods of a Fourier series, a run that was recorded again) is
no test of a fit to its other half: windows that repeat what is left out are left out with it.

The band of a motion bounds what its torques can contain, not what a model explains of them: elastic
gears and controllers add what no rigid body has. Below each of some cut-offs, half of the one
before, least squares fits all data but one part, whose efforts are then predicted in one band.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import ceil
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.identified_model import BAND
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.runs.processing_choices import rounded
from steelyard.runs.run import Run

FOLDS = 5  # stretches that a single run is divided into
FEWEST = 2  # parts that must be left out
EVEN = 0.6  # least motion of a stretch, over that of the longest one


def logarithms(errors: Array, sizes: Array) -> Array:
    """One figure per fold: between the typical joint's error and that of all joints together.

    The former alone would let joints that carry next to nothing decide, the latter would leave
    all but the strongest out. Relative errors `(folds, rows)` and squares of the efforts, zero of
    rows that do not count, give logarithms `(folds,)`.
    """
    least, known = 1e-12, sizes > 0.0
    each = np.where(known, np.log(np.maximum(errors, least)), 0.0)
    typical = each.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    pooled = np.sqrt((np.square(errors) * sizes).sum(axis=1) / sizes.sum(axis=1))
    return np.asarray(0.5 * (typical + np.log(np.maximum(pooled, least))))


def standard_error(values: Array) -> float:
    """Standard error of a mean."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def chance_of(loss: Array, sure: float) -> float:
    """Mean loss over parts that chance explains but for the probability `sure` (Student)."""
    from scipy.special import stdtrit

    return float(stdtrit(len(loss) - 1, sure)) * standard_error(loss) if len(loss) > 1 else 0.0


LEAST_GAIN_PER_PARAMETER = 0.005  # gain of an error that is worth another parameter, relative to it
STILL = 0.05  # speed in a run over the greatest in any, up to which a joint does not move there
Fold = Callable[[Window], bool]  # whether a window belongs to a fold


def folds_of(runs: Sequence[Run]) -> tuple[Fold, ...]:
    """One fold per run; a single run is divided into `FOLDS` stretches of equal length."""
    _refuse_one_name(runs)
    if len(runs) > 1:
        return tuple(_within({run.name: WHOLE}) for run in runs)
    return tuple(_within({w.run: (w.start, w.stop)}) for w in stretches_of(runs[0]))


WHOLE = (-np.inf, np.inf)  # start and stop of a run that is a fold as a whole


def _within(spans: Mapping[str, tuple[float, float]]) -> Fold:
    """Windows whose middle is in the span of their run."""

    def has(window: Window) -> bool:
        start, stop = spans.get(window.run, (np.inf, np.inf))
        return start <= 0.5 * (window.start + window.stop) < stop

    return has


def _refuse_one_name(runs: Sequence[Run]) -> None:
    names = [run.name for run in runs]
    if twice := [name for name in names if names.count(name) > 1]:
        wrong = f"{names.count(twice[0])} runs are called '{twice[0]}'"
        fix = "give every run a name of its own"
        raise DataError(wrong, where="runs of the cross-validation", fix=fix)


@dataclass(frozen=True)
class Folding:
    """How data are divided into parts that are left out in turn."""

    left_out: Literal["run", "segment"]  # whether a part is a run, or a stretch of every run
    longest: float  # length of windows that parts can be made of [s]

    def parts(self, moving: Information) -> tuple[Fold, ...]:
        """The parts with motion: runs, or stretches with as much of it each."""
        if self.left_out == "run":
            return tuple(_within({name: WHOLE}) for name in moving.windows_of_runs)
        edges = {}
        for name, mine in moving.windows_of_runs.items():  # stretches with as much motion each
            before = np.cumsum([0.0, *moving.counts[mine].sum(axis=1)])
            at = np.searchsorted(before, before[-1] * np.arange(1, FOLDS) / FOLDS)
            starts = [moving.windows[k].start for k in mine] + [np.inf]
            edges[name] = [-np.inf, *(starts[k] for k in at), np.inf]
        spans = ({name: (x[k], x[k + 1]) for name, x in edges.items()} for k in range(FOLDS))
        parts = (_within(some) for some in spans)
        return tuple(part for part in parts if any(map(part, moving.windows)))


def folding(runs: Sequence[Run]) -> Folding:
    """Parts of which each leaves motion of every joint to be fitted.

    Where a joint moves in one run only, without that run nothing identifies its friction: then a
    stretch of every run is left out. Two runs of one name are refused.
    """
    _refuse_one_name(runs)
    speeds = np.array([run.quality.max_speed for run in runs])
    once = ((speeds > STILL * speeds.max(axis=0)).sum(axis=0) == 1).any()
    if len(runs) > 1 and not once:
        return Folding("run", float("inf"))
    return Folding("segment", min(longest_window([run]) for run in runs))


def windows_of_folds(information: Information) -> tuple[tuple[int, ...], ...]:
    """Numbers of the windows of each run, or of stretches of a single run with as much motion each.

    There are as many stretches, up to `FOLDS`, as windows make alike: what is left at the end of a
    run is no stretch. None if there are too few windows.
    """
    runs = tuple(information.windows_of_runs.values())
    if len(runs) > 1:
        return tuple(map(tuple, runs))
    ends = np.cumsum([0.0, *information.counts.sum(axis=1)])
    found, alike = tuple[tuple[int, ...], ...](), 0.0
    for number in range(FOLDS, FEWEST - 1, -1):
        edges = np.abs(ends[:, None] - np.linspace(0.0, ends[-1], number + 1)).argmin(axis=0)
        motion = np.diff(ends[edges])
        share = motion.min() / max(motion.max(), 1.0)
        if share > alike:
            found, alike = tuple(tuple(range(a, b)) for a, b in pairwise(edges.tolist())), share
        if alike >= EVEN:
            break
    return found


def stretches_of(run: Run) -> tuple[Window, ...]:
    """Stretches of equal length; the first and the last have no outer end."""
    edges = np.linspace(*run.span, FOLDS + 1).tolist()
    edges[0], edges[-1] = -np.inf, np.inf
    return tuple(Window(run.name, a, b) for a, b in pairwise(edges))


def longest_window(runs: Sequence[Run]) -> float:
    """Length of windows that folds can be made of [s]."""
    if len(runs) > 1:
        return float("inf")
    return (runs[0].span[1] - runs[0].span[0]) / (8.0 * FOLDS)


def per_fold(information: Information, folds: Sequence[Fold]) -> Information:
    """One window per fold, in their order."""
    groups = [[k for k, w in enumerate(information.windows) if fold(w)] for fold in folds]
    if len(groups) < FEWEST or not all(groups):
        raise too_short(information.runs)
    return information.grouped(groups)


class TooShortError(DataError):
    """There is nothing in a part of a run that is to be left out."""


NAMED_LAWS = 'log longer or several runs, or name the friction laws instead of "auto"'


def too_short(where: str, fix: str = NAMED_LAWS) -> TooShortError:
    """What to say where nothing can be left out."""
    return TooShortError("the run is too short to leave a part of it out", where=where, fix=fix)


def values_by(estimator: Estimator[Information]) -> Callable[[Information], Array]:
    """Values of an information's columns that an estimator finds, zero of what it does not see."""
    return lambda data: estimator(data).parameters.named(data.layout.columns)


def left_out_errors(
    fitted: Information,
    tested: Information,
    values: Callable[[Information], Array],
    only: Sequence[int] | None = None,
) -> Array:
    r"""Relative errors of each fold, predicted from all others, shape `(folds, rows)` [%].

    $100\,\|y - A\hat\phi\| / \|y\|$ per effort row behind the parallel filter. Information has one
    window per fold; `values` are those of an information's columns, fitted to it. Only some folds
    are predicted where `only` names them.
    """
    count = len(fitted.windows)
    wanted = range(count) if only is None else only
    errors = np.empty((len(wanted), len(tested.layout.rows)))
    for place, fold in enumerate(wanted):
        known = values(fitted.of([k for k in range(count) if k != fold]))
        errors[place] = tested.of([fold]).relative_errors(known)
    return frozen(errors)


PER_WAVE = 20.0  # instants at which motions are compared, over the regression cut-off
REPEATED_MOTION_DISTANCE = 0.1  # most between alike states, in standard deviations
SAME_LAG = 2.0  # instants by which the lag of two alike motions may vary
REPEATED_WINDOW_SHARE = 0.5  # least share of a window's instants that repeat a motion
LONGEST = 200_000  # samples of a left-out run or stretch that are predicted at most: its first ones
INSTANTS = 200_000  # instants of a run that are compared with what is left out, at most


@dataclass(frozen=True)
class LeftOut:
    """A stretch to be predicted, and what may be fitted meanwhile."""

    run: int
    span: tuple[float, float]  # start and end of what is predicted [s]
    fitted: tuple[int, ...]  # numbers of the windows that are fitted


def runs_left_out(runs: Sequence[Run], information: Information) -> tuple[LeftOut, ...]:
    """Every run in turn; runs of which nothing but repetitions would be left are not left out."""
    return _left_out([(k, run.span) for k, run in enumerate(runs)], runs, information)


def stretches_left_out(runs: Sequence[Run], information: Information) -> tuple[LeftOut, ...]:
    """Stretches of the longest run in turn, where all runs are of one motion."""
    longest = max(range(len(runs)), key=lambda k: runs[k].duration)
    begin, end = runs[longest].span
    parts = stretches_of(runs[longest])
    wanted = [(longest, (max(part.start, begin), min(part.stop, end))) for part in parts]
    return _left_out(wanted, runs, information)


def _left_out(
    wanted: Sequence[tuple[int, tuple[float, float]]], runs: Sequence[Run], information: Information
) -> tuple[LeftOut, ...]:
    """Spans of runs with what may be fitted meanwhile; without those for which nothing may."""
    courses = [_Course.of(run, INSTANTS) for run in runs]
    size = np.std(np.concatenate([course.states for course in courses]), axis=0)
    size = np.where(size > 0.0, size, 1.0)
    by_run = {run.name: course.over(size) for run, course in zip(runs, courses, strict=True)}
    found = []
    for number, (start, stop) in wanted:
        run = runs[number]
        first = (start, min(stop, start + LONGEST / run.rate))
        out = _Course.of(replace(run, span=first)).over(size)
        fitted = tuple(
            k
            for k, window in enumerate(information.windows)
            if not (window.run == run.name and window.start < stop and start < window.stop)
            and not by_run[window.run].during(window.start, window.stop).repeats(out)
        )
        found += [LeftOut(number, first, fitted)] if fitted else []
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _Course:
    """The motion of a run at evenly spaced instants."""

    t: Array  # shape `(N,)` [s]
    states: Array  # positions and velocities, shape `(N, 2 n)`
    apart: float  # time between instants [s]

    @classmethod
    def of(cls, run: Run, most: float = np.inf) -> "_Course":
        step = max(1, int(run.rate / (PER_WAVE * run.matched_cutoff)))
        step *= max(1, ceil(run.rate * run.duration / step / most))
        parts = [
            (block.t[::step].copy(), np.concatenate([block.q[:, ::step], block.dq[:, ::step]]).T)
            for block in run.blocks()
        ]
        empty = (np.zeros(0), np.zeros((0, 1)))
        t, states = (np.concatenate(part) for part in zip(*(parts or [empty]), strict=True))
        return cls(t, states, step / run.rate)

    def during(self, start: float, stop: float) -> "_Course":
        mine = (self.t >= start) & (self.t <= stop)
        return replace(self, t=self.t[mine], states=self.states[mine])

    def over(self, size: Array) -> "_Course":
        """In units of `size`, shape `(2 n,)`."""
        return replace(self, states=self.states / size)

    @cached_property
    def tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(self.states)

    def repeats(self, other: "_Course") -> bool:
        """Whether most of this is what the other does, at one lag."""
        if not len(self.t) or not len(other.t):
            return False
        distance, index = other.tree.query(
            self.states, p=np.inf, distance_upper_bound=REPEATED_MOTION_DISTANCE
        )
        near = np.isfinite(distance)
        if np.mean(near) < REPEATED_WINDOW_SHARE:
            return False
        lags = self.t[near] - other.t[index[near]]
        steady = np.abs(lags - np.median(lags)) <= SAME_LAG * max(self.apart, other.apart)
        return bool(np.sum(steady) >= REPEATED_WINDOW_SHARE * len(near))


IN_DOUBT = 2.0  # cut-off over the band of errors from which on lower ones are tried
HALVINGS = 3  # lower cut-offs that are tried, each half of the one before
WORTH = 0.05  # fall of the error that a lower cut-off must bring, relative to it


@dataclass(frozen=True)
class CutoffChoice:
    """Cut-offs that were tried, the highest first, and their errors on left-out motion."""

    cutoffs: tuple[float, ...]  # [Hz]
    errors: tuple[float, ...]  # mean over parts of the typical and the pooled error [%]

    @property
    def chosen(self) -> float:
        """The highest cut-off whose error no lower one undercuts by as much as is worth it [Hz]."""
        least = min(self.errors)
        return next(
            cutoff
            for cutoff, error in zip(self.cutoffs, self.errors, strict=True)
            if error * (1.0 - WORTH) <= least
        )

    @property
    def note(self) -> str:
        """What was chosen and why, for people to read."""
        pairs = zip(self.cutoffs, self.errors, strict=True)
        listed = ", ".join(f"{cutoff:g} Hz {error:.3g} %" for cutoff, error in pairs)
        return (
            f"regression cut-off {self.chosen:g} Hz, chosen by the error on motion left out, below "
            f"{BAND:g} Hz: {listed}; matched_cutoff under [processing] states another one"
        )


def choose_cutoff(
    model: Model, runs: Sequence[Run], threads: int = 1, progress: Progress = silent
) -> CutoffChoice | None:
    """The cut-off at which a model's laws predict left-out motion best.

    `None` where the runs' own is not far above the band of errors, or nothing can be left out.
    """
    first = runs[0].matched_cutoff
    if first <= IN_DOUBT * BAND or any(finds_of(term) for term in model.terms):
        return None
    tried = tuple(rounded(first / 2**k) for k in range(HALVINGS + 1) if first / 2**k >= BAND)
    regressor, values = base_regressor(model), values_by(WeightedLeastSquares())
    try:
        divided, known = folding(runs), []
        for number, cutoff in enumerate(dict.fromkeys((*tried, BAND))):
            report_progress(progress, "choosing the cut-off", number, len(tried) + 1)
            information_of = information_from(
                [behind(run, cutoff) for run in runs],
                rests=model.has_memory,
                longest=divided.longest,
                threads=threads,
            )
            known.append(information_of(regressor))
        folds = divided.parts(known[-1])
        parts = [per_fold(one, folds) for one in known]
        judge = parts[-1]
        sizes = np.array([judge.of([k]).effort_squares() for k in range(len(judge.windows))])
        errors = [
            float(np.exp(logarithms(left_out_errors(one, judge, values), sizes).mean()))
            for one in parts[: len(tried)]
        ]
    except (DataError, LogError):
        return None
    return CutoffChoice(tried, tuple(errors))


def behind(run: Run, cutoff: float) -> Run:
    """The run behind another parallel filter [Hz]."""
    processing = replace(run.chain.processing, matched_cutoff=cutoff)
    return replace(run, chain=replace(run.chain, processing=processing))
