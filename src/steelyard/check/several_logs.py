"""Several logs of one robot: edits that contradict each other, and friction that differs."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.case import Case, Evidence, case_check
from steelyard.check.decision.verdict import judge_log
from steelyard.check.finding import Edit, Finding, Fix, Picture, Severity, Trace
from steelyard.check.hypotheses.likelihood import Likelihood
from steelyard.check.hypotheses.nuisance import LEAST_SAMPLE_COUNT

SHARED_DIGITS = 4
DIFFERENT_FACTORS = 3.0  # standard deviations by which factors of two logs differ if not one number
OTHER_LOGS_AGREE = (
    "the other logs agree with the robot file as it is: give this one a robot file of its own"
)


def edits_that_serve_all_logs(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings of all checks with edits that serve all logs.

    A log that is wrong while others are fine has no line in a robot file they share. Numbers that
    several logs suggest become their median; fitted factors that differ by more than their accuracy
    are doubtful, and none is written. Edits that were tried as one change stay together or go.
    """
    shared: list[Finding] = []
    reasons: dict[str, str] = {}
    by_check = {f.check: [g for g in findings if g.check == f.check] for f in findings}
    unlike = {check: _unlike(found) for check, found in by_check.items()}
    against = {check: _against(found, findings) for check, found in by_check.items()}
    for f in findings:
        fix = f.fix
        if fix is not None and fix.edits:
            if f.log and f.severity == Severity.WRONG and (why := against[f.check]):
                fix = _without(fix, why)
            elif why := unlike[f.check]:
                fix, f = _without(fix, why), replace(f, severity=Severity.DOUBTFUL)
            else:
                wanted = [e for g in by_check[f.check] if g.fix for e in g.fix.edits]
                values = {
                    e.path: _middle([o.value for o in wanted if o.path == e.path])
                    for e in fix.edits
                }
                fix = replace(fix, edits=tuple(replace(e, value=values[e.path]) for e in fix.edits))
        if fix is not None and fix.jointly and not fix.edits:
            reasons.setdefault(f.log, unlike[f.check] or against[f.check])
        shared.append(replace(f, fix=fix))
    return tuple(
        replace(f, fix=_without(f.fix, reasons[f.log]))
        if f.log in reasons and f.fix is not None and f.fix.jointly and f.fix.edits
        else f
        for f in shared
    )


def _without(fix: Fix, why: str) -> Fix:
    """The advice without edits: the robot file that the logs share cannot be changed so."""
    return replace(fix, says=f"{fix.says}; {why}", edits=())


def _against(found: Sequence[Finding], findings: Sequence[Finding]) -> str:
    """Why other logs, with nothing else wrong, speak against what one suggests; or empty."""
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
    fixes = [(f.log, f.fix) for f in found if f.log and f.fix is not None]
    edits = [(log, edit) for log, fix in fixes for edit in fix.edits if edit.spread > 0.0]
    for (_, a), (_, b) in combinations(edits, 2):
        if a.path == b.path and _differ(a, b):
            listed = ", ".join(
                "{} ± {:.2g} % ({})".format(str(e.value).replace("'", '"'), 200.0 * e.spread, log)
                for log, e in edits
                if e.path == a.path
            )
            return (
                f"the logs require different factors ({a.path[-1]}: {listed}; 95 %): "
                "another difference between the logs explains them; no factor is written"
            )
    return ""


def _differ(a: Edit, b: Edit) -> bool:
    first, second = (np.array(e.value, dtype=np.float64).reshape(-1) for e in (a, b))
    if len(first) != len(second) or np.any(first * second <= 0.0):
        return True
    apart = float(np.max(np.abs(np.log(first / second))))
    accuracy = DIFFERENT_FACTORS * float(np.hypot(a.spread, b.spread))
    return apart > accuracy + 2.0 * 10.0**-SHARED_DIGITS


def _middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or of lists of as many numbers; the first of anything else."""
    first = values[0]
    if all(value == first for value in values) or len({np.shape(value) for value in values}) > 1:
        return first
    if (numbers := np.array(values)).dtype.kind != "f":
        return first
    middle = np.atleast_1d(np.median(numbers, axis=0))
    rounded = [float(f"{x:.{SHARED_DIGITS}g}") for x in middle]
    return rounded if isinstance(first, list) else rounded[0]


DIFFERENT_FRICTION = 0.75  # range over mean of unlike logs: more than from day to day
LEAST_FRICTION_SHARE = 0.1  # least share of a joint's effort that friction must have to matter
RELIABLE_MISFIT = 0.2  # misfit of a joint above which its friction is not reliable


@case_check("drift", "Is friction the same in all logs?", quick=False)
def friction_drift_check(case: Case) -> Iterable[Finding]:
    """Friction and offsets that differ between several logs."""
    found = [(e.name, *x) for e in case.logs if (x := _friction_level(case, e)) is not None]
    if len(found) < 2:
        return ()
    names = [name for name, _, _ in found]
    levels, known = (np.array(x) for x in zip(*(one[1:] for one in found), strict=True))
    if not (reliable := known.all(axis=0)).any():
        return ()
    mean = np.maximum(levels.mean(axis=0), 1e-12)
    spread = np.where(reliable, np.ptp(levels, axis=0) / mean, 0)
    worst = int(np.argmax(spread))
    much = tuple(case.joints[j] for j in np.flatnonzero(spread > DIFFERENT_FRICTION))
    says = (
        f"friction differs from log to log by up to {100.0 * spread[worst]:.0f} % of its mean "
        f"('{case.joints[worst]}': least in {names[int(np.argmin(levels[:, worst]))]}, most in "
        f"{names[int(np.argmax(levels[:, worst]))]})"
    )
    fix = Fix(
        'estimate it per log: {law = "offset", per_run = true} and likewise friction '
        "under [model] terms, or identify from logs of one day"
    )
    numbers = np.arange(1.0, len(levels) + 1.0)
    traces = tuple(
        Trace(name, numbers, 100.0 * level / own, "points")
        for name, level, own in zip(case.joints, levels.T, mean, strict=True)
    )
    return [
        Finding.doubtful_if(
            bool(much),
            says,
            f"{100.0 * spread[worst]:.0f} %, at most {100.0 * DIFFERENT_FRICTION:.0f} % allowed",
            fix,
            joints=much,
            picture=Picture("log", "friction over its mean [%]", traces),
        )
    ]


def _friction_level(case: Case, evidence: Evidence) -> tuple[Array, Array] | None:
    """Friction at half of the speed [base unit], where it is reliable; `None` of a wrong log."""
    decision = judge_log(case, evidence)
    if decision is None or decision.winners:
        return None
    log = with_unbounded_friction(decision.likelihood)
    score = log.declared.score
    c, v, _, _ = score.nuisances.T
    friction = c + 0.5 * v * np.quantile(np.abs(log.driven(log.declared.motion()[1])), 0.98, axis=1)
    reliable = (score.counts >= LEAST_SAMPLE_COUNT) & (score.misfits < RELIABLE_MISFIT)
    return friction, reliable & (friction > LEAST_FRICTION_SHARE * log.size)


def with_unbounded_friction(likelihood: Likelihood) -> Likelihood:
    """The log with friction and offsets unbounded."""
    lower, upper = (x.copy() for x in likelihood.bounds)
    lower[:, :3], upper[:, :3] = -np.inf, np.inf
    return replace(likelihood, bounds=(lower, upper))
