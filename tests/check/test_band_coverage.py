"""Bands of predicted efforts that hold less of unseen motion than they state."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted.post_fit_checks import band_coverage_check


def score(run: str, *shares: float, at_rest: bool = False) -> Any:
    """A score of which the bands of two joints hold such shares."""
    joints = tuple(SimpleNamespace(joint=name) for name in ("shoulder", "elbow"))
    traces = SimpleNamespace(coverage=np.array(shares) if shares else None)
    known = [share for share in shares if share == share]
    percent = 100.0 * float(np.mean(known)) if known else None
    errors = SimpleNamespace(at_rest=at_rest)
    return SimpleNamespace(
        run=run, joints=joints, traces=traces, errors=errors, coverage_percent=percent
    )


def found(*scores: Any) -> tuple[Finding, ...]:
    return band_coverage_check(cast(Any, SimpleNamespace(unseen_scores=scores)))


def test_bands_that_hold_enough_say_nothing() -> None:
    assert found() == found(score("run", 0.94, 0.9)) == found(score("run")) == ()
    assert found(score("run", 0.1, 0.1, at_rest=True)) == ()


def test_bands_that_hold_less_are_a_remark_with_the_worst_joint() -> None:
    (finding,) = found(score("run", 0.94, 0.58))
    assert finding.headline and finding.severity == Severity.OK and finding.log == "run"
    words = "the 95 % bands of efforts hold 76 % of the samples (fewest: elbow, 58 %)"
    assert finding.says.startswith(words)
    assert finding.brief == f"{words}: errors on other motion may be larger than stated"


def test_several_logs_are_one_remark_about_the_worst() -> None:
    (finding,) = found(score("a", 0.9, 0.8), score("b", np.nan, 0.6), score("c", 0.95, 0.95))
    assert finding.log == ""
    assert finding.says.startswith(
        "the 95 % bands of efforts hold 60 % of b (fewest: elbow, 60 %), less than 90 % in 2 of 3 "
        "logs"
    )
