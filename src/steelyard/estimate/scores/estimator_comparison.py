"""Estimators compared: each fitted to all runs but one and judged by that one; which to take.

An estimator that fails has its reason, and stops no other.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, finite_json, frozen
from steelyard.base.errors import SteelyardError
from steelyard.base.progress import Progress, Stopped, report_progress, silent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.estimator_register import Context, Needs, Offer
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.scores import cross_validation
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.runs.run import Run

NEGLIGIBLE_LOSS = 0.02  # loss against the best, relative to its error, that is not worth a choice
LOSS_THAT_COUNTS = 0.1  # the same, from which on a loss counts however much it scatters
ZERO = 100.0  # error of a model that predicts zero [%]

BEATEN = "is better than predicting zero, which has 100 %: check the log against the robot file"

FEW_PARTS = 2
FEW_PARTS_NOTE = "; two parts are few, use more runs"  # if so many parts were predicted
COST = {"information": 0, "samples": 1, "experiment": 2}  # what an estimator needs


@dataclass(frozen=True)
class Failure:
    """A fit that failed."""

    left_out: str | None  # what was left out of it; `None` if it was of all data
    reason: str
    fix: str


@dataclass(frozen=True, eq=False)
class EstimatorScore:
    """How one estimator did; `errors` are behind the parallel filter, where joints move."""

    name: str
    about: str
    needs: str
    slow: bool
    errors: Array  # of left-out `(parts, joints)` [%]; NaN at rest, infinite where a fit failed
    pooled: Array  # the same with norms over all joints together, shape `(parts,)` [%]
    seconds: float | None  # time of one fit, mean [s]; `None` if none came to an end
    parameters: int | None  # number of parameters it gives values to, fitted to all data
    condition: float | None  # condition number of that fit, columns scaled to unit length
    chi_square: float | None  # squared residuals over noise of WLS, per degree of freedom
    impossible: tuple[str, ...] | None  # bodies; `None` if the fit says nothing of them
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()  # what that fit says of itself

    @property
    def means(self) -> Array:
        """Mean error over the joints that move, shape `(parts,)` [%]; NaN where none does."""
        return mean_of(self.errors, axis=1)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether a part could not be predicted, shape `(parts,)`."""
        return np.asarray(np.isinf(self.errors).any(axis=1), bool)

    @property
    def by_joint(self) -> Array:
        """Mean error over the parts that were predicted, shape `(joints,)` [%]."""
        return mean_of(self.errors[~self.failed], axis=0)

    @property
    def mean_pooled(self) -> float:
        """Mean of `pooled` over the parts with motion [%]; NaN if a fit failed."""
        return float("nan") if self.failed.any() else float(mean_of(self.pooled, axis=0))

    @property
    def mean(self) -> float | None:
        """Mean error over joints and those parts that could be predicted [%]."""
        known = self.means[np.isfinite(self.means)]
        return float(known.mean()) if len(known) else None

    @property
    def standard_error(self) -> float | None:
        """Standard error of the mean over the parts [%]."""
        known = self.means[np.isfinite(self.means)]
        return cross_validation.standard_error(known) if len(known) > 1 else None

    @property
    def whole(self) -> bool:
        """Whether no fit failed and there is an error."""
        return not self.failures and not self.failed.any() and self.mean is not None

    @property
    def valid(self) -> bool:
        """Whether every body is known to be physically consistent."""
        return self.impossible == ()

    @property
    def mean_text(self) -> str:
        """The mean error with its standard error, like `3.0 ± 0.4 %`."""
        if self.mean is None or not isfinite(self.mean):
            return "no error"
        if not self.standard_error:
            return f"{self.mean:.2f} %"
        digits = min(max(0, 1 - int(np.floor(np.log10(self.standard_error)))), 3)
        return f"{self.mean:.{digits}f} ± {self.standard_error:.{digits}f} %"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; an error that is not finite is `None`."""
        figures = {
            "estimator": self.name,
            "about": self.about,
            "needs": self.needs,
            "mean_percent": self.mean,
            "standard_error_percent": self.standard_error,
            "pooled_percent": self.mean_pooled,
            "errors_percent": self.errors,
            "seconds_per_fit": self.seconds,
            "parameters": self.parameters,
            "condition_normalised": self.condition,
            "chi_square": self.chi_square,
            "bodies_valid": None if self.impossible is None else not self.impossible,
            "impossible_bodies": self.impossible,
            "failures": [vars(one) for one in self.failures],
            "notes": self.notes,
        }
        return dict(finite_json(figures))


@dataclass(frozen=True)
class Advice:
    """Which estimator to take, `None` of all, and why, in one sentence."""

    name: str | None
    why: str


@dataclass(frozen=True, eq=False)
class Comparison:
    """Estimators beside each other."""

    scores: tuple[EstimatorScore, ...]  # one score per estimator, in the order they were fitted
    parts: tuple[str, ...]  # what was left out in turn
    left_out: Literal["run", "segment"]  # whether those are runs or stretches of one
    joints: tuple[str, ...]  # names of the effort rows
    untried: tuple[str, ...] = ()  # requested, but the comparison was stopped before
    current: str | None = None  # the estimator that the robot file chooses

    @property
    def setting(self) -> str:
        """What to write into the robot file for the estimator to take; empty if nothing."""
        name = None if self.advice is None else self.advice.name
        if name is None or self.current in (None, name):
            return ""
        return f'[estimation] method = "{name}"'

    @property
    def advice(self) -> Advice | None:
        """The estimator to take; `None` if none came through."""
        return recommended(self.scores)

    @property
    def words(self) -> str:
        """What was compared, in one sentence."""
        which = "run" if self.left_out == "run" else "segment of the run"
        return (
            f"Each estimator is fitted to all but one {which} and predicts that one, for each of "
            f"the {len(self.parts)}."
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        advice = self.advice
        return {
            "left_out": self.left_out,
            "parts": list(self.parts),
            "joints": list(self.joints),
            "estimators": [score.to_dict() for score in self.scores],
            "recommended": None if advice is None else vars(advice),
            "robot_file": self.setting or None,
            "stopped_before": list(self.untried),
        }


def recommended(scores: Sequence[EstimatorScore]) -> Advice | None:
    """The estimator to take, by the one-standard-error rule [Hastie2009].

    Among the estimators whose errors do not differ significantly from the least, those with valid
    bodies are preferred, then those that need less data, then the simplest: the first fitted of
    those within 2 % of the least remaining error. Errors of two estimators are compared part by
    part, because parts differ in difficulty. None is recommended if all are worse than
    a model that predicts zero, whose error is 100 %.
    """
    fit = [score for score in scores if score.whole]
    if not fit:
        return None
    best = min(fit, key=_error)
    if _error(best) > ZERO:
        return Advice(None, f"{best.name}: {best.mean_text}, the least error; nothing {BEATEN}")
    close = [score for score in fit if score is best or within_standard_error(score, best)]
    rank = min(map(_rank, close))
    equal = [score for score in close if _rank(score) == rank]
    most = (1.0 + NEGLIGIBLE_LOSS) * min(map(_error, equal))
    chosen = next(score for score in equal if _error(score) <= most)
    few = int(np.isfinite(best.means).sum()) <= FEW_PARTS
    return Advice(chosen.name, _why(chosen, best, close) + (FEW_PARTS_NOTE if few else ""))


def _error(score: EstimatorScore) -> float:
    return np.inf if score.mean is None else score.mean


def _rank(score: EstimatorScore) -> tuple[bool, bool, int]:
    """What speaks against an estimator beside its error."""
    return not score.valid, score.slow, COST[score.needs]


def within_standard_error(score: EstimatorScore, best: EstimatorScore) -> bool:
    """Whether the logarithm of the errors' ratio, part by part, is not above its standard error."""
    tiny = 1e-12
    known = np.isfinite(score.means) & np.isfinite(best.means)
    loss = np.log(np.maximum(score.means[known], tiny) / np.maximum(best.means[known], tiny))
    return float(loss.mean()) <= min(
        max(cross_validation.standard_error(loss), NEGLIGIBLE_LOSS), LOSS_THAT_COUNTS
    )


def _why(chosen: EstimatorScore, best: EstimatorScore, close: Sequence[EstimatorScore]) -> str:
    if chosen is best:
        text = f"{chosen.name}: {chosen.mean_text}, the least error"
        others = [t.name for t in close if t is not best]
        text += f"; {', '.join(others)} not significantly different" if others else ""
        return text + ("; its inertias are valid" if chosen.valid else "")
    reasons = []
    if chosen.valid and not best.valid:
        reasons.append("its inertias are valid")
    if _rank(chosen)[1:] < _rank(best)[1:] or not reasons:
        reasons.append("it is simpler")
    return (
        f"{best.name}: {best.mean_text}; {chosen.name}: {chosen.mean_text}, within one standard "
        f"error of the difference, and {' and '.join(reasons)}: {chosen.name} is recommended"
    )


def mean_of(errors: Array, axis: int) -> Array:
    """Mean of those that are not NaN, NaN where all are."""
    known = ~np.isnan(errors)
    total = np.where(known, errors, 0.0).sum(axis=axis)
    count = known.sum(axis=axis)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


LEFT = "leave it out of the comparison"  # what to do about an estimator that only fails
Chosen = Callable[[Information], Any]  # windows to what an estimator needs of them


@dataclass(frozen=True, eq=False)
class Parts:
    """Data in parts, each of which is left out in turn."""

    names: tuple[str, ...]  # what is left out: runs, or stretches of a single one
    left_out: Literal["run", "segment"]
    information: Information  # what all of them say about the base columns
    windows: tuple[tuple[int, ...], ...]  # per part the indices of its windows
    others: Mapping[Needs, Chosen]  # samples and experiments of some windows

    @classmethod
    def of(
        cls, runs: Sequence[Run], information: Information, others: Mapping[Needs, Chosen]
    ) -> "Parts":
        """Runs, or stretches of a single one."""
        windows = tuple(
            tuple(k for k, w in enumerate(information.windows) if fold(w))
            for fold in cross_validation.folds_of(runs)
        )
        names = tuple(run.name for run in runs)
        if not all(windows):
            raise cross_validation.too_short(", ".join(names), "log longer, or several runs")
        if len(runs) > 1:
            return cls(names, "run", information, windows, others)
        first, last = runs[0].span
        names = tuple(
            f"{max(part.start, first):.3g} to {min(part.stop, last):.3g} s"
            for part in cross_validation.stretches_of(runs[0])
        )
        return cls(names, "segment", information, windows, others)

    def information_of(self, parts: Sequence[int]) -> Information:
        """Information of some of the parts."""
        return self.information.of([k for part in parts for k in self.windows[part]])


def compare(
    offers: Sequence[Offer],
    context: Context,
    parts: Parts,
    *,
    progress: Progress = silent,
    interruption: type[BaseException] = Stopped,
) -> Comparison:
    """Fit each estimator to all parts but one and predict that one, the cheap estimators first.

    An interruption keeps what is done, if anything is.
    """
    noise: Array | None = None
    with suppress(SteelyardError, np.linalg.LinAlgError):
        least_squares = WeightedLeastSquares(per_run=context.per_run)
        noise = np.square(least_squares(parts.information).sigma)
    queue = sorted(offers, key=lambda offer: (offer.slow, COST[offer.needs]))
    scores: list[EstimatorScore] = []
    try:
        for offer in queue:
            scores.append(_tried(offer, context, parts, noise, progress))
    except interruption:
        if not scores:
            raise
    untried = tuple(offer.name for offer in queue[len(scores) :])
    rows = context.regressor.layout.rows
    return Comparison(tuple(scores), parts.names, parts.left_out, rows, untried)


def _tried(
    offer: Offer, context: Context, parts: Parts, noise: Array | None, progress: Progress
) -> EstimatorScore:
    """One estimator, fitted to everything and to all parts but one."""
    count = len(parts.names)
    rows = len(context.regressor.layout.rows)
    errors, pooled = np.full((count, rows), np.inf), np.full(count, np.inf)
    whole: Estimate | None = None
    failures: list[Failure] = []
    seconds: list[float] = []
    for left in (None, *range(count)):
        done = 0 if left is None else left + 1
        report_progress(progress, f"fitting with {offer.name}", done, count + 1)
        chosen = [k for k in range(count) if k != left]
        found = _fitted(offer, context, parts, chosen, seconds)
        # an interrupt may have become an error of a library on its way
        report_progress(progress, f"fitting with {offer.name}", done + 1, count + 1)
        if not isinstance(found, Estimate):
            failures.append(Failure(None if left is None else parts.names[left], *found))
        elif left is None:
            whole = found
        else:
            left_out = parts.information_of([left])
            errors[left], pooled[left] = _errors(found, context.regressor.base, left_out)
            if np.isinf(errors[left]).any():
                failures.append(Failure(parts.names[left], "its predictions are not finite", LEFT))
    return EstimatorScore(
        offer.name,
        offer.about,
        offer.needs,
        offer.slow,
        frozen(errors),
        frozen(pooled),
        float(np.mean(seconds)) if seconds else None,
        None if whole is None else len(whole.values.names),
        None if whole is None else whole.condition_normalised,
        None if whole is None or noise is None else _chi_square(whole, context, parts, noise),
        None if whole is None else impossible_bodies(whole, context.knowledge),
        tuple(failures),
        () if whole is None else whole.notes,
    )


def _fitted(
    offer: Offer, context: Context, parts: Parts, chosen: Sequence[int], seconds: list[float]
) -> Estimate | tuple[str, str]:
    """An estimate, or why there is none and what to do."""
    try:
        data = parts.information_of(chosen)
        if offer.needs != "information":
            data = parts.others[offer.needs](data)
        start = perf_counter()
        with np.errstate(all="ignore"):
            estimator: Estimator[Any] = offer.make(context)
            estimate = estimator(data)
        seconds.append(perf_counter() - start)
    except Stopped:
        raise
    except SteelyardError as error:
        return error.wrong, error.fix
    except np.linalg.LinAlgError as error:
        return f"a matrix cannot be solved with ({str(error).lower()})", LEFT
    except MemoryError:
        return "there is not enough memory", LEFT
    except Exception as error:  # whatever an estimator does, the others go on
        reason = (str(error).splitlines() or ["no reason given"])[0]
        return f"it failed: {type(error).__name__}: {reason}", LEFT
    if not np.isfinite(estimate.values.values).all():
        return "its values are not finite", LEFT
    return estimate


def base_values(estimate: Estimate, base: BaseMap) -> Array:
    """Base parameters of an estimate, zero where it says nothing, shape `(b,)`."""
    if estimate.standard is None:
        return estimate.parameters.named(base.base_names)
    return base.base_values(estimate.standard.parameters.named(base.names))


def impossible_bodies(estimate: Estimate, knowledge: Knowledge) -> tuple[str, ...] | None:
    """Bodies that cannot exist; `None` if an estimate does not say what bodies it has."""
    if estimate.standard is None:
        return None
    found, values = [], estimate.standard.parameters.named(knowledge.names)
    for number, body in enumerate(knowledge.bodies):
        inertia = Inertia.from_ten(values[knowledge.tens(number)])
        if inertia.mass <= 0.0 or inertia.flaw() is not None:
            found.append(body)
    return tuple(found)


def _errors(estimate: Estimate, base: BaseMap, left_out: Information) -> tuple[Array, float]:
    """Relative errors per joint, NaN where it never moves, and over all together [%]."""
    with np.errstate(all="ignore"):
        squares = left_out.residual_squares(base_values(estimate, base))
    sizes = left_out.effort_squares()
    moving = sizes > 0.0
    if not moving.any():
        return np.full(len(sizes), np.nan), float("nan")
    squares = np.where(np.isnan(squares), np.inf, squares)
    shares = squares / np.where(moving, sizes, np.nan)
    pooled = float(squares[moving].sum() / sizes.sum())
    return 100.0 * np.sqrt(shares), 100.0 * float(np.sqrt(pooled))


def _chi_square(estimate: Estimate, context: Context, parts: Parts, noise: Array) -> float:
    """Squared residuals over the noise, per degree of freedom of weighted least squares."""
    base, information = context.regressor.base, parts.information
    own = {one.run: one.parameters.as_dict() for one in estimate.per_run}
    shared = base_values(estimate, base)
    squares = np.zeros(len(noise))
    for run, windows in information.windows_of_runs.items():
        mine = own.get(run, {})
        values = [mine.get(name, v) for name, v in zip(base.base_names, shared, strict=True)]
        with np.errstate(all="ignore"):
            squares += information.of(windows).residual_squares(np.array(values))
    freedom = float(information.n_samples.sum()) - len(base)
    return float((squares / noise).sum()) / max(freedom, 1.0)
