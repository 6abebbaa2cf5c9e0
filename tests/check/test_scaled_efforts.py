"""Findings on scales, and on a term that explains more than the scales."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted.causes_of_residuals import Cause, LeftOutGain
from steelyard.check.fitted.post_fit_checks import scaled_efforts_check
from steelyard.estimate.nonlinear.effort_scales import Scales

Tested = tuple[Cause, LeftOutGain]
FOUND = Scales(np.array([0.8, 1.05]), 0.05**2 * np.eye(2), np.zeros(0), 1.0, np.zeros(0))


def remark(*tested: Tested) -> str:
    """What the finding on `FOUND` says."""
    return found(FOUND, *tested).says


def found(values: Scales, *tested: Tested) -> Finding:
    """The finding on scales beside which the causes are left, the most likely first."""
    joints = tuple("abcd"[: len(values.values)])
    known = SimpleNamespace(half_width=1.96 * values.std * values.values)
    scales = SimpleNamespace(joints=joints, found=values, known=known)
    case = SimpleNamespace(scales=scales, tested=tested)
    (finding,) = scaled_efforts_check(cast(Any, case))
    return finding


def cause(kind: str, factor: float, confirmed: bool = True) -> Tested:
    """One that takes so many times what the scales take from chi square, and its gain."""
    found = Cause(kind, "", f"a {kind}", (f"{kind}.a", f"{kind}.b"), factor * FOUND.distance, 0.5)
    return found, LeftOutGain(3.0, 2.0 if confirmed else 4.0, confirmed, "run")


@pytest.mark.parametrize("kind", ["spring", "load_dependent"])
def test_a_term_that_looks_like_scales_is_named(kind: str) -> None:
    says = remark(cause(kind, 3.0), cause("gain", 2.0))
    assert "a 0.80" in says and f"a {kind} explains more than the scales" in says
    assert "reduces the error on left-out motion (3 %, with it 2 %): add it" in says
    assert says.endswith("keep it if the error as logged falls")


def test_a_term_that_predicts_worse_is_not_recommended() -> None:
    says = remark(cause("spring", 3.0, confirmed=False))
    assert says.endswith("but is not confirmed on left-out motion")


def test_others_and_weaker_ones_are_not() -> None:
    for tested in ((), (cause("spring", 0.9),), (cause("stribeck", 3.0), cause("spring", 2.0))):
        assert "explains more" not in remark(*tested)


@pytest.mark.parametrize(("value", "doubtful"), [(1.25, False), (1.8, True), (0.5, True)])
def test_a_gain_that_is_far_off_is_doubtful(value: float, doubtful: bool) -> None:
    scales = Scales(np.array([1.0, value]), 0.05**2 * np.eye(2), np.zeros(0), 1.0, np.zeros(0))
    finding = found(scales)
    assert finding.headline and finding.severity == Severity(int(doubtful))
    assert finding.joints == (("b",) if doubtful else ())
    assert (finding.fix is not None) == doubtful


def test_a_joint_that_is_off_is_said_to_differ_from_the_others() -> None:
    values = np.array([1.0, 0.5, 1.01, 0.99])
    scales = Scales(values, 0.01**2 * np.eye(4), np.zeros(0), 1.0, np.zeros(0))
    brief = found(scales).brief
    assert brief.startswith("effort over what the efforts of the other joints imply: b 0.50")
    assert "a factor common to all joints looks like heavier links" in brief
