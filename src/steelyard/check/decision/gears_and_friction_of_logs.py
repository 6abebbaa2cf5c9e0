"""Do gear signs and couplings agree with the log, and is friction the same in all logs?

A ratio of the wrong sign turns position and effort of a joint together, and friction with them:
only masses tell it from the right one, by a mirrored motion. A coupling changes the speed of a
joint and the effort of the one before it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, log_check
from steelyard.check.decision.undecided_questions import misfit_hides
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Fix, Picture, Trace
from steelyard.check.hypotheses.hypotheses_and_their_scores import SURE
from steelyard.check.hypotheses.nuisance_fit_and_score import LEAST_SAMPLE_COUNT
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood
from steelyard.robot.file.signals import MOTOR_KINDS
from steelyard.robot.robot import Transmission

COMPARE_RATIOS = Fix(
    "compare ratios, their signs and coupling in [robot.transmission] with the data sheet"
)
COUPLED, WITH = "other couplings of ", " with the joint before"
"""Words around the motors whose other couplings fit about as well."""
ENTER_COUPLING = Fix(
    "Enter coupling from the data sheet (coupling = [] if there is none), or move single joints: "
    "a motor that turns beside its own joint's is coupled. Errors with and without a coupling are "
    "of different joint efforts and cannot be compared"
)
"""What to do where a coupling that is not declared fits as well."""


@dataclass(frozen=True, eq=False)
class OtherGears:
    """Gears with one change."""

    motor: str  # whose
    coupling: bool  # whether its coupling with the joint before is changed, or else its sign
    says: str  # the change, in words
    matrix: Array  # motor positions per joint position


@log_check("transmission", "Do gear signs and couplings agree with the log?")
def transmission_check(case: Case, log: CheckedLog) -> Finding | None:
    """Gears with one sign or one coupling changed, compared with those declared for motors."""
    decision = judge_log(case, log)
    if decision is None or decision.of_other_check:
        return None
    likelihood, (*_, last) = decision.likelihood, (decision.declared, *decision.written)
    if likelihood.gears is None or likelihood.signals.position_map is None:
        return None
    now = last.reading.on(with_gears(likelihood, likelihood.gears.matrix))
    others = list(other_gears(likelihood.gears, (now.score.counts > 0.0).tolist()))
    readings = [last.reading.on(with_gears(likelihood, other.matrix)) for other in others]
    rises = [reading.log_likelihood - now.log_likelihood for reading in readings]
    best = max(rises, default=-np.inf)
    near = [o for o, rise in zip(others, rises, strict=True) if rise > -SURE]
    figure = f"log-likelihood of the best other gears {best:+.0f}, at most {-SURE:g} required"
    if not near:
        return Finding.ok("other signs of gear ratios and other couplings fit worse", figure)
    first, misfit = int(np.argmax(rises)), f"{now.percent:.1f} %"
    says, other = others[first].says, f"{readings[first].percent:.1f} %"
    if best > SURE:
        says = f"{says} fits clearly better: misfit {other}, as declared {misfit}"
        return Finding.doubtful(says, figure, fix=COMPARE_RATIOS)
    signs, couplings = (
        ", ".join(dict.fromkeys(o.motor for o in near if o.coupling == coupling))
        for coupling in (False, True)
    )
    words = [f"opposite signs of the ratios of {signs}"] if signs else []
    words += [f"{COUPLED}{couplings}{WITH}"] if couplings else []
    says = (
        f"undecided: misfit {misfit}, but about as well fit {', and '.join(words)}; the best of "
        f"them, {says}, has a misfit of {other}"
    )
    hidden = misfit_hides(decision)
    return Finding.ok(says, figure, fix=COMPARE_RATIOS, answered=False, hidden=hidden)


def missing_coupling(findings: Sequence[Finding], stated: bool) -> tuple[Finding, ...]:
    """A remark beside the headline of a fit where motors that no coupling names may be coupled."""
    name = transmission_check.name
    open_ones = [f for f in findings if f.check == name and not f.answered and COUPLED in f.says]
    if stated or not open_ones:
        return ()
    motors = open_ones[0].says.partition(COUPLED)[2].partition(WITH)[0]
    says = f"no coupling is declared, but one of {motors}{WITH} fits the logs about as well"
    return (Finding.ok(says, fix=ENTER_COUPLING, headline=True).by(name),)


def other_gears(gears: Transmission, moving: Sequence[bool]) -> Iterator[OtherGears]:
    """Gears with another sign, or another coupling of a motor with the joint before its own."""
    for k, motor in enumerate(gears.motors):
        own = float(gears.matrix[k, k])
        if not moving[k]:
            continue
        says = f"the opposite sign of the ratio of {motor}"
        yield OtherGears(motor, False, says, _changed(gears.matrix, k, k, -own))
        if k == 0 or not moving[k - 1]:
            continue
        now = float(gears.matrix[k, k - 1])
        named = {"no": 0.0, "the opposite": -now} if now else {"a": own, "an opposite": -own}
        for article, value in named.items():
            says = f"{article} coupling of {motor} with the joint before"
            yield OtherGears(motor, True, says, _changed(gears.matrix, k, k - 1, value))


def _changed(matrix: Array, row: int, column: int, value: float) -> Array:
    changed = np.array(matrix)
    changed[row, column] = value
    return changed


def with_gears(likelihood: Likelihood, matrix: Array) -> Likelihood:
    """The log read with other gears; efforts of motors likewise."""
    signals, gears = likelihood.signals, likelihood.gears
    if gears is None:
        raise ValueError("the robot has no gears")
    own = signals.effort_map
    if own is None and signals.effort_kind in MOTOR_KINDS:
        own = np.diag(likelihood.gains)
    if own is not None:
        own = matrix.T @ np.linalg.solve(gears.matrix.T, own)
    bounds = likelihood.bounds
    if own is not None and signals.effort_map is None:
        # of friction, offset and rotor inertia at rates of motors, from those at joints'
        ratios = np.diag(gears.matrix)
        factors = np.stack((np.sign(ratios), 1.0 / ratios, np.ones_like(ratios), 1.0 / ratios), 1)
        lower, upper = np.sort([factors * side for side in bounds], axis=0)
        bounds = lower, upper
    return replace(
        likelihood,
        signals=replace(signals, effort_map=own),
        gears=Transmission(gears.motors, matrix),
        bounds=bounds,
    )


DIFFERENT_FRICTION = 0.75  # range over mean of unlike logs: more than from day to day
LEAST_FRICTION_SHARE = 0.1  # least share of a joint's effort that friction must have to matter
RELIABLE_MISFIT = 0.2  # misfit of a joint above which its friction is not reliable


@case_check("drift", "Is friction the same in all logs?", quick=False)
def friction_drift_check(case: Case) -> Iterable[Finding]:
    """Friction and offsets that differ between several logs."""
    found = [(e.name, *x) for e in case.logs if (x := _friction(case, e)) is not None]
    if len(found) < 2:
        return ()
    names = [name for name, _, _ in found]
    friction, known = (np.array(x) for x in zip(*(one[1:] for one in found), strict=True))
    levels = friction[:, 0] + friction[:, 1] * friction[:, 2].min(axis=0)  # at the same speed
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


def _friction(case: Case, checked: CheckedLog) -> tuple[Array, Array] | None:
    """Dry and viscous friction [base unit] and half of the speed, `(3, n)`, and where reliable.

    `None` of a wrong log.
    """
    decision = judge_log(case, checked)
    if decision is None or decision.winners:
        return None
    log = with_unbounded_friction(decision.likelihood)
    score = log.declared.score
    c, v, _, _ = score.nuisances.T
    speed = 0.5 * np.quantile(np.abs(log.driven(log.declared.motion()[1])), 0.98, axis=1)
    reliable = (score.counts >= LEAST_SAMPLE_COUNT) & (score.misfits < RELIABLE_MISFIT)
    return np.stack([c, v, speed]), reliable & (c + v * speed > LEAST_FRICTION_SHARE * log.size)


def with_unbounded_friction(likelihood: Likelihood) -> Likelihood:
    """The log with friction and offsets unbounded."""
    lower, upper = (x.copy() for x in likelihood.bounds)
    lower[:, :3], upper[:, :3] = -np.inf, np.inf
    return replace(likelihood, bounds=(lower, upper))
