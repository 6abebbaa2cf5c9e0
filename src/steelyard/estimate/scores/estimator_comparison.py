"""Estimators compared: each fitted to all runs but one, and judged by the one that was left out.

An estimator that fails has its reason, and stops no other.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, SteelyardError
from steelyard.base.progress import Progress, Stopped, report_progress, silent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.estimator_register import Context, Needs, Offer
from steelyard.estimate.information.base_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_and_robust import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.scores.cross_validation import folds_of, stretches_of
from steelyard.estimate.scores.estimator_scores_and_advice import (
    COST,
    Comparison,
    EstimatorScore,
    Failure,
)
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.runs.run import Run

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
            for fold in folds_of(runs)
        )
        if not all(windows):
            raise DataError(
                "the run is too short to leave a part of it out",
                where=", ".join(run.name for run in runs),
                fix="log longer, or several runs",
            )
        if len(runs) > 1:
            return cls(tuple(run.name for run in runs), "run", information, windows, others)
        first, last = runs[0].span
        names = tuple(
            f"{max(part.start, first):.3g} to {min(part.stop, last):.3g} s"
            for part in stretches_of(runs[0])
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
    if estimate.standard is not None:
        known = estimate.standard.parameters.as_dict()
        return base.base_values([known.get(name, 0.0) for name in base.names])
    known = estimate.parameters.as_dict()
    return np.array([known.get(name, 0.0) for name in base.base_names])


def impossible_bodies(estimate: Estimate, knowledge: Knowledge) -> tuple[str, ...] | None:
    """Bodies that cannot exist; `None` if an estimate does not say what bodies it has."""
    if estimate.standard is None:
        return None
    known = estimate.standard.parameters.as_dict()
    found = []
    for number, body in enumerate(knowledge.bodies):
        ten = [known[knowledge.names[k]] for k in knowledge.tens(number)]
        inertia = Inertia.from_ten(ten)
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
    for run in information.windows_of_runs:
        mine = own.get(run, {})
        values = [mine.get(name, v) for name, v in zip(base.base_names, shared, strict=True)]
        windows = [k for k, window in enumerate(information.windows) if window.run == run]
        with np.errstate(all="ignore"):
            squares += information.of(windows).residual_squares(np.array(values))
    freedom = float(information.n_samples.sum()) - len(base)
    return float((squares / noise).sum()) / max(freedom, 1.0)
