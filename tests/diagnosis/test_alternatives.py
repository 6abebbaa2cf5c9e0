"""Advice where gains and masses cannot be identified together."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.conftest import Arm
from steelyard.diagnosis.hypotheses.alternatives import ways


@pytest.mark.parametrize(("factor", "offered"), [(7e-4, True), (0.01, False), (1.0, False)])
def test_torques_in_thousandths_are_offered_their_gain(
    arm: Arm, factor: float, offered: bool
) -> None:
    reading = SimpleNamespace(effort_scale=np.full(3, factor))
    hypothesis = cast(Any, SimpleNamespace(cause="effort kind", interpretation=reading))
    says = ways(arm.case(arm.table), hypothesis, sure=True).says
    assert says.startswith("if efforts are in mNm, write gain = 0.001") == offered
    assert "gains and masses cannot be identified together" in says
