"""From a robot file with position targets and logs to identified actuators and their errors."""

import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.actuators.actuator_model import ActuatorModel, arm_step, load_actuators
from steelyard.actuators.actuator_parameters import IN_STEP, KINDS, ActuatorValues
from steelyard.actuators.actuators_page import (
    ActuatorIdentification,
    ActuatorValidation,
)
from steelyard.actuators.assumed_scales import like_the_others, with_assumed_scales
from steelyard.actuators.choice import ALWAYS, USUAL, Search, chosen
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import Fitted, fit
from steelyard.actuators.halves import halves_apart, widened
from steelyard.actuators.open_loop import open_loops
from steelyard.actuators.read_targets import TargetLog, read_targets
from steelyard.actuators.rollout import STEP
from steelyard.actuators.starts import Quiet, gravity_joints, starts, zero_prior
from steelyard.actuators.target_runs import TargetRun, Window, windows_of
from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.identified_model import Provenance
from steelyard.identify.runs_and_notes_of_logs import fitted_before, provenance
from steelyard.model.model import ValuedModel
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import TargetSignals
from steelyard.runs.runs_of_named_logs import (
    LogArgument,
    distinct_names,
    log_files,
    paths_of,
    refuse_overlaps,
)

WINDOW = 4.0  # length of what is rolled out from a measured state [s]
TRIED = 4  # combinations of signs that are fitted
FIRST_ROUNDS, FIRST_SECONDS, FIRST_STEP = 8, 100.0, 0.02
"""Of the fits between which signs are decided: rounds, motion [s], and steps of rollouts [s]."""
CHOICE_SECONDS = 200.0  # of motion on which parts of the law are tried [s]
LEAST_WINDOWS = 8
STILL = 0.03  # range of a joint that does not move [rad; m]
LOADED = 0.3
"""Size of a joint's gravity along the logs, over its dry friction, that gives it a scale."""
COARSE_ROUNDS, LAST_ROUNDS = 6, 8  # of the fits to all windows, with coarse and with fine steps
FINER = 4  # times shorter are the steps of the last fit, and of all that it predicts
AS_GOOD = 1.1
"""Misfit over the least up to which signs fit as well: masses of model files are off by more."""


@dataclass(frozen=True, eq=False)
class _Job:
    """What is identified from what."""

    file: LoadedRobot
    signals: TargetSignals
    step: ArmStep
    logs: tuple[TargetLog, ...]
    threads: int
    progress: Progress

    @property
    def runs(self) -> list[TargetRun]:
        """Of all logs."""
        return [run for log in self.logs for run in log.runs]

    @property
    def nominal(self) -> ValuedModel:
        """The bodies of the model file."""
        found = self.step.model.prior
        assert found is not None
        return found


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
    """Identify the actuators of an arm from position targets and positions, without efforts.

    The whole arm is simulated under its position controllers, from targets alone, and the
    parameters are those for which positions come out as measured. The masses of the model file give
    stiffness, damping, friction and rotor inertia their scale.

    Args:
        robot: Robot file (TOML) with `target` under `[signals]`, and no efforts.
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
    read = _read(file, signals, [*known, *unknown], progress)
    cores = threads or os.cpu_count() or 1
    job = _Job(file, signals, step, read[: len(known)], cores, progress)
    windows = windows_of(job.runs, WINDOW)
    refuse_few(windows, known)
    begun, start, open_signs, seen = _started(job, windows)
    search = _search(job, _some(windows, CHOICE_SECONDS), start, seen, 2.0 * STEP)
    fitted, rungs, parts, search = chosen(
        replace(search, centre=begun),
        start,
        _stated(file),
        file.actuator.law == "auto",
        lambda what, done, of: report_progress(progress, "choosing the law", done, of, what),
    )
    search = replace(search, windows=tuple(windows))
    final = _final(search, fitted, parts, job)
    first = _first(start, fitted.values, parts, _stated(file))
    first = _alike(first, search, parts, job)
    wider = halves_apart(
        search,
        first,
        parts,
        final,
        lambda half: report_progress(progress, "fitting two halves of the motions", half, 2),
    )
    final = widened(final, wider or 1.0)
    notes = (*_notes_of_zeros(job, final.values, open_signs, seen), *_notes_of_chance(final))
    origin = provenance(file, known, (), unknown, (), (*file.notes, *notes))
    origin = replace(origin, runs=tuple(log.name for log in job.logs))
    model = _model(job, final, _with_scale(search, parts, job), wider, open_signs, origin)
    every = open_loops(step, model.values, read, cores, model.step)
    moved = np.concatenate([one.q for one in every])
    model = replace(model, beyond_limits=tuple(model.outside_limits(moved)))
    more = tuple(note for log in read for note in log.notes)
    return ActuatorIdentification(
        model,
        every[len(known) :],
        every[: len(known)],
        rungs,
        (*file.notes, *notes, *more),
    )


def signals_of_targets(file: LoadedRobot) -> TargetSignals:
    """The columns of targets that a robot file names."""
    if file.targets is None:
        raise ModelError(
            "no columns of position targets are named"
            if file.signals is None
            else "the robot file names efforts: actuators are identified from targets without them",
            where=file.reference,
            fix='`steelyard init MODEL LOG` writes a robot file; or set [signals] target = "..." '
            "there, without [signals.effort]",
        )
    return file.targets


def _read(
    file: LoadedRobot, signals: TargetSignals, logs: Sequence[LogArgument], progress: Progress
) -> tuple[TargetLog, ...]:
    """All logs, with distinct names."""
    found = []
    for k, log in enumerate(logs):
        report_progress(progress, "reading logs", k, len(logs))
        found.append(read_targets(log, signals, file.robot))
    names = distinct_names([(x.name, log.path) for x, log in zip(found, logs, strict=True)])
    return tuple(
        replace(log, name=name, runs=tuple(replace(run, name=name) for run in log.runs))
        for log, name in zip(found, names, strict=True)
    )


def refuse_few(windows: Sequence[Window], logs: Sequence[LogArgument]) -> None:
    """A `ModelError` where there is too little for intervals."""
    seconds = sum(float(w.t[-1] - w.t[0]) for w in windows)
    if len(windows) < LEAST_WINDOWS or seconds < 0.9 * LEAST_WINDOWS * WINDOW:
        raise ModelError(
            f"the logs hold {seconds:.3g} s that can be used, and {LEAST_WINDOWS * WINDOW:g} s are "
            "needed",
            where=", ".join(log.text for log in logs),
            fix=f"give logs of {LEAST_WINDOWS * WINDOW:g} s in all, at least",
        )


def _stated(file: LoadedRobot) -> dict[str, Array]:
    """What the robot file states of the actuators: `(n,)`, NaN where it is to be identified."""
    found = {}
    for name in (*IN_STEP, "delay"):
        given = getattr(file.actuator, name)
        if given is None or given == "identify":
            if given == "identify" and name not in (*ALWAYS, *USUAL):
                found[name] = np.full(file.robot.n, np.nan)
            continue
        listed = given if isinstance(given, tuple) else (given,) * file.robot.n
        if len(listed) != file.robot.n:
            raise ModelError(
                f"{len(listed)} values for {file.robot.n} joints",
                where=file.where("actuator", name),
                fix="give one value for all joints, or one each",
            )
        found[name] = np.array([np.nan if x == "identify" else float(x) for x in listed])
    return found


def _open_joints(job: _Job) -> dict[str, list[int]]:
    """Joints at which what is stated of others is searched; none of what is stated of all."""
    return {
        name: np.flatnonzero(np.isnan(given)).tolist()
        for name, given in _stated(job.file).items()
        if not np.isnan(given).all()
    }


def _started(
    job: _Job, windows: Sequence[Window]
) -> tuple[ActuatorValues, ActuatorValues, list[int], list[int]]:
    """Where slow motion begins, and a first fit to some windows ends.

    Then joints whose sign stays open, and those that gravity shows.
    """
    s = job.signals
    report_progress(job.progress, "finding signs and zeros", 0, 1)
    seen = gravity_joints(job.nominal, Quiet.of(job.runs))
    begun = starts(job.nominal, job.runs, s.signs, s.zeros)
    some = _some(windows, FIRST_SECONDS)
    tried: dict[int, Fitted] = {}
    for k, one in enumerate(begun[:TRIED]):
        report_progress(job.progress, "finding signs and zeros", k, min(TRIED, len(begun)))
        search = _search(job, some, one.values, seen, FIRST_STEP)
        tried[k] = fit(search.task(some, (*ALWAYS, *USUAL)), one.values, FIRST_ROUNDS)
    least = min(map(_misfit, tried.values()))
    alike = {k: one for k, one in tried.items() if _misfit(one) < AS_GOOD * least}
    best = min(alike, key=lambda k: _changes(alike[k]))
    signs = np.array([one.values.signs for one in alike.values()])
    open_signs = [j for j in seen if s.signs[j] is None and np.ptp(signs[:, j]) > 0.0]
    return begun[best].values, alike[best].values, open_signs, seen


def _notes_of_zeros(
    job: _Job, values: ActuatorValues, open_signs: Sequence[int], seen: Sequence[int]
) -> tuple[str, ...]:
    """What was found of the log's signs and zeros."""
    names, s, notes = job.file.robot.joint_names, job.signals, list[str]()
    for j in seen:
        if s.signs[j] is None and values.signs[j] < 0.0 and j not in open_signs:
            notes.append(f"positions of {names[j]} count against the model file's")
        if s.zeros[j] is None:
            notes.append(
                f"where the log of {names[j]} says zero, the model file's joint is at "
                f"{values['zero'][j]:.3f} {job.file.robot.coordinates[j].unit}"
            )
    return tuple(notes)


def _notes_of_chance(found: Fitted) -> tuple[str, ...]:
    """How much motion did not count."""
    if not found.chance:
        return ()
    return (
        f"{found.chance:.1%} of the motion did not count in the fit: simulated with the values "
        "that were found, it depends on chance, as in stick-slip",
    )


def _search(
    job: _Job, windows: Sequence[Window], start: ActuatorValues, seen: Sequence[int], h: float
) -> Search:
    """What is searched: at joints that move, zeros only where gravity shows them."""
    q = np.concatenate([run.q for run in job.runs])
    robot = job.file.robot
    zeros = {j: zero_prior(robot, q, start.signs, j) for j in seen if job.signals.zeros[j] is None}
    moving, loaded = moving_joints(job), sorted({*weighed(job, start), *_stated_torques(job)})
    joints: dict[str, list[int]] = {kind.name: moving for kind in KINDS}
    joints |= {"stiffness": [j for j in loaded if j in moving] or moving}
    joints |= {"zero": [j for j in zeros if j in moving]}
    for name, some in _open_joints(job).items():
        joints[name] = [j for j in some if j in moving]
    return Search(job.step, tuple(windows), joints, zeros, start, h, job.threads)


def moving_joints(job: _Job) -> list[int]:
    """Joints that move in some log."""
    spread = np.max([np.ptp(run.q, axis=0) for run in job.runs], axis=0)
    return np.flatnonzero(spread > STILL).tolist()


def weighed(job: _Job, values: ActuatorValues) -> list[int]:
    """Joints whose gravity, along the logs, is large enough to give their torques a scale.

    All of them if there is none.
    """
    q = np.concatenate([run.q for run in job.runs])
    q = values.signs * q[:: max(1, len(q) // 1000)] + values["zero"]
    size = np.sqrt(np.mean(np.asarray(job.nominal.gravity(q)) ** 2, axis=0))
    found = np.flatnonzero(size > LOADED * values["coulomb"]).tolist()
    return found or list(range(job.signals.n))


def _misfit(found: Fitted) -> float:
    """Geometric mean over the joints of the residuals' scale."""
    return float(np.exp(np.log(found.scale).mean()))


def _changes(found: Fitted) -> tuple[int, float]:
    """How far the log is from the model's convention: joints that are reversed, and zeros."""
    return int((found.values.signs < 0.0).sum()), float(np.abs(found.values["zero"]).sum())


def _some(windows: Sequence[Window], seconds: float) -> list[Window]:
    """Windows of about so long in all, spread over the logs."""
    every = max(1, round(len(windows) * WINDOW / seconds))
    return list(windows[::every])


def _final(search: Search, fitted: Fitted, parts: Sequence[str], job: _Job) -> Fitted:
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
    return fitted.changed(**{name: start[name] for name in usual if name not in stated})


def _alike(
    values: ActuatorValues, search: Search, parts: Sequence[str], job: _Job
) -> ActuatorValues:
    """Joints without a scale of their own are like the others."""
    scaled = _with_scale(search, parts, job)
    return like_the_others(values, scaled, job.step.kinds, _stated(job.file)) if scaled else values


def _stated_torques(job: _Job) -> list[int]:
    """Joints of which the user states a torque that acts in all motion: it gives them a scale."""
    stated, found = _stated(job.file), set[int]()
    for name in ("damping", "coulomb", "armature"):
        if name in stated:
            found |= set(np.flatnonzero(stated[name] > 0.0).tolist())
    return sorted(found)


def _with_scale(search: Search, parts: Sequence[str], job: _Job) -> Sequence[int]:
    """Joints whose stiffness is searched, if it is stated of none."""
    stated = "stiffness" in _stated(job.file) or "stiffness" not in parts
    return () if stated else search.joints.get("stiffness", range(job.step.n))


def _model(
    job: _Job,
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
        tuple(_stated(job.file)),
        found.task.h / found.task.finer,
        tuple(names[j] for j in assumed),
        tuple(name for j, name in enumerate(names) if j not in moving),
        tuple(names[j] for j in open_signs),
        (),
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
        read.append(read_targets(log, known.signals, known.robot))
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
