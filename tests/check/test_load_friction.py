"""Load-dependent friction that no gear has."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from steelyard.base.arrays import Parameters
from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted.implausible_estimates_and_gear_side import load_friction_check


def found(*values: float, std: float = 0.1, fitted: bool = True) -> tuple[Finding, ...]:
    """The check of a model with these coefficients, and other friction of 0.9 N m."""
    names = [*(f"load_dependent.joint_{k}" for k in range(1, len(values) + 1)), "coulomb.joint_1"]
    parameters = Parameters(names, ["1"] * len(values) + ["N m"], np.array([*values, 0.9]))
    estimate = SimpleNamespace(parameters=parameters, std=np.full(len(names), std))
    identified = SimpleNamespace(estimate=estimate)
    case = SimpleNamespace(identified=identified, fitted=(None,) if fitted else ())
    return load_friction_check(cast(Any, case))


def test_friction_as_of_gears_is_not_named() -> None:
    assert found(0.0, 0.2, 0.49) == ()
    assert found(0.8, fitted=False) == ()


def test_what_the_data_do_not_identify_is_named_beside_others_only() -> None:
    assert found(0.2, 0.8, std=0.5) == ()
    (finding,) = found(0.8, 1.2, std=0.5)
    assert finding.joints == ("joint_1", "joint_2")


@pytest.mark.parametrize(("std", "severity"), [(0.1, Severity.DOUBTFUL), (0.3, Severity.OK)])
def test_more_is_named_with_interval_and_efficiency(std: float, severity: Severity) -> None:
    (finding,) = found(0.1, 0.8, std=std)
    assert finding.severity == severity and finding.headline
    assert finding.joints == ("joint_2",)
    words = f"joint_2 0.80 ± {1.96 * std:.2g} (efficiency 56 %)"
    assert words in finding.says and words in finding.brief
    for text in (finding.says, finding.brief.lower()):
        assert "gain or gear ratio is wrong, a term is missing" in text
