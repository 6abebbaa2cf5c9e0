"""Whether the 95 % bands of predicted efforts hold as many samples of unseen motion as they state.

Bands are calibrated on left-out motion of the fitted logs. Where they hold clearly less of another
log, it differs from the fitted ones by more than these differ from each other.
"""

from typing import ClassVar

import numpy as np

from steelyard.diagnosis.finding import Finding, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.validation.headline import PROMISED
from steelyard.validation.score import RunScore


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
