"""From clean runs to an identified model: which data are fitted, what is found on the way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

from steelyard.base.progress import Progress
from steelyard.check.fitted.changes_within_run import force_of_run, force_words
from steelyard.check.fitted.fitted_case_causes_and_constraints import contradicted_rows
from steelyard.check.fitted.implausible_estimates_and_gear_side import (
    LINK_SIDE_INSTEAD,
    rotors_at_zero,
)
from steelyard.estimate import estimator_register as register
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.estimator_register import Sources
from steelyard.estimate.identified_model import BAND, Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information import base_parameters_and_regressor as regression
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares import weighted_robust_and_whitened as weighted
from steelyard.estimate.least_squares.known_bounded_and_ridge import fixed_values
from steelyard.estimate.nonlinear.effort_scales import EffortScales, effort_scales
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.prior.mirrored_limbs import symmetry_note
from steelyard.estimate.scores.cross_validation import choose_cutoff
from steelyard.estimate.scores.residual_traces_and_band_calibration import calibrate
from steelyard.identify import fit_preparation as preparation
from steelyard.model.model import Model, with_friction
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import EstimationSection, PriorSection
from steelyard.robot.file.signals import Signals
from steelyard.runs.processing_choices import NYQUIST_SHARE
from steelyard.runs.run import Run, fastest_of, motion_samples
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

    task: preparation.FitTask
    identified: IdentifiedModel
    fitted: Fitted  # with the gains and scales that were found
    prepared: preparation.PreparedFit  # laws, their fields, gains and offsets, found before
    scales: EffortScales | None
    notes: tuple[str, ...]  # what was decided, for people to read
    ignored: tuple[str, ...]  # what the robot file requests without effect
    method: register.Offer
    beside: Estimator[Information]  # what made the estimate that the model's is compared with
    unscaled: IdentifiedModel | None = None  # with all scales 1, where some were estimated
    consistent: Consistent | None = None  # what made the estimate, if it was this, without scales

    @cached_property
    def estimator(self) -> Estimator[Information]:
        """What made the estimate."""
        return self.fitted.estimating(self.fitted.runs, self.fitted.information)


def fit(task: preparation.FitTask, origin: Provenance) -> Fit:
    """Gains, friction laws, their fields, and last the parameters.

    What is decided is added to the notes of the `origin`.
    """
    loaded = task.loaded
    method = register.method_of(loaded)
    usual, plain = method.name == EstimationSection().method, method.name
    if plain not in PLAIN_LEAST_SQUARES:
        plain = register.LEAST_SQUARES[loaded.estimation.weights]
    least_squares = _of_runs(PLAIN_LEAST_SQUARES[plain], task.model)
    prepared = preparation.prepare_fit(task, least_squares)
    regressor = regression.base_regressor(prepared.model)
    information = prepared.information_of(regressor)
    context = register.context_of(loaded, regressor, fastest_of(prepared.runs), task.progress)

    def estimating(runs: Sequence[Run], pooled: Information) -> Estimator[Information]:
        sources = Sources(regressor, runs, pooled, task.threads, task.progress)
        return register.on_information(method, context, sources)

    declared = _fitted(estimating, prepared.runs, information)
    estimator, scales, refused = method.make(context), None, ""
    found, why_unscaled = declared, _unscaled_because(loaded, prepared, estimator)
    wanted = loaded.estimation.effort_scales == "auto" and not why_unscaled
    if wanted and isinstance(estimator, Consistent):
        found, scales, refused = _scaled_fit(declared, estimator, task.progress)
    other = next(name for name in PLAIN_LEAST_SQUARES if name != plain)
    beside = register.offer_of(other, "").make(context) if method.name == plain else least_squares
    reference = beside(found.information)
    ignored = _ignored(loaded, prepared, method, usual, why_unscaled, context)
    bodies = ": inertias may be invalid" if found.estimate.standard is None else ""
    free, plane = found.estimate if method.name == plain else reference, loaded.prior.symmetry
    notes = (
        *prepared.notes,
        *([] if usual else [f"estimated by {method.name} ({method.about}), as requested{bodies}"]),
        *([] if scales is None else [scales.note]),
        *([refused] if refused else []),
        *found.estimate.notes,
        *_notes_beyond_physical_bounds(regressor.base, context.knowledge, free),
        *([] if plane is None else [symmetry_note(regressor.base, loaded.robot, free, plane)]),
    )
    first, cutoff = found.runs[0], loaded.validation.cutoff
    identified = IdentifiedModel(
        model=prepared.model,
        base=regression.base_parameters(prepared.model),
        estimate=found.estimate,
        reference=(reference,),
        signals=first.recording.signals,
        cutoffs=Cutoffs(
            motion=first.motion_cutoff,
            matched=first.matched_cutoff,
            score=cutoff or min(first.matched_cutoff, NYQUIST_SHARE * first.rate),
            headline=cutoff or BAND,
        ),
        processing=processing_of_robot(loaded),
        motions=motion_samples([*found.runs, *task.carrying]),
        provenance=replace(origin, notes=(*origin.notes, *notes, *ignored)),
        effort_scales=None if scales is None else scales.known,
    )
    unscaled, own = None, declared.runs[0].recording.signals
    if scales is not None:
        unscaled = replace(identified, estimate=declared.estimate, signals=own, effort_scales=None)
    of_fit = found, prepared, scales, notes, ignored, method, beside, unscaled
    return Fit(task, identified, *of_fit, estimator if isinstance(estimator, Consistent) else None)


def _scaled_fit(
    declared: Fitted, estimator: Consistent, progress: Progress
) -> tuple[Fitted, EffortScales | None, str]:
    """The fit with scales of the efforts, if any are found; and why they are not adopted."""
    scales = effort_scales(estimator, declared.information, progress=progress)
    if scales is None:
        return declared, None, ""
    values, units = scales.found.values, declared.information.signature.effort
    signals = (run.recording.signals for run in declared.runs)
    divided = (replace(own, gains=own.gains / values) for own in signals)
    runs = tuple(map(preparation.with_signals, declared.runs, divided))
    scaled_information = declared.information.scaled(1.0 / values, units)
    estimate = partial(scales.scaled.estimate, scales=scales.found)
    scaled = _fitted(lambda runs, information: estimate, runs, scaled_information)
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
    runs, information, *_ = found.fitted
    calibration = calibrate(
        identified, runs, information, found.estimator, threads=threads, progress=progress
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

LeastSquares = weighted.OrdinaryLeastSquares | weighted.WeightedLeastSquares

PLAIN_LEAST_SQUARES: dict[str, LeastSquares] = {
    "WLS": weighted.WeightedLeastSquares(),
    "OLS": weighted.OrdinaryLeastSquares(),
}


def _unscaled_because(
    loaded: LoadedRobot, prepared: preparation.PreparedFit, estimator: Estimator[Any]
) -> str:
    """Why scales cannot be estimated; empty where they can."""
    if loaded.robot.floating:
        return "with a floating base, whose efforts are known: none, or those of contacts"
    if prepared.gains is not None:
        return 'together with gain = "identify"'
    if type(estimator) is not Consistent:
        return f'with method = "{loaded.estimation.method}"'
    if estimator.per_run:
        return "together with terms that are estimated per run"
    if estimator.equal:
        return 'with weights = "equal", which small scales of the largest residuals lessen'
    if prepared.runs[0].recording.signals.effort_map is not None:
        return "with coupled gears, where a scale belongs to a motor and not to a joint"
    return ""


def _ignored(
    loaded: LoadedRobot,
    prepared: preparation.PreparedFit,
    method: register.Offer,
    usual: bool,
    why_unscaled: str,
    context: register.Context,
) -> tuple[str, ...]:
    estimation, notes = loaded.estimation, []
    if not usual:
        unused: tuple[str, ...] = ()
        least_squares = method.name in PLAIN_LEAST_SQUARES
        if least_squares and loaded.knowledge:
            _, unused = fixed_values(context.regressor.base, context.knowledge)
        if unused:
            only = f"{method.name} uses of [[knowledge]] only values of whole base parameters"
            notes.append(f"{only}, not: {'; '.join(unused)}")
        given = {
            register.PRIOR: loaded.prior != PriorSection(),
            register.KNOWLEDGE: bool(loaded.knowledge) and not least_squares,
            register.WEIGHTS: "weights" in estimation.model_fields_set
            and method.name != register.LEAST_SQUARES[estimation.weights],
        }
        idle = [name for name, there in given.items() if there and name not in method.uses]
        notes += [f"{method.name} does not use {' and '.join(idle)}"] if idle else []
    stated = "effort_scales" in estimation.model_fields_set and estimation.effort_scales != "off"
    if why_unscaled and stated:
        notes.append(f'effort_scales = "auto" has no effect {why_unscaled}')
    if loaded.friction and prepared.choice is None:
        notes.append(preparation.TOO_SHORT)
    return tuple(notes)


def _of_runs(estimator: LeastSquares, model: Model) -> Estimator[Information]:
    """The estimator with the parameters that every run of this model has for itself."""
    return lambda information: replace(
        estimator, per_run=register.per_run_columns(model, information.layout)
    )(information)


def _notes_beyond_physical_bounds(
    base: regression.BaseMap, known: Knowledge, estimate: Estimate
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


MOST_FORCES = 3  # rounds in which a force is found in each run


def below_described_band(
    loaded: LoadedRobot,
    signals: Signals,
    model: Model,
    runs: Sequence[Run],
    threads: int,
    progress: Progress,
) -> tuple[LoadedRobot, tuple[str, ...]]:
    """The robot with the cut-off of regression at which its model predicts best, and why.

    As it is where the robot file states one, gains or zeros are unknown, or none is better.
    """
    stated = loaded.processing.matched_cutoff is not None
    if stated or any(signals.unknown_gains) or any(signals.unknown_offsets):
        return loaded, ()
    choice = choose_cutoff(with_friction(model, loaded), runs, threads, progress)
    if choice is None or choice.chosen == choice.cutoffs[0]:
        return loaded, ()
    cutoff = {"matched_cutoff": choice.chosen}
    return replace(loaded, processing=loaded.processing.model_copy(update=cutoff)), (choice.note,)


def without_forces(
    found: Fit, refit: Callable[[preparation.FitTask, tuple[str, ...]], Fit]
) -> tuple[Fit, tuple[str, ...]]:
    """The fit to what is left of the runs without forces that pass, and what is left out.

    A round leaves out one force of each run; `refit` fits anew, with notes on what is left out.
    """
    notes: tuple[str, ...] = ()
    for _ in range(MOST_FORCES):
        identified, information = found.identified, found.fitted.information
        groups, coordinates = information.windows_of_runs, identified.model.robot.coordinates
        forces = {
            run.name: force
            for run in found.fitted.runs
            if run.name in groups
            and (force := force_of_run(identified, information.of(groups[run.name]), run))
        }
        if not forces:
            break
        notes += tuple(
            f"{name}: efforts {force.when} are left out of the fit: a force acts that the other "
            f"motion does not have, as by a contact (rms {force_words(force, coordinates)})"
            for name, force in forces.items()
        )
        runs = tuple(
            run.leaving_out([forces[run.name].stretch]) if run.name in forces else run
            for run in found.task.runs
        )
        found = refit(replace(found.task, runs=runs), notes)
    return found, notes
