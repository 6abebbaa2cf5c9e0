"""Before the fit: gains, zero offsets, friction laws and fields that a robot file leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from steelyard.base.errors import DataError, ModelError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.estimator_register import method_of
from steelyard.estimate.friction.friction_choice import (
    FrictionChoice,
    choose_friction,
    refuse_listed,
)
from steelyard.estimate.friction.friction_mixes_and_curves import PLAIN, with_any_speed
from steelyard.estimate.information import base_parameters_and_regressor as regression
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.hidden_by_contacts import (
    hidden_parameters,
    stances_of,
    touched_samples,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear import nonlinear_parameters as nonlinear
from steelyard.estimate.nonlinear.grid_search import InformationOf
from steelyard.estimate.payload.drive_gains import GainEstimate, identified_gains
from steelyard.estimate.prior.prior_constraint_kinds import knowledge_of
from steelyard.estimate.scores.cross_validation import TooShortError
from steelyard.estimate.scores.effort_errors import gains_known
from steelyard.model.model import Model, model_with_open_friction, with_friction
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.runs.run import Run, fastest_of

TOO_SHORT = (
    "the runs are too short to compare friction laws on motion that is left out: coulomb + viscous "
    "are used; log longer or several runs"
)

_NOT_CONVERGED = (
    "the reference of load-dependent friction has not converged after three passes: "
    "its coefficients are inaccurate"
)


@dataclass(frozen=True, eq=False)
class PreparedFit:
    """A model of which only the parameters are open, and its runs."""

    model: Model
    runs: tuple[Run, ...]  # the runs to be fitted, with the gains that were found
    information_of: InformationOf  # what they say about a regressor; every call is a pass
    choice: FrictionChoice | None  # of the friction laws; `None` if there was none, or could not be
    findings: tuple[nonlinear.Finding, ...]
    gains: GainEstimate | None
    offsets: nonlinear.ZeroOffsets | None
    notes: tuple[str, ...]  # what was decided, for people to read
    of_contacts: tuple[str, ...] = ()  # what contacts of unknown force take from the data


@dataclass(frozen=True, eq=False)
class FitTask:
    """What is fitted: a model, without friction where that is to be chosen, and clean runs."""

    model: Model
    loaded: LoadedRobot
    runs: tuple[Run, ...]  # without payload
    carrying: tuple[Run, ...] = ()  # with it, for the gains
    payload_mass: float | None = None  # [kg]; `None` if it is unknown
    payload_frame: str | None = None  # to give its numbers in; that of the last link if `None`
    threads: int = 1
    progress: Progress = silent

    def information_of(
        self, model: Model, runs: Sequence[Run], longest: float = inf
    ) -> InformationOf:
        """What runs say about regressors of a model's laws; every call is a pass over the runs."""
        rests, threads = model.has_memory, self.threads
        return nonlinear.information_from(
            runs, rests=rests, longest=longest, threads=threads, progress=self.progress
        )


def with_signals(run: Run, signals: Signals) -> Run:
    """The run, its log read by other signals."""
    return replace(run, recording=replace(run.recording, signals=signals))


def model_to_fit(loaded: LoadedRobot) -> Model:
    """The model of a robot file, without friction where that is to be chosen."""
    model = model_with_open_friction(loaded)
    if loaded.friction:
        refuse_listed(model)
        if searched := [term.law for term in model.terms if finds_of(term)]:
            raise ModelError(
                f"a nonlinear parameter of term '{searched[0]}' cannot be estimated while "
                "friction is selected",
                where="[model] friction",
                fix='give it a number, or list the friction laws in place of "auto"',
            )
    return model


def prepare_fit(task: FitTask, estimator: Estimator[Information]) -> PreparedFit:
    """Gains, zero offsets, friction laws and their nonlinear parameters.

    The `estimator` fits references, and laws where the estimate is least squares.
    """
    model, loaded, runs = task.model, task.loaded, task.runs
    gains = _gains(task)
    if gains is not None:
        given, none = gains.gains, (False,) * len(gains.gains)
        own = (run.recording.signals for run in runs)
        known = (replace(signals, gains=given, unknown_gains=none) for signals in own)
        runs = tuple(map(with_signals, runs, known))
    runs = _with_spread(task, runs)
    signals = runs[0].recording.signals
    if not all(gains_known(signals.effort_units, signals.gains)):
        task = replace(task, model=_in_unit_of_log(task, runs))
        model = task.model
    offsets = _offsets(task, runs, gains)
    if offsets is not None:
        runs = tuple(nonlinear.with_offsets(runs, offsets.values))
    choice = None
    if loaded.friction:
        choice = _friction_choice(task, runs, estimator)
        laws = PLAIN if choice is None else choice.best.terms
        model = replace(model, terms=(*model.terms, *laws))
    information_of = task.information_of(model, runs)
    found = nonlinear.find_fields(model, information_of, progress=task.progress)
    model, converged = found.model, True
    regression.refuse_twins(model, regression.base_parameters(model))
    if any(term.needs_reference for term in model.terms):
        model, converged = nonlinear.converged_reference(model, information_of, estimator)
    notes = (
        *([] if gains is None else [_gain_note(gains)]),
        *(one.note for one in (offsets, choice) if one is not None),
        *found.notes,
        *([] if converged else [_NOT_CONVERGED]),
    )
    of_contacts = contact_notes(regression.base_regressor(model), runs)
    decided = found.findings, gains, offsets, notes, of_contacts
    return PreparedFit(model, runs, information_of, choice, *decided)


SPREAD_ROUNDS, SPREAD_FOUND = 4, 0.05
"""Most fits for the errors of rows without contact forces, and their change that is none."""


def _with_spread(task: FitTask, runs: tuple[Run, ...]) -> tuple[Run, ...]:
    """Runs whose contact forces are taken out by the errors of the efforts, if any are unknown."""
    base = runs[0].recording.signals.base
    if base is None or not base.touches:
        return runs
    model = with_any_speed(with_friction(task.model, task.loaded))
    regressor = regression.base_regressor(model)
    for _ in range(SPREAD_ROUNDS):
        found = WeightedLeastSquares().fit(task.information_of(model, runs)(regressor))
        before, now = base.spread, np.sqrt(found.variances)
        base = replace(base, spread=tuple(now.tolist()))
        runs = tuple(with_signals(run, replace(run.recording.signals, base=base)) for run in runs)
        if before and np.abs(np.log(now / np.array(before))).max() < SPREAD_FOUND:
            break
    return runs


def contact_notes(regressor: regression.Regressor, runs: Sequence[Run]) -> tuple[str, ...]:
    """What unknown forces of contacts take from runs, for people to read; empty without them."""
    base = runs[0].recording.signals.base
    if base is None or not base.touches:
        return ()
    touching, near, samples = touched_samples(runs, len(base.touches))
    each = ", ".join(
        f"{touch.frame} {100.0 * share:.0f} % ({100.0 * edge:.1f} %)"
        for touch, share, edge in zip(base.touches, touching / samples, near / samples, strict=True)
    )
    taken = (
        "forces of contacts are not measured, and are taken out of all rows of the samples in "
        f"which a contact may touch; errors are what they do not explain: {each} of {samples} "
        "samples, in brackets only for the margin around changes"
    )
    hidden = hidden_parameters(regressor, base, stances_of(runs)).note
    return (taken, *([hidden] if hidden else []))


def _in_unit_of_log(task: FitTask, runs: Sequence[Run]) -> Model:
    """The model with nominal bodies as large as efforts of an unknown common unit have them.

    A gain of 1 stands for that unit: without this, the prior would be so many times too heavy.
    """
    model, robot, base = task.model, task.model.robot, regression.base_parameters(task.model)
    information = task.information_of(model, runs)(regression.base_regressor(model))
    nominal = {
        f"{kind}.{body.name}": value
        for body, ten in zip(robot.bodies, robot.nominal, strict=True)
        for kind, value in zip(INERTIAL_NAMES, ten, strict=True)
    }
    standard = [nominal.get(name, 0.0) for name in base.names]
    values, sizes = base.values_of(information.layout.columns, standard), []
    for row, sees in enumerate(information.layout.sees):
        gram, own = information.row_gram(row), values[list(sees)]
        moved = float(own @ gram[:-1, :-1] @ own)
        if moved > 0.0 and gram[-1, -1] > 0.0:
            sizes.append(0.5 * np.log(gram[-1, -1] / moved))
    if not sizes:
        return model
    scale = float(np.exp(np.median(sizes)))
    bodies = tuple(
        replace(body, inertia=Inertia.from_ten(scale * body.inertia.ten)) for body in robot.bodies
    )
    return replace(model, robot=replace(robot, bodies=bodies))


def _friction_choice(
    task: FitTask, runs: Sequence[Run], estimator: Estimator[Information]
) -> FrictionChoice | None:
    """The friction laws; `None` where runs are too short, which a note says.

    What is known of the robot counts where it holds and the estimate uses it: then laws are fitted
    by the consistent estimate, in which the runs' speeds bound friction.
    """
    loaded, fastest = task.loaded, fastest_of(runs)

    def consistent(model: Model, base: regression.BaseMap) -> Consistent:
        equal = loaded.estimation.weights == "equal"
        return Consistent(base, knowledge_of(model, loaded, fastest), equal=equal)

    known = method_of(loaded).uses and not task.model.per_run_names
    try:
        given = task.model, runs, estimator, consistent if known else None
        memory, threads, progress = loaded.friction == "auto", task.threads, task.progress
        return choose_friction(*given, memory=memory, threads=threads, progress=progress)
    except TooShortError:
        return None


def _gains(task: FitTask) -> GainEstimate | None:
    signals, mass, frame = task.runs[0].recording.signals, task.payload_mass, task.payload_frame
    if not any(signals.unknown_gains):
        if task.carrying or mass is not None or frame is not None:
            given = "loaded logs are" if task.carrying else "a payload is"
            raise ModelError(
                f"{given} given, but no drive gain is to be identified",
                where="loaded (--loaded)"
                if task.carrying
                else "payload_mass, payload_frame (--payload-mass, --payload-frame)",
                fix='give gain = "identify" in [signals.effort], or identify the payload with '
                "`steelyard payload MODEL LOG`",
            )
        return None
    model = with_any_speed(with_friction(task.model, task.loaded))
    if any(finds_of(term) for term in model.terms):
        wrong = "drive gains and nonlinear parameters of terms cannot be estimated together"
        fix = "identify the gains with given nonlinear parameters, and write them into the file"
        raise DataError(wrong, where="[signals.effort] gain", fix=fix)
    regressor, rests, threads = regression.base_regressor(model), model.has_memory, task.threads
    gather_all = partial(gather, regressor, rests=rests, threads=threads, progress=task.progress)
    unloaded, loaded = (list(map(gather_all, some)) for some in (task.runs, task.carrying))
    gains = zip(model.robot.joint_names, signals.gains, signals.unknown_gains, strict=True)
    known = {joint: float(gain) for joint, gain, unknown in gains if not unknown}
    return identified_gains(model, unloaded, loaded, mass=mass, frame=frame, known=known)


def _offsets(
    task: FitTask, runs: Sequence[Run], gains: GainEstimate | None
) -> nonlinear.ZeroOffsets | None:
    signals = runs[0].recording.signals
    if not any(signals.unknown_offsets) or signals.position_offset is None:
        return None
    model = with_friction(task.model, task.loaded)
    if gains is not None or any(finds_of(term) for term in model.terms):
        beside = "drive gains" if gains is not None else "nonlinear parameters of terms"
        wrong = f"zero offsets and {beside} cannot be identified together"
        fix = "identify the offsets with values given there, and write them into the file"
        raise DataError(wrong, where="[signals] position_offset", fix=fix)
    offset, unknown = signals.position_offset, signals.unknown_offsets
    moved = partial(nonlinear.with_offsets, runs)
    return nonlinear.find_offsets(
        model, lambda offsets: task.information_of(model, moved(offsets)), offset, unknown
    )


def _gain_note(gains: GainEstimate) -> str:
    found, assumed, joints = [], [], []
    for joint, gain, half, unit, known, is_assumed in gains.each:
        if is_assumed:
            assumed.append(f"{joint} {gain:.4g} {unit}")
            joints.append(joint)
        elif not known:
            found.append(f"{joint} {gain:.4g} ± {half:.2g} {unit}")
    sentences = [f"drive gains identified: {', '.join(found)}"] if found or not assumed else []
    if assumed:
        sentences.append(
            f"drive gain of {', '.join(assumed)}: not identifiable from these data, assumed to be "
            "the geometric mean of the others. Efforts in Nm, friction and rotor inertia of "
            f"{', '.join(joints)} are relative to this assumption"
        )
    return ". ".join(
        f"{text[0].upper() if k else text[0]}{text[1:]}" for k, text in enumerate(sentences)
    )
