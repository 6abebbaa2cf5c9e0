"""All checks in their order, the diagnosis of a case by them, and the edits that serve all logs."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from steelyard.base.progress import report_progress
from steelyard.check.cases_and_checks import Case, CaseCheck
from steelyard.check.decision import gears_and_friction_of_logs, hypothesis_checks
from steelyard.check.decision.joint_zeros_and_quarter_turns import joint_zeros_check
from steelyard.check.decision.places_and_bias_beside_bodies import (
    accelerometer_bias_check,
    contact_places_check,
)
from steelyard.check.decision.slipping_feet import slipping_feet_check
from steelyard.check.decision.small_errors_beside_free_bodies import sensor_place_check
from steelyard.check.decision.unmeasured_contacts import unmeasured_contacts_check
from steelyard.check.finding import MOST_NAMED, WRITTEN_DIGITS, Edit, Finding, Severity
from steelyard.check.fitted import implausible_estimates_and_gear_side
from steelyard.check.signals import (
    corrupt_and_repeated_rows,
    measured_signals,
    movement_rests_and_moving_base,
)
from steelyard.check.signals.position_unit_and_columns import position_check
from steelyard.check.signals.sensors_of_floating_base import base_sensors_check
from steelyard.check.signals.time_stamps_and_scale import clock_check, out_of_order
from steelyard.check.signals.velocity_check import velocity_check
from steelyard.report.words import first_names

DIFFERENT_FACTORS = 3.0  # standard deviations by which factors of two logs differ if not one number
SAME_NUMBERS = 0.1  # difference of numbers without an accuracy up to which they are one, relative

Path = tuple[str, ...]


def edits_that_serve_all_logs(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of all checks with those edits that every log asks for.

    A log in which nothing moves has no say in edits of checks of motion. Numbers become their
    median; those that differ by more than their accuracy are doubtful, and none is written. Edits
    that were tried on a log as one change stay together or go.
    """
    of_motion = {check.name for check in (*OF_MOTION, *OF_FLOATING_BASE)}
    at_rest = movement_rests_and_moving_base.excitation_check.name, Severity.WRONG
    logs = dict.fromkeys(f.log for f in findings if f.log)
    resting = {f.log for f in findings if (f.check, f.severity) == at_rest}
    of_signals = set[Path]()  # paths that checks of the signals alone ask for
    wanted: dict[Path, dict[str, Edit]] = {}
    groups: dict[tuple[str, int], set[Path]] = {}
    for number, f in enumerate(findings):
        if f.log and f.fix is not None and f.fix.edits:
            group = groups.setdefault((f.log, -1 if f.fix.jointly else number), set())
            for edit in f.fix.edits:
                if f.check not in of_motion:
                    of_signals.add(edit.path)
                wanted.setdefault(edit.path, {})[f.log] = edit
                group.add(edit.path)
    apart = {path: why for path, edits in wanted.items() if (why := _unlike(edits))}
    silent = {
        path: [
            log for log in logs if log not in edits and (log not in resting or path in of_signals)
        ]
        for path, edits in wanted.items()
    }
    untested = {f.log for f in findings if f.check == MOTION_CHECKS_NAME and not f.answered}
    of_own = {path: set(logs) if path in of_signals else set[str]() for path in wanted}
    refused = {
        path: apart.get(path) or _asked_by_some(edits, silent[path], untested - of_own[path])
        for path, edits in wanted.items()
        if path in apart or silent[path]
    }
    for _ in groups:  # what was tried together with something that is refused
        for paths in groups.values():
            if why := next((refused[path] for path in paths if path in refused), ""):
                refused |= {path: why for path in paths if path not in refused}
    return tuple(_shared(f, wanted, refused, apart) for f in findings)


def _shared(
    f: Finding,
    wanted: Mapping[Path, Mapping[str, Edit]],
    refused: Mapping[Path, str],
    apart: Mapping[Path, str],
) -> Finding:
    """A finding with the edits that all logs share, or with why there are none."""
    if not f.log or f.fix is None or not f.fix.edits:
        return f
    paths = [edit.path for edit in f.fix.edits]
    if why := next((refused[path] for path in paths if path in refused), ""):
        doubtful = any(path in apart for path in paths)
        fix = replace(f.fix, says=f"{f.fix.says}; {why}", edits=())
        return replace(f, fix=fix, severity=Severity.DOUBTFUL if doubtful else f.severity)
    edits = (
        replace(edit, value=_middle([one.value for one in wanted[edit.path].values()]))
        for edit in f.fix.edits
    )
    return replace(f, fix=replace(f.fix, edits=tuple(edits)))


def _asked_by_some(edits: Mapping[str, Edit], others: Sequence[str], untested: Set[str]) -> str:
    """Why no line is written that some logs ask for and others do not, or are not tested for."""
    path = next(iter(edits.values())).path
    key, its = ".".join(path), "its" if len(edits) == 1 else "their"
    if left := [log for log in others if log in untested]:
        return (
            f"{first_names(left, MOST_NAMED)} cannot be tested for {key} before what is wrong "
            "there is corrected: no line is written yet"
        )
    convert = f", or convert {its} columns" if path[0] == "signals" else ""
    return (
        f"{first_names(others, MOST_NAMED)} {'does' if len(others) == 1 else 'do'} not require "
        f"another {key}: no line is written; give {first_names([*edits], MOST_NAMED)} a robot file "
        f"of {its} own{convert}"
    )


def _unlike(edits: Mapping[str, Edit]) -> str:
    """The values of several logs that are not one; empty if they may be."""
    if not any(_differ(a, b) for a, b in combinations(edits.values(), 2)):
        return ""
    values = [
        str(e.value).replace("'", '"')
        + (f" ± {200.0 * e.spread:.2g} %" if e.spread > 0.0 else "")
        + f" ({log})"
        for log, e in edits.items()
    ]
    listed = first_names(values, MOST_NAMED)
    accuracy = "; 95 %" * any(e.spread > 0.0 for e in edits.values())
    key = next(iter(edits.values())).path[-1]
    return f"the logs require different values ({key}: {listed}{accuracy}): none is written"


def _differ(a: Edit, b: Edit) -> bool:
    if a.value == b.value:
        return False
    first, second = (np.atleast_1d(np.array(e.value)) for e in (a, b))
    if first.shape != second.shape or {first.dtype.kind, second.dtype.kind} != {"f"}:
        return True
    if not (a.spread > 0.0 and b.spread > 0.0):
        size = float(np.max(np.abs([first, second])))
        return bool(np.any(np.abs(first - second) > SAME_NUMBERS * size))
    if np.any(first * second <= 0.0):
        return True
    far = float(np.max(np.abs(np.log(first / second))))
    accuracy = DIFFERENT_FACTORS * float(np.hypot(a.spread, b.spread))
    return far > accuracy + 2.0 * 10.0**-WRITTEN_DIGITS


def _middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or of lists of as many numbers; what all are, of anything else."""
    first = values[0]
    if all(value == first for value in values):
        return first
    middle = np.atleast_1d(np.median(np.array(values), axis=0))
    rounded = [float(f"{x:.{WRITTEN_DIGITS}g}") for x in middle]
    return rounded if isinstance(first, list) else rounded[0]


Check = CaseCheck[Case] | hypothesis_checks.HypothesisCheck
"""Has a name, a question, `quick`, and gives findings."""
OF_SIGNALS: tuple[Check, ...] = (
    clock_check,
    corrupt_and_repeated_rows.corrupt_rows_check,
    corrupt_and_repeated_rows.repeated_rows_check,
    measured_signals.noise_check,
    measured_signals.set_points_check,
    measured_signals.computed_efforts_check,
    measured_signals.saturation_check,
    measured_signals.signed_efforts_check,
    movement_rests_and_moving_base.rests_check,
    movement_rests_and_moving_base.excitation_check,
    position_check,
    velocity_check,
)
"""Checks of the signals by themselves; those that differentiate know the unit of time."""
OF_MOTION: tuple[Check, ...] = (
    *hypothesis_checks.OF_COLUMNS,
    gears_and_friction_of_logs.transmission_check,
    implausible_estimates_and_gear_side.gear_side_check,
    hypothesis_checks.GAIN,
    hypothesis_checks.EFFORT_DELAY,
    hypothesis_checks.JOINT_ZEROS,
    joint_zeros_check,
    hypothesis_checks.MOUNTING,
    movement_rests_and_moving_base.moving_base_check,
    hypothesis_checks.PAYLOAD,
    gears_and_friction_of_logs.friction_drift_check,
    implausible_estimates_and_gear_side.identifiability_check,
)
"""Checks that compare efforts with a model: by velocities and accelerations, in true seconds."""
OF_FLOATING_BASE: tuple[Check, ...] = (
    hypothesis_checks.SENSOR_MOUNTING_CHECK,
    hypothesis_checks.SENSOR_DELAY_CHECK,
    hypothesis_checks.CONTACTS_CHECK,
    sensor_place_check,
    contact_places_check,
    accelerometer_bias_check,
    unmeasured_contacts_check,
    slipping_feet_check,
)
"""Checks of the sensors and contacts of a floating base, by the same evidence."""
OF_UNKNOWN_FORCES: tuple[Check, ...] = (contact_places_check, accelerometer_bias_check)
"""Those of them that need no measured forces of contacts."""
OF_FIXED_BASE: tuple[Check, ...] = (
    joint_zeros_check,
    hypothesis_checks.JOINT_ZEROS,
    hypothesis_checks.MOUNTING,
    movement_rests_and_moving_base.moving_base_check,
    hypothesis_checks.PAYLOAD,
)
"""Checks that suppose a base at rest, or one limb."""
CHECKS = (*OF_SIGNALS, *OF_MOTION)


def checks_of(floating: bool) -> tuple[Check, ...]:
    """All checks of a robot whose base is at rest, or floats."""
    if not floating:
        return CHECKS
    by_model = (check for check in OF_MOTION if check not in OF_FIXED_BASE)
    return (*OF_SIGNALS, base_sensors_check, *by_model, *OF_FLOATING_BASE)


BASIC_CHECKS = (
    *hypothesis_checks.OF_COLUMNS,
    hypothesis_checks.MOUNTING,
    hypothesis_checks.SENSOR_MOUNTING_CHECK,
    hypothesis_checks.CONTACTS_CHECK,
    gears_and_friction_of_logs.transmission_check,
)
"""Checks without whose answers nobody knows whether the robot file describes the log."""
SEVERAL_OPEN = 3  # basic questions from which on a large misfit that leaves them open is doubtful
DECIDING_CHECKS = (
    hypothesis_checks.JOINT_ORDER.name,
    gears_and_friction_of_logs.transmission_check.name,
    hypothesis_checks.GAIN.name,
    hypothesis_checks.PAYLOAD.name,
)
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
PREMISE_CHECKS = (
    clock_check.name,
    position_check.name,
    base_sensors_check.name,
)  # without them accelerations are unknown
NOT_RUN = "the checks that compare efforts with a model are not run: correct the {} first"
CORRECTED_BY_FIX = ", or --fix corrects it and checks again"  # by a line of the file


UNKNOWN_FORCES = (
    "forces of contacts are not measured, so that no model says what its efforts should be: order, "
    "signs, units, gains and mounting are not compared with other ones"
)


def examine(case: Case, *, quick: bool = False, checks: Sequence[Check] | None = None) -> Diagnosis:
    """Ask checks, all or quick ones; where clock, positions or efforts are wrong no `OF_MOTION`."""
    every = checks_of(case.loaded.robot.floating) if checks is None else checks
    selected = [s for s in every if s.quick or not quick]
    case = replace(case, quick=quick)
    by_model = (*OF_MOTION, *OF_FLOATING_BASE)
    selected.sort(key=lambda check: (check in by_model, check is not clock_check))
    findings: list[Finding] = []
    motion, measured = False, case
    for number, check in enumerate(selected):
        if check in by_model and not motion:
            motion = True
            case, found = _without(case, MOTION_CHECKS_NAME, _not_run(case, findings))
            findings += found
            measured, found = _without(case, MOTION_CHECKS_NAME, _of_unknown_forces(case))
            findings += found
        asked = measured if check in by_model and check not in OF_UNKNOWN_FORCES else case
        if not asked.logs:
            continue
        report_progress(case.progress, f"checking: {check.name}", number, len(selected))
        findings += check(asked)
        if check is clock_check:
            disordered = {log.name: ORDER_FIRST for log in case.logs if out_of_order(log)}
            case, found = _without(case, OTHER_CHECKS_NAME, disordered)
            findings += found
    return Diagnosis(edits_that_serve_all_logs(findings))


def _without(case: Case, check: str, reasons: Mapping[str, str]) -> tuple[Case, list[Finding]]:
    """The case without some logs, and an open finding for each of them."""
    left = tuple(log for log in case.logs if log.name not in reasons)
    found = [
        Finding.ok(says, answered=False, log=log, headline=says == UNKNOWN_FORCES).by(check)
        for log, says in reasons.items()
    ]
    return (replace(case, logs=left) if reasons else case), found


def _not_run(case: Case, findings: Sequence[Finding]) -> dict[str, str]:
    """Why checks are not made, for every log whose clock, positions or efforts are others."""
    wrong = [f for f in findings if f.check in PREMISE_CHECKS and f.severity == Severity.WRONG]
    targets = [
        f for f in findings if f.check == measured_signals.set_points_check.name and f.severity
    ]
    reasons = {}
    for log in case.logs:
        mine = [f for f in wrong if f.log in ("", log.name)]
        if measured_signals.measured_instead(log):
            mine += [f for f in targets if f.log == log.name]
        if mine:
            edits = all(f.fix is not None and f.fix.edits for f in mine)
            names = " and the ".join(dict.fromkeys(f.check for f in mine))
            reasons[log.name] = NOT_RUN.format(names) + CORRECTED_BY_FIX * edits
    return reasons


def _of_unknown_forces(case: Case) -> dict[str, str]:
    """Logs with contacts whose forces are not measured, and what that means."""
    bases = {log.name: log.recording.signals.base for log in case.logs}
    return {name: UNKNOWN_FORCES for name, base in bases.items() if base and base.touches}
