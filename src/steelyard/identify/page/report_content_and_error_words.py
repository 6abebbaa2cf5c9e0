"""What the page of a model shows, as values, and errors of predicted efforts in words."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from statistics import fmean

from steelyard.base.arrays import Parameters
from steelyard.check.all_checks import Diagnosis
from steelyard.check.finding import Finding
from steelyard.estimate.friction.friction_choice import FrictionChoice
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import Finding as FieldFinding
from steelyard.estimate.nonlinear.nonlinear_parameters import ZeroOffsets
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
)
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.reduction.stopping_rules_and_reduction import Reduction
from steelyard.estimate.scores import effort_errors as errors_of
from steelyard.estimate.scores.parts_and_bands_along_run import TorqueParts
from steelyard.estimate.scores.score import JointScore, RunScore
from steelyard.report.page import PageContent
from steelyard.report.words import count, percent, significant


@dataclass(frozen=True, kw_only=True)
class ReportContent(PageContent):
    """Everything that the report of an identified, validated or reduced model shows."""

    identified: IdentifiedModel
    scores: tuple[RunScore, ...] = ()  # scores on runs that were not fitted
    fitted: tuple[RunScore, ...] = ()  # scores on the runs that were
    unscaled: tuple[RunScore, ...] = ()  # as `scores`, without estimated scales of efforts
    friction: FrictionChoice | None = None  # how the friction laws were chosen, if they were
    findings: tuple[FieldFinding, ...] = ()
    gains: GainEstimate | None = None
    zero_offsets: ZeroOffsets | None = None  # zero offsets of joints that were estimated, if any
    effort_scales: EffortScales | None = None  # estimated scales of the joints' efforts, if any
    diagnosis: Diagnosis | None = None  # what the logs were checked for before
    limitations: tuple[Finding, ...] = ()  # checks of the fitted model; they qualify the headline
    sensitivity: Sensitivity | None = None  # fits with other cut-offs, if they were asked for
    bootstrap: Bootstrap | None = None  # estimates of windows drawn again, if they were asked for
    repeated: RepeatedEstimates | None = None  # estimates from each log alone, if asked for
    reduction: Reduction | None = None  # how a model was made smaller, if it was
    before: tuple[RunScore, ...] = ()  # `scores` of the model that was made smaller
    truth: Parameters | None = None  # all standard parameters of a simulated robot
    logs: Mapping[str, str] = field(default_factory=dict)  # the log of each run, as it was given
    only_errors: bool = False  # whether the model's errors on logs are reported, and not its fit


def pooled_samples(content: ReportContent, first: str) -> tuple[TorqueParts, str] | None:
    """Samples of the `first` kind of runs, `fitted` or `validation`, else of the others; of which.

    `None` if no run has samples.
    """
    runs = (("validation", content.scores), ("fitted", content.fitted))
    for kind, scores in runs if first == "validation" else runs[::-1]:
        if known := [score.parts for score in scores if score.parts is not None]:
            return TorqueParts.joined(known), count(len(known), f"{kind} run")
    return None


MOVING, WHOLE = "where they move", "whole log"

RATIO = "‖measured − predicted‖ / ‖measured‖"  # the relative error in the validation band
NORMS = {"pooled": "over all joints together", "mean": "mean over joints"}  # in a sentence
MOST_NAMED_JOINTS = 3  # most joints that are named one by one
LEAST_LOAD = 0.01  # effort of a joint with load over the largest of its unit


@dataclass(frozen=True)
class RelativeError:
    """One relative error of one or more runs."""

    value: float  # mean over the runs [%]
    norm: str  # `pooled` or `mean`: norms over all joints together, or the mean of their errors
    joints: str  # over how many joints, like `6 joints`
    samples: str  # over which samples: `where they move` or `whole log`

    @property
    def kind(self) -> str:
        """Like `pooled over 7 joints, where they move`."""
        return f"{self.norm} over {self.joints}, {self.samples}"

    @property
    def words(self) -> str:
        """Like `1.5 % over all joints together, where they move`."""
        return f"{percent(self.value)} {NORMS[self.norm]}, {self.samples}"


def relative_errors(scores: Sequence[RunScore]) -> list[RelativeError]:
    """Relative errors of runs, the one to be judged by first.

    Pooled before mean, since a joint that carries hardly any load has a large relative error and
    rules a mean; where joints move before whole logs. A pooled error needs one unit of effort, one
    of motion a joint that moves: what some run does not have is left out. None without runs.
    """
    if not scores:
        return []
    each = list(zip(*(run.joints for run in scores), strict=True))
    moves = [any(x.relative_percent_moving is not None for x in joint) for joint in each]
    moving, every = _moving_words(sum(moves), len(each)), count(len(each), "joint")
    kinds: tuple[tuple[Callable[[RunScore], float | None], str, str, str], ...] = (
        (lambda s: s.pooled_percent_moving, "pooled", moving, MOVING),
        (lambda s: s.pooled_percent, "pooled", every, WHOLE),
        (lambda s: s.mean_percent_moving, "mean", moving, MOVING),
        (lambda s: s.mean_percent, "mean", every, WHOLE),
    )
    found = []
    for of, *kind in kinds:
        known = [value for value in map(of, scores) if value is not None]
        if known and len(known) == len(scores):
            found.append(RelativeError(fmean(known), *kind))
    return found


def error_words(errors: Sequence[errors_of.EffortError]) -> str:
    """Like `2.1 Nm: 3.8 % of the effort used`."""
    return "; ".join(f"{one} of the effort used" for one in _each(errors))


def _each(errors: Sequence[errors_of.EffortError]) -> list[str]:
    return [f"{significant(x.error, 2)} {x.unit}: {percent(x.percent_of_used)}" for x in errors]


def limit_words(errors: Sequence[errors_of.EffortError]) -> str:
    """Like `1.0 % of the joints' effort limits`; empty where that is unknown."""
    shares = [one.percent_of_limit for one in errors if one.percent_of_limit is not None]
    words = " and ".join(map(percent, shares))
    return f"{words} of the joints' effort limits" if shares else ""


def both_words(
    errors: Sequence[errors_of.EffortError], logged: Sequence[errors_of.EffortError]
) -> str:
    """The errors, with estimated scales of the efforts also those against efforts as logged."""
    if not logged:
        return error_words(errors)
    return f"{error_words(errors)}, as logged {', '.join(_each(logged))}"


def basis_words(scores: Sequence[RunScore]) -> str:
    """Like `RMS below 5 Hz, pooled over 6 joints, where they move, 12 to 18 s each`."""
    moving = {j.joint for run in scores for j in run.errors.joints if j.counted}
    joints = _moving_words(len(moving), sum(j.driven for j in scores[0].errors.joints))
    still = [run.errors.at_rest for run in scores]
    where = "at rest" if all(still) else f"{MOVING}, or all rest" if any(still) else MOVING
    band = below(run.errors.cutoff for run in scores)
    own = zip(*(run.errors.joints for run in scores), strict=True)
    sums = [sum(one.seconds for one in joint if one.counted) for joint in own]
    ends = dict.fromkeys(significant(s, 2) for s in (min(filter(None, sums)), max(sums)))
    return f"RMS {band}, pooled over {joints}, {where}, {' to '.join(ends)} s each"


def worse_joints(scores: Sequence[RunScore], limit: float) -> tuple[str, ...]:
    """Joints with an error above `limit` [% of the effort used], the worst first, with the error.

    Joints at rest are none of them. With estimated scales of the efforts, the larger of the errors
    with and without them counts.
    """
    if all(run.errors.at_rest for run in scores):
        return ()
    listed = []
    own = errors_of.of_joints([run.errors for run in scores])
    logged = errors_of.of_joints(errors_of.as_logged(run.errors for run in scores)) or own
    for joint, *both in zip(scores[0].joints, own, logged, strict=True):
        known = [one for one in both if one is not None]
        error = max(known, key=lambda one: one.percent_of_used, default=None)
        if error is not None and limit < round(error.percent_of_used, 1) < inf:
            share = percent(error.percent_of_used)
            share += "" if error is both[0] else " as logged"
            listed.append((error.percent_of_used, f"{joint.joint} {share}"))
    return tuple(words for _, words in sorted(listed, reverse=True))


def loaded_joints(scores: Sequence[RunScore]) -> list[errors_of.EffortError]:
    """Errors of the joints that move and carry load, over all runs; none of logs at rest."""
    if all(run.errors.at_rest for run in scores):
        return []
    known = [
        error for error in errors_of.of_joints([run.errors for run in scores]) if error is not None
    ]
    most = {one.unit: max(e.reference for e in known if e.unit == one.unit) for one in known}
    return [one for one in known if one.reference > LEAST_LOAD * most[one.unit]]


def without_percentage(scores: Sequence[RunScore]) -> list[str]:
    """Joints without a relative error: their measured effort is zero, or no number."""
    errors = errors_of.of_joints([run.errors for run in scores])
    each = zip(scores[0].joints, errors, strict=True)
    return [joint.joint for joint, x in each if x is not None and not isfinite(x.percent_of_used)]


def other_errors(scores: Sequence[RunScore]) -> str:
    """The relative errors in the validation band, as one sentence."""
    words = "; ".join(error.words for error in relative_errors(scores))
    band = below(run.cutoff for run in scores)
    return f"Relative error {RATIO} in logged units, in the validation band, {band}: {words}."


def reference_words(joints: Sequence[errors_of.JointError]) -> str:
    """Whose errors are relative to more than what the joint used in this log; empty if none's."""
    more = [one for one in joints if one.reference > one.used]
    raised = [f"{one.joint} {significant(one.reference)} {one.unit}" for one in more]
    if not raised:
        return ""
    return (
        "relative to a quarter of the effort used in the fitted runs, which is more than in this "
        f"log: {', '.join(raised)}"
    )


def coverage_words(inside: float, unseen: bool) -> str:
    """How much of a log lies in its 95 % bands [%], and whether that is less than they promise."""
    less = ": less than stated" if unseen and inside < errors_of.PROMISED else ""
    return f"{percent(inside)} of this log inside{less}"


def scale_words(
    identified: IdentifiedModel, scores: Sequence[RunScore], unscaled: Sequence[RunScore] = ()
) -> str:
    """By what measured efforts are divided before they are compared; empty without scales."""
    if identified.effort_scales is None or not scores:
        return ""
    without = ""
    if unscaled:
        pairs = list(zip(unscaled, scores, strict=True))
        fresh = [one for one, score in pairs if not score.repeats] or unscaled
        errors = error_words(errors_of.pooled(one.errors for one in fresh))
        without = f'. Without scales (effort_scales = "off" in [estimation]): {errors}'
    return (
        f"efforts divided by the estimated scale: {identified.effort_scales.words}; as logged: not "
        "divided by it. torque() of the model predicts the divided efforts, effort() the logged "
        f"ones{without}"
    )


def relative(joint: JointScore) -> float:
    """The error a joint is judged by: where it moves, or else over all samples [%]."""
    moving = joint.relative_percent_moving
    return joint.relative_percent if moving is None else moving


def below(cutoffs: Iterable[float]) -> str:
    """Like `below 4 and 5 Hz`: cut-offs of low-passes."""
    return f"below {' and '.join(f'{c:g}' for c in sorted(set(cutoffs)))} Hz"


def _moving_words(moving: int, joints: int) -> str:
    """Like `6 joints`, `the 5 of 6 joints that move`."""
    if moving < joints:
        return f"the {moving} of {joints} joints that move"
    return count(joints, "joint")
