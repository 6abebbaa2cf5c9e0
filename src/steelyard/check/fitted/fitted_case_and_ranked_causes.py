"""What a check of a fitted model looks at: runs, residuals, and the causes of these, ranked."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.base.errors import DataError
from steelyard.check.finding import Finding
from steelyard.check.fitted.binding_constraints import BindingConstraints, binding_constraints
from steelyard.check.fitted.causes_of_residuals import (
    GEOMETRY,
    NAMED_CAUSE_SHARE,
    Cause,
    LeftOutGain,
    causes,
    left_out_gains,
    residual_shape,
    wide_model,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import inflations
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    ResidualNoise,
    residual_noise,
)
from steelyard.estimate.scores.score import RunScore
from steelyard.model.model import Model
from steelyard.runs.run import Run

JOINT_ABOVE_NOISE = 1.5  # residual over noise from which on a joint is counted as above it
MOST_NAMED_CAUSES = 3  # most causes that are named
CLEAR_OVER_FRICTION = 1.5
"""How many times more than a lack of friction an error of the geometry or of an effort must
explain to be blamed: on five real robots friction explains more than any such error."""
LEAST_CHI_SQUARE, CHI_SQUARE_PER_COLUMN = 25.0, 3.0
"""Chi square that it must explain, and more per column, over the factor by which the estimate
scatters more than by white residuals: a single column reaches 25 by noise once in a million."""
NEXT_CAUSE_RANK = 0.8  # rank over the first's from which on another error is named beside it
OF_MOTORS = ("gain", "saturation", "compliance")  # causes that a joint without a motor cannot have
MOST_RUNS, MOST_SAMPLES = 20, 200_000  # looked at: more make no cause clearer


@dataclass(frozen=True, eq=False)
class RankedCauses:
    """Residuals of a fit, and what may explain them."""

    beside: ResidualNoise  # residuals and measurement noise
    found: tuple[Cause, ...]  # all causes, the most likely first
    blamed: tuple[Cause, ...]  # not of friction, and explain much more than a lack of it
    total: float  # chi square of the fit
    wide: Regressor  # columns of all causes

    @property
    def of_geometry(self) -> bool:
        """Whether the first cause is one that wrong joint zeros look like."""
        return bool(self.found) and self.found[0].kind in ("zero_offset", "geometry", *GEOMETRY)

    @property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that are named, the best first; the whole geometry only if no other is."""
        large = [cause for cause in self.found if cause.share >= NAMED_CAUSE_SHARE]
        single = [cause for cause in large if cause.kind != "geometry"]
        return tuple(single or large)[:MOST_NAMED_CAUSES]


def can_be_ranked(model: Model) -> bool:
    """Whether causes have columns: an open chain with bodies."""
    return not model.robot.passive and model.has_bodies


def first_parts_of_runs(runs: Sequence[Run], samples: int = MOST_SAMPLES) -> tuple[Run, ...]:
    """At most `MOST_RUNS` runs, spread over all, and of each no more than makes `samples`."""
    step = -(-len(runs) // MOST_RUNS)
    chosen = runs[::step]
    most = samples / len(chosen)
    return tuple(
        replace(run, span=(run.span[0], min(run.span[1], run.span[0] + most / run.rate)))
        for run in chosen
    )


def ranked_causes(model: Model, estimate: Estimate, runs: Sequence[Run]) -> RankedCauses:
    """The causes of what a fit of runs leaves, and which of them stand out."""
    gains, free = runs[0].recording.signals.gains, runs[0].recording.signals.unactuated
    valued = model.at(estimate.values)
    beside = residual_noise(valued, runs, estimate.sigma, gains)
    shape = residual_shape(valued, runs, gains)
    wide = base_regressor(wide_model(model, estimate, shape))
    information = information_from(runs, rests=model.has_memory)(wide)
    found = tuple(
        cause
        for cause in causes(model, information, estimate.sigma, beside.ratios, shape)
        if cause.kind not in OF_MOTORS
        or cause.joint not in {model.robot.joint_names[j] for j in free}
    )
    own = information.select(base_parameters(model).base_names)
    fit = WeightedLeastSquares(per_run=model.per_run_names).fit(own)
    terms = max((cause.rank for cause in found if cause.of_friction), default=0.0)
    others = [cause for cause in found if not cause.of_friction]
    blamed: list[Cause] = []
    if others and others[0].rank >= CLEAR_OVER_FRICTION * terms:
        enough = LEAST_CHI_SQUARE + CHI_SQUARE_PER_COLUMN * others[0].columns
        if others[0].chi2 / float(inflations(fit).max()) >= enough:
            blamed = [cause for cause in others if cause.rank >= NEXT_CAUSE_RANK * others[0].rank]
    total = float(information.n_samples.sum())
    return RankedCauses(beside, found, tuple(blamed[:MOST_NAMED_CAUSES]), total, wide)


def worst_residual_words(beside: ResidualNoise) -> str:
    """The worst joint's residual in measurement noise."""
    ratios = beside.ratios
    if not np.isfinite(ratios).any():
        return "residuals are not noise"
    above, known = int(np.sum(ratios > JOINT_ABOVE_NOISE)), int(np.sum(ratios > 0.0))
    return (
        f"residuals are up to {largest_residual(beside)} x the measurement noise (worst joint: "
        f"{beside.joints[int(np.nanargmax(ratios))]}; {above} of {known} joints above "
        f"{JOINT_ABOVE_NOISE:g} x)"
    )


def largest_residual(beside: ResidualNoise) -> str:
    """The largest residual in measurement noise."""
    ratio = float(np.nanmax(beside.ratios))
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"


@dataclass(frozen=True, eq=False)
class FittedCase:
    """A fitted model with the runs that it is compared with."""

    identified: IdentifiedModel  # the model
    fitted: tuple[Run, ...] = ()  # runs that were fitted; empty in `validate`
    unseen: tuple[Run, ...] = ()  # runs that were not fitted
    fitted_scores: tuple[RunScore, ...] = ()  # one score per fitted run
    unseen_scores: tuple[RunScore, ...] = ()  # one score per unseen run
    # information of the fitted runs on the base columns, by windows and runs; `None` in `validate`
    information: Information | None = None
    unresolved: tuple[Finding, ...] = ()  # doubts of the check before the fit in the fitted runs
    scales: EffortScales | None = None  # scales of the efforts that were estimated, if any
    consistent: Consistent | None = None  # what made the estimate, if it was this, without scales
    gains: GainEstimate | None = None  # drive gains that were identified, if any

    @cached_property
    def examined(self) -> tuple[Run, ...]:
        """The fitted runs as far as causes of their residuals are looked for."""
        return first_parts_of_runs(self.fitted)

    @cached_property
    def ranked(self) -> RankedCauses | None:
        """Causes of the residuals of fitted runs; `None` in `validate`, and of closed chains."""
        model = self.identified.model
        if not self.fitted or not can_be_ranked(model):
            return None
        return ranked_causes(model, self.identified.estimate, self.examined)

    @cached_property
    def tested(self) -> tuple[tuple[Cause, LeftOutGain | None], ...]:
        """The likely causes with their gain on left-out motion; `None` of logs too short for it."""
        ranked = self.ranked
        if ranked is None or not ranked.likely:
            return ()
        model, sigma = self.identified.model, self.identified.estimate.sigma
        gains = left_out_gains(model, ranked.wide, sigma, self.examined, ranked.likely)
        return tuple(zip(ranked.likely, gains, strict=True))

    @cached_property
    def binding(self) -> BindingConstraints | None:
        """Constraints that the data contradict, at the cost of the prediction."""
        if self.information is None or self.consistent is None:
            return None
        moving = [
            run
            for run, score in zip(self.unseen, self.unseen_scores, strict=True)
            if not score.errors.at_rest and not score.repeats
        ]
        model, estimate = self.identified.model, self.identified.estimate
        try:
            return binding_constraints(
                model, estimate, self.information, self.consistent, self.scales, moving
            )
        except DataError:
            return None
