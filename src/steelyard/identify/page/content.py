"""What the page of an identified model shows, and the samples that its figures draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from steelyard.estimate.scores.residuals import TorqueParts
from steelyard.report.words import count

if TYPE_CHECKING:
    from steelyard.base.arrays import Parameters
    from steelyard.check.examine import Diagnosis
    from steelyard.check.finding import Finding
    from steelyard.estimate.estimate_scatter import Bootstrap, RepeatedEstimates, Sensitivity
    from steelyard.estimate.friction.friction_choice import FrictionChoice
    from steelyard.estimate.identified import IdentifiedModel
    from steelyard.estimate.nonlinear.effort_scales import EffortScales
    from steelyard.estimate.nonlinear.fields import Finding as FieldFinding
    from steelyard.estimate.nonlinear.zero_offset import ZeroOffsets
    from steelyard.estimate.payload.drive_gains import GainEstimate
    from steelyard.estimate.reduction.reduction import Reduction
    from steelyard.estimate.scores.estimator_advice import Comparison
    from steelyard.estimate.scores.model_comparison import ModelComparison
    from steelyard.estimate.scores.score import RunScore
    from steelyard.excite.designed import Designed
    from steelyard.robot.file.excitation_sections import WorkspaceSection
    from steelyard.simulate.track import Tracking


LabelledValues = Sequence[tuple[str, str]]
"""Labels and values, ready to be read."""


@dataclass(frozen=True)
class ReportContent:
    """Everything that a report shows.

    Attributes:
        title: What the page is called.
        robot: The robot's name.
        identified: The model; `None` if there is none to show.
        scores: Scores on runs that were not fitted.
        fitted: Scores on the runs that were.
        qualities: Per run its name and what was found in its log.
        notes: What was assumed or is doubtful, for people to read.
        details: What else was decided on the way, such as cut-offs and corrected rows.
        settings: What the results depend on.
        friction: How the friction laws were chosen, if they were.
        findings: Fields of terms that were found.
        gains: Drive gains that were found, if any.
        offsets: Zero offsets of joints that were estimated, if any.
        scales: Scales of the joints' efforts that were estimated, if any.
        diagnosis: What the logs were checked for before.
        limitations: What checks of the fitted model found; they qualify the headline.
        sensitivity: Fits with other cut-offs, if they were asked for.
        bootstrap: Estimates of windows drawn again, if they were asked for.
        repeated: Estimates from each log alone, if they were asked for.
        comparison: Estimators beside each other, if they were compared.
        models: Identified models side by side, if they were compared.
        reduction: How a model was made smaller, if it was.
        before: Scores of the model that was made smaller, on the runs that were not fitted.
        design: A motion, if one was designed.
        tracking: A motion run under several controllers, if it was.
        truth: All standard parameters of a simulated robot; `None` of a real one.
        workspace: Where its tool may be, drawn with its path; `None` if none is given.
        logs: The log of each run, as it was given.
        files: What was written beside the page, and the files' names.
        only_errors: Whether the model's errors on logs are reported, and not its fit.
        unscaled: Scores on the same runs of the model without scales of the efforts, where they
            were estimated.
    """

    title: str
    robot: str
    identified: IdentifiedModel | None = None
    scores: tuple[RunScore, ...] = ()
    fitted: tuple[RunScore, ...] = ()
    qualities: tuple[tuple[str, LabelledValues], ...] = ()
    notes: tuple[str, ...] = ()
    details: tuple[str, ...] = ()
    settings: tuple[tuple[str, str], ...] = ()
    friction: FrictionChoice | None = None
    findings: tuple[FieldFinding, ...] = ()
    gains: GainEstimate | None = None
    offsets: ZeroOffsets | None = None
    scales: EffortScales | None = None
    diagnosis: Diagnosis | None = None
    limitations: tuple[Finding, ...] = ()
    sensitivity: Sensitivity | None = None
    bootstrap: Bootstrap | None = None
    repeated: RepeatedEstimates | None = None
    comparison: Comparison | None = None
    models: ModelComparison | None = None
    reduction: Reduction | None = None
    before: tuple[RunScore, ...] = ()
    design: Designed | None = None
    tracking: Tracking | None = None
    truth: Parameters | None = None
    workspace: WorkspaceSection | None = None
    logs: Mapping[str, str] = field(default_factory=dict)
    files: LabelledValues = ()
    only_errors: bool = False
    unscaled: tuple[RunScore, ...] = ()


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
    pooled = TorqueParts(
        t=np.concatenate([one.t for one in known]),
        q=np.concatenate([one.q for one in known]),
        dq=np.concatenate([one.dq for one in known]),
        moving=np.concatenate([one.moving for one in known]),
        measured=np.concatenate([one.measured for one in known]),
        parts=np.concatenate([one.parts for one in known], axis=1),
    )
    return pooled, count(len(known), f"{kind} run")
