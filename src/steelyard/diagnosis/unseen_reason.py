"""Why a model does not predict a log that it was not fitted to.

The log is read under the same explanations as in `check`, with the model as reference: a load, a
sign, an order, a unit, a gain, a delay, another mounting. What none of them explains is friction
that changed, if friction and offsets fitted to the log bring the error down, or else the bodies.
"""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.drift import unbounded
from steelyard.diagnosis.finding import Finding, Judgement, Mend
from steelyard.diagnosis.fitted_case import FittedCase
from steelyard.diagnosis.verdict import Verdict, verdict
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement.run import Run
from steelyard.robot.robot_file import LoadedRobot
from steelyard.robot.schema import EstimationSection, ProcessingSection, ValidationSection
from steelyard.validation.score import RunScore

ABOVE = 2.0
"""RMS error over the residuals of the fit from which on a reason is looked for."""

FAR = 4.0
"""The same from which on it is said where no explanation is found."""

LARGE = 10.0
"""Typical relative error [%] below which an error without explanation is not remarkable."""

NEAR, LEAST = 3.0, 3.0
"""An explanation leaves no more than so many times the residuals of the fit, or this misfit [%]."""

LEFT = 0.2
"""Or, of friction and offsets fitted anew, this part of the error."""

ADVICE = {
    "payload": "weigh it with `steelyard payload`, or validate on a log without load",
}
"""What to do about an explanation, by its cause."""


class UnseenReason:
    """The most likely reason of a large error on a log that was not fitted."""

    name: ClassVar[str] = "unseen log"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """At most one finding per unseen run."""
        found = []
        for run, score in zip(case.unseen, case.unseen_scores, strict=True):
            ratio = excess(case.identified, score)
            if ratio > ABOVE:
                found.append(_reason(case.identified, run, score, ratio))
        return tuple(finding for finding in found if finding is not None)


def excess(identified: IdentifiedModel, score: RunScore) -> float:
    """RMS error of a run over the residuals of the fit, root mean square over joints."""
    gains = np.abs(np.asarray(identified.signals.gains))
    sigma = np.asarray(identified.estimate.sigma) / gains
    rmse = np.array([joint.rmse for joint in score.joints])
    seen = sigma > 0.0
    return float(np.sqrt(np.mean(np.square(rmse[seen] / sigma[seen])))) if seen.any() else 0.0


def _reason(identified: IdentifiedModel, run: Run, score: RunScore, ratio: float) -> Finding | None:
    """The explanation that the data support, or that there is none."""
    case, evidence = _case_of(identified, run)
    held = verdict(case, evidence)
    typical = _typical(score)
    limit = _explained_limit(identified, score)
    if held is not None and held.winners and held.winners[-1][0].percent <= limit:
        return _explained(run, held)
    if ratio < FAR or typical < LARGE:
        return None
    times = f"{ratio:.0f}" if ratio >= 10.0 else f"{ratio:.1f}"
    figure = f"RMS error {times} times the residuals of the fit, typical error {typical:.1f} %"
    anew = None if held is None else _with_other_friction(held)
    if anew is not None and anew <= max(limit, LEFT * typical):
        return Finding(
            UnseenReason.name,
            run.name,
            Judgement.DOUBTFUL,
            "friction or offsets are not those of the fitted logs: fitted anew to this log, they "
            f"bring the typical error from {typical:.1f} % to {anew:.1f} %",
            figure,
            mend=Mend("identify from logs of one day and temperature, or give terms per_run"),
        )
    return Finding(
        UnseenReason.name,
        run.name,
        Judgement.WRONG,
        "this log does not fit the model, and neither a load, sign, order, unit, gain, delay, "
        "mounting nor other friction explains it: most likely another robot, or one that was "
        "changed",
        figure,
        mend=Mend("make sure that all logs are of one robot, or identify this one by itself"),
    )


def _explained_limit(identified: IdentifiedModel, score: RunScore) -> float:
    """Typical misfit [%] that an explanation may leave: about what the fit left of its own runs."""
    gains = np.abs(np.asarray(identified.signals.gains))
    size = np.array([max(joint.predict_zero, 1e-12) for joint in score.joints])
    shares = np.asarray(identified.estimate.sigma) / gains / size
    own = 100.0 * float(np.exp(np.mean(np.log(np.maximum(shares, 1e-6)))))
    return max(LEAST, NEAR * own)


def _explained(run: Run, held: Verdict) -> Finding:
    """The winners as one sentence."""
    causes = tuple(rival for rival, _ in held.winners)
    says = ", and ".join(rival.says for rival in causes)
    before, after = held.ranking.declared, causes[-1]
    first = causes[0].cause
    names = held.ranking.trial.knowledge.robot.joint_names
    return Finding(
        UnseenReason.name,
        run.name,
        max(judgement for _, judgement in held.winners),
        f"most likely reason of the error: {says}",
        f"misfit {before.percent:.1f} %, so explained {after.percent:.1f} %",
        tuple(names[j] for j in causes[0].joints),
        Mend(ADVICE.get(first, f"`steelyard check ROBOT LOG --model MODEL` shows the {first}")),
    )


def _with_other_friction(held: Verdict) -> float:
    """Typical misfit [%] with friction and offsets fitted to the log, whatever they come to."""
    trial = held.ranking.trial
    return float(unbounded(trial).score(trial.declared).percent[0])


def _typical(score: RunScore) -> float:
    """Geometric mean over joints of the relative error [%]: as a misfit of `check` is."""
    errors = [max(joint.relative_percent, 1e-4) for joint in score.joints]
    return float(np.exp(np.mean(np.log(errors))))


def _case_of(identified: IdentifiedModel, run: Run) -> tuple[Case, Evidence]:
    """The run as `check` with this model looks at it."""
    cutoffs = identified.cutoffs
    processing = replace(
        identified.processing, motion_cutoff=cutoffs.motion, matched_cutoff=cutoffs.matched
    )
    evidence = Evidence(run.recording, processing, run.name)
    loaded = LoadedRobot(
        identified.model.robot,
        (),
        identified.signals,
        None,
        False,
        ProcessingSection(),
        EstimationSection(),
        ValidationSection(),
        (),
        lambda *key: "the model",
    )
    return Case(loaded, (evidence,), identified), evidence
