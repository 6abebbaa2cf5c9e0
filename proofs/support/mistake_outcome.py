"""What the commands say of a job with a planted mistake, and how far the result is from the truth.

Two logs are fitted and one is validated through the functions of the commands. The true error is
that of the identified model against the hidden truth, on another motion and without noise.
"""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from proofs.support.mistakes import Arm, Job

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.base.progress import silent
from steelyard.check.all_checks import Diagnosis
from steelyard.check.case_from_files_and_precheck import Subject, case_of, diagnosis_of, subject_of
from steelyard.check.check import correct_robot_file
from steelyard.identify.identify import identify
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.validate import validate
from steelyard.identify.verdict_and_next_steps import verdict
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import LogArgument, log_files


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a job.

    Attributes:
        sentences: What a person reads, each with its place in front: `check wrong clock: ...`,
            `refusal: ...`, `headline good: ...`, `note: ...`, `validate poor: ...`.
        error: True error of the identified model [%]; `None` where `identify` refused.
        fix: True errors [%] of the models identified without and with the lines that `check --fix`
            wrote; `None` where it wrote none, or where `identify` refused all the same.
    """

    sentences: tuple[str, ...]
    error: float | None
    fix: tuple[float, float] | None = None
    changes: tuple[str, ...] = field(default=())

    @property
    def wrong(self) -> tuple[str, ...]:
        """What `check` calls wrong."""
        return tuple(line for line in self.sentences if line.startswith("check wrong"))


def diagnosed(subject: Subject, files: list[LogArgument]) -> Diagnosis:
    """What the check finds in logs."""
    case, unread = case_of(subject, files, None, silent)
    return diagnosis_of(case, unread, subject.text, quick=False)


def outcome_of(arm: Arm, job: Job, folder: Path, *, validated: bool = True) -> Outcome:
    """Everything that the commands say of a job.

    Args:
        arm: The arm as it really is.
        job: What the commands get.
        folder: To work in; it is made.
        validated: Whether `validate` is run too, beside `identify --validate`.
    """
    robot, logs = written(job, folder)
    try:
        files = log_files(logs)
        subject = subject_of(robot, files[0])
        diagnosis = diagnosed(subject, files)
    except SteelyardError as error:
        return Outcome((f"refusal: {error}",), None)
    lines = list(findings(diagnosis))
    content = identified(robot, logs, folder / "model")
    if isinstance(content, str):
        lines.append(f"refusal: {content}")
        error = None
    else:
        lines += sentences(content, "headline")
        error = true_error(arm, content, zeros(arm, job, robot))
        lines += validation(folder / "model", logs[-1]) if validated else []
    both, changes = (None, ())
    if diagnosis.edits:
        both, changes = fix_of(arm, job, (robot, logs), diagnosis, folder)
    return Outcome(tuple(lines), error, both, changes)


def written(job: Job, folder: Path) -> tuple[str, list[str]]:
    """The job's files: the robot, and the logs, the unseen one last."""
    folder.mkdir(parents=True)
    (folder / "demo_arm.urdf").write_text(job.urdf)
    robot = folder / ("demo_arm.toml" if job.robot_file else "demo_arm.urdf")
    if job.robot_file:
        robot.write_text(job.robot_file)
    named = {f"fit{k + 1}": log for k, log in enumerate(job.fitted)} | {"unseen": job.unseen}
    for name, log in named.items():
        log.write(folder / f"{name}.parquet", job.columns)
    return str(robot), [str(folder / f"{name}.parquet") for name in named]


def identified(
    robot: str, logs: list[str], folder: Path, *, check: bool = True
) -> ReportContent | str:
    """What `identify` reports, or its error's words."""
    try:
        found = identify(robot, logs[:-1], logs[-1:], threads=1, check=check)
        found.save(folder)
        return found.content
    except SteelyardError as error:
        return str(error)


def validation(model: Path, log: str) -> list[str]:
    """What `validate` says of a log."""
    try:
        return sentences(validate(model, log).content, "validate")
    except SteelyardError as error:
        return [f"validate refusal: {error}"]


def findings(diagnosis: Diagnosis) -> list[str]:
    """What `check` says that is not ok, or that it leaves open."""
    return [
        f"check {f.severity.word if f.severity else 'open'} {f.check}: {f.log}: "
        f"{', '.join(f.joints)}: {f.says} ({f.figure}) {'' if f.fix is None else f.fix.says}"
        for f in sorted(diagnosis.findings, key=lambda f: -f.severity)
        if f.severity or not f.answered
    ]


def sentences(content: ReportContent, place: str) -> list[str]:
    """What a report says beside its tables and its settings."""
    judged = verdict(content)
    lines = [f"{place} {judged.level}: {judged.headline}. {judged.detail}"]
    lines += [f"{place} {one.level}: {one.text}" for one in judged.limitations]
    notes = [note for note in content.notes if not re.search("^cut-offs:|processing: ", note)]
    return lines + [f"note: {note}" for note in notes]


def zeros(arm: Arm, job: Job, robot: str) -> Array:
    """Positions of the model file's joints where the arm's own are zero, shape `(n,)` [rad].

    Logs with moved zeros are led back to the arm's own by `position_offset`; in a model file whose
    axes were turned it leads to the joints of that file.
    """
    if job.urdf == arm.urdf or not job.robot_file:
        return np.zeros(arm.robot.n)
    offset = load_robot(robot).signals.position_offset
    return np.zeros(arm.robot.n) if offset is None else offset


def true_error(arm: Arm, content: ReportContent, zero: Array) -> float:
    """Mean over joints of the identified model's relative error against the truth [%].

    Args:
        arm: The arm as it really is.
        content: With the identified model.
        zero: Positions of the model's joints where the arm's are zero, shape `(n,)` [rad].
    """
    if content.identified is None:
        raise ValueError("nothing was identified")
    valued = content.identified.valued
    motion = arm.motion(7)
    truth = arm.torque(motion)
    predicted = valued.torque(replace(motion, q=motion.q + zero))
    error = np.linalg.norm(predicted - truth, axis=0) / np.linalg.norm(truth, axis=0)
    return 100.0 * float(np.mean(error))


def fix_of(
    arm: Arm, job: Job, files: tuple[str, list[str]], diagnosis: Diagnosis, folder: Path
) -> tuple[tuple[float, float] | None, tuple[str, ...]]:
    """True errors without and with what `check --fix` writes, and what it writes."""
    robot, logs = files
    every = log_files(logs)
    subject, target = subject_of(robot, every[0]), folder / "fixed.toml"
    try:
        corrected = correct_robot_file(
            subject, target, diagnosis, lambda new: diagnosed(new, every)
        )
    except SteelyardError as error:
        return None, (str(error),)
    if not corrected.changes:
        return None, ()
    target.write_text(corrected.subject.text)
    changes = tuple(change.line for change in corrected.changes)
    after = identified(str(target), logs, folder / "with")
    before = identified(robot, logs, folder / "without", check=False)
    if isinstance(after, str):
        return None, changes
    unfixed = np.inf if isinstance(before, str) else true_error(arm, before, zeros(arm, job, robot))
    return (unfixed, true_error(arm, after, zeros(arm, job, str(target)))), changes
