"""Why a model does not predict a log that it was not fitted to.

The log is read under the same explanations as in `check`, with the model as reference: a load, a
sign, an order, a unit, a gain, a delay, another mounting, or else friction and offsets that
changed. What none of them explains has no known cause, and is reported so.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.check.case import Case, Evidence
from steelyard.check.decision.edits import zero_edits
from steelyard.check.decision.verdict import LogVerdict, judge_log
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.fitted_case import FittedCase, post_fit_check
from steelyard.check.hypotheses.likelihood import Likelihood
from steelyard.check.hypotheses.position_columns import ZERO_CAUSE
from steelyard.check.several_logs import with_unbounded_friction
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.scores.score import RunScore
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.runs.run import Run

UNSEEN_ERROR_FACTOR = 2.0
"""RMS error over the residuals of the fit from which on a reason is looked for."""

FAR_UNSEEN_ERROR = 4.0  # the same from which on an error without explanation is reported

LARGE_UNSEEN_ERROR = 10.0
"""Typical relative error [%] below which an error without explanation is not remarkable."""

NEAR_OWN_ERROR, LEAST_LEFT_ERROR = 3.0, 3.0
"""An explanation leaves no more than so many times the residuals of the fit, or this misfit [%]."""

MOST_LEFT_ERROR, LEAST_ERROR_FALL = 20.0, 1.3
"""No explanation leaves more than this misfit [%], or lowers it by a smaller factor."""
FRICTION_ERROR_SHARE, LEFT_ERROR_SHARE = 0.5, 0.2
"""Friction and offsets fitted anew leave no more than `UNSEEN_ERROR_FACTOR` times the residuals of
the fit, or `LEAST_LEFT_ERROR`, and at most the first part of the error, for they lower that of any
log; or the second."""

RESTING_RESIDUAL = 1e-6
"""Residual, relative to the largest, up to which a joint was not fitted as it did not move."""
WRONG_BODIES_ERROR = 30.0
"""Typical error [%] with friction and offsets fitted anew from which on bodies are wrong."""

TRIED_CAUSES = (
    "payload, joint zeros, signs, order, units, gains, delay, mounting, friction and offsets"
)

UNSEEN_ADVICE = {
    "payload": Fix(
        "Identify it with `steelyard payload`, or validate on a log without payload",
        command="steelyard payload MODEL LOG",
    ),
}
"""What to do about an explanation, by its cause."""

COMPARE_COMMAND = "steelyard check ROBOT LOG --model MODEL"
"""What shows the comparison of explanations."""


@post_fit_check("unseen log")
def unseen_reason_check(case: FittedCase) -> Iterable[Finding]:
    """The most likely reason of a large error on a log that was not fitted."""
    for run, score in zip(case.unseen, case.unseen_scores, strict=True):
        if score.errors.at_rest:
            continue
        ratio = excess_error(case.identified, score)
        found = _reason(case, run, score, ratio) if ratio > UNSEEN_ERROR_FACTOR else None
        if found is not None:
            yield found


def excess_error(identified: IdentifiedModel, score: RunScore) -> float:
    """RMS error of a run over the residuals of the fit, root mean square over joints that moved.

    Both are of the samples where a joint moves: at rest, friction has any value.
    """
    gains = np.abs(np.asarray(identified.signals.gains))
    sigma = np.asarray(identified.estimate.sigma) / gains
    rmse = np.array([np.nan if j.rmse_moving is None else j.rmse_moving for j in score.joints])
    seen = (sigma > RESTING_RESIDUAL * sigma.max(initial=0.0)) & _moving(score)
    return float(np.sqrt(np.mean(np.square(rmse[seen] / sigma[seen])))) if seen.any() else 0.0


def _reason(fit: FittedCase, run: Run, score: RunScore, ratio: float) -> Finding | None:
    """The explanation that the data support, or that there is none."""
    case, evidence = _case_of(fit.identified, run)
    decision = judge_log(case, evidence)
    typical, own = _typical(score), _own(fit.identified, score)
    if decision is not None and decision.winners and _explains(decision, own):
        return _explained(fit, run, decision)
    if ratio < FAR_UNSEEN_ERROR or typical < LARGE_UNSEEN_ERROR:
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
            log=run.name,
        )
    return _unexplained(fit, run, left, figure)


def _explains(decision: LogVerdict, own: float) -> bool:
    """Whether the winners bring the misfit down, to about what the fit left of its own runs.

    A zero offset does so in few joints, by which it was found.
    """
    last, declared = decision.last, decision.declared
    small = last.percent <= min(max(LEAST_LEFT_ERROR, NEAR_OWN_ERROR * own), MOST_LEFT_ERROR)
    of_joints = any(hypothesis.cause == ZERO_CAUSE for hypothesis, _ in decision.winners)
    return small and (of_joints or last.percent * LEAST_ERROR_FALL <= declared.percent)


def _unexplained(fit: FittedCase, run: Run, left: float, figure: str) -> Finding:
    """That no cause was found, and what is to be looked at first."""
    says = (
        f"no cause of the error was found; tested: {TRIED_CAUSES} ({left:.1f} % remain with "
        "the last)"
    )
    fix = Fix(f"`{COMPARE_COMMAND}` shows what was compared", command=COMPARE_COMMAND)
    fitted = [run.name for run in fit.fitted] or fit.identified.provenance.runs
    same = any(_one_file(run.name, name) for name in fitted)
    if fit.unresolved:
        finding = fit.unresolved[0]
        says += f". The check before the fit was doubtful about {finding.log}: {finding.says}"
        fix = Fix("Resolve that first")
    elif not same:
        says += ". The log may come from another robot, or one that was modified"
        fix = Fix("Make sure that all logs are of one robot, or identify this one separately")
    wrong = not same and not fit.unresolved and left > WRONG_BODIES_ERROR
    severity = Severity.WRONG if wrong else Severity.DOUBTFUL
    return Finding.of(severity, says, figure, fix=fix, log=run.name)


def _one_file(one: str, other: str) -> bool:
    """Whether two runs are windows of one file, as far as their names contain folders."""
    first, second = (f"/{name.partition('@')[0]}" for name in (one, other))
    return first.endswith(second) or second.endswith(first)


def _own(identified: IdentifiedModel, score: RunScore) -> float:
    """Typical misfit [%] that the fit left of its own runs, relative to this run's efforts.

    These are the smaller of measured and predicted ones: efforts may be logged in another unit.
    """
    gains = np.abs(np.asarray(identified.signals.gains))
    predicted = np.sqrt(np.mean(np.square(score.traces.predicted), axis=0))
    measured = np.array([joint.predict_zero for joint in score.joints])
    size = np.maximum(np.minimum(measured, predicted), 1e-12)
    shares = np.asarray(identified.estimate.sigma) / gains / size
    return 100.0 * float(np.exp(np.mean(np.log(np.maximum(shares, 1e-6)))))


def _explained(fit: FittedCase, run: Run, decision: LogVerdict) -> Finding:
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
    return Finding.of(
        severity,
        reason,
        f"misfit {decision.declared.percent:.1f} %, with this explanation "
        f"{decision.last.percent:.1f} %",
        tuple(names[j] for j in first.joints),
        _advice(decision, first.cause),
        log=run.name,
    )


def _advice(decision: LogVerdict, cause: str) -> Fix:
    """What to do about an explanation: of zeros the line, elsewhere a command."""
    if cause != ZERO_CAUSE:
        return UNSEEN_ADVICE.get(
            cause, Fix(f"`{COMPARE_COMMAND}` shows the {cause}", command=COMPARE_COMMAND)
        )
    (edit,) = zero_edits(decision.last.reading)
    says = f"If the robot's zeros confirm it, set position_offset = {edit.value} in [signals]"
    return Fix(f"{says} of this log's robot file", command=COMPARE_COMMAND)


def _with_other_friction(likelihood: Likelihood) -> float:
    """Typical misfit [%] with friction and offsets fitted to the log; friction dissipates."""
    anew = with_unbounded_friction(likelihood)
    if likelihood.signals.effort_map is None:
        lower, upper = anew.bounds
        turned = np.diag(likelihood.declared.into_logged()) < 0.0
        lower[~turned, :2], upper[turned, :2] = 0.0, 0.0
    return anew.declared.percent


def _typical(score: RunScore) -> float:
    """Geometric mean over joints that move of their relative error [%]: a misfit of `check`."""
    errors = np.array([joint.relative_percent_moving or 0.0 for joint in score.joints])
    return float(np.exp(np.mean(np.log(np.maximum(errors[_moving(score)], 1e-4)))))


def _moving(score: RunScore) -> NDArray[np.bool_]:
    """Which joints move long enough to be compared, shape `(n,)`."""
    return np.array([joint.counted for joint in score.errors.joints])


def _case_of(identified: IdentifiedModel, run: Run) -> tuple[Case, Evidence]:
    """The run as `check` with this model looks at it."""
    cutoffs = identified.cutoffs
    processing = replace(
        identified.processing, motion_cutoff=cutoffs.motion, matched_cutoff=cutoffs.matched
    )
    evidence = Evidence(run.recording, processing, run.name)
    loaded = LoadedRobot(identified.model.robot, (), identified.signals)
    return Case(loaded, (evidence,), identified), evidence
