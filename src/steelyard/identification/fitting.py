"""From clean runs to an identified model: what a robot file leaves open is found on the way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.consistent.consistent import Consistent
from steelyard.estimation.estimate import Z95, Estimate, Estimator
from steelyard.estimation.fields.fields import Finding
from steelyard.estimation.identified import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimation.knowledge import Knowledge, Row
from steelyard.estimation.least_squares.least_squares import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimation.payload.gains import GainEstimate
from steelyard.estimation.zero_offset import ZeroOffsets
from steelyard.identification.logs import wanted_by
from steelyard.identification.prepare_model import Ground, consistent_of, grounded, own_columns
from steelyard.identification.prepare_model import Payload as Payload
from steelyard.measurement import Run
from steelyard.measurement.motion_samples import motion_samples
from steelyard.model import Model
from steelyard.progress import Progress
from steelyard.regression.base import base_parameters
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.robot_file.file import LoadedRobot
from steelyard.robot_file.sections import PriorSection
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.validation.calibrate import calibrate
from steelyard.validation.effort_scales import EffortScales, effort_scales
from steelyard.validation.friction.friction import FrictionChoice


@dataclass(frozen=True, eq=False)
class Fit:
    """An identified model, and what was found on the way to it.

    Attributes:
        identified: The model.
        runs: The runs that were fitted, with the gains that were found.
        choice: How the friction laws were chosen, if they were.
        findings: Fields that were found.
        gains: Drive gains that were found, if any.
        offsets: Zero offsets that were estimated, if any.
        scales: Scales of the efforts that were estimated, if any.
        notes: What was decided, for people to read.
        information: What the runs say about the model's columns.
        estimator: What made the estimate of it.
    """

    identified: IdentifiedModel
    runs: tuple[Run, ...]
    choice: FrictionChoice | None
    findings: tuple[Finding, ...]
    gains: GainEstimate | None
    offsets: ZeroOffsets | None
    scales: EffortScales | None
    notes: tuple[str, ...]
    information: Information
    estimator: Estimator[Information]

    def alike(self, run: Run) -> Run:
        """Another run, with its joint positions and efforts read as those of the fitted ones."""
        return replace(run, recording=replace(run.recording, signals=self.identified.signals))


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

    Args:
        model: The model; without friction where that is to be chosen.
        loaded_robot: What the robot file says.
        runs: Runs without payload.
        carrying: Runs with it, for the gains.
        payload: What they carry.
        origin: Inputs; what was decided here is added to its notes.
        threads: Native threads.
        progress: Told about every pass.
    """
    least_squares, other = (_of_runs(e, model) for e in estimators(loaded_robot))
    ground = grounded(
        model, loaded_robot, runs, carrying, payload, least_squares, threads, progress
    )
    model, runs = ground.model, ground.runs
    information = ground.said(base_regressor(model))
    more = _least_squares_because(loaded_robot, ground.gains)
    consistent = consistent_of(loaded_robot, runs)(model, base_parameters(model))
    estimator = least_squares if more else _of_runs(consistent, model)
    scales, why = None, _unscaled_because(loaded_robot, ground, information)
    asked = loaded_robot.estimation.effort_scales == "auto"
    if asked and not why:
        scales = effort_scales(consistent, information, progress=progress)
    if scales is not None:
        runs = [_scaled(run, scales.found.values) for run in runs]
        information = information.scaled(1.0 / scales.found.values, information.stamp.effort)
        estimator = partial(scales.scaled.estimate, scales=scales.found)
    plain = least_squares(information)
    estimate, reference = (plain, other(information)) if more else (estimator(information), plain)
    notes = (
        *ground.notes,
        *more,
        *([] if scales is None else [scales.note]),
        *_in_vain(loaded_robot, why),
        *estimate.notes,
        *_beyond(model, consistent.knowledge, plain),
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
        ),
        processing=wanted_by(loaded_robot),
        motions=motion_samples([*runs, *carrying]),
        provenance=replace(origin, notes=(*origin.notes, *notes)),
        effort_scales=None if scales is None else scales.found.known,
    )
    return Fit(
        identified,
        tuple(runs),
        ground.choice,
        ground.findings,
        ground.gains,
        ground.offsets,
        scales,
        notes,
        information,
        estimator,
    )


def calibrated(found: Fit, threads: int, progress: Progress) -> Fit:
    """The fit with bands of predicted efforts that are calibrated on left-out motion.

    Args:
        found: The fit.
        threads: Native threads.
        progress: Told about every fit to the rest.
    """
    identified = found.identified
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
    return replace(found, notes=(*found.notes, NOT_CALIBRATED))


NOT_CALIBRATED = (
    "the 95 % bands of efforts count noise only: the logs are too short to leave a part out and "
    "calibrate the bands on it"
)

LeastSquares = OrdinaryLeastSquares | WeightedLeastSquares


def estimators(loaded: LoadedRobot) -> tuple[LeastSquares, LeastSquares]:
    """The estimator that the robot file asks for, and the one beside it."""
    noise, equal = WeightedLeastSquares(), OrdinaryLeastSquares()
    return (noise, equal) if loaded.estimation.weights == "noise" else (equal, noise)


def _unscaled_because(loaded: LoadedRobot, ground: Ground, information: Information) -> str:
    """Why scales cannot be estimated; empty where they can."""
    if loaded.estimation.method == "least_squares":
        return 'with method = "least_squares"'
    if ground.gains is not None:
        return 'beside gain = "identify"'
    if set(own_columns(ground.model)) & set(information.layout.columns):
        return "beside terms that are estimated per run"
    if ground.runs[0].recording.signals.effort_map is not None:
        return "behind coupled gears, where a scale is of a motor and not of a joint"
    return ""


def _in_vain(loaded: LoadedRobot, why: str) -> tuple[str, ...]:
    """A note where the robot file asks for scales that cannot be estimated."""
    given = loaded.estimation
    if not why or given.effort_scales == "off" or "effort_scales" not in given.model_fields_set:
        return ()
    return (f'effort_scales = "auto" has no effect {why}',)


def _scaled(run: Run, scales: Array) -> Run:
    """The run with its efforts divided by scales."""
    signals = run.recording.signals
    signals = replace(signals, gains=signals.gains / scales)
    return replace(run, recording=replace(run.recording, signals=signals))


def _least_squares_because(loaded: LoadedRobot, gains: GainEstimate | None) -> tuple[str, ...]:
    """Notes on why the estimate is plain least squares; none where it is not."""
    if loaded.estimation.method == "least_squares":
        why = "as the robot file specifies: inertias may be invalid"
    elif gains is not None and gains.relative:
        why = "for without a scale no prior of the bodies can be compared"
    else:
        return ()
    given = {"[prior]": loaded.prior != PriorSection(), "[[knowledge]]": bool(loaded.knowledge)}
    idle = " and ".join(name for name, there in given.items() if there)
    unheard = (f"in plain least squares nothing comes of {idle}",) if idle else ()
    return (f"plain least squares, {why}", *unheard)


def _of_runs(estimator: LeastSquares | Consistent, model: Model) -> Estimator[Information]:
    """The estimator with the parameters that every run of this model has for itself."""
    own = own_columns(model)

    def estimate(information: Information) -> Estimate:
        names = tuple(name for name in information.layout.columns if name in own)
        return replace(estimator, per_run=names)(information)

    return estimate


def _beyond(model: Model, known: Knowledge, estimate: Estimate) -> tuple[str, ...]:
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
