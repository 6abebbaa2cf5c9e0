"""The checks whose question a hypothesis about the robot file answers, and their findings."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from steelyard.base.arrays import Z95
from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.decision.drive_gains_and_what_init_learns import (
    gains_left,
    gains_of_controller,
    unwritten_number_advice,
)
from steelyard.check.decision.joint_zeros_and_quarter_turns import quarter_turns
from steelyard.check.decision.ranked_readings import HOPELESS_MISFIT, Judged, LogVerdict
from steelyard.check.decision.robot_file_edits import confirmed, edits_of, velocity_edits
from steelyard.check.decision.search_with_unknown_bodies import least_mass
from steelyard.check.decision.small_errors_beside_free_bodies import removed_weight
from steelyard.check.decision.undecided_questions import UNTIL_OTHER, misfit_hides, undecided
from steelyard.check.decision.verdict_of_log import (
    CLEAN,
    FREE_INERTIAS,
    friction_alone_explains,
    judge_log,
    least_delay,
)
from steelyard.check.finding import (
    MOST_LISTED,
    ComparedHypothesis,
    Edit,
    Finding,
    Fix,
    Picture,
    Severity,
    trace,
)
from steelyard.check.hypotheses.hypotheses_and_their_scores import LIKELY, SURE, Hypothesis
from steelyard.check.hypotheses.position_and_effort_hypotheses import ZERO_CAUSE, zero_offsets
from steelyard.check.hypotheses.sensors_contacts_and_limbs import (
    CONTACTS,
    SENSOR_DELAY,
    SENSOR_MOUNTING,
)
from steelyard.check.hypotheses.signs_and_delay_by_friction import friction_signs, residual_delay

EMPTY_MISFIT = 0.5  # typical misfit of a reading that predicts next to nothing
WHOLE_PERCENT_MISFIT = 100.0  # misfit from which on no decimals are printed [%]
LARGEST_PRINTED = 1000.0  # misfit [%], or log odds, beyond which the number says no more
UNEXPLAINED_CHECK = "effort kind"  # the check that says so where nothing explains the efforts
NO_HYPOTHESIS = (
    "no single hypothesis explains these efforts: check columns, kind, unit, gains, and locked "
    "joints with their positions, or the model file is of another robot; a model from runs "
    "known to be correct (--model) allows more conclusions"
)
OF_NOMINAL = (
    ", with the masses of the model file, which may be wrong: take the ratio from the data sheet, "
    "or give a model from runs known to be correct (--model)"
)
UNKNOWN_BODIES = "undecided: the robot's model gives no masses; give --model"


@remembered
def edits(case: Case, evidence: CheckedLog) -> tuple[Edit, ...]:
    """All edits that correct the robot file for one log; none if they do not do so together."""
    decision = judge_log(case, evidence)
    if decision is None or not decision.written:
        return ()
    last = decision.written[-1].reading
    causes = dict.fromkeys(hypothesis.cause for hypothesis in decision.written)
    found = [e for c in causes for e in edits_of(c, last, case.loaded)]
    found += velocity_edits(case, evidence, last)
    whole = tuple({edit.path: edit for edit in found}.values())
    return whole if confirmed(case, evidence, whole, decision) else ()


Findings = tuple[Finding, ...]


@dataclass(frozen=True)
class HypothesisCheck:
    """A check by the hypotheses that have its name as their cause."""

    name: str  # as users see it, and the cause of its hypotheses
    question: str  # the question in a few words
    fine: Callable[[LogVerdict], str]  # what is said where nothing is wrong
    advice: str  # what to do about a hypothesis that explains a log better
    completed: Callable[[Case, Findings], Findings] = lambda case, found: found  # by other means
    quick = True

    def __call__(self, case: Case) -> Findings:
        """One finding per log that moves; one for all if nothing is known of the robot."""
        found: Findings = (Finding.ok(UNKNOWN_BODIES, "no masses, no reference", answered=False),)
        if case.knowledge is not None:
            judged = [(evidence, judge_log(case, evidence)) for evidence in case.logs]
            found = tuple(
                replace(
                    self._of_log(case, evidence, decision),
                    log=evidence.name,
                    hypotheses=self._hypotheses(decision),
                    nominal=not decision.likelihood.knowledge.identified,
                )
                for evidence, decision in judged
                if decision is not None and not decision.of_other_check
            )
        return tuple(finding.by(self.name) for finding in self.completed(case, found))

    def _of_log(self, case: Case, evidence: CheckedLog, decision: LogVerdict) -> Finding:
        mine = [(number, w) for number, w in enumerate(decision.winners) if w[0].cause == self.name]
        if not mine:
            return self._without_fault(decision)
        number, (hypothesis, severity) = mine[-1]
        before = decision.winners[number - 1][0] if number else decision.declared
        (known, then), rise = (_known(decision), before.reading.percent), ""
        gain = hypothesis.log_likelihood - before.reading.log_likelihood
        if hypothesis.compared is not None:
            known, then = hypothesis.compared
        if hypothesis.odds is not None:  # free bodies may absorb what is wrong
            odds = f"{hypothesis.odds:.0f} (doubtful from {LIKELY:.0f}, wrong from {SURE:.0f})"
            if not hypothesis.odds < LARGEST_PRINTED:
                odds = f"above {LARGEST_PRINTED:.0f}"
            rise = f", log Bayes factor {odds} to the best reading without it{hypothesis.note}"
        elif gain > 0.0:
            rise = f", log-likelihood rises by {gain:.0f}"
        fix, severity = self._fix(case, evidence, decision, mine[-1][1])
        return Finding.of(
            severity,
            f"{hypothesis.says}: misfit of {known} {_percent(hypothesis.percent)}, "
            f"{'without' if number and hypothesis.compared is None else 'as declared'} "
            f"{_percent(then)}",
            f"misfit {_percent(then)} falls to {_percent(hypothesis.percent)}{rise}",
            tuple(case.joints[j] for j in hypothesis.joints),
            fix,
            picture(decision, before, hypothesis),
            answered=bool(severity),
        )

    def _without_fault(self, decision: LogVerdict) -> Finding:
        """That nothing is wrong, that it is open, or once that nothing explains the efforts."""
        declared, sure = decision.declared, bool(decision.winners) or decision.explained
        unclear = undecided(decision, self.name) if sure else ""
        says, answered = unclear or self.fine(decision), sure and not unclear
        waits = says.startswith(UNTIL_OTHER)  # the question that it waits for counts
        hidden = not answered and not waits and misfit_hides(decision)
        worst = float(np.max(declared.misfits[declared.score.counts > 0.0], initial=0.0))
        bad = worst > HOPELESS_MISFIT or declared.percent > 100.0 * EMPTY_MISFIT
        if self.name == UNEXPLAINED_CHECK and bad and not sure:
            j, names = int(np.argmax(declared.misfits)), decision.likelihood.names
            much = _percent(100.0 * declared.misfits[j])
            figure, fix = f"misfit of {names[j]} {much}, at most 90 % allowed", Fix(NO_HYPOTHESIS)
            return Finding.doubtful(says, figure, fix=fix, answered=answered, hidden=hidden)
        mine = next((r for r in decision.rounds[0] if r.cause == self.name), None)
        figure = f"misfit {declared.percent:.1f} %"
        if (search := decision.search) is not None:
            figure += f", {search.declared.evidence.percent:.1f} % with {FREE_INERTIAS}"
        if mine is not None:
            figure += f"; best alternative of this check ({mine.says}): {mine.percent:.1f} %"
        return Finding.ok(says, figure, answered=answered, hidden=hidden)

    def _hypotheses(self, decision: LogVerdict) -> tuple[ComparedHypothesis, ...]:
        """The likeliest hypotheses, with the declared reading and this check's own best ones."""
        first, as_declared = decision.rounds[0], decision.declared.reading
        declared = next(r for r in first if r.reading is as_declared)
        mine = [r for r in first if r.cause == self.name][:2]
        shown = dict.fromkeys((*first[: MOST_LISTED - 2], declared, *mine))
        ordered = sorted(shown, key=lambda r: -r.log_likelihood)
        top = ordered[0].log_likelihood
        return tuple(
            ComparedHypothesis(r.says, r.percent, r.log_likelihood - top, r is declared)
            for r in ordered
        )

    def _fix(
        self, case: Case, evidence: CheckedLog, decision: LogVerdict, judged: Judged
    ) -> tuple[Fix | None, Severity]:
        """The advice with its edits, which the first finding of a log has for the velocities."""
        hypothesis, severity = judged
        if not severity:
            return None, severity
        if not hypothesis.fixed:
            if np.any(hypothesis.reading.ratios != 1.0):
                return Fix(f"{hypothesis.says}{OF_NOMINAL}"), severity
            sure = severity is Severity.WRONG
            return unwritten_number_advice(case, hypothesis, sure=sure), severity
        wanted = edits_of(hypothesis.cause, decision.written[-1].reading, case.loaded)
        whole = edits(case, evidence)
        if wanted and not whole:
            says = f"{hypothesis.says}; no line of the robot file corrects it: examine the log"
            return Fix(says), Severity.DOUBTFUL
        paths = {edit.path for edit in wanted}
        if hypothesis.cause in ("joint order", "position sign"):
            paths |= {("signals", "velocity"), ("signals", "velocity_sign")}
        mine = tuple(edit for edit in whole if edit.path in paths)
        return Fix(f"{hypothesis.says}: {self.advice}", mine, bool(mine)), severity


def _percent(value: float) -> str:
    if value >= LARGEST_PRINTED:
        return f"more than {LARGEST_PRINTED:.0f} %"
    return f"{value:.1f} %" if value < WHOLE_PERCENT_MISFIT else f"{value:.0f} %"


def picture(decision: LogVerdict, before: Hypothesis, after: Hypothesis) -> Picture:
    """Effort of the joint that gains most: measured, and as it should be."""
    joint = int(np.argmax(before.misfits / np.maximum(after.misfits, 1e-3)))
    t, e, wrong = before.reading.compared(joint)
    _, corrected, right = after.reading.compared(joint)
    shown = {"measured": e, before.says: wrong, "measured, corrected": corrected, after.says: right}
    if np.allclose(corrected, e):
        del shown["measured, corrected"]
    traces = tuple(trace(name, t, values) for name, values in shown.items())
    return Picture("time [s]", f"effort of '{decision.likelihood.names[joint]}'", traces)


def _known(decision: LogVerdict) -> str:
    identified = decision.likelihood.knowledge.identified
    return "the reference" if identified else "the nominal model"


def agreement_sentence(decision: LogVerdict, what: str) -> str:
    """The sentence where nothing is wrong, or where nothing can be concluded."""
    identified, percent = decision.likelihood.knowledge.identified, decision.last.reading.percent
    if not (decision.winners or decision.explained):
        much = _percent(decision.declared.percent)
        clear = "no hypothesis is clearly better"
        why = clear if identified else f"{_unclear(decision, clear)}; give --model"
        return f"undecided: {_known(decision)} has a misfit of {much} and {why}"
    once = ""
    if decision.winners:
        written = len(decision.written) == len(decision.winners)
        once = ", once the rest is corrected" if written else ", if the rest is as stated"
    high = "" if percent <= CLEAN else "high "
    return f"{what} ({high}misfit of {_known(decision)}: {percent:.1f} %{once})"


def _no_delay(decision: LogVerdict) -> str:
    least = 1e3 * least_delay(decision.declared.reading)
    return agreement_sentence(decision, f"efforts have no common delay of {least:.2g} ms or more")


def _unclear(decision: LogVerdict, clear: str) -> str:
    if decision.search is None:
        return clear
    reading, found = decision.search.best.reading, decision.search.best.evidence
    if not friction_alone_explains(reading, found.score):
        return clear
    alone = float(reading.friction_alone.percent)
    return (
        f"the efforts contain hardly any rigid-body torque: the misfit is {_percent(alone)} with "
        f"friction alone, {_percent(found.percent)} with free link inertias"
    )


def _winners(case: Case) -> list[tuple[CheckedLog, LogVerdict, Judged]]:
    judged = [(log, judge_log(case, log)) for log in case.logs]
    return [(log, decision, w) for log, decision in judged if decision for w in decision.winners]


def _gains_not_found(case: Case, found: Findings) -> Findings:
    """Where neither unit nor gain is wrong, what the controller and the logs say of gains."""
    winners = _winners(case)
    if any(hypothesis.cause == EFFORT_UNIT.name for _, _, (hypothesis, _) in winners):
        return found
    controller = gains_of_controller(case)
    if controller and not any(f.severity for f in controller):
        factors = [
            (log.name, decision.declared.reading.effort_scale / hypothesis.reading.effort_scale)
            for log, decision, (hypothesis, _) in winners
            if hypothesis.cause == GAIN.name
        ]
        # efforts that are not those of the model file's links, though the gains are confirmed
        other = tuple(
            Finding.doubtful(
                f"the controller's targets confirm the gains, but efforts are {x[0]:.2g} times "
                "those of the links in the model file: it is of another robot, or the arm carries "
                "a payload",
                f"efforts over those of the model file: {x[0]:.3g}",
                fix=Fix(
                    "compare the masses of the model file with the robot; if they are right, weigh "
                    "the payload (steelyard payload)"
                ),
                log=log,
            )
            for log, x in factors
            if np.allclose(x, x[0])
        )
        if other:
            return other
    if any(f.severity for f in found):
        return found
    if any(f.severity for f in controller):
        return controller
    return gains_left(case) or controller or found


def _short_delays(case: Case, found: Findings) -> Findings:
    """A delay in the residuals of a fit, unless one is known or another cause comes first."""
    winners = [winner for _, _, winner in _winners(case)]
    if any(h.cause == EFFORT_DELAY.name or severity == Severity.WRONG for h, severity in winners):
        return found
    if (late := residual_delay(case)) is None:
        return found
    if len(case.logs) > 1:  # the longest log shows one; a line is written if every log does
        each = ((e.name, residual_delay(case.only(e))) for e in case.logs)
        own = {name: replace(one, log=name) for name, one in each if one is not None}
        return (*own.values(), *(f for f in found if f.log and f.log not in own))
    return (late, *(f for f in found if f.log))


def _of_reference(case: Case, found: Findings) -> Findings:
    """Zeros of an open chain that are not to be identified; quarter turns without a reference."""
    known = case.knowledge
    if known is None or not known.identified or known.robot.passive:
        return tuple(quarter_turns(case))
    open_ = [e.name for e in case.logs if any(e.recording.signals.unknown_offsets)]
    return tuple(finding for finding in found if finding.log not in open_)


def _fine_gains(decision: LogVerdict) -> str:
    if any(decision.likelihood.signals.unknown_gains):
        return "gains are identified, so they are not compared with the model file"
    return agreement_sentence(decision, "gains and gear ratios are right")


def _no_load(decision: LogVerdict) -> str:
    knowledge = decision.likelihood.knowledge
    what = "the arm carries no payload"
    if not knowledge.identified:
        least = least_mass(knowledge)
        what = f"no payload of {least:.2g} kg or more, if the model file's masses are right"
    return agreement_sentence(decision, what)


def _same_zeros(decision: LogVerdict) -> str:
    """That zeros are right, how far they may be off, like `elbow 0.012 rad`, or are unknown."""
    same = "joint zeros are those of the reference"
    if decision.likelihood.knowledge.identified:
        zeros = zero_offsets(decision.last.reading)
        bounds = [
            f"{zero.name} {abs(zero.value) + Z95 * zero.std:.2g} {zero.unit}"
            for zero in zeros
            if zero.identifiable
        ]
        left = [zero.name for zero in zeros if not zero.identifiable]
        says = [f"within (95 %): {', '.join(bounds)}"] if bounds else []
        says += [f"not identifiable: {', '.join(left)}"] if left else []
        same += f", {'; '.join(says)}"
    return agreement_sentence(decision, same)


JOINT_ORDER = HypothesisCheck(
    "joint order",
    "Does every column belong to its joint?",
    partial(agreement_sentence, what="every column belongs to its joint"),
    "put the columns in the order of the joints",
)
POSITION_SIGN = HypothesisCheck(
    "position sign",
    "Do positions have the right sign?",
    partial(agreement_sentence, what="positions have the right sign"),
    "state which position columns have the opposite sign",
)
EFFORT_SIGN = HypothesisCheck(
    "effort sign",
    "Do efforts have the right sign?",
    partial(agreement_sentence, what="efforts have the right sign"),
    "change the sign of the gain",
    # without masses, what friction determines
    lambda case, found: (friction_signs(case) if case.knowledge is None else ()) or found,
)
EFFORT_UNIT = HypothesisCheck(
    "effort unit",
    "Are efforts in the unit declared?",
    partial(agreement_sentence, what="efforts are in the unit declared"),
    "declare the unit in which efforts are logged",
)
EFFORT_KIND = HypothesisCheck(
    "effort kind",
    "Are efforts of the declared kind?",
    partial(agreement_sentence, what="efforts are of the kind declared"),
    "declare what the columns hold",
    removed_weight,
)
OF_COLUMNS = (JOINT_ORDER, POSITION_SIGN, EFFORT_SIGN, EFFORT_UNIT, EFFORT_KIND)
GAIN = HypothesisCheck(
    "gain",
    "Are gains and gear ratios right?",
    _fine_gains,
    "use this gain, or correct the gear ratio",
    _gains_not_found,
)
EFFORT_DELAY = HypothesisCheck(
    "effort delay",
    "Do all efforts have a common delay?",
    _no_delay,
    "compensate the delay",
    _short_delays,
)
JOINT_ZEROS = HypothesisCheck(
    ZERO_CAUSE,
    "Are the joint zeros those of the reference?",
    _same_zeros,
    "set it as position_offset, if the robot's zeros confirm it",
    _of_reference,
)
MOUNTING = HypothesisCheck(
    "mounting",
    "Is the direction of gravity that of the robot file?",
    partial(agreement_sentence, what="gravity has the direction of the robot file"),
    "state the direction of gravity in the base frame as the log fits it best",
)
SENSOR_MOUNTING_CHECK = HypothesisCheck(
    SENSOR_MOUNTING,
    "Is the sensor of the base turned as declared?",
    partial(agreement_sentence, what="the sensor of the base is turned as declared"),
    "state how the sensor is mounted",
)
SENSOR_DELAY_CHECK = HypothesisCheck(
    SENSOR_DELAY,
    "Has the sensor of the base the clock of the joints?",
    partial(agreement_sentence, what="the sensor of the base has the clock of the joints"),
    "compensate the delay",
)
CONTACTS_CHECK = HypothesisCheck(
    CONTACTS,
    "Do measured contacts act where, and as, they are declared?",
    partial(agreement_sentence, what="contacts act as declared"),
    "correct the columns, units, signs or axes of [[signals.base.contacts]]",
)
PAYLOAD = HypothesisCheck(
    "payload",
    "Does the arm carry no payload?",
    _no_load,
    "identify without this log, give it as --loaded, or identify the payload with steelyard "
    "payload",
)
