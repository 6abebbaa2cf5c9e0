"""Logs of targets as the fit takes them, and their signs and zeros: where the search begins."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.actuators.actuator_parameters import IN_STEP, KINDS, ActuatorValues
from steelyard.actuators.choice import (
    ALWAYS,
    USUAL,
    Search,
    first_values,
    left_out,
    size,
    stays_off,
)
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import Fitted, fit
from steelyard.actuators.read_targets import TargetLog, read_targets
from steelyard.actuators.starts import Quiet, gravity_joints, starts, zero_prior
from steelyard.actuators.target_runs import TargetRun, Window
from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import ModelError
from steelyard.base.progress import Progress, report_progress
from steelyard.model.model import ValuedModel
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.signals import TargetSignals
from steelyard.runs.runs_of_named_logs import LogArgument, distinct_names

WINDOW = 4.0  # length of what is rolled out from a measured state [s]
TRIED = 4  # combinations of signs that are fitted
FIRST_ROUNDS, FIRST_SECONDS, FIRST_STEP = 8, 100.0, 0.02
"""Of the fits between which signs are decided: rounds, motion [s], and steps of rollouts [s]."""
LEAST_WINDOWS = 8
STILL = 0.03  # range of a joint that does not move [rad; m]
LOADED = 0.3
"""Size of a joint's gravity along the logs, over its dry friction, that gives it a scale."""
AS_GOOD = 1.1
"""Misfit over the least up to which signs fit as well: masses of model files are off by more."""


@dataclass(frozen=True, eq=False)
class Job:
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


def signals_of_targets(file: LoadedRobot) -> TargetSignals:
    """The columns of targets that a robot file names."""
    if file.targets is None:
        raise ModelError(
            "no columns of position targets are named"
            if file.signals is None
            else "the robot file is for identification from efforts",
            where=file.reference,
            fix='`steelyard init MODEL LOG` writes a robot file; or set [signals] target = "..." '
            "there, and add [actuator], or remove [signals.effort]",
        )
    return file.targets


def read_logs(
    file: LoadedRobot,
    signals: TargetSignals,
    fitted: Sequence[LogArgument],
    others: Sequence[LogArgument],
    progress: Progress,
) -> tuple[TargetLog, ...]:
    """All logs, with distinct names; of others than those that are fitted without efforts."""
    found, logs = [], [*fitted, *others]
    for k, log in enumerate(logs):
        report_progress(progress, "reading logs", k, len(logs))
        own = signals if k < len(fitted) else replace(signals, effort=())
        found.append(read_targets(log, own, file.robot))
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


def stated_values(file: LoadedRobot) -> dict[str, Array]:
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
        values = np.array([np.nan if x == "identify" else float(x) for x in listed])
        if name not in (*ALWAYS, "coulomb") or np.isfinite(values).any():
            found[name] = values
    if file.targets is not None and file.targets.supply and "integral" in found:
        raise ModelError(
            "an integral gain beside a supply voltage that changes is not modelled",
            where=file.where("actuator", "integral"),
            fix="remove integral, or supply_voltage and nominal_voltage",
        )
    if np.isnan(found.get("back_emf", 0.0)).any() and "torque_limit" not in found:
        raise ModelError(
            "below a torque limit back-EMF and damping are one",
            where=file.where("actuator", "back_emf"),
            fix='add torque_limit = "identify", or a number; or leave back_emf out: law = "auto" '
            "tries both",
        )
    return found


def _open_joints(job: Job) -> dict[str, list[int]]:
    """Joints at which what is stated of others is searched; none of what is stated of all."""
    return {
        name: np.flatnonzero(np.isnan(given)).tolist()
        for name, given in stated_values(job.file).items()
        if not np.isnan(given).all()
    }


def started(
    job: Job, windows: Sequence[Window]
) -> tuple[ActuatorValues, ActuatorValues, list[int], list[int]]:
    """Where slow motion begins, and a first fit to some windows ends.

    Then joints whose sign stays open, and those that gravity shows.
    """
    s = job.signals
    report_progress(job.progress, "finding signs and zeros", 0, 1)
    seen = gravity_joints(job.nominal, Quiet.of(job.runs))
    begun = starts(job.nominal, job.runs, s.signs, s.zeros)
    some = some_windows(windows, FIRST_SECONDS)
    tried: dict[int, Fitted] = {}
    for k, one in enumerate(begun[:TRIED]):
        report_progress(job.progress, "finding signs and zeros", k, min(TRIED, len(begun)))
        search = search_of(job, some, one.values, seen, FIRST_STEP)
        tried[k] = _first_fit(search, one.values)
    least = min(map(_misfit, tried.values()))
    alike = {k: one for k, one in tried.items() if _misfit(one) < AS_GOOD * least}
    best = min(alike, key=lambda k: _changes(alike[k]))
    signs = np.array([one.values.signs for one in alike.values()])
    open_signs = [j for j in seen if s.signs[j] is None and np.ptp(signs[:, j]) > 0.0]
    return begun[best].values, alike[best].values, open_signs, seen


def _first_fit(search: Search, values: ActuatorValues) -> Fitted:
    """Of the usual law, with an integral gain where that describes motion better."""
    parts = (*ALWAYS, *USUAL)
    found = fit(search.task(search.windows, parts), values, FIRST_ROUNDS)
    if not search.joints["integral"] or stays_off(search, found.values, search.windows):
        return found
    begun = found.values.changed(integral=first_values(found.values, search.windows)["integral"])
    search = replace(search, centre=begun)
    other = fit(search.task(search.windows, (*parts, "integral")), begun, FIRST_ROUNDS)
    return other if _misfit(other) * AS_GOOD < _misfit(found) else found


def otherwise(
    job: Job, windows: Sequence[Window], values: ActuatorValues
) -> tuple[float, ActuatorValues] | None:
    """What motion asks for where signs or zeros are stated, and how many times better it fits.

    `None` where none is stated.
    """
    n = job.step.n
    free = replace(job.signals, signs=(None,) * n, zeros=(None,) * n)
    if (free.signs, free.zeros) == (job.signals.signs, job.signals.zeros):
        return None
    _, found, _, seen = started(replace(job, signals=free), windows)
    some = some_windows(windows, FIRST_SECONDS)
    stated, other = (
        size(left_out(search_of(job, some, x, seen, FIRST_STEP), x, some)) for x in (values, found)
    )
    return stated / other, found


def notes_of_zeros(
    job: Job, found: Fitted, open_signs: Sequence[int], seen: Sequence[int]
) -> tuple[str, ...]:
    """What was found of the log's signs and zeros, with 95 % intervals."""
    names, s, notes = job.file.robot.joint_names, job.signals, list[str]()
    stds = {one.joint: std for one, std in zip(found.task.free, found.std, strict=True)
            if one.name == "zero"}  # fmt: skip
    for j in seen:
        if s.signs[j] is None and found.values.signs[j] < 0.0 and j not in open_signs:
            notes.append(f"positions of {names[j]} count against the model file's")
        if s.zeros[j] is None:
            within = f" ± {Z95 * stds[j]:.3f}" if j in stds else ""
            notes.append(
                f"where the log of {names[j]} says zero, the model file's joint is at "
                f"{found.values['zero'][j]:.3f}{within} {job.file.robot.coordinates[j].unit}"
            )
    return tuple(notes)


def search_of(
    job: Job, windows: Sequence[Window], start: ActuatorValues, seen: Sequence[int], h: float
) -> Search:
    """What is searched: at joints that move, zeros only where gravity shows them."""
    q = np.concatenate([run.q for run in job.runs])
    robot = job.file.robot
    zeros = [j for j in seen if job.signals.zeros[j] is None]
    known = {("zero", j): zero_prior(robot, q, start.signs, j) for j in zeros}
    moving = moving_joints(job)
    joints: dict[str, list[int]] = {kind.name: moving for kind in KINDS}
    joints |= {"zero": [j for j in zeros if j in moving]}
    joints |= {"integral": []} if job.signals.supply else {}
    for name, some in _open_joints(job).items():
        joints[name] = [j for j in joints[name] if j in some]
    return Search(job.step, tuple(windows), joints, known, start, h, job.threads)


def moving_joints(job: Job) -> list[int]:
    """Joints that move in some log."""
    spread = np.max([np.ptp(run.q, axis=0) for run in job.runs], axis=0)
    return np.flatnonzero(spread > STILL).tolist()


def with_scale(job: Job, values: ActuatorValues) -> list[int]:
    """Joints whose torques have a scale: by the weight of links, or by what is stated of them."""
    return sorted({*weighed(job, values), *stated_torques(job), *stated_stiffness(job)})


def weighed(job: Job, values: ActuatorValues) -> list[int]:
    """Joints whose gravity, along the logs, is large enough to give their torques a scale."""
    q = np.concatenate([run.q for run in job.runs])
    q = values.signs * q[:: max(1, len(q) // 1000)] + values["zero"]
    size = np.sqrt(np.mean(np.asarray(job.nominal.gravity(q)) ** 2, axis=0))
    return np.flatnonzero(size > LOADED * values["coulomb"]).tolist()


def stated_stiffness(job: Job) -> list[int]:
    """Joints whose stiffness the user states."""
    given = stated_values(job.file).get("stiffness", np.zeros(0))
    return np.flatnonzero(np.isfinite(given)).tolist()


def _misfit(found: Fitted) -> float:
    """Geometric mean over the joints of the residuals' scale."""
    return float(np.exp(np.log(found.scale).mean()))


def _changes(found: Fitted) -> tuple[int, float]:
    """How far the log is from the model's convention: joints that are reversed, and zeros."""
    return int((found.values.signs < 0.0).sum()), float(np.abs(found.values["zero"]).sum())


def some_windows(windows: Sequence[Window], seconds: float) -> list[Window]:
    """Windows of about so long in all, spread over the logs."""
    every = max(1, round(len(windows) * WINDOW / seconds))
    return list(windows[::every])


def stated_torques(job: Job) -> list[int]:
    """Joints of which the user states a torque that acts in all motion: it gives them a scale."""
    stated, found = stated_values(job.file), set[int]()
    for name in ("damping", "coulomb", "armature"):
        if name in stated:
            found |= set(np.flatnonzero(stated[name] > 0.0).tolist())
    return sorted(found)
