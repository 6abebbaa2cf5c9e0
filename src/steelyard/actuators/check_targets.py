"""What logs of targets show before actuators are identified: clock, motion, signs, zeros, scale."""

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.actuators.actuator_model import arm_step, outside_limits
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.logged_efforts import (
    Efforts,
    agrees,
    logged_efforts,
    masses_differ,
    scales,
)
from steelyard.actuators.logs_signs_and_zeros import (
    AS_GOOD,
    WINDOW,
    Job,
    moving_joints,
    otherwise,
    refuse_few,
    signals_of_targets,
    started,
    stated_stiffness,
    stated_torques,
    weighed,
)
from steelyard.actuators.read_targets import (
    TargetLog,
    ahead_of_targets,
    read_targets,
    unfollowed,
)
from steelyard.actuators.target_runs import windows_of
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.all_checks import Diagnosis
from steelyard.check.check import CheckResult
from steelyard.check.finding import Finding, Fix
from steelyard.check.findings_text_and_page import CheckContent
from steelyard.report.words import significant
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import (
    LogArgument,
    log_files,
    paths_of,
    refuse_overlaps,
)

FAR = 0.1  # from a stated zero to one that fits better, from which on it is told [rad; m]
QUESTIONS = {
    "targets": "Are targets and positions on one clock, in one order, unit and sign?",
    "motion": "Do all joints move, and long enough?",
    "signs": "Do positions count as the model file's joints do?",
    "joint zeros": "Where are the model file's joints when the log says zero?",
    "limits": "Is the motion within the limits of the joints?",
    "efforts": "Do logged efforts follow the controllers, with the gains that are stated?",
    "scale": "What gives stiffness and friction of each joint their scale?",
}


@checked(threads=1)
def check_targets(
    robot: str | Path,
    logs: str | Path | Iterable[str | Path],
    *,
    threads: int | None = None,
    progress: Progress = silent,
) -> CheckResult:
    """Check logs of position targets and positions.

    Args:
        robot: Robot file (TOML) with `target` under `[signals]`, and no efforts or `[actuator]`.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: The robot file cannot be used, or a log is given twice.

    Example:
        >>> found = check_targets("servo.toml", "servo_fit.csv")
        >>> found.last.severity.name
        'OK'
    """
    file = load_robot(robot)
    signals, files = signals_of_targets(file), log_files(paths_of(logs, least=1))
    refuse_overlaps(files, ())
    read, findings = list[TargetLog](), list[Finding]()
    for k, log in enumerate(files):
        report_progress(progress, "reading logs", k, len(files))
        try:
            read.append(read_targets(log, signals, file.robot))
            found = _read_well(read[-1], file.robot.joint_names)
        except LogError as error:
            found = Finding.wrong(f"{error.wrong} ({error.where})", fix=Fix(error.fix))
        findings.append(replace(found, log=log.text).by("targets"))
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


def _read_well(log: TargetLog, joints: Sequence[str]) -> Finding:
    """What a log that could be read holds, and joints whose positions are not of their targets."""
    rate = 1.0 / float(np.median(np.concatenate([np.diff(run.t) for run in log.runs])))
    others = unfollowed(log, joints)
    says = [f"{log.seconds:.0f} s at {rate:.3g} Hz", *log.notes]
    if others:
        says.insert(0, f"positions of {', '.join(others)} do not follow the targets")
    elif ahead := ahead_of_targets(log, joints):
        says.insert(0, f"positions of {', '.join(ahead)} come before their targets")
        others = ahead
    fix = Fix(
        "compare the columns of position and target; a servo that is off, or at its torque limit, "
        "does not follow"
    )
    return Finding.doubtful_if(bool(others), "; ".join(says), "", fix, others)


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
        f"no motion of {', '.join(still)}: nothing of it is identified"
        if still
        else f"all joints move, {seconds:.0f} s in all",
        "",
        Fix("add logs with slow motion in both directions, and fast motion, of every joint"),
        still,
    ).by("motion")
    _, values, open_signs, seen = started(job, windows)
    better, other = otherwise(job, windows, values) or (1.0, values)
    contradicted = _contradicted(job, values, other, seen, better)
    by_motion = f"motion fits {better:.2g} times better with"
    yield _signs(job, values, open_signs, seen, contradicted[0], by_motion).by("signs")
    zeros = other if contradicted[1] else values
    yield _zeros(job, zeros, open_signs, seen, contradicted[1], by_motion).by("joint zeros")
    q = np.concatenate([run.q for run in job.runs])
    outside = outside_limits(job.file.robot, values, q)
    past = outside_limits(job.file.robot, values, q, 0.0)
    listed = "; ".join(f"{joint} is at {where}" for joint, where in past.items())
    yield Finding.doubtful_if(
        bool(outside),
        listed or "the motion is within them, with these signs and zeros",
        "",
        Fix(
            "compare position_unit, position_sign and position_offset in the robot file with the "
            "log, and the limits with the arm"
        ),
        [*outside],
        answered=bool(outside) or not open_signs,
    ).by("limits")
    given = (job.step, windows, values, job.signals, moving, job.threads)
    efforts = logged_efforts(*given)
    if job.signals.effort:
        yield _efforts(job, efforts, moving, weighed(job, values)).by("efforts")
    yield _scale(job, values, moving, scales(efforts, job.signals)).by("scale")


def _contradicted(
    job: Job,
    values: ActuatorValues,
    other: ActuatorValues,
    seen: Sequence[int],
    better: float,
) -> tuple[list[int], list[int]]:
    """Joints whose stated sign, and whose stated zero, is another one in values that fit better.

    Of zeros those that are far off, or the one that is farthest.
    """
    s = job.signals
    if better <= AS_GOOD:
        return [], []
    turned = [j for j in seen if s.signs[j] is not None and other.signs[j] != values.signs[j]]
    off = np.abs(other["zero"] - values["zero"])
    stated = [j for j in seen if s.zeros[j] is not None and j not in turned]
    moved = [j for j in stated if off[j] > FAR]
    if not turned and not moved:
        moved = [max(stated, key=lambda j: off[j])] if stated else []
    return turned, moved


def _signs(
    job: Job,
    values: ActuatorValues,
    open_signs: Sequence[int],
    seen: Sequence[int],
    contradicted: Sequence[int],
    by_motion: str,
) -> Finding:
    """Which joints count against the model file's, and which the weight of links does not show."""
    names = job.file.robot.joint_names
    if contradicted:
        joints = [names[j] for j in contradicted]
        told = f"{by_motion} the other sign of {', '.join(joints)} than the stated one"
        remedy = Fix("compare position_sign in the robot file with the arm, or leave it out")
        return Finding.doubtful_if(True, told, "", remedy, joints)
    free = [j for j, sign in enumerate(job.signals.signs) if sign is None]
    unseen = [names[j] for j in free if j not in seen]
    turned = [names[j] for j in free if values.signs[j] < 0.0 and j not in open_signs]
    says = []
    if open_signs:
        says.append(f"not decided for {', '.join(names[j] for j in open_signs)}")
    if turned:
        says.append(f"positions of {', '.join(turned)} count against the model file's")
    if unseen:
        says.append(f"gravity does not show the sign of {', '.join(unseen)}: taken as the model's")
    if not free:
        return _as_stated(names, seen)
    if not open_signs and not unseen:
        return Finding.ok("; ".join(says) or "they do")
    fix = "state position_sign in the robot file: errors of the joints are the same, but not the "
    return Finding.ok("; ".join(says), fix=Fix(fix + "posture of the arm"), answered=False)


def _zeros(
    job: Job,
    values: ActuatorValues,
    open_signs: Sequence[int],
    seen: Sequence[int],
    contradicted: Sequence[int],
    by_motion: str,
) -> Finding:
    """Where joints are when the log says zero, as far as the weight of links shows it."""
    joints = job.file.robot.coordinates
    if contradicted:
        places = [
            f"{joints[j].name} at {values['zero'][j]:.2f} {joints[j].unit}" for j in contradicted
        ]
        fix = Fix("compare position_offset in the robot file with the arm, or leave it out")
        told = f"{by_motion} {', '.join(places)} where the log says zero, not as stated"
        return Finding.doubtful_if(True, told, "", fix, [joints[j].name for j in contradicted])
    unknown = [j for j, zero in enumerate(job.signals.zeros) if zero is None]
    found = [
        f"{joints[j].name} {values['zero'][j]:.3f} {joints[j].unit}" for j in unknown if j in seen
    ]
    hidden = [joints[j].name for j in unknown if j not in seen]
    says = [f"by slow motion and a first fit: {', '.join(found)}"] if found else []
    if hidden:
        says.append(f"gravity does not show the zero of {', '.join(hidden)}: taken as the model's")
    sure = not hidden and not open_signs and bool(found)
    if not unknown:
        return _as_stated([joint.name for joint in joints], seen)
    return Finding.ok("; ".join(says), answered=sure)


def _as_stated(names: Sequence[str], seen: Sequence[int]) -> Finding:
    """What all joints state, as far as gravity shows it."""
    hidden = [name for j, name in enumerate(names) if j not in seen]
    says = ["with others motion does not fit better"] if seen else []
    says += [f"gravity does not show {', '.join(hidden)}"] if hidden else []
    return Finding.ok(f"as stated: {'; '.join(says)}")


def _efforts(job: Job, efforts: Efforts, moving: Sequence[int], loaded: Sequence[int]) -> Finding:
    """Whether logged efforts follow the torques of the controllers, with the gains that are stated.

    Where the weight of links shows these torques, gains agree with the masses, too.
    """
    names, says, joints = job.file.robot.joint_names, list[str](), list[str]()
    for j in moving:
        one, gain, why = efforts.factors.get(j), job.signals.effort_gain[j], ""
        if j in efforts.others:
            why = f"follow the torque of {names[efforts.others[j]]}"
        elif one is None:
            why = "do not follow the torque of the controller"
        elif gain is not None and not agrees(gain, one):
            why = "count against the joint, with the gain that is stated"
        elif gain is not None and j in loaded and masses_differ(abs(gain * one.value)):
            unit = f"{job.file.robot.coordinates[j].effort_unit}/{job.signals.effort_units[j]}"
            by = f"about {significant(1.0 / one.value, 2)} {unit}"
            why = f"have the stated gain {gain:g}, and the masses of the model file ask for {by}"
        if why:
            says.append(f"those of {names[j]} {why}")
            joints.append(names[j])
    fix = Fix("compare columns, unit and gain under [signals.effort], and the masses, with the arm")
    good = ", ".join(f"{names[j]} {one.follows:.2f}" for j, one in efforts.factors.items())
    told = "; ".join(says) or f"they follow the torques of the controllers (correlation: {good})"
    return Finding.doubtful_if(bool(says), told, "", fix, joints)


def _scale(
    job: Job, values: ActuatorValues, moving: Sequence[int], measured: Collection[int]
) -> Finding:
    """What gives the torques of each joint a scale."""
    names = job.file.robot.joint_names
    loaded = weighed(job, values)
    sources = {
        "the stiffness that the robot file states": stated_stiffness(job),
        "the logged efforts": sorted(measured),
        "a torque that the robot file states": stated_torques(job),
        "the masses of the model file": loaded,
    }
    left, says = list(moving), list[str]()
    for source, joints in sources.items():
        mine = [j for j in left if j in joints]
        left = [j for j in left if j not in joints]
        if mine:
            says.append(f"{source} ({', '.join(names[j] for j in mine)})")
    if not says:
        return Finding.doubtful(
            "gravity hardly loads any joint, beside its friction: torques have no scale",
            fix=Fix(
                "compare position_sign, position_offset and the masses of the model file with the "
                "arm; or state stiffness in the robot file"
            ),
        )
    if not left:
        return Finding.ok("; ".join(says))
    without = ", ".join(names[j] for j in left)
    says.append(
        f"gravity hardly loads {without}: stiffness assumed like the others', unless `identify` "
        "finds it from the inertia of links"
    )
    fix = Fix("state their stiffness in the robot file, if it is known")
    return Finding.ok("; ".join(says), fix=fix, answered=False)
