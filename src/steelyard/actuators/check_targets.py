"""What logs of targets show before actuators are identified: clock, motion, signs, zeros, scale."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from steelyard.actuators.actuator_model import arm_step, outside_limits
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.logs_signs_and_zeros import (
    WINDOW,
    Job,
    moving_joints,
    refuse_few,
    scaled_by_gravity,
    signals_of_targets,
    started,
    stated_values,
)
from steelyard.actuators.read_targets import TargetLog, read_targets
from steelyard.actuators.target_runs import windows_of
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.all_checks import Diagnosis
from steelyard.check.check import CheckResult
from steelyard.check.finding import Finding, Fix
from steelyard.check.findings_text_and_page import CheckContent
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of

QUESTIONS = {
    "targets": "Are targets and positions on one clock, in one order, unit and sign?",
    "motion": "Do all joints move, and long enough?",
    "signs": "Do positions count as the model file's joints do?",
    "joint zeros": "Where are the model file's joints when the log says zero?",
    "limits": "Is the motion within the limits of the joints?",
    "scale": "What gives stiffness and friction of each joint their scale?",
}


@checked(threads=1)
def check_targets(
    robot: str | Path,
    logs: str | Path | Iterable[str | Path],
    *,
    fixed_base: str | None = None,
    threads: int | None = None,
    progress: Progress = silent,
) -> CheckResult:
    """Check logs of position targets and positions, without efforts.

    Args:
        robot: Robot file (TOML) with `target` under `[signals]`, and no efforts.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: The robot file cannot be used.

    Example:
        >>> found = check_targets("servo.toml", "servo_fit.csv")
        >>> found.last.severity.name
        'OK'
    """
    file = load_robot(robot, base=fixed_base)
    signals, files = signals_of_targets(file), log_files(paths_of(logs, least=1))
    read, findings = list[TargetLog](), list[Finding]()
    for k, log in enumerate(files):
        report_progress(progress, "reading logs", k, len(files))
        try:
            read.append(read_targets(log, signals, file.robot))
        except LogError as error:
            says = f"{error.wrong} ({error.where})"
            findings.append(Finding.wrong(says, log=log.text, fix=Fix(error.fix)).by("targets"))
        else:
            findings.append(_read_well(read[-1]).by("targets"))
    if len(read) == len(files):
        cores = threads or os.cpu_count() or 1
        job = Job(file, signals, arm_step(file.robot), tuple(read), cores, progress)
        findings += _of_motion(job, files)
    content = CheckContent(
        file.robot.name,
        str(robot),
        tuple(one.text for one in files),
        None,
        Diagnosis(tuple(findings)),
        QUESTIONS,
        tuple(file.notes),
    )
    return CheckResult(content, None)


def _read_well(log: TargetLog) -> Finding:
    rate = 1.0 / float(np.median(np.concatenate([np.diff(run.t) for run in log.runs])))
    says = f"{log.seconds:.0f} s at {rate:.3g} Hz, joints follow their targets"
    return Finding.ok("; ".join((says, *log.notes)), log=log.name)


def _of_motion(job: Job, files: Sequence[LogArgument]) -> Iterator[Finding]:
    """What all logs together show; nothing of signs and zeros where they are too short."""
    names, windows = job.file.robot.joint_names, windows_of(job.runs, WINDOW)
    moving = moving_joints(job)
    still = [name for j, name in enumerate(names) if j not in moving]
    seconds = sum(log.seconds for log in job.logs)
    try:
        refuse_few(windows, files)
    except ModelError as error:
        yield Finding.wrong(error.wrong, fix=Fix(error.fix)).by("motion")
        return
    yield Finding.doubtful_if(
        bool(still),
        f"{', '.join(still)} hardly moves: nothing of it is identified"
        if still
        else f"all joints move, {seconds:.0f} s in all",
        "",
        Fix("add a log in which it moves, slowly in both directions and fast"),
        still,
    ).by("motion")
    _, values, open_signs, seen = started(job, windows)
    yield from _of_gravity(job, values, open_signs, seen)
    outside = outside_limits(job.file.robot, values, np.concatenate([run.q for run in job.runs]))
    listed = "; ".join(f"{joint} is at {where}" for joint, where in outside.items())
    yield Finding.doubtful_if(
        bool(outside),
        listed or "within them, with these signs and zeros",
        "",
        Fix("state position_sign and position_offset in the robot file, or correct the limits"),
        [*outside],
    ).by("limits")
    yield _scale(job, values, moving, seen)


def _of_gravity(
    job: Job, values: ActuatorValues, open_signs: Sequence[int], seen: Sequence[int]
) -> Iterator[Finding]:
    """Signs and zeros, as far as the weight of the links shows them."""
    names, signals = job.file.robot.joint_names, job.signals
    free = [j for j, sign in enumerate(signals.signs) if sign is None]
    unseen = [names[j] for j in free if j not in seen]
    turned = [names[j] for j in free if values.signs[j] < 0.0 and j not in open_signs]
    says = [f"positions of {', '.join(turned)} count against the model file's"] * bool(turned)
    if unseen:
        says.append(f"gravity does not show that of {', '.join(unseen)}: taken as the model file's")
    if open_signs:
        doubt = f"the logs do not decide the sign of {', '.join(names[j] for j in open_signs)}"
        fix = Fix("state position_sign in the robot file: errors of the joints are the same, but "
                  "not the posture of the arm")  # fmt: skip
        yield Finding.ok("; ".join((doubt, *says)), fix=fix, answered=False).by("signs")
    else:
        said = "; ".join(says) or ("as stated" if not free else "they count as the model file's")
        yield Finding.ok(said).by("signs")
    found = [j for j in seen if signals.zeros[j] is None]
    units = [c.unit for c in job.file.robot.coordinates]
    zeros = ", ".join(f"{names[j]} {values['zero'][j]:.3f} {units[j]}" for j in found)
    by = "by slow motion and a first fit" + " with the likeliest signs" * bool(open_signs)
    about = f"{by}: {zeros}" if found else "as stated, or not shown by gravity"
    yield Finding.ok(about, answered=not open_signs or not found).by("joint zeros")


def _scale(job: Job, values: ActuatorValues, moving: Sequence[int], seen: Sequence[int]) -> Finding:
    """Whose torques the weight of the links gives a scale."""
    names = job.file.robot.joint_names
    if "stiffness" in stated_values(job.file):
        return Finding.ok("the stiffness that the robot file states").by("scale")
    if not seen:
        return Finding.doubtful(
            "no joint is loaded by gravity in the model file: torques have no scale",
            fix=Fix("state stiffness in the robot file, or give the links their masses"),
        ).by("scale")
    loaded = scaled_by_gravity(job, values)
    without = [names[j] for j in moving if j not in loaded]
    says = "the masses of the model file"
    if without:
        says += f"; gravity hardly loads {', '.join(without)}: stiffness assumed like the others'"
    fix = Fix("state their stiffness in the robot file, if it is known") if without else None
    return Finding.ok(says, fix=fix, answered=not without).by("scale")
