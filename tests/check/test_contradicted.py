"""Whether a log's own bodies speak for a delay that a nominal model suggests."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from steelyard.check.decision import judged_explanations
from steelyard.check.decision.judged_explanations import contradicted


@pytest.mark.parametrize(
    ("gain", "misfits", "expected"),
    [(90.0, (0.05, 0.3), True), (90.0, (0.9, 0.95), False), (10.0, (0.05, 0.3), False)],
)
def test_a_delay_must_be_likely_and_leave_clearly_less(
    gain: float, misfits: tuple[float, float], expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bodies(likelihood: float, misfits: tuple[float, float]) -> SimpleNamespace:
        score = SimpleNamespace(misfits=np.array(misfits), sharp=likelihood)
        return SimpleNamespace(score=score)

    before, after = object(), object()
    found = {before: bodies(0.0, (1.0, 1.0)), after: bodies(gain, misfits)}
    monkeypatch.setattr(judged_explanations, "consistent_bodies", lambda reading: found[reading])
    winner = SimpleNamespace(cause="effort delay", reading=after)
    assert contradicted(cast(Any, before), cast(Any, winner)) == expected
