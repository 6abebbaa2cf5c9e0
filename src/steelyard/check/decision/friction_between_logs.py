"""Is friction the same in all logs?"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.case_logs_and_checks import Case, CheckedLog, case_check
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Fix, Picture, Trace
from steelyard.check.hypotheses.nuisance_fit_and_score import LEAST_SAMPLE_COUNT
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood

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


def _friction_level(case: Case, checked: CheckedLog) -> tuple[Array, Array] | None:
    """Friction at half of the speed [base unit], where it is reliable; `None` of a wrong log."""
    decision = judge_log(case, checked)
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
