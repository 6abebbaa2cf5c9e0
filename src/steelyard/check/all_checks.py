"""All checks in their order, and the diagnosis of a case by them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from steelyard.base.progress import report_progress
from steelyard.check.case_logs_and_checks import Case, CaseCheck
from steelyard.check.decision.friction_between_logs import friction_drift_check
from steelyard.check.decision.gear_signs_and_couplings import transmission_check
from steelyard.check.decision.hypothesis_checks import (
    EFFORT_DELAY,
    GAIN,
    JOINT_ORDER,
    JOINT_ZEROS,
    MOUNTING,
    OF_COLUMNS,
    PAYLOAD,
    HypothesisCheck,
)
from steelyard.check.decision.joint_zeros_and_quarter_turns import joint_zeros_check
from steelyard.check.edits_that_serve_all_logs import edits_that_serve_all_logs
from steelyard.check.finding import Edit, Finding, Severity
from steelyard.check.fitted.gear_side_and_rotors import gear_side_check
from steelyard.check.identifiability_check import identifiability_check
from steelyard.check.signals.computed_efforts_and_set_points import (
    computed_efforts_check,
    measured_instead,
    set_points_check,
)
from steelyard.check.signals.corrupt_and_repeated_rows import (
    corrupt_rows_check,
    repeated_rows_check,
)
from steelyard.check.signals.movement_rests_and_moving_base import (
    excitation_check,
    moving_base_check,
    rests_check,
)
from steelyard.check.signals.noise_saturation_and_signs import (
    noise_check,
    saturation_check,
    signed_efforts_check,
)
from steelyard.check.signals.position_unit_and_columns import position_check
from steelyard.check.signals.time_stamps_and_scale import clock_check, out_of_order
from steelyard.check.signals.velocity_check import velocity_check

Check = CaseCheck[Case] | HypothesisCheck  # has a name, a question, `quick`, and gives findings
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
    *OF_COLUMNS,
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
BASIC_CHECKS = (*OF_COLUMNS, MOUNTING, transmission_check)
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
OTHER_CHECKS_NAME = "other checks"  # all checks but that of the clock, where they are not made
ORDER_FIRST = "not run: the rows must be in the order of time"
PREMISE_CHECKS = (clock_check.name, position_check.name)  # without them accelerations are unknown
NOT_RUN = "the checks that compare efforts with a model are not run: correct the {} first"
CORRECTED_BY_FIX = ", or --fix corrects it and checks again"  # by a line of the file


def examine(case: Case, *, quick: bool = False, checks: Sequence[Check] | None = None) -> Diagnosis:
    """Ask checks, all or quick ones; where clock, positions or efforts are wrong no `OF_MOTION`."""
    selected = [s for s in (CHECKS if checks is None else checks) if s.quick or not quick]
    selected.sort(key=lambda check: (check in OF_MOTION, check is not clock_check))
    findings: list[Finding] = []
    motion = False
    for number, check in enumerate(selected):
        if check in OF_MOTION and not motion:
            motion = True
            case, found = _without(case, MOTION_CHECKS_NAME, _not_run(case, findings))
            findings += found
        if not case.logs:
            break
        report_progress(case.progress, f"checking: {check.name}", number, len(selected))
        findings += check(case)
        if check is clock_check:
            disordered = {log.name: ORDER_FIRST for log in case.logs if out_of_order(log)}
            case, found = _without(case, OTHER_CHECKS_NAME, disordered)
            findings += found
    return Diagnosis(edits_that_serve_all_logs(findings))


def _without(case: Case, check: str, reasons: Mapping[str, str]) -> tuple[Case, list[Finding]]:
    """The case without some logs, and an open finding for each of them."""
    left = tuple(log for log in case.logs if log.name not in reasons)
    found = [Finding.ok(says, answered=False, log=log).by(check) for log, says in reasons.items()]
    return (replace(case, logs=left) if reasons else case), found


def _not_run(case: Case, findings: Sequence[Finding]) -> dict[str, str]:
    """Why checks are not made, for every log whose clock, positions or efforts are others."""
    wrong = [f for f in findings if f.check in PREMISE_CHECKS and f.severity == Severity.WRONG]
    targets = [f for f in findings if f.check == set_points_check.name and f.severity]
    reasons = {}
    for log in case.logs:
        mine = [f for f in wrong if f.log in ("", log.name)]
        if measured_instead(log):
            mine += [f for f in targets if f.log == log.name]
        if mine:
            edits = all(f.fix is not None and f.fix.edits for f in mine)
            names = " and the ".join(dict.fromkeys(f.check for f in mine))
            reasons[log.name] = NOT_RUN.format(names) + CORRECTED_BY_FIX * edits
    return reasons
