"""Checks of a fitted model: what residuals, windows and runs say against the model or the logs.

They complete the checks before a fit: what they find qualifies the headline of `identify` and
`validate`. A new check is one file of this room and one entry of `POST_FIT`.
"""

from collections.abc import Sequence

from steelyard.diagnosis.finding import Finding
from steelyard.diagnosis.fitted.absurd import AbsurdBodies
from steelyard.diagnosis.fitted.band_coverage import BandCoverage
from steelyard.diagnosis.fitted.below_nominal import BelowNominal
from steelyard.diagnosis.fitted.change_in_run import ChangeInRun
from steelyard.diagnosis.fitted.clipped import Clipped
from steelyard.diagnosis.fitted.fitted_case import FittedCase as FittedCase
from steelyard.diagnosis.fitted.fitted_case import PostFitCheck as PostFitCheck
from steelyard.diagnosis.fitted.last_link import LastLink
from steelyard.diagnosis.fitted.load_friction import LoadFriction
from steelyard.diagnosis.fitted.model_error import ModelError
from steelyard.diagnosis.fitted.rotors_at_zero import RotorsAtZero
from steelyard.diagnosis.fitted.runs_disagree import RunsDisagree
from steelyard.diagnosis.fitted.scaled_efforts import ScaledEfforts
from steelyard.diagnosis.fitted.unseen_reason import UnseenReason
from steelyard.progress import Progress, report_progress, silent

POST_FIT: tuple[PostFitCheck, ...] = (
    AbsurdBodies(),
    RunsDisagree(),
    ChangeInRun(),
    RotorsAtZero(),
    ModelError(),
    ScaledEfforts(),
    LoadFriction(),
    LastLink(),
    BelowNominal(),
    UnseenReason(),
    BandCoverage(),
    Clipped(),
)


def examine_fit(
    case: FittedCase,
    progress: Progress = silent,
    checks: Sequence[PostFitCheck] | None = None,
) -> tuple[Finding, ...]:
    """The findings that are doubtful, wrong or for the headline, the most severe first.

    Args:
        case: The fitted model and its runs.
        progress: Receives the name of every check.
        checks: Which to run; all that are registered if `None`.

    Raises:
        Stopped: `progress` requested a stop.
    """
    chosen = POST_FIT if checks is None else checks
    found: list[Finding] = []
    for number, check in enumerate(chosen):
        report_progress(progress, f"checking the fit: {check.name}", number, len(chosen))
        found += [finding for finding in check(case) if finding.severity or finding.headline]
    return tuple(sorted(found, key=lambda finding: -finding.severity))
