"""What the page of an identified model shows, the samples of its figures, logs and settings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from steelyard.base.arrays import Parameters
from steelyard.check.check_register_and_diagnosis import Diagnosis
from steelyard.check.finding import Finding
from steelyard.check.findings_page import findings_of
from steelyard.check.findings_text import diagnosis_dict
from steelyard.estimate.bootstrap_and_sensitivity import Bootstrap, RepeatedEstimates, Sensitivity
from steelyard.estimate.friction.friction_choice import FrictionChoice
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.nonlinear.effort_scales import EffortScales
from steelyard.estimate.nonlinear.nonlinear_parameters import Finding as FieldFinding
from steelyard.estimate.nonlinear.nonlinear_parameters import ZeroOffsets
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.reduction.reduction import Reduction
from steelyard.estimate.scores.bands_and_traces import TorqueParts
from steelyard.estimate.scores.score import RunScore
from steelyard.report.page import Numbers, PageContent, Section
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
    offsets: ZeroOffsets | None = None  # zero offsets of joints that were estimated, if any
    scales: EffortScales | None = None  # scales of the joints' efforts that were estimated, if any
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


class SettingsSection(
    Section, name="settings", title="Notes and settings", folded=True, template="settings.html"
):
    """What was assumed, and everything that is needed to make the same results again."""

    def numbers(self, content: PageContent) -> Numbers | None:
        """Notes, settings, runs, and hashes of the files."""
        notes = (*content.notes, *content.details)
        origin = content.identified.provenance if isinstance(content, ReportContent) else None
        if origin is not None:
            notes += origin.notes
        elif not content.settings and not notes:
            return None
        shown = tuple(dict.fromkeys(notes))
        return {"settings": content.settings, "origin": origin, "notes": shown}


LETTERS_OF_LONG_VALUE = 80  # from which on it stands below its run


class QualitySection(
    Section, name="quality", title="Data quality", folded=True, template="quality.html"
):
    """Rows, rates, gaps and dropped samples of every run."""

    def numbers(self, content: PageContent) -> Numbers | None:
        """One column per label, one row per run; long values stand below their run."""
        if not content.qualities:
            return None
        values = [value for _, found in content.qualities for value in found]
        long = dict.fromkeys(label for label, value in values if len(value) > LETTERS_OF_LONG_VALUE)
        labels = [
            label for label in dict.fromkeys(label for label, _ in values) if label not in long
        ]
        return {
            "labels": labels,
            "runs": [
                (
                    run,
                    [dict(found).get(label, "") for label in labels],
                    [(label, value) for label, value in found if label in long],
                )
                for run, found in content.qualities
            ],
        }


FEW = 40_000  # most points of all pictures of the evidence together


class CheckSection(Section, name="check", title="Check of the logs", template="findings.html"):
    """The verdict on the logs, and every finding; what is not ok with its picture."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The findings, if the logs were checked."""
        if content.diagnosis is None:
            return None
        return findings_of(content.diagnosis, FEW, fine=False)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The findings."""
        return {"check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis)}
