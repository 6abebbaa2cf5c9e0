"""Several logs of one robot: edits that contradict each other, and friction that differs."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from numbers import Real
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.case import Case, Evidence, case_check
from steelyard.check.decision.verdict import judge_log
from steelyard.check.finding import Edit, Finding, Fix, Picture, Severity, Trace
from steelyard.check.hypotheses.likelihood import Likelihood
from steelyard.check.hypotheses.nuisance import LEAST_SAMPLE_COUNT

SHARED_DIGITS = 4
DIFFERENT_FACTORS = 3.0
"""Standard deviations by which factors of two logs differ if they are not one number."""
OTHER_LOGS_AGREE = (
    "the other logs agree with the robot file as it is: give this one a robot file of its own"
)


def edits_that_serve_all_logs(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of all checks with corrects that serve all logs.

    A log that is wrong while others are fine has no line in a robot file they share. Numbers that
    several logs suggest become their median; fitted factors that differ by more than their accuracy
    are doubtful, and none is written. Edits that were tried as one change stay together or go.
    """
    names = dict.fromkeys(f.check for f in findings)
    of = {name: [f for f in findings if f.check == name] for name in names}
    unlike = {name: _unlike(found) for name, found in of.items()}
    against = {name: _against(found, findings) for name, found in of.items()}
    shared = [_shared(f, of[f.check], against[f.check], unlike[f.check]) for f in findings]
    reasons: dict[str, str] = {}
    for f in shared:
        if f.fix is not None and f.fix.jointly and not f.fix.edits:
            reasons.setdefault(f.log, unlike[f.check] or against[f.check])
    return tuple(
        replace(f, fix=_without(f.fix, reasons[f.log]))
        if f.fix is not None and f.fix.jointly and f.fix.edits and f.log in reasons
        else f
        for f in shared
    )


def _against(found: Sequence[Finding], findings: Sequence[Finding]) -> str:
    """Why the other logs speak against what one suggests; empty if none does.

    A log with which nothing else is wrong agrees with the robot file as it is.
    """
    fine = [f.log for f in found if f.severity == Severity.OK and f.answered and f.log]
    others = {log: [f.check for f in findings if f.severity and f.log == log] for log in fine}
    if not fine or not all(others.values()):
        return OTHER_LOGS_AGREE if fine else ""
    listed = "; ".join(f"{log}: {', '.join(dict.fromkeys(x))}" for log, x in others.items())
    return (
        f"the other logs do not show this, but something else was found on them ({listed}): "
        "resolve that first, or give this log a robot file of its own"
    )


def _unlike(found: Sequence[Finding]) -> str:
    """The fitted factors of several logs that are not one number; empty if they may be."""
    edits = [
        (f.log, edit)
        for f in found
        for edit in (f.fix.edits if f.fix else ())
        if edit.spread > 0.0 and f.log
    ]
    for (_, a), (_, b) in combinations(edits, 2):
        if a.path == b.path and _differ(a, b):
            listed = ", ".join(
                f"{_shown(e.value)} ± {200.0 * e.spread:.2g} % ({log})"
                for log, e in edits
                if e.path == a.path
            )
            return (
                f"the logs require different factors ({a.path[-1]}: {listed}; 95 %): "
                "another difference between the logs explains them; no factor is written"
            )
    return ""


def _differ(a: Edit, b: Edit) -> bool:
    """Whether two edits' numbers are farther apart than their accuracy."""
    first, second = (np.array(e.value, dtype=np.float64).reshape(-1) for e in (a, b))
    if len(first) != len(second) or np.any(first * second <= 0.0):
        return True
    apart = float(np.max(np.abs(np.log(first / second))))
    return (
        apart > DIFFERENT_FACTORS * float(np.hypot(a.spread, b.spread)) + 2.0 * 10.0**-SHARED_DIGITS
    )


def _shown(value: Any) -> str:
    return str(value).replace("'", '"')


def _shared(finding: Finding, found: Sequence[Finding], against: str, unlike: str) -> Finding:
    fix = finding.fix
    if fix is None or not fix.edits:
        return finding
    if against and finding.log and finding.severity == Severity.WRONG:
        return replace(finding, fix=_without(fix, against))
    if unlike:
        return replace(finding, severity=Severity.DOUBTFUL, fix=_without(fix, unlike))
    edits = tuple(replace(e, value=_middle(list(_suggested_values(found, e)))) for e in fix.edits)
    return replace(finding, fix=replace(fix, edits=edits))


def _suggested_values(found: Sequence[Finding], edit: Edit) -> Iterator[Any]:
    """What all logs suggest under one key."""
    for finding in found:
        for other in finding.fix.edits if finding.fix else ():
            if other.path == edit.path:
                yield other.value


def _without(fix: Fix, why: str) -> Fix:
    """The advice without edits: the robot file that the logs share cannot be changed so."""
    return replace(fix, says=f"{fix.says}; {why}", edits=())


def _middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or of lists of as many numbers; the first of anything else."""
    first = values[0]
    if all(value == first for value in values):
        return first
    if all(_is_number(value) for value in values):
        return _rounded(float(np.median(values)))
    lists = all(isinstance(v, list) and all(map(_is_number, v)) for v in values)
    if not lists or len({len(v) for v in values}) > 1:
        return first
    return [_rounded(float(x)) for x in np.median(np.array(values, dtype=np.float64), axis=0)]


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | int)


def _rounded(value: float) -> float:
    return float(f"{value:.{SHARED_DIGITS}g}")


DIFFERENT_FRICTION = 0.75
"""Range of friction over its mean from which on logs are not alike: more than from day to day."""
LEAST_FRICTION_SHARE = 0.1  # least share of a joint's effort that friction must have to matter
RELIABLE_MISFIT = 0.2  # misfit of a joint above which its friction is not reliable


@case_check("drift", "Is friction the same in all logs?", quick=False)
def friction_drift_check(case: Case) -> Iterable[Finding]:
    """Friction and offsets that differ between several logs."""
    found = [(e, level) for e in case.logs if (level := _friction_level(case, e)) is not None]
    if len(found) < 2:
        return ()
    levels = np.array([level for _, (level, _) in found])
    reliable = np.all([known for _, (_, known) in found], axis=0)
    if not reliable.any():
        return ()
    mean = np.maximum(levels.mean(axis=0), 1e-12)
    spread = np.where(reliable, np.ptp(levels, axis=0) / mean, 0)
    worst = int(np.argmax(spread))
    much = tuple(case.joints[j] for j in np.flatnonzero(spread > DIFFERENT_FRICTION))
    names = [e.name for e, _ in found]
    says = (
        f"friction differs from log to log by up to {100.0 * spread[worst]:.0f} % of its mean "
        f"('{case.joints[worst]}': least in {names[int(np.argmin(levels[:, worst]))]}, most in "
        f"{names[int(np.argmax(levels[:, worst]))]})"
    )
    fix = Fix(
        'estimate it per log: {law = "offset", per_run = true} and likewise friction '
        "under [model] terms, or identify from logs of one day"
    )
    logs = np.arange(1.0, len(levels) + 1.0)
    traces = [
        Trace(name, logs, 100.0 * level / own, "points")
        for name, level, own in zip(case.joints, levels.T, mean, strict=True)
    ]
    return [
        Finding.doubtful_if(
            bool(much),
            says,
            f"{100.0 * spread[worst]:.0f} %, at most {100.0 * DIFFERENT_FRICTION:.0f} % allowed",
            fix,
            joints=much,
            picture=Picture("log", "friction over its mean [%]", tuple(traces)),
        )
    ]


def _friction_level(case: Case, evidence: Evidence) -> tuple[Array, Array] | None:
    """Friction of every joint at half of its speed, and where it is reliable, each `(n,)`.

    In base units of the effort; `None` where something else is wrong with the log.
    """
    decision = judge_log(case, evidence)
    if decision is None or decision.winners:
        return None
    log = with_unbounded_friction(decision.likelihood)
    score = log.declared.score
    c, v, _, _ = score.nuisances.T
    speed = np.quantile(np.abs(log.driven(log.declared.motion()[1])), 0.98, axis=1)
    friction = c + 0.5 * v * speed
    reliable = (score.counts >= LEAST_SAMPLE_COUNT) & (score.misfits < RELIABLE_MISFIT)
    return friction, reliable & (friction > LEAST_FRICTION_SHARE * log.size)


def with_unbounded_friction(likelihood: Likelihood) -> Likelihood:
    """The log with friction and offsets unbounded."""
    lower, upper = (x.copy() for x in likelihood.bounds)
    lower[:, :3], upper[:, :3] = -np.inf, np.inf
    return replace(likelihood, bounds=(lower, upper))
