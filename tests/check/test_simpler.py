"""A simpler explanation that fits as well keeps a likelier one from being sure."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from steelyard.check.decision.search_with_unknown_bodies import Explanation
from steelyard.check.decision.verdict_of_log import SIMPLER_FIT, _as_good


def explanation(log: float, percent: float, *costs: float) -> Explanation:
    changes = tuple(SimpleNamespace(cost=cost) for cost in costs)
    found: Any = SimpleNamespace(
        log=log, changes=changes, evidence=SimpleNamespace(percent=percent)
    )
    return cast(Explanation, found)


@pytest.mark.parametrize(
    ("one", "good"),
    [
        (explanation(-5.0, 9.0, 20.0), True),  # about as likely
        (explanation(-50.0, 7.8, 2.0), True),  # simpler, and fits as well
        (explanation(-50.0, 7.8, 5.0, 5.0), False),  # not simpler
        (explanation(-50.0, 1.01 * SIMPLER_FIT * 7.5, 2.0), False),  # fits worse
    ],
)
def test_what_is_as_good_as_the_best(one: Explanation, good: bool) -> None:
    assert _as_good(one, explanation(0.0, 7.5, 8.0)) is good
