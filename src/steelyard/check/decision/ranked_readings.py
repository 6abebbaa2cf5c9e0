"""Readings of a log, ranked: all explanations at once, so that one fault raises one alarm."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import report_progress
from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.decision.search_with_unknown_bodies import SAME_FACTOR, Search
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.gravity_payload_and_delay import (
    delay_hypotheses,
    gravity_hypotheses,
    payload_hypotheses,
)
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    AS_DECLARED,
    LIKELY,
    SURE,
    Hypothesis,
    scored,
)
from steelyard.check.hypotheses.log_excerpt import excerpt_of
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    PERCENT,
    OtherEfforts,
    best_factors,
    deep_hypotheses,
    effort_hypotheses,
    position_changes,
    ratio_hypotheses,
    zero_hypotheses,
)
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood, likelihood_of
from steelyard.check.hypotheses.sensors_contacts_and_limbs import base_hypotheses
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.robot.file.signals import Signals

BAD_JOINT_MISFIT = 0.12  # misfit of a joint from which on a reading is bad, with a reference
EXPECTED_MISFIT_FACTOR = 3.0  # the same over what the reference's own residuals come to
HOPELESS_MISFIT = 0.9
CAUSES_OF_OTHER_CHECKS = ("position unit", "clock")  # reported there; what they leave is for later
COMPARING_PHASE = "comparing explanations: order, signs, units, gains, mounting"
"""The phase of the work that the checks share."""
FAULT_ROUNDS = 3  # faults that are looked for, one after the other


Judged = tuple[Hypothesis, Severity]


@dataclass(frozen=True, eq=False)
class LogVerdict:
    """Explanations of one log, and what holds of it."""

    declared: Hypothesis  # as the robot file reads the log
    # per round all hypotheses, the likeliest first; a round starts from the winner of the one
    # before, and the last one's winner is what it started from, or agrees
    rounds: tuple[tuple[Hypothesis, ...], ...]
    # what is wrong, in the order in which it was found, with how sure that is; ok where the model
    # file alone is wrong, which leaves a question open
    winners: tuple[Judged, ...] = ()
    explained: bool = False  # whether the last winner agrees with what is known
    search: Search | None = None  # explanations by their evidence, where bodies are not known

    @property
    def likelihood(self) -> Likelihood:
        """The log."""
        return self.declared.reading.likelihood

    @property
    def last(self) -> Hypothesis:
        """The last winner, or the declared reading."""
        return self.winners[-1][0] if self.winners else self.declared

    @property
    def written(self) -> tuple[Hypothesis, ...]:
        """Those of the winners that the robot file may be changed to say."""
        return tuple(hypothesis for hypothesis, _ in self.winners if hypothesis.fixed)

    @property
    def of_other_check(self) -> bool:
        """Whether another check's cause is the first to be corrected."""
        return any(hypothesis.cause in CAUSES_OF_OTHER_CHECKS for hypothesis, _ in self.winners)


@remembered
def rankings(case: Case) -> dict[CheckedLog, LogVerdict]:
    """Explanations of every log that has some, not judged yet; see `ranking`.

    Several logs are looked at on several cores.
    """
    number, found = len(case.logs), dict[CheckedLog, LogVerdict]()
    with ThreadPoolExecutor(min(number, os.cpu_count() or 1)) as pool:
        try:
            ranked = pool.map(partial(ranking, case), case.logs)
            for done, log in enumerate(case.logs):
                report_progress(case.progress, COMPARING_PHASE, done, number, log.name)
                if (one := next(ranked)) is not None:
                    found[log] = one
            report_progress(case.progress, COMPARING_PHASE, number, number, case.logs[-1].name)
        finally:
            pool.shutdown(cancel_futures=True)
    return found


@remembered
def ranking(case: Case, evidence: CheckedLog) -> LogVerdict | None:
    """Explanations, not judged yet; `None` without motion, or if the robot is unknown."""
    signals, knowledge = evidence.recording.signals, case.knowledge
    if knowledge is None:
        return None
    cutoff = None if case.reference is None else case.reference.cutoffs.matched
    excerpt = excerpt_of(evidence.recording, evidence.processing, cutoff)
    if excerpt is None:
        return None
    gains, scales = _gains(case, signals), _scales(case, signals)
    likelihood = likelihood_of(excerpt, signals, knowledge, case.loaded.robot, gains, scales)
    unknown = np.array(signals.unknown_gains or (False,) * signals.n)
    if unknown.any() and not knowledge.identified:
        factors = np.where(unknown, best_factors(likelihood.declared), 1.0)
        likelihood = replace(likelihood, gains=likelihood.gains * factors)
    others = _others(likelihood, case.reference)
    declared = likelihood.declared
    first = now = Hypothesis("", AS_DECLARED, declared, 0.0, (), declared.score)
    if not np.any(first.score.counts > 0.0):
        return None
    if not knowledge.identified:
        found = Search(likelihood, others, unknown)
        if not found.found:
            return None
        return LogVerdict(first, (tuple(x.as_hypothesis() for x in found.ordered()),), search=found)
    rounds = []
    for _ in range(FAULT_ROUNDS):
        rounds.append(_rivals(now, others))
        best = rounds[-1][0]
        gain = best.log_likelihood - now.log_likelihood
        if gain < SURE or best.cause in CAUSES_OF_OTHER_CHECKS or not has_bad_joint(best):
            break
        now = best
    return LogVerdict(first, tuple(rounds))


def _gains(case: Case, signals: Signals) -> Array:
    """Gains of the efforts; those to be identified are the reference's, without one 1."""
    if case.reference is None:
        return np.array(signals.gains)
    return np.where(signals.unknown_gains or False, case.reference.signals.gains, signals.gains)


def _scales(case: Case, signals: Signals) -> Array | float:
    """Logged effort over what the gains say, as the reference found it of sensors of this kind.

    1 where the gains are those of the reference, which contain its scales.
    """
    reference = case.reference
    if reference is None or reference.effort_scales is None:
        return 1.0
    its = reference.signals
    if (its.effort_kind, its.effort_units) != (signals.effort_kind, signals.effort_units):
        return 1.0
    included = np.allclose(signals.gains, its.gains, equal_nan=True)
    values = 1.0 if included else reference.effort_scales.values
    # gains that are to be identified are the reference's, which count its scales
    return np.where(signals.unknown_gains or False, 1.0, values)


def _others(likelihood: Likelihood, reference: IdentifiedModel | None) -> OtherEfforts:
    units, gains = likelihood.signals.effort_units, likelihood.gains
    found = {}
    if "A" in units:
        scale = np.asarray(likelihood.declared.effort_scale)
        found["efforts are joint torques"] = "joint_torque", 1.0 / (gains * scale)
    elif reference is not None and "A" in reference.signals.effort_units:
        currents = reference.signals.gains / gains
        for unit, size in (("A", 1.0), ("mA", 1e-3)):
            found[f"efforts are motor currents in {unit}"] = "motor_current", size * currents
    limits = np.array([c.limits.effort for c in likelihood.knowledge.robot.coordinates])
    if np.isfinite(limits).all() and np.all(limits > 0.0) and likelihood.signals.effort_map is None:
        says = "efforts are percents of the joints' limits"
        factors = 0.01 * limits / np.abs(gains)
        if np.any(np.abs(np.log(factors)) > np.log(SAME_FACTOR)):  # else percents are newton metres
            found[says] = PERCENT, factors
    return found


def _rivals(now: Hypothesis, others: OtherEfforts) -> tuple[Hypothesis, ...]:
    reading = now.reading
    found = [now, *effort_hypotheses(reading, others)]
    if reading.base is None:
        found += [*gravity_hypotheses(reading), *payload_hypotheses(reading)]
        found += [*delay_hypotheses(reading), *zero_hypotheses(reading)]
    else:
        found += scored(list(base_hypotheses(reading)))
    found.sort(key=lambda h: -h.log_likelihood)
    if has_bad_joint(now) or found[0].log_likelihood - now.log_likelihood > LIKELY:
        found += [*scored(list(position_changes(reading))), *ratio_hypotheses(reading)]
        found.sort(key=lambda h: -h.log_likelihood)
    if has_bad_joint(found[0]):
        found += deep_hypotheses(reading)
        found.sort(key=lambda h: -h.log_likelihood)
    return tuple(found)


def _misfit_limits(log: Likelihood) -> Array:
    """Misfit of each joint from which on a reading is bad, shape `(n,)`."""
    least = np.full(log.signals.n, BAD_JOINT_MISFIT)
    if log.knowledge.sigma is None:
        return least
    logged = np.abs(log.declared.into_logged()) @ log.knowledge.sigma
    expected = EXPECTED_MISFIT_FACTOR * logged / np.maximum(log.size, 1e-300)
    return np.asarray(np.maximum(least, np.minimum(expected, HOPELESS_MISFIT)))


def has_bad_joint(hypothesis: Hypothesis) -> bool:
    """Whether a joint disagrees more than friction and a rough model explain.

    An effort that is smaller than it should be, such as one without gravity, may disagree by as
    many newton metres.
    """
    if not disagrees(hypothesis):
        return False
    reading, log = hypothesis.reading, hypothesis.reading.likelihood
    e = log.excerpt.e[list(reading.effort)] * reading.effort_scale[:, None]
    rms = np.maximum(np.sqrt(np.mean(np.square(e), axis=1)), 1e-300)
    allowed = _misfit_limits(log) * np.maximum(log.size / rms, 1.0)
    return bool(np.any((hypothesis.misfits > allowed) & (hypothesis.score.counts > 0.0)))


def disagrees(hypothesis: Hypothesis) -> bool:
    """Whether a joint disagrees, relative to its effort, however small that is."""
    above = hypothesis.misfits > _misfit_limits(hypothesis.reading.likelihood)
    return bool(np.any(above & (hypothesis.score.counts > 0.0)))
