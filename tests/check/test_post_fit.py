"""Findings of checks after the fit: in the order of their severity, and in the headline."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np

from invented import single
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.post_fit_checks import FittedCase, assumed_gains_check, examine_fit
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.verdict_and_next_steps import Limitation, Verdict, verdict
from weighed import identified_of

CASE = FittedCase(cast(Any, None))


class Says:
    name: ClassVar[str] = "says"

    def __init__(self, severity: Severity) -> None:
        self.severity = severity

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        word = self.severity.word
        return (Finding("says", "run 1", self.severity, f"this is {word}", "3 Nm", (), Fix("A.")),)


def judged_by(limitations: tuple[Finding, ...]) -> Verdict:
    model = identified_of(single())
    return verdict(ReportContent("title", "robot", identified=model, limitations=limitations))


def test_what_is_ok_does_not_qualify_and_the_worst_comes_first() -> None:
    seen: list[str] = []
    case = cast(FittedCase, None)
    found = examine_fit(
        case,
        lambda event: bool(seen.append(event.phase)) or True,
        [Says(Severity.OK), Says(Severity.DOUBTFUL), Says(Severity.WRONG)],
    )
    assert [finding.severity for finding in found] == [Severity.WRONG, Severity.DOUBTFUL]
    assert len(seen) == 3


def test_a_limitation_lowers_the_level_and_stands_beside_the_headline() -> None:
    found = examine_fit(cast(FittedCase, None), checks=[Says(Severity.WRONG)])
    judged = judged_by(found)
    assert judged.level == "poor"
    text = "run 1: this is wrong (3 Nm). A."
    assert judged.limitations == (Limitation(text, text, "poor"),)
    short = replace(found[0], brief="wrong")
    (one,) = judged_by((short,)).limitations
    assert one == Limitation(text, "run 1: wrong", "poor")
    doubtful = examine_fit(cast(FittedCase, None), checks=[Says(Severity.DOUBTFUL)])
    assert judged_by(doubtful).level == "fair"


def test_a_remark_stands_beside_the_headline_and_leaves_the_level() -> None:
    remark = Finding("says", "", Severity.OK, "residuals are 2 x the noise", "", headline=True)
    plain = Finding("says", "", Severity.OK, "all is well", "")

    class Both:
        name: ClassVar[str] = "both"

        def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
            return plain, remark

    found = examine_fit(cast(FittedCase, None), checks=[Both()])
    assert found == (remark,)
    judged = judged_by(found)
    assert judged.level == judged_by(()).level
    text = "residuals are 2 x the noise"
    assert judged.limitations == (Limitation(text, text, "none"),)


def test_gains_that_logs_do_not_show_stand_in_the_headline() -> None:
    def found(assumed: tuple[bool, ...], gains: tuple[float, ...]) -> Finding:
        count = len(gains)
        known = (True, *(False,) * (count - 1))
        estimate = GainEstimate(
            tuple(f"j{k}" for k in range(count)),
            np.array(gains),
            ("Nm/A",) * count,
            np.zeros((count, count)),
            known,
            assumed,
            False,
            None,
            np.ones(count),
        )
        signals = SimpleNamespace(effort_units=("A",) * count, gains=np.array(gains))
        identified = SimpleNamespace(signals=signals, effort_scales=None)
        case = replace(CASE, identified=cast(Any, identified), gains=estimate)
        (finding,) = assumed_gains_check(case) or (Finding.ok("nothing"),)
        return finding

    none, one, most = (False,) * 3, (False, False, True), (False, True, True)
    assert found(none, (2.0, 3.0, 4.0)).says == "nothing"
    relative = found(none, (1.0, 3.0, 4.0))
    assert relative.headline and not relative.severity and "common factor" in relative.says
    single_one = found(one, (2.0, 3.0, 4.0))
    assert single_one.headline and not single_one.severity
    assert "the gain of j2 is assumed" in single_one.says
    assert found(most, (2.0, 3.0, 4.0)).severity is Severity.DOUBTFUL
