"""From clean runs to an identified model: what a robot file leaves open is found on the way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from steelyard.cli.river import wanted_by, with_friction
from steelyard.errors import DataError, ModelError
from steelyard.estimation.estimate import Estimate, Estimator
from steelyard.estimation.fields import Finding, find_fields, said_by
from steelyard.estimation.gains import GainEstimate, identified_gains
from steelyard.estimation.identified import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimation.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
from steelyard.estimation.reference import needs_reference, settled_reference
from steelyard.measurement import Run
from steelyard.model import Model
from steelyard.progress import Progress
from steelyard.regression.base import base_map, refuse_twins
from steelyard.regression.gather import gather
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.robot.robot_file import LoadedRobot
from steelyard.terms.find import finds_of
from steelyard.terms.rigid_body import RigidBody
from steelyard.validation.friction import FrictionChoice, choose_friction, refuse_listed
from steelyard.validation.mixes import remembers

_UNSETTLED = (
    "the reference of load-dependent friction still moved after three passes: "
    "its coefficients are rough"
)


@dataclass(frozen=True)
class Payload:
    """What the loaded runs carry, as far as it is known.

    Attributes:
        mass: [kg]; `None` if it is unknown.
        frame: Frame to give its numbers in; that of the last link if `None`.
    """

    mass: float | None = None
    frame: str | None = None


@dataclass(frozen=True, eq=False)
class Fit:
    """An identified model, and what was found on the way to it.

    Attributes:
        identified: The model.
        runs: The runs that were fitted, with the gains that were found.
        choice: How the friction laws were chosen, if they were.
        findings: Fields that were found.
        gains: Drive gains that were found, if any.
        notes: What was decided, for people to read.
    """

    identified: IdentifiedModel
    runs: tuple[Run, ...]
    choice: FrictionChoice | None
    findings: tuple[Finding, ...]
    gains: GainEstimate | None
    notes: tuple[str, ...]


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
    if loaded_robot.friction:
        refuse_listed(model)
        _refuse_finds(model)
    gains = _gains(model, loaded_robot, runs, carrying, payload, threads, progress)
    if gains is not None:
        runs = [_with_gains(run, gains) for run in runs]
    estimator, other = (_of_runs(e, model) for e in estimators(loaded_robot))
    choice = None
    if loaded_robot.friction:
        choice = choose_friction(model, runs, estimator, threads=threads, progress=progress)
        model = replace(model, terms=(*model.terms, *choice.terms))
    said = said_by(runs, rests=remembers(model.terms), threads=threads, progress=progress)
    found = find_fields(model, said, progress=progress)
    model, settled = found.model, True
    refuse_twins(model, base_map(model))
    if needs_reference(model):
        model, settled = settled_reference(model, said, estimator)
    information = said(base_regressor(model))
    estimate, reference = estimator(information), other(information)
    notes = (
        *([_gain_note(gains)] if gains is not None else []),
        *([choice.note] if choice is not None else []),
        *found.notes,
        *([] if settled else [_UNSETTLED]),
        *_beyond(model, estimate),
    )
    identified = IdentifiedModel(
        model=model,
        base=base_map(model),
        estimate=estimate,
        reference=(reference,),
        signals=runs[0].recording.signals,
        cutoffs=Cutoffs(
            motion=runs[0].motion_cutoff,
            matched=runs[0].matched_cutoff,
            score=loaded_robot.validation.cutoff or runs[0].matched_cutoff,
        ),
        processing=wanted_by(loaded_robot),
        provenance=replace(origin, notes=(*origin.notes, *notes)),
    )
    return Fit(identified, tuple(runs), choice, found.findings, gains, notes)


LeastSquares = OrdinaryLeastSquares | WeightedLeastSquares


def estimators(loaded: LoadedRobot) -> tuple[LeastSquares, LeastSquares]:
    """The estimator that the robot file asks for, and the one beside it."""
    noise, equal = WeightedLeastSquares(), OrdinaryLeastSquares()
    return (noise, equal) if loaded.estimation.weights == "noise" else (equal, noise)


def estimator_of(loaded: LoadedRobot, model: Model) -> Estimator[Information]:
    """The estimator that the robot file asks for, with what every run has for itself."""
    return _of_runs(estimators(loaded)[0], model)


def _of_runs(estimator: LeastSquares, model: Model) -> Estimator[Information]:
    """The estimator with the parameters that every run of this model has for itself."""
    own = {
        p.name
        for term in model.terms
        if getattr(term, "per_run", False)
        for p in term.parameters(model.robot)
    }

    def estimate(information: Information) -> Estimate:
        names = tuple(name for name in information.layout.columns if name in own)
        return replace(estimator, per_run=names)(information)

    return estimate


def _refuse_finds(model: Model) -> None:
    """Fields are found for friction that is there; which is there is still to be chosen."""
    asking = [term.law for term in model.terms if finds_of(term)]
    if asking:
        raise ModelError(
            f"a field of term '{asking[0]}' is to be found, and friction is to be chosen at once",
            where="[model] friction",
            mend='give the field a number, or list the friction laws in place of "auto"',
        )


def _beyond(model: Model, estimate: Estimate) -> tuple[str, ...]:
    """Parameters whose interval lies wholly beyond what is physical, bodies aside."""
    lower = {
        p.name: p.lower
        for term in model.terms
        if not isinstance(term, RigidBody)
        for p in term.parameters(model.robot)
    }
    ends = estimate.parameters.values + estimate.half_width
    found = [
        name
        for name, end in zip(estimate.parameters.names, ends, strict=True)
        if end < lower.get(name, -float("inf"))
    ]
    if not found:
        return ()
    return (
        f"below what is physical: {', '.join(found)}; these terms fit the data, but stand for "
        "something else",
    )


def _with_gains(run: Run, gains: GainEstimate) -> Run:
    signals = replace(
        run.recording.signals, gains=gains.gains, unknown_gains=(False,) * len(gains.gains)
    )
    return replace(run, recording=replace(run.recording, signals=signals))


def _gains(
    model: Model,
    loaded_robot: LoadedRobot,
    runs: Sequence[Run],
    carrying: Sequence[Run],
    payload: Payload,
    threads: int,
    progress: Progress,
) -> GainEstimate | None:
    """The drive gains that the robot file asks for."""
    signals = runs[0].recording.signals
    if not any(signals.unknown_gains):
        if carrying or payload != Payload():
            given = "loaded logs are" if carrying else "a payload is"
            raise ModelError(
                f"{given} given, but no drive gain is to be identified",
                where="--loaded" if carrying else "--payload-mass, --payload-frame",
                mend='give gain = "identify" in [signals.effort], or weigh the payload with '
                "`steelyard payload MODEL LOG`",
            )
        return None
    model = with_friction(model, loaded_robot)
    if any(finds_of(term) for term in model.terms):
        raise DataError(
            "drive gains and fields of terms cannot be found at once",
            where="[signals.effort] gain",
            mend="identify the gains with fields that are given, and write them into the file",
        )
    regressor = base_regressor(model)
    rests = remembers(model.terms)
    unloaded, loaded = (
        [gather(regressor, run, rests=rests, threads=threads, progress=progress) for run in some]
        for some in (runs, carrying)
    )
    known = {
        joint: float(gain)
        for joint, gain, unknown in zip(
            model.robot.joint_names, signals.gains, signals.unknown_gains, strict=True
        )
        if not unknown
    }
    return identified_gains(
        model, unloaded, loaded, mass=payload.mass, frame=payload.frame, known=known
    )


def _gain_note(gains: GainEstimate) -> str:
    found = ", ".join(
        f"{joint} {gain:.4g} ± {half:.2g} {unit}"
        for joint, gain, half, unit, known in zip(
            gains.joints, gains.gains, gains.half_width, gains.units, gains.known, strict=True
        )
        if not known
    )
    return f"drive gains identified: {found}"
