"""Why residuals are far above the noise, and why a model does not predict an unseen log.

Such a log is read under the same explanations as in `check`, with the model as reference: a load, a
sign, an order, a unit, a gain, a delay, another mounting, or else friction and offsets that
changed. What none of them explains has no known cause, and is reported so.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check
from steelyard.check.decision.gears_and_friction_of_logs import with_unbounded_friction
from steelyard.check.decision.joint_zeros_and_quarter_turns import (
    estimated_offsets,
    far_offsets,
    offset_line,
    turned_zeros,
)
from steelyard.check.decision.ranked_readings import LogVerdict
from steelyard.check.decision.robot_file_edits import zero_edits
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.causes_of_residuals import Cause, LeftOutGain
from steelyard.check.fitted.fitted_case_causes_and_constraints import (
    LEAST_ERROR,
    FittedCase,
    RankedCauses,
    largest_residual,
    worst_residual_words,
)
from steelyard.check.hypotheses.position_and_effort_hypotheses import ZERO_CAUSE
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood
from steelyard.estimate.consistent.convex_estimator import TERM_MISSING
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.residual_traces_and_band_calibration import ResidualNoise
from steelyard.estimate.scores.score import RunScore
from steelyard.model.laws.laws_without_friction import Cogging
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.runs.run import Run

INCOMPLETE = "the model is incomplete, which the intervals of parameters do not cover"
INCOMPLETE_RESIDUAL = 2.0  # over the noise's upper bound, of an incomplete model
CAUSE_ADVICE = {
    "gain": "Check the gain and unit of this effort",
    "saturation": "Check the gain of this effort at large currents",
    "hysteresis": "Check the mounting of this sensor, and its calibration with rising and "
    "falling torques",
    "crosstalk": "Check the calibration of this sensor under loads of the other joint",
    "tilt": "Check gravity (or mounting) in [robot], its direction in the frame of the base",
    "compliance": "Positions may be measured before an elastic gear",
}
"""What to do about a cause, by its kind; of the geometry otherwise."""
LIKE_THE_BEST = 1.1  # error on left-out motion over the best cause's up to which one is as likely
INTO_TERMS = (
    'Add it to [model] terms (with friction = "auto", which takes no fixed law: list the laws '
    "that it chose there instead)"
)
ADD_TERM = f". {INTO_TERMS}"  # about a term that predicts left-out motion better
AS_LOGGED = (
    f" at the present effort scales, which change with it. {INTO_TERMS} only if the error as "
    "logged then falls"
)
"""What to do about it where scales of the efforts are estimated: errors of two models that divide
efforts by other scales cannot be compared."""
GEOMETRY_ADVICE = (
    "Check the joint zeros (position_offset in [signals]), then the lengths and axes in the model "
    "file, against the robot"
)


@case_check("model error")
def model_error_check(case: FittedCase) -> Iterable[Finding]:
    """Residuals over noise, and the causes in order, of all fitted runs together.

    Doubtful if an error of geometry or efforts stands out; nothing where residuals are noise and
    bounds hold, and in `validate`; of closed chains only what bounds show.
    """
    ranked = case.ranked
    if ranked is None:
        return _impossible(case)
    ratios, blamed = ranked.beside.ratios, _confirmed(case, ranked)
    if not blamed and not np.isfinite(ratios).any():
        errors = [score.pooled_percent or score.mean_percent for score in case.fitted_scores]
        error, run = max(errors, default=0.0), case.examined[0]
        if not error > LEAST_ERROR:
            return _impossible(case)
        says = (
            "residuals could not be compared with noise: the regression cut-off of "
            f"{run.matched_cutoff:g} Hz leaves no band above it at {run.rate:g} Hz, and the fitted "
            f"runs have errors up to {error:.0f} %"
        )
        return (Finding.ok(says, headline=True), *_impossible(case))
    if not blamed and float(np.nanmax(ratios)) < INCOMPLETE_RESIDUAL:
        return (*_periodic(case), *_impossible(case))
    zeros = _zeros(case, ranked)
    if not blamed and zeros is None:
        return (_remark(case, ranked),)
    return (_doubtful(case, ranked, blamed, zeros),)


def _confirmed(case: FittedCase, ranked: RankedCauses) -> tuple[Cause, ...]:
    """The causes to blame: shapes of a reading only if left-out motion confirms them, clearly.

    Nothing is blamed for residuals below the noise.
    """
    if np.isfinite(ranked.beside.ratios).any() and float(np.nanmax(ranked.beside.ratios)) < 1.0:
        return ()
    gains = dict(case.tested) if any(cause.of_reading for cause in ranked.blamed) else {}
    sure = {cause: gain for cause, gain in gains.items() if gain is not None and gain.confirmed}
    least = min((gain.after for gain in sure.values()), default=0.0)
    return tuple(
        cause
        for cause in ranked.blamed
        if not cause.of_reading or (cause in sure and sure[cause].after <= LIKE_THE_BEST * least)
    )


def _periodic(case: FittedCase) -> tuple[Finding, ...]:
    """An effort with a period, which raises the noise above the band too, if it is confirmed."""
    ranked = case.ranked
    if ranked is None or all(cause.kind != Cogging.law for cause in ranked.likely):
        return ()
    sure = [(gain.after, cause) for cause, gain in case.tested if gain and gain.confirmed]
    if not sure or min(sure, key=lambda one: one[0])[1].kind != Cogging.law:
        return ()
    return (Finding.ok(term_advice(case.tested, case.scales is not None), headline=True),)


def _impossible(case: FittedCase) -> tuple[Finding, ...]:
    """An error that residuals do not show, but bounds and valid inertias, as a note says."""
    notes = case.identified.estimate.notes if case.fitted and case.binding is None else ()
    found = (f"{note}; {INCOMPLETE}" for note in notes if note.endswith(TERM_MISSING))
    return tuple(Finding.ok(says, headline=True) for says in found)


def _remark(case: FittedCase, ranked: RankedCauses) -> Finding:
    """What stands beside the headline where no single error is to blame."""
    worst, tested = _worst(ranked.beside), case.tested
    says = f"{worst_residual_words(ranked.beside)}: {INCOMPLETE}"
    if not tested:
        says += ", or the noise varies slowly"
        brief = f"model incomplete, or the noise varies slowly: residuals {worst}"
        return Finding.ok(says, headline=True, brief=brief)
    named = ", ".join(_share(cause, gain) for cause, gain in tested)
    says += ". Share of the residuals above noise that each candidate alone explains "
    says += f"(not additive): {named}"
    parts = next((gain.left_out for _, gain in tested if gain is not None), None)
    if parts is not None:
        says += ". Errors on left-out motion: least squares without prior, cross-validation over "
        says += f"{parts}s"
    brief = f"model incomplete: residuals {worst}. {term_advice(tested, case.scales is not None)}"
    return Finding.ok(says, headline=True, brief=brief)


def _share(cause: Cause, gain: LeftOutGain | None) -> str:
    columns = f"{cause.columns} parameter" + "s" * (cause.columns != 1)
    text = f"{cause.says} {100.0 * cause.share:.0f} % by {columns}"
    if gain is None:
        return text
    confirmed = "" if gain.confirmed else ", not confirmed"
    return f"{text} (error on left-out motion {gain.words}{confirmed})"


def term_advice(tested: Sequence[tuple[Cause, LeftOutGain | None]], scaled: bool) -> str:
    """The candidate that reduces the error on left-out motion most, or that none is confirmed."""
    sure = [(gain.after, cause, gain) for cause, gain in tested if gain and gain.confirmed]
    if sure:
        _, cause, gain = min(sure, key=lambda one: one[0])
        falls = (
            f"With {cause.says} the error on left-out motion falls from {gain.before:.2g} to "
            f"{gain.after:.2g} % (least squares, fitted logs)"
        )
        rivals = [other.says for other, its in tested if its and its.after < gain.after]
        if rivals:
            return f"{falls}, and further with {rivals[0]}: the logs do not decide between them"
        if cause.of_friction:
            return f"{falls}{AS_LOGGED if scaled else ADD_TERM}"
        return f"{falls}. {CAUSE_ADVICE.get(cause.kind, GEOMETRY_ADVICE)}"
    (cause, found), *_ = tested
    most = (
        f"Of single causes {cause.says} would explain most, {100.0 * cause.share:.0f} % of the "
        "residuals above noise"
    )
    if found is None:
        return f"{most}: not tested on left-out motion, the logs are too short"
    more = 100.0 * (found.after / found.before - 1.0)
    way = "larger with it" if more >= 0.0 else "smaller with it"
    way += ", not significantly" if found.after < found.before else ""
    return f"{most}: not confirmed on left-out motion (error {abs(more):.0f} % {way})"


def _doubtful(
    case: FittedCase, ranked: RankedCauses, blamed: Sequence[Cause], zeros: tuple[str, Fix] | None
) -> Finding:
    first, *_ = blamed or ranked.found
    words = " or ".join(cause.says for cause in blamed)
    gain = dict(case.tested).get(first) if first.of_reading else None
    if gain is not None:
        words += f" (error on left-out motion {gain.words})"
    fix = Fix(CAUSE_ADVICE.get(first.kind, GEOMETRY_ADVICE))
    if zeros is not None:
        words, fix = zeros
    says = "a model error that the intervals of parameters do not cover"
    return Finding.doubtful(
        f"{worst_residual_words(ranked.beside)}: {says}, {words}",
        f"{100.0 * first.chi2 / ranked.total:.2g} % of chi²",
        joints=tuple(j for j in ranked.beside.joints if j == first.joint),
        fix=fix,
        brief=f"{words}: residuals {_worst(ranked.beside)}. {fix.says}",
    )


def _zeros(case: FittedCase, ranked: RankedCauses) -> tuple[str, Fix] | None:
    """Joint zeros that explain an error of the geometry, in words and as a line."""
    if not ranked.of_geometry:
        return None
    model = case.identified.model
    if ranked.blamed and ranked.blamed[0].kind == "zero_offset":
        offsets = estimated_offsets(model, case.examined)
        if offsets is not None and (far := far_offsets(offsets)).any():
            return f"zero offset of {offsets.words(far)}", offset_line(offsets, far)
    turned = turned_zeros(model, case.identified.estimate.sigma, case.fitted)
    return None if turned is None or turned.fix is None else (turned.says, turned.fix)


def _worst(beside: ResidualNoise) -> str:
    if not np.isfinite(beside.ratios).any():
        return "are not noise"
    joint = beside.joints[int(np.nanargmax(beside.ratios))]
    return f"up to {largest_residual(beside)} x noise (largest: {joint})"


UNSEEN_ERROR_FACTOR = 2.0  # RMS error over the fit's residuals for a reason to be looked for
FAR_UNSEEN_ERROR = 4.0  # the same from which on an error without explanation is reported
NEAR_OWN_ERROR, LEAST_LEFT_ERROR = 3.0, 3.0
"""An explanation leaves no more than so many times the residuals of the fit, or this misfit [%]."""
MOST_LEFT_ERROR, LEAST_ERROR_FALL = 20.0, 1.3
"""No explanation leaves more than this misfit [%], or lowers it by a smaller factor."""
FRICTION_ERROR_SHARE, LEFT_ERROR_SHARE = 0.5, 0.2
"""Friction and offsets fitted anew leave no more than `UNSEEN_ERROR_FACTOR` times the residuals of
the fit, or `LEAST_LEFT_ERROR`, and at most the first part of the error, for they lower that of any
log; or the second."""
RESTING_RESIDUAL = 1e-6  # relative to the largest, of a joint that was not fitted
WRONG_BODIES_ERROR = 30.0  # typical error [%] with friction fitted anew if bodies are wrong
TRIED_CAUSES = (
    "payload, joint zeros, signs, order, units, gains, delay, mounting, friction and offsets"
)
COMPARE_COMMAND = "steelyard check ROBOT LOG --model MODEL"  # compares explanations


@case_check("unseen log")
def unseen_reason_check(case: FittedCase) -> Iterable[Finding]:
    """The most likely reason of a large error on a log that was not fitted."""
    for run, score in zip(case.unseen, case.unseen_scores, strict=True):
        if score.errors.at_rest:
            continue
        ratio = excess_error(case.identified, score)
        found = _reason(case, run, score, ratio) if ratio > UNSEEN_ERROR_FACTOR else None
        if found is not None:
            yield replace(found, log=run.name)


def _sigma(identified: IdentifiedModel) -> Array:
    """Standard deviations of the fit's residuals, in the units of the joints' efforts."""
    return np.asarray(identified.estimate.sigma) / np.abs(np.asarray(identified.signals.gains))


def excess_error(identified: IdentifiedModel, score: RunScore) -> float:
    """RMS error of a run over the residuals of the fit, root mean square over joints that moved.

    Both are of the samples where a joint moves: at rest, friction has any value.
    """
    sigma = _sigma(identified)
    rmse = np.array([np.nan if j.rmse_moving is None else j.rmse_moving for j in score.joints])
    seen = (sigma > RESTING_RESIDUAL * sigma.max(initial=0.0)) & _moving(score)
    return float(np.sqrt(np.mean(np.square(rmse[seen] / sigma[seen])))) if seen.any() else 0.0


def _moving(score: RunScore) -> NDArray[np.bool_]:
    """Which joints move long enough to be compared, shape `(n,)`."""
    return np.array([joint.counted for joint in score.errors.joints])


def _reason(fit: FittedCase, run: Run, score: RunScore, ratio: float) -> Finding | None:
    identified, cutoffs = fit.identified, fit.identified.cutoffs
    # the run as `check` with this model looks at it
    processing = replace(
        identified.processing, motion_cutoff=cutoffs.motion, matched_cutoff=cutoffs.matched
    )
    log = CheckedLog(run.recording, processing, run.name)
    loaded = LoadedRobot(identified.model.robot, (), identified.signals)
    decision = judge_log(Case(loaded, (log,), identified), log)
    # geometric mean over joints that move of their relative error [%]: a misfit of `check`
    errors = np.array([joint.relative_percent_moving or 0.0 for joint in score.joints])
    typical = float(np.exp(np.mean(np.log(np.maximum(errors[_moving(score)], 1e-4)))))
    own = _own(identified, score)
    if decision is not None and decision.winners and _explains(decision, own):
        return _explained(fit, decision)
    if ratio < FAR_UNSEEN_ERROR or typical < LEAST_ERROR:
        return None
    times = f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"
    figure = f"RMS error {times} times the residuals of the fit, typical error {typical:.1f} %"
    left = typical if decision is None else _with_other_friction(decision.likelihood)
    enough = max(
        min(max(LEAST_LEFT_ERROR, UNSEEN_ERROR_FACTOR * own), FRICTION_ERROR_SHARE * typical),
        LEFT_ERROR_SHARE * typical,
    )
    if left <= min(enough, WRONG_BODIES_ERROR):
        return Finding.doubtful(
            "friction or offsets differ from those of the fitted logs: fitting them to this log "
            f"reduces the typical error from {typical:.1f} % to {left:.1f} %",
            figure,
            fix=Fix("Identify from logs at one temperature, or use terms with per_run = true"),
        )
    # constraints that the data contradict are a reason, which has its own finding
    return None if fit.binding is not None else _unexplained(fit, run, left, figure)


def _explains(decision: LogVerdict, own: float) -> bool:
    """Whether winners leave about what the fit left of its own runs; a zero does in few joints."""
    last, declared = decision.last, decision.declared
    small = last.percent <= min(max(LEAST_LEFT_ERROR, NEAR_OWN_ERROR * own), MOST_LEFT_ERROR)
    of_joints = any(hypothesis.cause == ZERO_CAUSE for hypothesis, _ in decision.winners)
    return small and (of_joints or last.percent * LEAST_ERROR_FALL <= declared.percent)


def _unexplained(fit: FittedCase, run: Run, left: float, figure: str) -> Finding:
    says = (
        f"no cause of the error was found; tested: {TRIED_CAUSES} ({left:.1f} % remain with "
        "the last)"
    )
    fitted = [run.name for run in fit.fitted] or fit.identified.provenance.runs
    if fit.unresolved:
        finding = fit.unresolved[0]
        says += f". The check before the fit was doubtful about {finding.log}: {finding.says}"
        return Finding.doubtful(says, figure, fix=Fix("Resolve that first"))
    if any(_one_file(run.name, name) for name in fitted):
        fix = Fix(f"`{COMPARE_COMMAND}` shows what was compared", command=COMPARE_COMMAND)
        return Finding.doubtful(says, figure, fix=fix)
    says += ". The log may come from another robot, or one that was modified"
    fix = Fix("Make sure that all logs are of one robot, or identify this one separately")
    severity = Severity.WRONG if left > WRONG_BODIES_ERROR else Severity.DOUBTFUL
    return Finding.of(severity, says, figure, fix=fix)


def _one_file(one: str, other: str) -> bool:
    """Whether two runs are windows of one file, as far as their names contain folders."""
    first, second = (f"/{name.partition('@')[0]}" for name in (one, other))
    return first.endswith(second) or second.endswith(first)


def _own(identified: IdentifiedModel, score: RunScore) -> float:
    """Typical misfit [%] that the fit left of its own runs, relative to this run's efforts.

    These are the smaller of measured and predicted ones: efforts may be logged in another unit.
    """
    predicted = np.sqrt(np.mean(np.square(score.traces.predicted), axis=0))
    measured = np.array([joint.predict_zero for joint in score.joints])
    shares = _sigma(identified) / np.maximum(np.minimum(measured, predicted), 1e-12)
    return 100.0 * float(np.exp(np.mean(np.log(np.maximum(shares, 1e-6)))))


def _explained(fit: FittedCase, decision: LogVerdict) -> Finding:
    """The winners as one sentence, and what is to be resolved before they can be trusted."""
    says = ", and ".join(hypothesis.says for hypothesis, _ in decision.winners)
    severity = max(severity for _, severity in decision.winners)
    first, names = decision.winners[0][0], decision.likelihood.names
    reason = f"most likely reason of the error: {says}"
    if fit.unresolved:
        severity, finding = Severity.DOUBTFUL, fit.unresolved[0]
        reason = (
            f"the check before the fit was doubtful about {finding.log}: {finding.says}. If the "
            f"robot file describes that log correctly, the {reason}"
        )
    fix = Fix(f"`{COMPARE_COMMAND}` shows the {first.cause}", command=COMPARE_COMMAND)
    if first.cause == "payload":
        ten = first.reading.payload
        less = ten is not None and ten[0] < 0.0
        fix = Fix(
            "`steelyard payload` says what is missing; validate on a log with the same tool and "
            "payload, or fit logs like this one"
            if less
            else "Identify it with `steelyard payload`, or validate on a log without payload",
            command="steelyard payload MODEL LOG",
        )
    elif first.cause == ZERO_CAUSE:
        (edit,) = zero_edits(decision.last.reading)
        line = f"If the robot's zeros confirm it, set position_offset = {edit.value} in [signals]"
        fix = Fix(f"{line} of this log's robot file", command=COMPARE_COMMAND)
    return Finding.of(
        severity,
        reason,
        f"misfit {decision.declared.percent:.1f} %, with this explanation "
        f"{decision.last.percent:.1f} %",
        tuple(names[j] for j in first.joints),
        fix,
    )


def _with_other_friction(likelihood: Likelihood) -> float:
    """Typical misfit [%] with friction and offsets fitted to the log; friction dissipates."""
    anew = with_unbounded_friction(likelihood)
    if likelihood.signals.effort_map is None:
        lower, upper = anew.bounds
        turned = np.diag(likelihood.declared.into_logged()) < 0.0
        lower[~turned, :2], upper[turned, :2] = 0.0, 0.0
    return anew.declared.percent
