"""The motion that is advised for parameters that no log shows."""

import pytest

from steelyard.check.fitted.implausible_estimates_and_gear_side import _advice
from steelyard.estimate.estimate import Unidentifiable


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (("stribeck.elbow",), "slow motion in both directions of elbow"),
        (("lugre_damping.elbow", "dahl.wrist"), "reversals of elbow, wrist"),
        (("offset.elbow", "coulomb.elbow"), "motion in both directions of elbow"),
        (
            ("mx.arm", "Izz.arm"),
            "other configurations of the joints up to arm; acceleration, one by one",
        ),
    ],
)
def test_each_law_says_what_shows_it(names: tuple[str, ...], wanted: str) -> None:
    assert wanted in _advice([Unidentifiable(name) for name in names])
