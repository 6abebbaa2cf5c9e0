"""Findings on scales, and on a term that explains more than the scales."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from steelyard.diagnosis.causes import Cause
from steelyard.diagnosis.finding import Finding, Severity
from steelyard.diagnosis.fitted import scaled_efforts
from steelyard.diagnosis.fitted.scaled_efforts import ScaledEfforts
from steelyard.estimation.effort_scales import Scales

FOUND = Scales(np.array([0.8, 1.05]), 0.05**2 * np.eye(2), np.zeros(0), 1.0, np.zeros(0))


def remark(monkeypatch: pytest.MonkeyPatch, *causes: Cause) -> str:
    """What the finding on `FOUND` says."""
    return found(monkeypatch, FOUND, *causes).says


def found(monkeypatch: pytest.MonkeyPatch, values: Scales, *causes: Cause) -> Finding:
    """The finding on scales beside which the causes are left, the most likely first."""
    monkeypatch.setattr(scaled_efforts, "can_be_ranked", lambda model: True)
    monkeypatch.setattr(scaled_efforts, "beginnings", lambda runs: runs)
    ranked = SimpleNamespace(found=causes)
    monkeypatch.setattr(scaled_efforts, "ranked_causes", lambda *given: ranked)
    scales = SimpleNamespace(
        joints=("a", "b"), found=values, half_width=1.96 * values.std * values.values
    )
    identified = SimpleNamespace(model=None, estimate=None)
    case = SimpleNamespace(scales=scales, identified=identified, fitted=(None,))
    (finding,) = ScaledEfforts()(cast(Any, case))
    return finding


def cause(kind: str, factor: float) -> Cause:
    """One that takes so many times what the scales take from chi square."""
    return Cause(kind, "", f"a {kind}", 2, factor * FOUND.distance, 0.5)


@pytest.mark.parametrize("kind", ["spring", "load_dependent"])
def test_a_term_that_looks_like_scales_is_named(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    says = remark(monkeypatch, cause(kind, 3.0), cause("gain", 2.0))
    assert "a 0.80" in says and f"a {kind} explains more than the scales" in says


def test_others_and_weaker_ones_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for causes in ((), (cause("spring", 0.9),), (cause("stribeck", 3.0), cause("spring", 2.0))):
        assert "explains more" not in remark(monkeypatch, *causes)


@pytest.mark.parametrize(("value", "doubtful"), [(1.25, False), (1.8, True), (0.5, True)])
def test_a_gain_that_is_far_off_is_doubtful(
    monkeypatch: pytest.MonkeyPatch, value: float, doubtful: bool
) -> None:
    scales = Scales(np.array([1.0, value]), 0.05**2 * np.eye(2), np.zeros(0), 1.0, np.zeros(0))
    finding = found(monkeypatch, scales)
    assert finding.headline and finding.severity == Severity(int(doubtful))
    assert finding.joints == (("b",) if doubtful else ())
    assert (finding.fix is not None) == doubtful
