"""What a report is made of; it looks at nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from steelyard.diagnosis import Diagnosis, Finding
    from steelyard.estimation.fields.fields import Finding as FieldFinding
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.estimation.least_squares.bootstrap import Bootstrap
    from steelyard.estimation.payload.gains import GainEstimate
    from steelyard.estimation.reduction.reduce import Reduction
    from steelyard.estimation.repeated import RepeatedEstimates
    from steelyard.estimation.zero_offset import ZeroOffsets
    from steelyard.excitation.result import Designed
    from steelyard.parameters import Parameters
    from steelyard.robot_file.excitation_sections import WorkspaceSection
    from steelyard.validation.comparison import Comparison
    from steelyard.validation.effort_scales import EffortScales
    from steelyard.validation.friction.friction import FrictionChoice
    from steelyard.validation.model_comparison import ModelComparison
    from steelyard.validation.score import RunScore
    from steelyard.validation.sensitivity import Sensitivity
    from steelyard.virtual.tracking import Tracking

Rows = Sequence[tuple[str, str]]
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
    qualities: tuple[tuple[str, Rows], ...] = ()
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
    files: Rows = ()
    only_errors: bool = False
    unscaled: tuple[RunScore, ...] = ()
