"""Causes of what a fit leaves, ranked beside its measurement noise, and which stand out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.diagnosis.causes import GEOMETRY, Cause, causes, wide_model
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.least_squares.sandwich import inflations
from steelyard.estimation.per_run import own_columns
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.base import base_parameters
from steelyard.regression.regressor import Regressor, base_regressor
from steelyard.validation.friction.mixes import remembers
from steelyard.validation.residuals import ResidualNoise, residual_noise

ABOVE = 1.5
"""Residual over noise from which on a joint is counted among those that are above it."""

SHARE = 0.2
"""Share of what noise does not explain from which on a cause is named."""

NAMED = 3
"""Most causes that are named."""

CLEAR = 1.5
"""How many times more than a lack of friction an error of the geometry or of an effort must
explain to be blamed: on five real robots friction explains more than any such error."""

LEAST, EACH = 25.0, 3.0
"""Chi square that it must explain, and more per column, over the factor by which the estimate
scatters more than by white residuals: a single column reaches 25 by noise once in a million."""

ALIKE = 0.8
"""Rank over the first's from which on another error is named beside it."""

MOST_RUNS, MOST_SAMPLES = 20, 200_000
"""Runs and samples that are looked at: more make no cause clearer, but take time."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """Residuals of a fit, and what may explain them.

    Attributes:
        beside: Residuals and measurement noise.
        found: All causes, the most likely first.
        blamed: Errors of geometry or efforts that explain much more than a lack of friction.
        total: Chi square of the fit.
        wide: Columns of all causes.
    """

    beside: ResidualNoise
    found: tuple[Cause, ...]
    blamed: tuple[Cause, ...]
    total: float
    wide: Regressor

    @property
    def of_geometry(self) -> bool:
        """Whether the first cause is one that wrong joint zeros look like."""
        return bool(self.found) and self.found[0].kind in ("zero_offset", "geometry", *GEOMETRY)

    @property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that are named, the best first; the whole geometry only if no other is."""
        large = [cause for cause in self.found if cause.share >= SHARE]
        single = [cause for cause in large if cause.kind != "geometry"]
        return tuple(single or large)[:NAMED]


def can_be_ranked(model: Model) -> bool:
    """Whether causes have columns: an open chain with bodies."""
    return not model.robot.passive and model.has_bodies


def beginnings(runs: Sequence[Run], samples: int = MOST_SAMPLES) -> tuple[Run, ...]:
    """At most `MOST_RUNS` runs, spread over all, and of each no more than makes `samples`."""
    step = -(-len(runs) // MOST_RUNS)
    chosen = runs[::step]
    most = samples / len(chosen)
    return tuple(
        replace(run, span=(run.span[0], min(run.span[1], run.span[0] + most / run.rate)))
        for run in chosen
    )


def ranked_causes(model: Model, estimate: Estimate, runs: Sequence[Run]) -> Ranked:
    """The causes of what a fit of runs leaves, and which of them stand out."""
    gains = runs[0].recording.signals.gains
    beside = residual_noise(model.at(estimate.values), runs, estimate.sigma, gains)
    wide = base_regressor(wide_model(model, estimate))
    information = information_from(runs, rests=remembers(model.terms))(wide)
    found = causes(model, information, estimate.sigma, beside.ratios)
    own = information.select(base_parameters(model).base_names)
    fit = WeightedLeastSquares(per_run=own_columns(model)).fit(own)
    blamed = _blamed(found, float(inflations(fit).max()))
    return Ranked(beside, found, blamed, float(information.n_samples.sum()), wide)


def _blamed(found: Sequence[Cause], inflation: float) -> tuple[Cause, ...]:
    """Errors of geometry or efforts that explain much more than a lack of friction, best first."""
    terms = max((cause.rank for cause in found if cause.of_friction), default=0.0)
    others = [cause for cause in found if not cause.of_friction]
    if not others:
        return ()
    first = others[0]
    enough = LEAST + EACH * first.columns
    if first.chi2 / inflation < enough or first.rank < CLEAR * terms:
        return ()
    return tuple(cause for cause in others if cause.rank >= ALIKE * first.rank)[:NAMED]


def residuals(beside: ResidualNoise) -> str:
    """The worst joint's residual in measurement noise."""
    if not np.isfinite(beside.ratios).any():
        return "residuals are not noise"
    worst = int(np.nanargmax(beside.ratios))
    above, known = (int(np.sum(test)) for test in (beside.ratios > ABOVE, beside.ratios > 0.0))
    return (
        f"residuals are up to {times(beside)} x the measurement noise (worst joint: "
        f"{beside.joints[worst]}; {above} of {known} joints above {ABOVE:g} x)"
    )


def times(beside: ResidualNoise) -> str:
    """The largest residual in measurement noise."""
    ratio = float(np.nanmax(beside.ratios))
    return f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"
