"""From clean runs to an identified model: what a robot file leaves open is found on the way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Progress
from steelyard.check.fitted.gear_side import LINK_SIDE_INSTEAD, rotors_at_zero
from steelyard.estimate.consistent.consistent import Consistent
from steelyard.estimate.estimate import Z95, Estimate, Estimator
from steelyard.estimate.estimators import (
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
from steelyard.estimate.identified import BAND, Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters import base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.least_squares.constrained import fixed_values
from steelyard.estimate.least_squares.least_squares import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.nonlinear.effort_scales import EffortScales, effort_scales
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.prior.prior import Knowledge, Row
from steelyard.estimate.scores.band_calibration import calibrate
from steelyard.identify.prepared_fit import (
    TOO_SHORT,
    Payload,
    PreparedFit,
    prepare_fit,
    with_signals,
)
from steelyard.model.laws.rigid_body import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.robot.file.sections import EstimationSection, PriorSection
from steelyard.runs.named_logs import processing_of_robot
from steelyard.runs.run import Run
from steelyard.runs.run_samples import motion_samples

EstimatorOf = Callable[[Sequence[Run], Information], Estimator[Information]]
"""The estimator for runs, and what they say: it may look at more than that."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An identified model, and what was found on the way to it.

    Attributes:
        unscaled: The model with all scales of the efforts 1, where some were estimated.
    """

    identified: IdentifiedModel
    runs: tuple[Run, ...]  # the runs that were fitted, with the gains that were found
    prepared: PreparedFit  # laws, their fields, gains and offsets, found before
    scales: EffortScales | None  # scales of the efforts that were estimated, if any
    notes: tuple[str, ...]  # what was decided, for people to read
    ignored: tuple[str, ...]  # what the robot file requests without effect
    information: Information  # what the runs say about the model's columns
    method: Offer
    estimating: EstimatorOf  # makes it for these runs, or for others of the same model
    unscaled: IdentifiedModel | None = None

    @cached_property
    def estimator(self) -> Estimator[Information]:
        """What made the estimate."""
        return self.estimating(self.runs, self.information)


def _scaled(run: Run, scales: Array) -> Run:
    """The run with its efforts divided by scales."""
    signals = run.recording.signals
    return with_signals(run, replace(signals, gains=signals.gains / scales))


def fit(
    model: Model,
    loaded_robot: LoadedRobot,
    runs: Sequence[Run],
    carrying: Sequence[Run],
    payload: Payload,
    origin: Provenance,
    threads: int,
    progress: Progress,
) -> Fit:
    """Gains, friction laws, their fields, and last the parameters.

    Arguments are those of `prepare_fit`; what is decided is added to the notes of the `origin`.
    """
    plain = method_of(loaded_robot).name
    if plain not in PLAIN_LEAST_SQUARES:
        plain = LEAST_SQUARES[loaded_robot.estimation.weights]
    least_squares = _of_runs(PLAIN_LEAST_SQUARES[plain], model)
    prepared = prepare_fit(
        model, loaded_robot, runs, carrying, payload, least_squares, threads, progress
    )
    model, runs = prepared.model, prepared.runs
    regressor = base_regressor(model)
    information = prepared.information_of(regressor)
    method, why = _method(loaded_robot, plain, prepared.gains)
    context = context_of(loaded_robot, regressor, runs, progress)
    if prepared.gains is not None and prepared.gains.relative:
        # of the prior constraints what holds in any scale: parameters that are zero
        known = context.knowledge
        rows = tuple(row for row in known.rows if row.lower == row.upper == 0.0)
        context = replace(context, knowledge=replace(known, rows=rows))

    def from_runs(of: Sequence[Run], pooled: Information) -> Estimator[Information]:
        return on_information(method, context, Sources(regressor, of, pooled, threads, progress))

    estimating: EstimatorOf = from_runs
    scales, estimator = None, method.make(context)
    without_scales = _unscaled_because(loaded_robot, prepared, estimator)
    requested = loaded_robot.estimation.effort_scales == "auto"
    stated = "effort_scales" in loaded_robot.estimation.model_fields_set
    if requested and not without_scales and isinstance(estimator, Consistent):
        scales = effort_scales(estimator, information, progress=progress)
    declared = runs, information
    if scales is not None:
        runs = tuple(_scaled(run, scales.found.values) for run in runs)
        information = information.scaled(1.0 / scales.found.values, information.signature.effort)
        estimating = partial(_with_scales, scales)
    estimate, refused = estimating(runs, information)(information), ""
    zero, every = rotors_at_zero(estimate, runs[0].recording.signals.effort_kind)
    if scales is not None and zero:
        refused, scales, estimating = NO_SCALES.format(len(zero), every), None, from_runs
        runs, information = declared
        estimate = estimating(runs, information)(information)
    plain_estimate = None if scales is None else from_runs(*declared)(declared[1])
    other = next(name for name in PLAIN_LEAST_SQUARES if name != plain)
    beside = offer_of(other, "").make(context) if method.name == plain else least_squares
    reference = beside(information)
    ineffective = without_scales and stated and loaded_robot.estimation.effort_scales != "off"
    ignored = (
        *_unused(loaded_robot, method, why, context),
        *([f'effort_scales = "auto" has no effect {without_scales}'] if ineffective else []),
        *([TOO_SHORT] if loaded_robot.friction and prepared.choice is None else []),
    )
    bodies = ": inertias may be invalid" if estimate.standard is None else ""
    notes = (
        *prepared.notes,
        *([f"estimated by {method.name} ({method.about}), {why}{bodies}"] if why else []),
        *([] if scales is None else [scales.note]),
        *([refused] if refused else []),
        *estimate.notes,
        *_notes_beyond_physical_bounds(
            model, context.knowledge, estimate if method.name == plain else reference
        ),
    )
    identified = IdentifiedModel(
        model=model,
        base=base_parameters(model),
        estimate=estimate,
        reference=(reference,),
        signals=runs[0].recording.signals,
        cutoffs=Cutoffs(
            motion=runs[0].motion_cutoff,
            matched=runs[0].matched_cutoff,
            score=loaded_robot.validation.cutoff or runs[0].matched_cutoff,
            headline=loaded_robot.validation.cutoff or BAND,
        ),
        processing=processing_of_robot(loaded_robot),
        motions=motion_samples([*runs, *carrying]),
        provenance=replace(origin, notes=(*origin.notes, *notes, *ignored)),
        effort_scales=None if scales is None else scales.known,
    )
    unscaled = None
    if plain_estimate is not None:
        unscaled = replace(
            identified,
            estimate=plain_estimate,
            signals=declared[0][0].recording.signals,
            effort_scales=None,
        )
    return Fit(
        identified,
        tuple(runs),
        prepared,
        scales,
        notes,
        ignored,
        information,
        method,
        estimating,
        unscaled,
    )


NO_SCALES = (
    "no scales of the efforts are adopted: with them {} of {} rotor inertias are zero, so torques "
    "may be those of sensors on the link side, which has a similar effect; if so, use "
    f"{LINK_SIDE_INSTEAD}"
)


def calibrated(found: Fit, threads: int, progress: Progress) -> Fit:
    """The fit with bands of predicted efforts that are calibrated on left-out motion."""
    identified = found.identified
    estimator, information = found.estimator, found.information
    calibration = calibrate(
        identified, found.runs, information, estimator, threads=threads, progress=progress
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


def _with_scales(
    scales: EffortScales, runs: Sequence[Run], information: Information
) -> Estimator[Information]:
    """The estimate of any information, as unsure as the scales make it."""
    return partial(scales.scaled.estimate, scales=scales.found)


def _unused(loaded: LoadedRobot, method: Offer, why: str, context: Context) -> tuple[str, ...]:
    """A note on what an estimator that is not the default one does not use."""
    if not why:
        return ()
    if method.name in PLAIN_LEAST_SQUARES and loaded.knowledge:
        unused = fixed_values(context.regressor.base, context.knowledge).unused
        only = f"{method.name} uses of [[knowledge]] only values of whole base parameters"
        notes = (f"{only}, not: {'; '.join(unused)}",) if unused else ()
        return (*notes, *_unused(replace(loaded, knowledge=()), method, why, context))
    given = {
        PRIOR: loaded.prior != PriorSection(),
        KNOWLEDGE: bool(loaded.knowledge),
        WEIGHTS: "weights" in loaded.estimation.model_fields_set
        and method.name != LEAST_SQUARES[loaded.estimation.weights],
    }
    idle = " and ".join(name for name, there in given.items() if there and name not in method.uses)
    return (f"{method.name} does not use {idle}",) if idle else ()


def _of_runs(estimator: LeastSquares, model: Model) -> Estimator[Information]:
    """The estimator with the parameters that every run of this model has for itself."""
    return lambda information: replace(
        estimator, per_run=per_run_columns(model, information.layout)
    )(information)


def _notes_beyond_physical_bounds(
    model: Model, known: Knowledge, estimate: Estimate
) -> tuple[str, ...]:
    """Parameters and friction curves whose interval lies wholly beyond what is physical."""
    place = {name: k for k, name in enumerate(estimate.parameters.names)}
    bodies = {p.name for p in RigidBody().parameters(model.robot)}
    alone = [
        Row(name, {name: 1.0}, lower)
        for name, lower in zip(known.names, known.lower.tolist(), strict=True)
        if name not in bodies | known.shaped
    ]
    found = []
    for row in (*alone, *known.curves):
        if not set(row.coefficients) <= set(place):
            continue
        at = [place[name] for name in row.coefficients]
        factors = np.array(list(row.coefficients.values()))
        value = factors @ estimate.parameters.values[at]
        std = np.sqrt(max(factors @ estimate.covariance[np.ix_(at, at)] @ factors, 0.0))
        if value + Z95 * std < row.lower:
            found.append(row.label)
    if not found:
        return ()
    return (
        f"least squares estimates below the physical bound: {', '.join(dict.fromkeys(found))}; "
        "these terms fit the data, but represent another effect",
    )
