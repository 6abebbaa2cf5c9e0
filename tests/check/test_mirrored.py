"""All efforts or all positions of the other sign are reported as two readings of one log."""

from dataclasses import replace

import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.hypotheses_and_their_scores import CLOSE_HYPOTHESES


def turned(arm: Arm, *patterns: str) -> Array:
    table = arm.table.copy()
    for pattern in patterns:
        table[:, arm.at(pattern)] *= -1.0
    return table


@pytest.mark.slow
@pytest.mark.parametrize(
    ("patterns", "cause", "other"),
    [
        (
            ("tau{}_Nm",),
            "effort sign",
            "or all positions have the opposite sign: both fit",
        ),
        (
            ("q{}_rad", "dq{}_rad_s"),
            "position sign",
            "or all efforts have the opposite sign: both fit",
        ),
    ],
)
def test_the_mirror_of_a_sign_is_named(
    six: Arm, patterns: tuple[str, ...], cause: str, other: str
) -> None:
    found = six.examined(turned(six, *patterns), known=False)
    (wrong,) = (f for f in found.findings if f.severity == Severity.WRONG)
    assert wrong.check == cause and other in wrong.says


def test_turned_efforts_come_first_where_turned_positions_fit_as_well(arm: Arm) -> None:
    case = arm.case(turned(arm, "tau{}_Nm"))
    found = ranking(case, case.logs[0])
    assert found is not None
    hypotheses = {r.says: r for r in found.rounds[0]}
    efforts, positions = (
        hypotheses["all efforts have the opposite sign"],
        hypotheses["all positions have the opposite sign"],
    )
    assert found.rounds[0][0] is efforts
    even = replace(positions, score=efforts.score)
    assert efforts.log_likelihood > even.log_likelihood + CLOSE_HYPOTHESES
