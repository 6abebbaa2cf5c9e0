"""From a robot file with position targets and logs to identified actuators and their errors."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.actuators.actuator_model import (
    ActuatorModel,
    arm_step,
    load_actuators,
    outside_limits,
    reach_of,
)
from steelyard.actuators.actuator_parameters import BY_NAME, KINDS, ActuatorValues
from steelyard.actuators.actuators_page import (
    ActuatorIdentification,
    ActuatorValidation,
)
from steelyard.actuators.assumed_scales import like_the_others, scaled, with_assumed_scales
from steelyard.actuators.choice import ALWAYS, NONE, SHARES, USUAL, WIDE, Search, chosen, limited
from steelyard.actuators.fit import Fitted, fit
from steelyard.actuators.halves import halves_apart, widened
from steelyard.actuators.logged_efforts import (
    Efforts,
    effort_gains,
    logged_efforts,
    scales,
)
from steelyard.actuators.logs_signs_and_zeros import (
    WINDOW,
    Job,
    moving_joints,
    notes_of_zeros,
    read_logs,
    refuse_few,
    search_of,
    signals_of_targets,
    some_windows,
    started,
    stated_stiffness,
    stated_torques,
    stated_values,
    weighed,
    with_scale,
)
from steelyard.actuators.open_loop import open_loops
from steelyard.actuators.read_targets import TargetLog, read_targets
from steelyard.actuators.rollout import STEP
from steelyard.actuators.target_runs import Window, windows_of
from steelyard.base.arrays import frozen
from steelyard.base.checked_arguments import checked
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.identified_model import Provenance
from steelyard.identify.runs_and_notes_of_logs import fitted_before, provenance
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import (
    log_files,
    paths_of,
    refuse_overlaps,
)

CHOICE_SECONDS = 200.0  # of motion on which parts of the law are tried [s]
COARSE_ROUNDS, LAST_ROUNDS = 6, 8  # of the fits to all windows, with coarse and with fine steps
BEYOND_AT_ALL = 0.01  # how far motion leaves the limits of the model file when a note says so
FINER = 4  # times shorter are the steps of the last fit, and of all that it predicts


@checked(threads=1)
def identify_actuators(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    validate: str | Path | Iterable[str | Path] = (),
    *,
    fixed_base: str | None = None,
    threads: int | None = None,
    progress: Progress = silent,
) -> ActuatorIdentification:
    """Identify the actuators of an arm from position targets and positions.

    The whole arm is simulated under its position controllers, from targets alone, and the
    parameters are those for which positions come out as measured. The masses of the model file give
    stiffness, damping, friction and rotor inertia their scale, or efforts that are logged beside.

    Args:
        robot: Robot file (TOML) with `target` under `[signals]`, and no efforts or `[actuator]`.
        logs: Logs to fit; `run.csv@5:20` is a window in seconds.
        validate: Logs of other motions, for validation.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the targets are not those of the positions.

    Example:
        >>> found = identify_actuators("servo.toml", "servo_fit.csv", "servo_other.csv")
        >>> bool(found.validation[0].rms.max() < 0.01)
        True
    """
    file = load_robot(robot, base=fixed_base)
    signals = signals_of_targets(file)
    known, unknown = (log_files(paths_of(x, least)) for x, least in ((logs, 1), (validate, 0)))
    refuse_overlaps(known, unknown)
    step = arm_step(file.robot)
    read = read_logs(file, signals, known, unknown, progress)
    cores = threads or os.cpu_count() or 1
    job = Job(file, signals, step, read[: len(known)], cores, progress)
    windows = windows_of(job.runs, WINDOW)
    refuse_few(windows, known)
    begun, start, open_signs, seen = started(job, windows)
    if start["integral"].any():  # the choice of the law tries it first, from where all began
        start = begun.changed(zero=start["zero"])
    search = search_of(job, some_windows(windows, CHOICE_SECONDS), start, seen, 2.0 * STEP)
    fitted, rungs, parts, search = chosen(
        replace(search, centre=begun),
        start,
        stated_values(file),
        file.actuator.law == "auto",
        lambda what, done, of: report_progress(progress, "choosing the law", done, of, what),
    )
    search = _shown(replace(search, windows=tuple(windows)), fitted, job)
    fitted, search = _limits_of_all(search, fitted, parts, job)
    first = _first(start, fitted.values, parts, stated_values(file))
    final = _final(search, fitted, parts, job)
    efforts = _efforts(job, windows, final.values)
    by_masses = _by_masses(job, efforts, final.values)
    if measured := _measured_scales(job, efforts):
        search, parts = _measured(search, final.values, parts, measured)
        first, values = (_rescaled(x, measured, job) for x in (first, final.values))
        final = _final(search, replace(final, values=values), parts, job)
    first = _alike(first, search, parts, job)
    wider = halves_apart(
        search,
        first,
        parts,
        final,
        lambda half: report_progress(progress, "fitting two halves of the motions", half, 2),
    )
    final = widened(final, wider or 1.0)
    notes = (*notes_of_zeros(job, final, open_signs, seen), *_notes_of_chance(final))
    origin = provenance(file, known, (), unknown, (), (*file.notes, *notes))
    origin = replace(origin, runs=tuple(log.name for log in job.logs))
    model = _model(job, final, _with_scale(search, parts, job), wider, open_signs, origin)
    efforts = _efforts(job, windows, final.values)
    model = replace(model, efforts=effort_gains(model, efforts, by_masses))
    every = open_loops(step, model.values, read, cores, model.step)
    moved = np.concatenate([one.q for one in every])
    model = replace(
        model,
        beyond_limits=tuple(model.outside_limits(moved)),
        reach=frozen(reach_of(model.values, moved)),
    )
    past = outside_limits(file.robot, model.values, moved, BEYOND_AT_ALL)
    notes += tuple(
        f"{joint} moves over {words}: exports have limits that contain it"
        for joint, words in past.items()
        if joint not in model.beyond_limits
    )
    more = tuple(note for log in read for note in log.notes)
    return ActuatorIdentification(
        model,
        every[len(known) :],
        every[: len(known)],
        rungs,
        (*file.notes, *notes, *more),
    )


def _notes_of_chance(found: Fitted) -> tuple[str, ...]:
    """How much motion did not count."""
    if not found.chance:
        return ()
    return (
        f"{found.chance:.1%} of the motion did not count in the fit: simulated with the values "
        "that were found, it depends on chance, as in stick-slip",
    )


def _final(search: Search, fitted: Fitted, parts: Sequence[str], job: Job) -> Fitted:
    """The fit to all windows, from that to some of them."""
    start = _alike(fitted.values, search, parts, job)
    task = search.task(search.windows, parts)

    def report(round_: int, value: float) -> None:
        report_progress(job.progress, "identifying the actuators", round_, 15)

    coarse = fit(task, start, COARSE_ROUNDS, report)
    fine = replace(task, h=STEP, finer=FINER)
    return fit(fine, coarse.values, LAST_ROUNDS, report)


def _first(
    start: ActuatorValues,
    fitted: ActuatorValues,
    parts: Sequence[str],
    stated: Collection[str],
) -> ActuatorValues:
    """Where the usual law began; what it lacks as it was found."""
    usual = [k.name for k in KINDS if k.part in (*ALWAYS, *USUAL) and k.part in parts]
    first = fitted.changed(**{name: start[name] for name in usual if name not in stated})
    if "damping" in stated:
        return first
    # some of it acts beside the torque limit
    left = np.maximum(first["damping"] - fitted["back_emf"], 0.1 * first["damping"])
    return first.changed(damping=left)


def _limits_of_all(
    search: Search, fitted: Fitted, parts: Sequence[str], job: Job
) -> tuple[Fitted, Search]:
    """With torque limits of further joints, that motion reaches on which no law was tried."""
    if "torque_limit" not in parts or "torque_limit" in stated_values(job.file):
        return fitted, search
    known, falls = search.joints["torque_limit"], "back_emf" in parts
    falls &= "back_emf" not in stated_values(job.file)
    rest = {"torque_limit": [j for j in moving_joints(job) if j not in known]}
    there = replace(search, h=STEP, joints={**search.joints, **rest})
    values, more = limited(there, fitted.values, search.windows, SHARES if falls else NONE)
    for name in ("torque_limit", *["back_emf"] * falls):
        rest[name] = sorted({*search.joints[name], *more})
    joints = {**search.joints, **rest}
    return replace(fitted, values=values), replace(search, joints=joints)


def _efforts(job: Job, windows: Sequence[Window], values: ActuatorValues) -> Efforts:
    """What logs show of the efforts of joints that move."""
    given = (job.step, windows, values, job.signals)
    return logged_efforts(*given, moving_joints(job), job.threads)


def _by_masses(job: Job, efforts: Efforts, values: ActuatorValues) -> dict[int, float]:
    """Gains with which torques have the scale of the masses, at joints that their weight loads.

    Not of those whose scale is stated.
    """
    loaded = {*weighed(job, values)} - {*stated_stiffness(job), *stated_torques(job)}
    return {j: 1.0 / one.value for j, one in efforts.factors.items() if j in loaded}


def _measured_scales(job: Job, efforts: Efforts) -> dict[int, tuple[float, float]]:
    """Scales of torques by efforts, at joints whose stiffness is not stated."""
    stated = stated_stiffness(job)
    return {j: x for j, x in scales(efforts, job.signals).items() if j not in stated}


def _measured(
    search: Search,
    values: ActuatorValues,
    parts: Sequence[str],
    found: Mapping[int, tuple[float, float]],
) -> tuple[Search, tuple[str, ...]]:
    """With the stiffness that logged efforts show as prior, and masses of links searched."""
    known = {
        ("stiffness", j): (float(np.log(values["stiffness"][j] * factor)), std)
        for j, (factor, std) in found.items()
    }
    # masses have the scale of the efforts, too, and differ from each other by as much as before
    scale = float(np.median([factor for factor, _ in found.values()]))
    masses = search.joints["mass_factor"]
    spread = BY_NAME["mass_factor"].spread
    known |= {("mass_factor", j): (float(np.log(scale)), spread) for j in masses}
    joints = {**search.joints, "stiffness": sorted({*search.joints["stiffness"], *found})}
    more = ("mass_factor",) if "mass_factor" not in parts else ()
    return replace(search, known={**search.known, **known}, joints=joints), (*parts, *more)


def _rescaled(
    values: ActuatorValues, found: Mapping[int, tuple[float, float]], job: Job
) -> ActuatorValues:
    """Values in the scale that logged efforts give the torques of joints, and links' masses."""
    usual = float(np.median([by for by, _ in found.values()]))
    factor = np.array([found[j][0] if j in found else usual for j in range(values.n)])
    return scaled(values, factor, stated_values(job.file)).changed(mass_factor=usual)


def _shown(search: Search, fitted: Fitted, job: Job) -> Search:
    """Without the stiffness of joints that neither gravity nor the inertia of links shows."""
    clear = with_scale(job, fitted.values)
    clear += [
        one.joint
        for one, std in zip(fitted.task.free, fitted.std, strict=True)
        if one.name == "stiffness" and std < WIDE
    ]
    searched = search.joints["stiffness"]
    some = [j for j in searched if j in clear] or searched
    return replace(search, joints={**search.joints, "stiffness": some})


def _alike(
    values: ActuatorValues, search: Search, parts: Sequence[str], job: Job
) -> ActuatorValues:
    """Joints without a scale of their own are like the others."""
    scaled = _with_scale(search, parts, job)
    return (
        like_the_others(values, scaled, job.step.kinds, stated_values(job.file))
        if scaled
        else values
    )


def _with_scale(search: Search, parts: Sequence[str], job: Job) -> Sequence[int]:
    """Joints whose stiffness is searched or stated; none if it is stated of all."""
    stated = stated_stiffness(job)
    if len(stated) == job.step.n or "stiffness" not in parts:
        return ()
    return sorted({*search.joints["stiffness"], *stated})


def _model(
    job: Job,
    found: Fitted,
    scaled: Sequence[int],
    wider: float | None,
    open_signs: Sequence[int],
    origin: Provenance,
) -> ActuatorModel:
    moving, names = moving_joints(job), job.file.robot.joint_names
    assumed = [j for j in moving if scaled and j not in scaled]
    free, covariance, known = with_assumed_scales(found, assumed, scaled, job.step.kinds)
    return ActuatorModel(
        job.file.robot,
        job.signals,
        found.values,
        free,
        covariance,
        known,
        wider,
        found.scale,
        tuple(name for name, x in stated_values(job.file).items() if np.isfinite(x).any()),
        found.task.h / found.task.finer,
        tuple(names[j] for j in assumed),
        tuple(name for j, name in enumerate(names) if j not in moving),
        tuple(names[j] for j in open_signs),
        (),
        frozen(np.zeros((job.step.n, 2))),
        origin,
    )


@checked(threads=1)
def validate_actuators(
    model: str | Path | ActuatorModel,
    logs: str | Path | Iterable[str | Path],
    *,
    threads: int | None = None,
    progress: Progress = silent,
) -> ActuatorValidation:
    """Predict the positions of logs from their targets alone, and compare with those measured.

    Args:
        model: Identified actuators, their `model.json`, or the folder that contains it.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> found = validate_actuators("servo-model", "servo_other.csv")
        >>> found.validation[0].log
        'servo_other'
    """
    known = load_actuators(model)
    files, read = log_files(paths_of(logs, least=1)), list[TargetLog]()
    for k, log in enumerate(files):
        report_progress(progress, "reading logs", k, len(files))
        read.append(read_targets(log, replace(known.signals, effort=()), known.robot))
    report_progress(progress, "simulating logs", 0, 1)
    cores = threads or os.cpu_count() or 1
    found = open_loops(known.arm, known.values, read, cores, known.step)
    again = tuple(
        one.log
        for one, log in zip(found, files, strict=True)
        if fitted_before(known.provenance, log)
    )
    notes = tuple(note for one in read for note in one.notes)
    return ActuatorValidation(known, found, again, notes)
