"""Checks of a fitted model: what residuals, windows and runs say against the model or the logs.

They complete the checks before a fit: what they find qualifies the headline of `identify` and
`validate`. A new check is one file of this room and one entry of `POST_FIT`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from steelyard.diagnosis.finding import Finding
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement.run import Run
from steelyard.progress import Progress, silent, tell
from steelyard.regression.information import Information
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
    """

    identified: IdentifiedModel
    fitted: tuple[Run, ...] = ()
    unseen: tuple[Run, ...] = ()
    fitted_scores: tuple[RunScore, ...] = ()
    unseen_scores: tuple[RunScore, ...] = ()
    information: Information | None = None


class PostFitCheck(Protocol):
    """One check of a fitted model.

    Attributes:
        name: Of the check, as it is printed.
    """

    name: ClassVar[str]

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """Findings, the most severe first; only those that are doubtful or wrong qualify the model.

        A finding's `says` is one sentence for the headline, its `figure` the evidence.
        """
        ...


POST_FIT: tuple[PostFitCheck, ...] = ()


def examine_fit(
    case: FittedCase,
    progress: Progress = silent,
    checks: Sequence[PostFitCheck] | None = None,
) -> tuple[Finding, ...]:
    """The findings of all checks that are doubtful or wrong, the most severe first.

    Args:
        case: The fitted model and its runs.
        progress: Receives the name of every check.
        checks: Which to run; all that are registered if `None`.

    Raises:
        Stopped: `progress` asked to stop.
    """
    chosen = POST_FIT if checks is None else checks
    found: list[Finding] = []
    for number, check in enumerate(chosen):
        tell(progress, f"checking the fit: {check.name}", number, len(chosen))
        found += [finding for finding in check(case) if finding.judgement]
    return tuple(sorted(found, key=lambda finding: -finding.judgement))
