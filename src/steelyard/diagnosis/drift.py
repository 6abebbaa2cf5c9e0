"""Whether friction is the same in all logs."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.decision.verdict import verdict
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity, Trace
from steelyard.diagnosis.likelihood.likelihood import LEAST, Likelihood

MUCH = 0.75
"""Range of friction over its mean from which on logs are not alike: more than from day to day."""
SHARE = 0.1
"""Least share of a joint's effort that friction must have to matter."""
RELIABLE = 0.2
"""Misfit of a joint above which its friction is not reliable."""


class Drift:
    """Friction and offsets that differ from log to log."""

    name: ClassVar[str] = "drift"
    question: ClassVar[str] = "Is friction the same in all logs?"
    quick: ClassVar[bool] = False

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding for all logs together; none for a single log."""
        found = [(e, level) for e in case.logs if (level := _level(case, e)) is not None]
        if len(found) < 2:
            return ()
        levels = np.array([level.friction for _, level in found])
        reliable = np.all([level.reliable for _, level in found], axis=0)
        if not reliable.any():
            return ()
        spread = np.where(
            reliable, np.ptp(levels, axis=0) / np.maximum(levels.mean(axis=0), 1e-12), 0
        )
        worst = int(np.argmax(spread))
        much = tuple(case.joints[j] for j in np.flatnonzero(spread > MUCH))
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
        return (
            Finding(
                self.name,
                "",
                Severity.DOUBTFUL if much else Severity.OK,
                says,
                f"{100.0 * spread[worst]:.0f} %, at most {100.0 * MUCH:.0f} % allowed",
                much,
                fix if much else None,
                _picture(case, levels),
            ),
        )


@dataclass(frozen=True, eq=False)
class _Level:
    """Friction of every joint at half of its speed, and where it is reliable, each `(n,)`."""

    friction: Array
    reliable: Array


def _level(case: Case, evidence: Evidence) -> _Level | None:
    """Friction in one log, in base units of the effort; `None` where something else is wrong."""
    decision = verdict(case, evidence)
    if decision is None or decision.winners:
        return None
    likelihood = decision.ranking.likelihood
    score = unbounded(likelihood).score(likelihood.declared)
    c, v, _, _ = score.nuisances[0].T
    speed = np.quantile(
        np.abs(likelihood.driven(likelihood.motion(likelihood.declared)[1])), 0.98, axis=1
    )
    friction = c + 0.5 * v * speed
    reliable = (score.counts[0] >= LEAST) & (score.misfits[0] < RELIABLE)
    return _Level(friction, reliable & (friction > SHARE * likelihood.size))


def unbounded(likelihood: Likelihood) -> Likelihood:
    """The likelihood with friction unbounded."""
    lower, upper = (x.copy() for x in likelihood.bounds)
    lower[:, :3], upper[:, :3] = -np.inf, np.inf
    return replace(likelihood, bounds=(lower, upper))


def _picture(case: Case, levels: Array) -> Picture:
    logs = np.arange(1.0, len(levels) + 1.0)
    mean = np.maximum(levels.mean(axis=0), 1e-12)
    traces = [
        Trace(name, logs, 100.0 * levels[:, j] / mean[j], "points")
        for j, name in enumerate(case.joints)
    ]
    return Picture("log", "friction over its mean [%]", tuple(traces))
