"""What a fit says of choices that its robot file made: a search that has not ended, standstill."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from steelyard.check.finding import Severity
from steelyard.check.fitted.post_fit_checks import standstill_check, unfinished_search_check


@pytest.mark.parametrize(("best", "severity"), [(2.0, [Severity.DOUBTFUL]), (0.052, [])])
def test_a_genetic_search_far_from_least_squares_is_doubtful(
    best: float, severity: list[Severity]
) -> None:
    evolution = SimpleNamespace(best=np.array([9.0, best]), least_squares=0.05)
    case: Any = SimpleNamespace(identified=SimpleNamespace(estimate=SimpleNamespace()))
    case.identified.estimate.evolution = evolution
    found = list(unfinished_search_check.look(case))
    assert [one.severity for one in found] == severity
    assert all("40.0 times" in one.says and one.headline for one in found)
    case.identified.estimate.evolution = None
    assert not list(unfinished_search_check.look(case))


@pytest.mark.parametrize(("rest", "said"), [(0.0, 1), (0.01, 0)])
def test_samples_at_standstill_are_said_to_be_fitted(rest: float, said: int) -> None:
    case: Any = SimpleNamespace(fitted=(SimpleNamespace(rest_speed=np.full(2, rest)),))
    found = list(standstill_check.look(case))
    assert len(found) == said and all("standstill" in one.brief for one in found)
