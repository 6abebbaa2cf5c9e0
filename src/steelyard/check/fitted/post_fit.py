"""Checks of a fitted model in their order, with the short ones of its efforts and bands.

Bands are calibrated on left-out motion of the fitted logs. Where they hold clearly less of another
log, it differs from the fitted ones by more than these differ from each other.

They complete the checks before a fit: what they find qualifies the headline of `identify` and
`validate`. A new check is one file of this room and one entry of `POST_FIT`.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.finding import Finding, Fix, Severity, percent_of
from steelyard.check.fitted.change_in_run import ChangeInRun
from steelyard.check.fitted.fitted_case import FittedCase
from steelyard.check.fitted.fitted_case import PostFitCheck as PostFitCheck
from steelyard.check.fitted.gear_side import BelowNominal, RotorsAtZero
from steelyard.check.fitted.implausible import AbsurdBodies, LoadFriction
from steelyard.check.fitted.model_error import ModelError
from steelyard.check.fitted.runs_disagree import LastLink, RunsDisagree
from steelyard.check.fitted.unseen_reason import UnseenReason
from steelyard.estimate.estimate import Z95
from steelyard.estimate.scores.joint_errors import PROMISED
from steelyard.estimate.scores.score import RunScore
from steelyard.model.laws.load_dependent import LoadDependent
from steelyard.model.laws.spring import Spring


class BandCoverage:
    """Logs that were not fitted, of which the bands hold too little."""

    name: ClassVar[str] = "95 % bands"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """A remark for all logs together; of a log at rest, the headline says what it shows."""
        scores = [score for score in case.unseen_scores if not score.errors.at_rest]
        known = {score.run: score.coverage_percent for score in scores}
        below = {run: x for run, x in known.items() if x is not None and x < PROMISED}
        if not below:
            return ()
        worst = min(below, key=lambda run: below[run])
        score = next(score for score in scores if score.run == worst)
        several = len(scores) > 1
        where = f" of {worst}" if several else " of the samples"
        brief = f"the 95 % bands of efforts hold {below[worst]:.0f} %{where}{_fewest(score)}"
        if several:
            brief += f", less than {PROMISED:.0f} % in {len(below)} of {len(known)} logs"
        says = (
            f"{brief}: this motion differs from the fitted one by more than parts of that differ "
            "from each other; the model is incomplete there, or a parameter error shifts all "
            "samples"
        )
        log = "" if several else worst
        brief += ": errors on other motion may be larger than stated"
        return (Finding(self.name, log, Severity.OK, says, "", headline=True, brief=brief),)


def _fewest(score: RunScore) -> str:
    """The joint with the smallest share."""
    shares = score.traces.coverage
    if shares is None or len(shares) < 2:
        return ""
    worst = int(np.nanargmin(shares))
    return f" (fewest: {score.joints[worst].joint}, {100.0 * shares[worst]:.0f} %)"


LEAST_CLIPPED_SHARE = 0.002
"""Share of the values of all efforts from which on they are named."""


class ClippedEfforts:
    """Efforts at a limit in runs that were not fitted."""

    name: ClassVar[str] = "clipped efforts"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """A remark per run."""
        found = []
        for run in case.unseen:
            count = run.quality.marked.cut_off
            values = run.quality.rows * len(run.recording.signals.effort_units)
            if count > LEAST_CLIPPED_SHARE * values:
                says = (
                    f"{count} efforts ({percent_of(count / values)}) are saturated: the "
                    "error includes them, though the required effort was not measured there"
                )
                remark = Finding(self.name, run.name, Severity.OK, says, "", headline=True)
                found.append(remark)
        return tuple(found)


TERMS_LIKE_A_SCALE = (Spring.law, LoadDependent.law)
"""Terms whose efforts change with posture or load, as those of a wrong scale do."""

WRONG_SCALE = 1.3
"""Factor, either way, beyond the interval of a scale, from which on a gain is doubtful."""


class ScaledEfforts:
    """Scales of the efforts that differ from 1 by more than their interval."""

    name: ClassVar[str] = "effort scales"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding, if scales were estimated; doubtful if a gain is far off."""
        scales = case.scales
        if scales is None:
            return ()
        far = np.abs(np.log(scales.found.values)) > Z95 * scales.found.std
        values = zip(scales.joints, scales.found.values, scales.half_width, far, strict=True)
        off = [f"{joint} {x:.2f} ± {half:.2f}" for joint, x, half, is_far in values if is_far]
        listed = ", ".join(off) or "none significant by itself"
        beyond = np.abs(np.log(scales.found.values)) - Z95 * scales.found.std > np.log(WRONG_SCALE)
        wrong = tuple(j for j, is_wrong in zip(scales.joints, beyond, strict=True) if is_wrong)
        says = (
            f"a scale of the efforts is estimated per joint ({listed}): sensors or gains may be "
            "off by these factors, or a missing term may have the same effect. Masses are as "
            f"uncertain as the scales{_term_instead(case, scales.found.distance)}"
        )
        brief = (
            f"sensors or gains may be off, or a term missing: estimated scales {listed}"
            if off
            else "estimated scales of the efforts are used: together they differ significantly "
            "from 1, though none does by itself"
        )
        if not wrong:
            return (Finding(self.name, "", Severity.OK, says, "", headline=True, brief=brief),)
        fix = Fix(f"Check gain and unit of the effort of {', '.join(wrong)}")
        brief = f"{brief}. {fix.says}"
        return (
            Finding(
                self.name, "", Severity.DOUBTFUL, says, "", wrong, fix, headline=True, brief=brief
            ),
        )


def _term_instead(case: FittedCase, distance: float) -> str:
    """A term that looks like a scale and explains more of what is left beside them than they do.

    Args:
        case: The fitted model and its runs.
        distance: Of the scales from 1, squared, which is about what they take from chi square.
    """
    if not case.tested:
        return ""
    first, gain = case.tested[0]
    if first.kind not in TERMS_LIKE_A_SCALE or first.chi2 <= distance:
        return ""
    more = (
        f"; {first.says} explains more than the scales (reduces χ² by {first.chi2:.0f} in "
        f"addition to them, the scales by {distance:.0f})"
    )
    if gain is None or not gain.confirmed:
        return f"{more}, but is not confirmed on left-out motion"
    return (
        f"{more} and reduces the error on left-out motion ({gain.words}): add it, and keep it if "
        "the error as logged falls"
    )


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
    ClippedEfforts(),
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
