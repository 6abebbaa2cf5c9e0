"""Many logs, each checked alone by a worker, and one diagnosis of all: `check --cluster`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.base.workers import each
from steelyard.check.all_checks import Diagnosis, edits_that_serve_all_logs
from steelyard.check.case_from_files_and_precheck import (
    READING_CHECK,
    Subject,
    case_of,
    diagnosis_of,
    subject_of,
)
from steelyard.check.finding import Finding, Fix
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.logs.files_and_urls import on_disk
from steelyard.logs.log_parts import LogPart
from steelyard.runs.runs_of_named_logs import log_files, names_of_parts


@dataclass(frozen=True, eq=False)
class CheckWork:
    """What all logs are checked with."""

    subject: Subject
    reference: IdentifiedModel | None
    quick: bool


def checked_log(common: CheckWork, part: LogPart) -> tuple[Finding, ...]:
    """What is found in one log, or why it cannot be read."""
    try:
        with on_disk(part.file.url) as path:
            case, unread = case_of(common.subject, log_files([str(path)]), common.reference, silent)
            return diagnosis_of(case, unread, common.subject.text, quick=common.quick).findings
    except SteelyardError as error:
        finding = Finding.wrong(error.wrong, part.where, fix=Fix(error.fix))
        return (finding.by(READING_CHECK),)


def subject_by_first_log(robot: str, parts: Sequence[LogPart], fixed_base: str | None) -> Subject:
    """The robot file; where it assigns no columns, by the first log that can be read."""
    refused = None
    for part in parts:
        try:
            with on_disk(part.file.url) as path:
                return subject_of(robot, log_files([str(path)])[0], fixed_base)
        except LogError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def diagnosis_by_workers(
    work: CheckWork, parts: Sequence[LogPart], cluster: str, progress: Progress
) -> Diagnosis:
    """What is found in all logs, with those edits of the robot file that every log asks for."""
    found: dict[int, tuple[Finding, ...]] = {}
    report_progress(progress, "checking logs", 0, len(parts))
    for number, findings in each(checked_log, work, parts, cluster, 1):
        found[number] = findings
        words = f"{len(found)} of {len(parts)}"
        report_progress(progress, "checking logs", len(found), len(parts), words)
    named = (
        replace(finding, log=name)
        for number, name in enumerate(names_of_parts(parts))
        for finding in found[number]
    )
    order = dict.fromkeys(finding.check for number in sorted(found) for finding in found[number])
    places = {check: place for place, check in enumerate(order)}
    every = sorted(named, key=lambda finding: places[finding.check])
    unread = [finding for finding in every if finding.check == READING_CHECK]
    read = [finding for finding in every if finding.check != READING_CHECK]
    return Diagnosis((*unread, *edits_that_serve_all_logs(read)))
