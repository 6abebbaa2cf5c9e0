"""All checks in the order in which they are run and shown, put to a case."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from steelyard.base.progress import report_progress
from steelyard.check.case import Case, CaseCheck
from steelyard.check.decision.checks import (
    EFFORT_DELAY,
    EFFORT_KIND,
    EFFORT_SIGN,
    EFFORT_UNIT,
    GAIN,
    JOINT_ORDER,
    JOINT_ZEROS,
    MOUNTING,
    PAYLOAD,
    POSITION_SIGN,
    HypothesisCheck,
)
from steelyard.check.decision.joint_zeros import joint_zeros_check
from steelyard.check.decision.transmission import transmission_check
from steelyard.check.finding import Edit, Finding, Severity
from steelyard.check.fitted.gear_side import gear_side_check
from steelyard.check.identifiability import identifiability_check
from steelyard.check.several_logs import edits_that_serve_all_logs, friction_drift_check
from steelyard.check.signals.measured import (
    computed_efforts_check,
    measured_instead,
    set_points_check,
)
from steelyard.check.signals.movement import excitation_check, moving_base_check, rests_check
from steelyard.check.signals.position import position_check
from steelyard.check.signals.rows import corrupt_rows_check, repeated_rows_check
from steelyard.check.signals.sensor_limits import (
    noise_check,
    saturation_check,
    signed_efforts_check,
)
from steelyard.check.signals.time_stamps import clock_check, out_of_order
from steelyard.check.signals.velocity import velocity_check

Check = CaseCheck | HypothesisCheck
"""What has a name, a question, says whether it is quick, and gives findings on a case."""

OF_SIGNALS: tuple[Check, ...] = (
    clock_check,
    corrupt_rows_check,
    repeated_rows_check,
    noise_check,
    set_points_check,
    computed_efforts_check,
    saturation_check,
    signed_efforts_check,
    rests_check,
    excitation_check,
    position_check,
    velocity_check,
)
"""Checks of the signals by themselves; those that differentiate know the unit of time."""

OF_MOTION: tuple[Check, ...] = (
    JOINT_ORDER,
    POSITION_SIGN,
    EFFORT_SIGN,
    EFFORT_UNIT,
    EFFORT_KIND,
    transmission_check,
    gear_side_check,
    GAIN,
    EFFORT_DELAY,
    JOINT_ZEROS,
    joint_zeros_check,
    MOUNTING,
    moving_base_check,
    PAYLOAD,
    friction_drift_check,
    identifiability_check,
)
"""Checks that compare efforts with a model: by velocities and accelerations, in true seconds."""

CHECKS = (*OF_SIGNALS, *OF_MOTION)

BASIC_CHECKS = (JOINT_ORDER, POSITION_SIGN, EFFORT_SIGN, EFFORT_UNIT, EFFORT_KIND, MOUNTING)
"""Checks without whose answers nobody knows whether the robot file describes the log."""

SEVERAL_OPEN = 3  # basic questions from which on a large misfit that leaves them open is doubtful

DECIDING_CHECKS = (JOINT_ORDER.name, transmission_check.name, GAIN.name, PAYLOAD.name)
"""Checks of facts that decide which model is identified; `SEVERAL_OPEN` open: no log is ok."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found."""

    findings: tuple[Finding, ...]  # in the order of the checks, then of the logs

    @property
    def severity(self) -> Severity:
        """The worst of all; doubtful where no finding is, but the check is inconclusive."""
        worst = max((f.severity for f in self.findings), default=Severity.OK)
        return Severity.DOUBTFUL if self.inconclusive else worst

    @property
    def open_checks(self) -> tuple[str, ...]:
        """The checks that could not be answered, on one log at least."""
        return tuple(dict.fromkeys(f.check for f in self.findings if not f.answered))

    @property
    def inconclusive(self) -> bool:
        """Whether nothing is suspicious, but a large misfit leaves several basic checks open."""
        names = {check.name for check in BASIC_CHECKS}
        hidden = {f.check for f in self.findings if f.hidden}
        return len(names & hidden) >= SEVERAL_OPEN and not any(f.severity for f in self.findings)

    @property
    def model_open(self) -> bool:
        """Whether nothing is suspicious, but several facts that decide the model are open."""
        return (
            len(set(DECIDING_CHECKS) & set(self.open_checks)) >= SEVERAL_OPEN and not self.severity
        )

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What would correct the robot file, each key once.

        Of findings that are wrong; only if there are none, of doubtful ones: these may well come
        from what is wrong, and are looked at again once it is corrected.
        """
        chosen: dict[tuple[str, ...], Edit] = {}
        for finding in self.findings:
            if finding.severity == self.severity != Severity.OK and finding.fix is not None:
                for edit in finding.fix.edits:
                    chosen.setdefault(edit.path, edit)
        return tuple(chosen.values())


MOTION_CHECKS_NAME = "efforts"  # the checks of `OF_MOTION` together, where they are not made
OTHER_CHECKS_NAME = "other checks"
"""All checks but that of the clock together, where they are not made."""
ORDER_FIRST = "not run: the rows must be in the order of time"
PREMISE_CHECKS = (clock_check.name, position_check.name)
"""Checks without which accelerations are unknown: where one is wrong, `OF_MOTION` is not asked."""
NOT_RUN = "the checks that compare efforts with a model are not run: correct the {} first"
CORRECTED_BY_FIX = ", or --fix corrects it and checks again"
"""How that is done where a line of the robot file corrects what is wrong."""


def examine(case: Case, *, quick: bool = False, checks: Sequence[Check] | None = None) -> Diagnosis:
    """Ask every check; where clock, positions or the choice of efforts are wrong, no `OF_MOTION`.

    Args:
        case: Robot, logs and what is known beforehand.
        quick: Whether to ask the quick ones only.
        checks: Which to ask; all that are registered if `None`.

    Raises:
        Stopped: The case's `progress` requested a stop.
    """
    selected = [s for s in (CHECKS if checks is None else checks) if s.quick or not quick]
    clock = [check for check in selected if check is clock_check]
    first = [check for check in selected if check not in OF_MOTION and check not in clock]
    rest = [check for check in selected if check in OF_MOTION]
    findings = _asked(case, clock, 0, len(selected))
    if clock:
        case, disordered = _in_order(case)
        findings += disordered
        if not case.logs:
            return Diagnosis(edits_that_serve_all_logs(findings))
    findings += _asked(case, first, len(clock), len(selected))
    skipped = list(_not_run(case, findings)) if rest else []
    if skipped:
        names = {finding.log for finding in skipped}
        case = replace(case, logs=tuple(e for e in case.logs if e.name not in names))
    findings += skipped
    if case.logs:
        findings += _asked(case, rest, len(clock) + len(first), len(selected))
    return Diagnosis(edits_that_serve_all_logs(findings))


def _in_order(case: Case) -> tuple[Case, list[Finding]]:
    """The case without logs whose rows are not in the order of time, and a finding for each."""
    left = tuple(evidence for evidence in case.logs if not out_of_order(case, evidence))
    names = [evidence.name for evidence in case.logs if evidence not in left]
    found = [
        Finding(OTHER_CHECKS_NAME, n, Severity.OK, ORDER_FIRST, "", answered=False) for n in names
    ]
    return (replace(case, logs=left) if names else case), found


def _asked(case: Case, checks: Sequence[Check], done: int, of: int) -> list[Finding]:
    """What some checks find, of which others were made before."""
    findings: list[Finding] = []
    for number, check in enumerate(checks, done):
        report_progress(case.progress, f"checking: {check.name}", number, of)
        findings += check(case)
    return findings


def _not_run(case: Case, findings: Sequence[Finding]) -> Iterator[Finding]:
    """That checks are not made, for every log whose clock, positions or efforts are others."""
    wrong = [f for f in findings if f.check in PREMISE_CHECKS and f.severity == Severity.WRONG]
    targets = [f for f in findings if f.check == set_points_check.name and f.severity]
    for evidence in case.logs:
        mine = [f for f in wrong if f.log in ("", evidence.name)]
        if measured_instead(evidence):
            mine += [f for f in targets if f.log == evidence.name]
        if mine:
            edits = all(f.fix is not None and f.fix.edits for f in mine)
            names = " and the ".join(dict.fromkeys(f.check for f in mine))
            says = NOT_RUN.format(names) + CORRECTED_BY_FIX * edits
            yield Finding(MOTION_CHECKS_NAME, evidence.name, Severity.OK, says, "", answered=False)
