r"""What a check of a fitted model looks at: residuals, their causes, and binding constraints.

Constraints of the consistent estimate raise $\chi^2$ over that of least squares; noise alone by
about the rank of the data. Where they raise it by far more, the estimate is repeated without the
bounds along the coordinates where least squares contradicts one, and both predict motion that
neither has seen: logs that were not fitted, or else each run or stretch of one, left out in turn.
If the error without these bounds is clearly smaller, they are at fault; if not that, but that of
least squares is, the prior or the physical consistency of the links. Efforts of the other sign
have the same least squares with the signs of all parameters turned: where constraints that hold
for them cost far less, it is the sign.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from steelyard.base.arrays import Z95
from steelyard.base.errors import DataError
from steelyard.check.finding import Finding
from steelyard.check.fitted.causes_of_residuals import (
    GEOMETRY,
    NAMED_CAUSE_SHARE,
    WORTH_A_SEARCH,
    WORTH_A_TERM,
    Cause,
    LeftOutGain,
    causes,
    left_out_logs,
    residual_shape,
    wide_model,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import (
    BaseMap,
    Regressor,
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.covariance_from_residuals import inflations
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    WeightedLeastSquares,
    whitened,
)
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.prior.body_priors import Knowledge, Row
from steelyard.estimate.scores.cross_validation import logarithms, values_by, windows_of_folds
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    ResidualNoise,
    residual_noise,
)
from steelyard.estimate.scores.score import RunScore
from steelyard.model.model import Model
from steelyard.report.words import with_interval
from steelyard.runs.run import Run

COST_OVER_NOISE = 2.0  # rise of chi square over the rank of the data from which on it is compared
CLEARLY_LARGER = 1.25  # error over that without constraints from which on they are at fault
TURNED_RISE = 0.2  # rise of chi square with all efforts turned, over that as they are
LEAST_ERROR = 10.0  # error [%] below which they do no harm worth a warning


@dataclass(frozen=True)
class BindingConstraints:
    """Constraints without which unseen motion is predicted clearly better.

    Errors are the geometric mean of a typical joint's and of all joints' together [%].
    """

    # labels of bounds that least squares contradicts; empty if it is the prior or physical
    # consistency of the links
    bounds: tuple[str, ...]
    values: tuple[str, ...]  # those of single parameters with their least-squares estimate
    negative: tuple[str, ...]  # parameters that they keep at zero or above, where it is below
    joints: tuple[str, ...]  # coordinates that these act along
    error: float  # of the estimate
    without: float  # without the bounds along these coordinates; of least squares if it is links
    rise: float  # of chi square over least squares
    rank: int  # rise within noise
    of_unseen: bool  # whether of logs that were not fitted, not of parts left out in turn
    # rise of chi square with the signs of all efforts turned, if it is far smaller
    turned: float | None = None


def binding_constraints(
    model: Model,
    estimate: Estimate,
    information: Information,
    consistent: Consistent,
    scales: EffortScales | None = None,
    unseen: Sequence[Run] = (),
) -> BindingConstraints | None:
    """The constraints at fault; `None` where there are none, or nothing could be left out.

    Efforts of the information and of `unseen`, runs in motion, are divided by the `scales`. Without
    the constraints there are none, for scales found with them make up for what they do not allow.
    """
    rise, rank = _rise(information, consistent, estimate)
    if rise <= COST_OVER_NOISE * rank:
        return None
    parts = list(_parts(model, information, unseen))
    estimator: Estimator[Information] = consistent
    if scales is not None:
        estimator = partial(scales.scaled.estimate, scales=scales.found)
    error = _error(parts, estimator)
    if not error > LEAST_ERROR:
        return None
    if scales is not None:
        gains, units = scales.found.values, information.signature.effort
        information = information.scaled(gains, units)
        parts = [(one.scaled(gains, units), other.scaled(gains, units)) for one, other in parts]
    turned = _turned_rise(information, consistent)
    free = WeightedLeastSquares(per_run=consistent.per_run)
    enough, plain, knowledge = error / CLEARLY_LARGER, free(information), consistent.knowledge
    rows, without = contradicted_rows(consistent.base, knowledge, plain), np.nan
    if rows:
        without = _error(parts, replace(consistent, knowledge=_without(knowledge, rows)))
    if not without < enough:
        rows, without = (), _error(parts, free)
    if not without < enough:
        return None
    below = [row for row in rows if _of_row(row, plain)[0] < row.lower == 0.0]
    return BindingConstraints(
        bounds=tuple(dict.fromkeys(row.label for row in rows)),
        values=_values(rows, plain),
        negative=tuple(sorted({name for row in below for name in row.coefficients})),
        joints=_axes(rows, information.layout.rows),
        error=error,
        without=without,
        rise=rise,
        rank=rank,
        of_unseen=bool(unseen),
        turned=turned if turned < TURNED_RISE * rise else None,
    )


def _rise(
    information: Information, consistent: Consistent, estimate: Estimate
) -> tuple[float, int]:
    """How far an estimate raises chi square over least squares, and the rank of the data."""
    data = whitened(information, consistent.per_run, equal=consistent.equal)
    known = estimate.parameters.as_dict()
    residual = data.matrix @ [known.get(name, 0.0) for name in data.names] - data.vector
    return float(residual @ residual), len(data.vector)


def _turned_rise(information: Information, consistent: Consistent) -> float:
    """The same with the signs of all efforts turned; infinite where nothing can be fitted."""
    signs = -np.ones(len(information.layout.rows))
    turned = information.scaled(signs, information.signature.effort)
    try:
        return _rise(turned, consistent, consistent(turned))[0]
    except DataError:
        return np.inf


def _error(
    parts: Sequence[tuple[Information, Information]], estimator: Estimator[Information]
) -> float:
    """Error [%] of what is predicted from what is fitted; NaN where no part can be fitted."""
    values, found = values_by(estimator), []
    for fitted, tested in parts:
        with suppress(DataError):
            errors = tested.relative_errors(values(fitted))
            found.append(float(logarithms(errors[None], tested.effort_squares()[None])[0]))
    return float(np.exp(np.mean(found))) if found else np.nan


def _parts(
    model: Model, information: Information, unseen: Sequence[Run]
) -> Iterator[tuple[Information, Information]]:
    if unseen:
        yield information, information_from(unseen, rests=model.has_memory)(base_regressor(model))
        return
    folds = information.grouped(windows_of_folds(information))
    count = len(folds.windows)
    for fold in range(count if count > 1 else 0):
        yield folds.of([k for k in range(count) if k != fold]), folds.of([fold])


def contradicted_rows(base: BaseMap, known: Knowledge, plain: Estimate) -> tuple[Row, ...]:
    """Bounds that a least-squares estimate is beyond with its whole 95 % interval.

    Of parameters of terms that are base parameters by themselves, of friction along a coordinate,
    and of the user.
    """
    values, bodies = plain.parameters.as_dict(), known.of_bodies
    alone = np.count_nonzero(base.lift, axis=1) == 1
    single = {name for name, is_alone in zip(base.base_names, alone, strict=True) if is_alone}
    bounds = [
        Row(name, {name: 1.0}, low, high)
        for name, low, high, of_body in zip(
            known.names, known.lower.tolist(), known.upper.tolist(), bodies, strict=True
        )
        if not of_body and name not in known.shaped
    ]
    found = []
    for row in (*bounds, *known.curves, *known.rows):
        if not single.intersection(values).issuperset(row.coefficients):
            continue
        value, std = _of_row(row, plain)
        if value + Z95 * std < row.lower or value - Z95 * std > row.upper:
            found.append(row)
    return tuple(found)


def _of_row(row: Row, estimate: Estimate) -> tuple[float, float]:
    at = [estimate.parameters.names.index(name) for name in row.coefficients]
    factors = np.array(list(row.coefficients.values()))
    variance = factors @ estimate.covariance[np.ix_(at, at)] @ factors
    return float(factors @ estimate.parameters.values[at]), float(np.sqrt(max(variance, 0.0)))


def _values(rows: Sequence[Row], plain: Estimate) -> tuple[str, ...]:
    units = dict(zip(plain.parameters.names, plain.parameters.units, strict=True))
    found = []
    for row in rows:
        if row.label in units:
            value, std = _of_row(row, plain)
            found.append(f"{row.label} {with_interval(value, Z95 * std)} {units[row.label]}")
    return tuple(found)


def _axes(rows: Sequence[Row], order: Sequence[str] = ()) -> tuple[str, ...]:
    """Coordinates of the parameters in rows, joints in their order first."""
    found = {name.partition(".")[2] for row in rows for name in row.coefficients}
    return (*(one for one in order if one in found), *sorted(found.difference(order)))


def _without(known: Knowledge, rows: Sequence[Row]) -> Knowledge:
    """What is known but for all bounds of terms along the coordinates of some rows."""
    axes, labels = set(_axes(rows)), {row.label for row in rows}
    freed = ~known.of_bodies & [name.partition(".")[2] in axes for name in known.names]
    return replace(
        known,
        lower=np.where(freed, -np.inf, known.lower),
        upper=np.where(freed, np.inf, known.upper),
        curves=tuple(row for row in known.curves if axes.isdisjoint(_axes([row]))),
        rows=tuple(row for row in known.rows if row.label not in labels),
    )


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
        own = base_parameters(model).base_names
        sets = [own, *((*own, *cause.names) for cause in ranked.likely)]
        try:
            parts, (plain, *wider) = left_out_logs(model, ranked.wide, sigma, self.examined, sets)
        except DataError:
            return tuple((cause, None) for cause in ranked.likely)
        worth = (WORTH_A_TERM if c.of_friction else WORTH_A_SEARCH for c in ranked.likely)
        gains = (LeftOutGain.of(plain, x, parts, w) for x, w in zip(wider, worth, strict=True))
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
