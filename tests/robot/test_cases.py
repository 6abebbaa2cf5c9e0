"""Logs of people who do this job, as `init` reads them: the cases beside the data."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from steelyard.robot.init.draft_robot_file import Assignment, assigned, proposed
from steelyard.robot.init.guess_columns import Guess
from steelyard.runs.runs_of_named_logs import sample_of


@pytest.fixture
def read() -> Callable[[str, str], Assignment]:
    data = os.environ.get("STEELYARD_DATA")
    cases = Path(data or "").parent / "cases"
    if data is None or not cases.is_dir():
        pytest.skip("there is no folder cases beside the folder that STEELYARD_DATA names")

    def assignment(case: str, log: str) -> Assignment:
        if not (cases / case).is_dir():
            pytest.skip(f"the folder cases lacks {case}")
        columns, sample = sample_of(cases / case / log)
        return assigned(proposed(str(cases / case / "arm.urdf")), columns, sample)

    return assignment


def guess_of(assignment: Assignment) -> Guess:
    assert assignment.guess is not None, assignment.problem
    return assignment.guess


@pytest.mark.parametrize(
    ("case", "log", "time"),
    [
        ("sparse-rows", "log.csv", "__time"),
        ("duplicate-columns", "robot_data.csv", "timestamp"),
        ("text-time", "iso.csv", "t"),
        ("text-time", "secs.csv", "time_s"),
        ("gripper-column", "log.csv", "t"),
    ],
)
def test_six_joints_have_their_columns(
    read: Callable[[str, str], Assignment], case: str, log: str, time: str
) -> None:
    guess = guess_of(read(case, log))
    assert len(guess.joints) == 6
    assert (guess.section.time, guess.section.time_unit) == (time, "s")


def test_efforts_that_messages_lack_are_named(read: Callable[[str, str], Assignment]) -> None:
    assert "no values of efforts" in read("bag-empty-effort", "bag").problem


def test_columns_of_text_order_the_joints(read: Callable[[str, str], Assignment]) -> None:
    guess = guess_of(read("rostopic-names", "log.csv"))
    first = dict(zip(guess.joints, guess.section.position, strict=True))
    assert first["shoulder_joint"] == "field.position2"
    assert first["elbow_joint"] == "field.position0"


def test_counts_have_one_unit(read: Callable[[str, str], Assignment]) -> None:
    guess = guess_of(read("raw-counts", "run1.csv"))
    assert guess.section.effort.unit == "mA"
    assert "the unit is not known" in guess.reasons[2]


def test_an_axis_that_slides_with_mimic_partners_is_none_of_a_hand(
    read: Callable[[str, str], Assignment],
) -> None:
    guess = guess_of(read("psm-insertion", "run1.csv"))
    assert guess.joints == ("yaw", "pitch", "insertion")
    assert guess.section.effort.unit == ("Nm", "Nm", "N")
