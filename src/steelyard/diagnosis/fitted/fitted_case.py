"""What a check of a fitted model looks at, and what every such check can do."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

from steelyard.diagnosis.causes import Cause
from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.left_out_gain import LeftOutGain, left_out_gains
from steelyard.diagnosis.ranked_causes import Ranked, beginnings, can_be_ranked, ranked_causes
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

    @cached_property
    def examined(self) -> tuple[Run, ...]:
        """The fitted runs as far as causes of their residuals are looked for."""
        return beginnings(self.fitted)

    @cached_property
    def ranked(self) -> Ranked | None:
        """Causes of the residuals of fitted runs; `None` in `validate`, and of closed chains."""
        model = self.identified.model
        if not self.fitted or not can_be_ranked(model):
            return None
        return ranked_causes(model, self.identified.estimate, self.examined)

    @cached_property
    def tested(self) -> tuple[tuple[Cause, LeftOutGain | None], ...]:
        """The likely causes with their gain on left-out motion; `None` of logs too short for it."""
        ranked = self.ranked
        if ranked is None or not ranked.likely:
            return ()
        model, sigma = self.identified.model, self.identified.estimate.sigma
        gains = left_out_gains(model, ranked.wide, sigma, self.examined, ranked.likely)
        return tuple(zip(ranked.likely, gains or (None,) * len(ranked.likely), strict=True))


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
