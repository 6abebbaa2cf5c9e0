"""From clean runs to an identified model: what a robot file leaves open is found on the way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

from steelyard.base.progress import Progress
from steelyard.check.fitted.binding_constraints import contradicted_rows
from steelyard.check.fitted.gear_side import LINK_SIDE_INSTEAD, rotors_at_zero
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.estimator_register import (
    KNOWLEDGE,
    LEAST_SQUARES,
    PRIOR,
    WEIGHTS,
    Context,
    Offer,
    Sources,
    context_of,
    method_of,
    offer_of,
    on_information,
    per_run_columns,
)
from steelyard.estimate.identified_model import BAND, Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.least_squares.known_bounded_and_ridge import fixed_values
from steelyard.estimate.least_squares.weighted_and_recursive import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.nonlinear.effort_scales import EffortScales, effort_scales
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.scores.band_calibration import calibrate
from steelyard.identify.gains_zeros_and_friction import (
    TOO_SHORT,
    FitTask,
    PreparedFit,
    prepare_fit,
    with_signals,
)
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import EstimationSection, PriorSection
from steelyard.runs.moving_samples_and_open_loops import motion_samples
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import processing_of_robot

EstimatorOf = Callable[[Sequence[Run], Information], Estimator[Information]]
"""The estimator for runs, and what they say: it may look at more than that."""


class Fitted(NamedTuple):
    """An estimate from runs; other runs of the same model are estimated alike."""

    runs: tuple[Run, ...]
    information: Information
    estimating: EstimatorOf
    estimate: Estimate


def _fitted(estimating: EstimatorOf, runs: tuple[Run, ...], information: Information) -> Fitted:
    return Fitted(runs, information, estimating, estimating(runs, information)(information))


@dataclass(frozen=True, eq=False)
class Fit:
    """An identified model, and what was found on the way to it."""

    task: FitTask
    identified: IdentifiedModel
    fitted: Fitted  # with the gains and scales that were found
    prepared: PreparedFit  # laws, their fields, gains and offsets, found before
    scales: EffortScales | None
    notes: tuple[str, ...]  # what was decided, for people to read
    ignored: tuple[str, ...]  # what the robot file requests without effect
    method: Offer
    unscaled: IdentifiedModel | None = None  # with all scales 1, where some were estimated
    consistent: Consistent | None = None  # what made the estimate, if it was this, without scales

    @property
    def runs(self) -> tuple[Run, ...]:
        """The runs that were fitted."""
        return self.fitted.runs

    @property
    def information(self) -> Information:
        """What the runs say about the model's columns."""
        return self.fitted.information

    @cached_property
    def estimator(self) -> Estimator[Information]:
        """What made the estimate."""
        return self.fitted.estimating(self.runs, self.information)


def fit(task: FitTask, origin: Provenance) -> Fit:
    """Gains, friction laws, their fields, and last the parameters.

    What is decided is added to the notes of the `origin`.
    """
    loaded = task.loaded
    plain = method_of(loaded).name
    if plain not in PLAIN_LEAST_SQUARES:
        plain = LEAST_SQUARES[loaded.estimation.weights]
    least_squares = _of_runs(PLAIN_LEAST_SQUARES[plain], task.model)
    prepared = prepare_fit(task, least_squares)
    regressor = base_regressor(prepared.model)
    information = prepared.information_of(regressor)
    method, why = _method(loaded, plain, prepared.gains)
    context = context_of(loaded, regressor, prepared.runs, task.progress)
    if prepared.gains is not None and prepared.gains.relative:
        # of the prior constraints what holds in any scale: parameters that are zero
        known = context.knowledge
        rows = tuple(row for row in known.rows if row.lower == row.upper == 0.0)
        context = replace(context, knowledge=replace(known, rows=rows))

    def estimating(runs: Sequence[Run], pooled: Information) -> Estimator[Information]:
        sources = Sources(regressor, runs, pooled, task.threads, task.progress)
        return on_information(method, context, sources)

    declared = _fitted(estimating, prepared.runs, information)
    estimator, scales, refused = method.make(context), None, ""
    found, why_unscaled = declared, _unscaled_because(loaded, prepared, estimator)
    wanted = loaded.estimation.effort_scales == "auto" and not why_unscaled
    if wanted and isinstance(estimator, Consistent):
        found, scales, refused = _scaled_fit(declared, estimator, task.progress)
    other = next(name for name in PLAIN_LEAST_SQUARES if name != plain)
    beside = offer_of(other, "").make(context) if method.name == plain else least_squares
    reference = beside(found.information)
    ignored = _ignored(loaded, prepared, method, why, why_unscaled, context)
    bodies = ": inertias may be invalid" if found.estimate.standard is None else ""
    free = found.estimate if method.name == plain else reference
    notes = (
        *prepared.notes,
        *([f"estimated by {method.name} ({method.about}), {why}{bodies}"] if why else []),
        *([] if scales is None else [scales.note]),
        *([refused] if refused else []),
        *found.estimate.notes,
        *_notes_beyond_physical_bounds(regressor.base, context.knowledge, free),
    )
    first, cutoff = found.runs[0], loaded.validation.cutoff
    identified = IdentifiedModel(
        model=prepared.model,
        base=base_parameters(prepared.model),
        estimate=found.estimate,
        reference=(reference,),
        signals=first.recording.signals,
        cutoffs=Cutoffs(
            motion=first.motion_cutoff,
            matched=first.matched_cutoff,
            score=cutoff or first.matched_cutoff,
            headline=cutoff or BAND,
        ),
        processing=processing_of_robot(loaded),
        motions=motion_samples([*found.runs, *task.carrying]),
        provenance=replace(origin, notes=(*origin.notes, *notes, *ignored)),
        effort_scales=None if scales is None else scales.known,
    )
    unscaled = None
    if scales is not None:
        signals = declared.runs[0].recording.signals
        unscaled = replace(
            identified, estimate=declared.estimate, signals=signals, effort_scales=None
        )
    return Fit(
        task,
        identified,
        found,
        prepared,
        scales,
        notes,
        ignored,
        method,
        unscaled,
        estimator if isinstance(estimator, Consistent) else None,
    )


def _scaled_fit(
    declared: Fitted, estimator: Consistent, progress: Progress
) -> tuple[Fitted, EffortScales | None, str]:
    """The fit with scales of the efforts, if any are found; and why they are not adopted."""
    scales = effort_scales(estimator, declared.information, progress=progress)
    if scales is None:
        return declared, None, ""
    values, units = scales.found.values, declared.information.signature.effort
    signals = (run.recording.signals for run in declared.runs)
    runs = tuple(
        with_signals(run, replace(own, gains=own.gains / values))
        for run, own in zip(declared.runs, signals, strict=True)
    )
    scaled = _fitted(
        lambda runs, information: partial(scales.scaled.estimate, scales=scales.found),
        runs,
        declared.information.scaled(1.0 / values, units),
    )
    zero, every = rotors_at_zero(scaled.estimate, runs[0].recording.signals.effort_kind)
    if zero:
        return declared, None, NO_SCALES.format(len(zero), every)
    return scaled, scales, ""


NO_SCALES = (
    "no scales of the efforts are adopted: with them {} of {} rotor inertias are zero, so torques "
    "may be those of sensors on the link side, which has a similar effect; if so, use "
    f"{LINK_SIDE_INSTEAD}"
)


def calibrated(found: Fit) -> Fit:
    """The fit with bands of predicted efforts that are calibrated on left-out motion."""
    identified, threads, progress = found.identified, found.task.threads, found.task.progress
    calibration = calibrate(
        identified,
        found.runs,
        found.information,
        found.estimator,
        threads=threads,
        progress=progress,
    )
    if calibration is not None:
        return replace(found, identified=replace(identified, calibration=calibration))
    why = "with one part of the logs left out, the rest does not suffice for a fit"
    if found.method.needs == "experiment":
        why = f"{found.method.name} needs whole runs, and could not be fitted without one of them"
    return replace(found, notes=(*found.notes, NOT_CALIBRATED.format(why)))


NOT_CALIBRATED = (
    "the 95 % bands of efforts include noise only: {}, so nothing could be left out to calibrate "
    "them"
)

LeastSquares = OrdinaryLeastSquares | WeightedLeastSquares

PLAIN_LEAST_SQUARES: dict[str, LeastSquares] = {
    "WLS": WeightedLeastSquares(),
    "OLS": OrdinaryLeastSquares(),
}


def _method(loaded: LoadedRobot, plain: str, gains: GainEstimate | None) -> tuple[Offer, str]:
    """The estimator, and why it is not the default one; nothing if it is."""
    requested = method_of(loaded)
    if requested.uses and gains is not None and gains.relative:
        return offer_of(plain, ""), "because a prior of the links needs efforts in a known scale"
    usual = EstimationSection().method
    return requested, "" if requested.name == usual else "as requested"


def _unscaled_because(loaded: LoadedRobot, prepared: PreparedFit, estimator: Estimator[Any]) -> str:
    """Why scales cannot be estimated; empty where they can."""
    if prepared.gains is not None:
        return 'together with gain = "identify"'
    if type(estimator) is not Consistent:
        return f'with method = "{loaded.estimation.method}"'
    if estimator.per_run:
        return "together with terms that are estimated per run"
    if prepared.runs[0].recording.signals.effort_map is not None:
        return "with coupled gears, where a scale belongs to a motor and not to a joint"
    return ""


def _ignored(
    loaded: LoadedRobot,
    prepared: PreparedFit,
    method: Offer,
    why: str,
    why_unscaled: str,
    context: Context,
) -> tuple[str, ...]:
    """What the robot file requests without effect."""
    estimation, notes = loaded.estimation, []
    if why:  # not the default estimator
        unused: tuple[str, ...] = ()
        least_squares = method.name in PLAIN_LEAST_SQUARES
        if least_squares and loaded.knowledge:
            unused = fixed_values(context.regressor.base, context.knowledge).unused
        if unused:
            only = f"{method.name} uses of [[knowledge]] only values of whole base parameters"
            notes.append(f"{only}, not: {'; '.join(unused)}")
        given = {
            PRIOR: loaded.prior != PriorSection(),
            KNOWLEDGE: bool(loaded.knowledge) and not least_squares,
            WEIGHTS: "weights" in estimation.model_fields_set
            and method.name != LEAST_SQUARES[estimation.weights],
        }
        idle = [name for name, there in given.items() if there and name not in method.uses]
        notes += [f"{method.name} does not use {' and '.join(idle)}"] if idle else []
    stated = "effort_scales" in estimation.model_fields_set and estimation.effort_scales != "off"
    if why_unscaled and stated:
        notes.append(f'effort_scales = "auto" has no effect {why_unscaled}')
    if loaded.friction and prepared.choice is None:
        notes.append(TOO_SHORT)
    return tuple(notes)


def _of_runs(estimator: LeastSquares, model: Model) -> Estimator[Information]:
    """The estimator with the parameters that every run of this model has for itself."""
    return lambda information: replace(
        estimator, per_run=per_run_columns(model, information.layout)
    )(information)


def _notes_beyond_physical_bounds(
    base: BaseMap, known: Knowledge, estimate: Estimate
) -> tuple[str, ...]:
    """Parameters and friction curves whose interval lies wholly beyond what is physical."""
    found = contradicted_rows(base, replace(known, rows=()), estimate)
    if not found:
        return ()
    labels = ", ".join(dict.fromkeys(row.label for row in found))
    return (
        f"least squares estimates below the physical bound: {labels}; "
        "these terms fit the data, but represent another effect",
    )
