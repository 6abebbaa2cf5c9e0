"""What a check of a fitted model looks at, and what every such check can do."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from steelyard.diagnosis.finding import Finding
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement.run import Run
from steelyard.regression.information import Information
from steelyard.validation.effort_scales import EffortScales
from steelyard.validation.score import RunScore


@dataclass(frozen=True, eq=False)
class FittedCase:
    """A fitted model with the runs that it is compared with.

    Attributes:
        identified: The model.
        fitted: Runs that were fitted; empty in `validate`.
        unseen: Runs that were not fitted.
        fitted_scores: One score per fitted run.
        unseen_scores: One score per unseen run.
        information: Information of the fitted runs on the base columns, by windows and runs;
            `None` in `validate`.
        unresolved: What the check before the fit is doubtful about in the fitted runs.
        scales: Scales of the efforts that were estimated, if any.
    """

    identified: IdentifiedModel
    fitted: tuple[Run, ...] = ()
    unseen: tuple[Run, ...] = ()
    fitted_scores: tuple[RunScore, ...] = ()
    unseen_scores: tuple[RunScore, ...] = ()
    information: Information | None = None
    unresolved: tuple[Finding, ...] = ()
    scales: EffortScales | None = None


class PostFitCheck(Protocol):
    """One check of a fitted model.

    Attributes:
        name: Of the check, as it is printed.
    """

    name: ClassVar[str]

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """Findings, the most severe first; those that are doubtful or wrong lower the verdict.

        A finding's `says` is one sentence for the headline, its `figure` the evidence.
        """
        ...
