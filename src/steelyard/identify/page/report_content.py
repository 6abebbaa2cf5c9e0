"""What the page of an identified, validated or reduced model shows, as values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
from steelyard.estimate.scores.parts_and_bands_along_run import TorqueParts
from steelyard.estimate.scores.score import RunScore
from steelyard.report.page import PageContent
from steelyard.report.words import count


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


def fitted_samples(content: ReportContent) -> tuple[TorqueParts, str] | None:
    """Samples of the fitted runs, else of the others, and what they are; or `None`."""
    return _pooled(content.fitted, "fitted") or _pooled(content.scores, "validation")


def unseen_samples(content: ReportContent) -> tuple[TorqueParts, str] | None:
    """Samples of runs that were not fitted, else of the others, and what they are."""
    return _pooled(content.scores, "validation") or _pooled(content.fitted, "fitted")


def _pooled(scores: Sequence[RunScore], kind: str) -> tuple[TorqueParts, str] | None:
    """The samples of several runs one after another."""
    known = [score.parts for score in scores if score.parts is not None]
    if not known:
        return None
    return TorqueParts.joined(known), count(len(known), f"{kind} run")
