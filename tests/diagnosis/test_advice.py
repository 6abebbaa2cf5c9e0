"""The motion that is advised for parameters that no log shows."""

import pytest

from steelyard.diagnosis.identifiability import _advice
from steelyard.estimation.estimate import Unidentifiable


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (("stribeck.elbow",), "slow motion both ways of elbow"),
        (("lugre_damping.elbow", "dahl.wrist"), "reversals of elbow, wrist"),
        (("offset.elbow", "coulomb.elbow"), "motion both ways of elbow"),
        (("mx.arm", "Izz.arm"), "other postures of the joints up to arm; acceleration, in turn"),
    ],
)
def test_each_law_says_what_shows_it(names: tuple[str, ...], wanted: str) -> None:
    assert wanted in _advice([Unidentifiable(name) for name in names])
