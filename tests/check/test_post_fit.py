"""Findings of checks after the fit: in the order of their severity, and in the headline."""

from dataclasses import replace
from typing import ClassVar, cast

from invented import single
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.post_fit_checks import FittedCase, examine_fit
from steelyard.identify.page.report_content import ReportContent
from steelyard.identify.page.verdict_and_next_steps import Limitation, Verdict, verdict
from weighed import identified_of


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
