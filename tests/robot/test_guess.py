from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.errors import LogError, ModelError
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.init.column_names import Column, words_of
from steelyard.robot.init.guess_columns import guess_columns, guess_signals, velocities_beside
from steelyard.robot.robot import Body, Coordinate, Limits, Robot

UR = tuple(
    Coordinate(f"{n}_joint", "revolute")
    for n in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)
TWO = (Coordinate("joint1", "revolute"), Coordinate("joint2", "revolute"))
MIXED = (
    Coordinate("lift_joint", "prismatic", Limits(0.0, 0.4)),
    Coordinate("arm_1_joint", "revolute"),
    Coordinate("arm_2_joint", "revolute"),
    Coordinate("gripper_joint", "prismatic", Limits(0.0, 0.03)),
)


def numbered(*stems: str, start: int = 1, count: int = 2) -> list[str]:
    return [stem.replace("#", str(k)) for stem in stems for k in range(start, start + count)]


def robot_of(coordinates: tuple[Coordinate, ...]) -> Robot:
    bodies = tuple(
        Body(c.name, c.name, c.kind, k - 1, np.eye(3), np.zeros(3), np.eye(3)[2], k,
             inertia=Inertia.zero())
        for k, c in enumerate(coordinates)
    )  # fmt: skip
    return Robot("robot", bodies, coordinates)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("current_arm1_A", "current arm 1 a"),
        ("tau_J_0", "tau j 0"),
        ("actualPosition[12]", "actual position 12"),
        ("q1(rad)", "q 1 rad"),
        ("tau1_Nm", "tau 1 nm"),
        ("current1_mA", "current 1 ma"),
    ],
)
def test_names_are_read_as_words(name: str, words: str) -> None:
    assert " ".join(words_of(name)) == words


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("timestamp", "time"),
        ("actual_q_0", "position"),
        ("dq3_rad_s", "velocity"),
        ("ddq3", "acceleration"),
        ("joint_torque_2", "effort"),
        ("i_3", "effort"),
        ("eff_panda_joint1", "effort"),
        ("TorqueCur1", "effort"),
        ("Cur1", "effort"),
        ("data.t", "time"),
        ("run/log/t", "time"),
        ("data.q_t_1", "position"),
        ("tool_t", None),
        ("target_q_0", None),
        ("tau_des1_Nm", None),
        ("q_d[3]", None),
        ("temperature1", None),
        ("x", None),
    ],
)
def test_quantities_by_words(name: str, quantity: str | None) -> None:
    assert Column(name).quantity == quantity


def test_numbered_columns_without_the_targets() -> None:
    columns = ["timestamp"]
    columns += numbered("target_q_#", "actual_q_#", "target_current_#", start=0, count=6)
    columns += numbered("actual_qd_#", "actual_current_#", start=0, count=6)
    guess = guess_columns(UR, columns)
    assert guess.section.time == "timestamp"
    assert guess.section.position == tuple(f"actual_q_{k}" for k in range(6))
    assert guess.section.effort.columns == tuple(f"actual_current_{k}" for k in range(6))
    assert (guess.section.effort.kind, guess.section.effort.unit) == ("motor_current", "A")
    assert guess.joints == tuple(c.name for c in UR)
    assert guess.velocity == tuple(f"actual_qd_{k}" for k in range(6))
    assert any("left out, as they are often late" in reason for reason in guess.reasons)


def test_numbers_count_all_joints_not_the_wrist() -> None:
    """`q1` is not wrist_1's."""
    guess = guess_columns(UR, ["t", *numbered("q#", "tau#", count=6)])
    assert guess.joints[0] == "shoulder_pan_joint" and guess.section.position == "q{}"


def test_names_of_joints_win_over_order() -> None:
    shuffled = [UR[k] for k in (3, 0, 5, 1, 4, 2)]
    columns = ["time", *(f"{c.name}_position" for c in shuffled)]
    columns += [f"effort.{c.name}" for c in shuffled]
    guess = guess_columns(UR, columns)
    assert guess.section.position == tuple(f"{c.name}_position" for c in UR)
    assert guess.section.effort.columns == tuple(f"effort.{c.name}" for c in UR)
    assert guess.section.effort.kind == "joint_torque"


def test_shortened_names_and_joints_without_columns() -> None:
    columns = ["time_s", "q_arm1", "q_lift", "current_arm1_A", "effort_lift_raw", "q_arm2"]
    guess = guess_columns(MIXED, columns)
    assert guess.joints == ("lift_joint", "arm_1_joint")
    assert guess.section.effort.unit == ("N", "A")
    assert guess.section.effort.columns == ("effort_lift_raw", "current_arm1_A")


def test_fingers_do_not_count() -> None:
    guess = guess_columns(MIXED, ["t", *numbered("q#", "tau#", count=3)])
    assert guess.joints == ("lift_joint", "arm_1_joint", "arm_2_joint")


def test_joint_torque_is_preferred_to_motor_columns() -> None:
    guess = guess_columns(TWO, ["t", *numbered("tau_motor#", "tau#", "q#")])
    assert guess.section.effort.columns == "tau{}"


def test_one_joint_needs_no_number() -> None:
    guess = guess_columns(TWO[:1], ["t", "q", "tau"])
    assert (guess.section.position, guess.section.effort.columns) == (("q",), ("tau",))


@pytest.mark.parametrize(
    ("step", "name", "unit"),
    [(0.01, "t", "s"), (10.0, "t", "ms"), (1e4, "t", "us"), (1e7, "t", "ns"), (0.01, "t_ms", "ms")],
)
def test_time_unit(step: float, name: str, unit: str) -> None:
    columns = [name, *numbered("q#", "tau#")]
    guess = guess_columns(TWO, columns, {name: step * np.arange(50.0)})
    assert guess.section.time_unit == unit


def test_time_must_rise() -> None:
    sample = {"t": np.sin(np.arange(50.0)), "timestamp": np.arange(50.0)}
    guess = guess_columns(TWO, ["t", "timestamp", *numbered("q#", "tau#")], sample)
    assert guess.section.time == "timestamp"


@pytest.mark.parametrize(
    ("stem", "reach", "unit"),
    [("q#", 1.5, None), ("q#", 120.0, "deg"), ("q#_deg", 1.0, "deg"), ("q#_rad", 90.0, None)],
)
def test_position_unit_by_name_then_range(stem: str, reach: float, unit: str | None) -> None:
    columns = numbered(stem)
    values = reach * np.sin(np.linspace(0.0, 6.0, 500))
    values[3:5] = 1e293, np.nan  # broken rows do not decide
    sample = {name: values for name in columns}
    guess = guess_columns(TWO, ["t", *columns, *numbered("tau#")], sample)
    assert guess.section.position_unit == unit


def test_efforts_that_state_no_quantity_are_named() -> None:
    stated = guess_columns(TWO, ["t", *numbered("q#", "effort#_Nm")])
    assert "side of the gears" in stated.reasons[2]
    unstated = guess_columns(TWO, ["t", *numbered("q#", "effort#")])
    assert "neither torque nor current" in unstated.reasons[2]


def test_millimetres_by_range() -> None:
    sample = {"lift_q": np.linspace(0.0, 350.0, 50), "arm_1_q": np.linspace(0.0, 1.0, 50)}
    guess = guess_columns(MIXED[:2], ["t", *sample, "lift_tau", "arm_1_tau"], sample)
    assert guess.section.position_unit == ("mm", "rad")


@pytest.mark.parametrize(
    ("stem", "reach", "unit"),
    [
        ("Cur#", 5.0, "A"),
        ("TorqueCur#", 5.0, "Nm"),
        ("i_#", 5.0, "A"),
        ("i_#", 5000.0, "mA"),
        ("current#_mA", 5.0, "mA"),
        ("tau#", 500.0, "Nm"),
    ],
)
def test_effort_unit(stem: str, reach: float, unit: str) -> None:
    columns = numbered(stem)
    sample = {name: reach * np.sin(np.arange(99.0)) for name in columns}
    guess = guess_columns(TWO, ["t", *numbered("q#"), *columns], sample)
    assert guess.section.effort.unit == unit


@pytest.mark.parametrize("names", ["field.name#", "name_#"])
def test_joints_that_columns_of_text_name(names: str) -> None:
    stem = names.replace("#", "").replace("name", "{}").replace("_", "[") + "#"
    columns = numbered(*(stem.format(w) for w in ("position", "velocity", "effort")), start=0)
    texts = numbered(names, start=0)
    named = {text: np.array([f"arm/joint{k}"]) for text, k in zip(texts, (2, 1), strict=True)}
    guess = guess_columns(TWO, ["t", *texts, *columns], named)
    assert guess.section.position == (columns[1], columns[0])
    assert guess.velocity == (columns[3], columns[2])
    assert guess.section.effort.columns == (columns[5], columns[4])
    assert "by the joints' names in the log's rows" in guess.reasons[1]
    named = {text: np.array([f"axis {k}"]) for k, text in enumerate(texts)}
    guess = guess_columns(TWO, ["t", *texts, *columns], named)
    assert guess.section.position == tuple(columns[:2])
    assert (
        "by their numbers, though the log calls them axis 0, axis 1: check it" in guess.reasons[1]
    )


def test_text_that_names_no_joint_leaves_names_of_columns() -> None:
    two = (Coordinate("base", "revolute"), Coordinate("elbow", "revolute"))
    columns = ["t", "base_state", "elbow_pos", "base_pos", "elbow_torque", "base_torque"]
    guess = guess_columns(two, columns, {"base_state": np.array(["running"])})
    assert guess.section.position == ("base_pos", "elbow_pos")
    assert "by the joints' names;" in guess.reasons[1]


def test_currents_of_one_robot_have_one_unit() -> None:
    sample = {f"i_{k}": reach * np.sin(np.arange(99.0)) for k, reach in ((1, 900.0), (2, 90.0))}
    guess = guess_columns(TWO, ["t", *numbered("q#"), *sample], sample)
    assert guess.section.effort.unit == "mA" and "whole numbers" not in guess.reasons[2]


def test_whole_numbers_of_currents_may_be_counts() -> None:
    wave = np.round(60.0 * np.sin(np.arange(99.0)))
    for stem, unit, unknown in (("i_#", "mA", True), ("i_#_A", "A", False)):
        sample = dict(zip(numbered(stem), (wave, np.zeros(99)), strict=True))
        guess = guess_columns(TWO, ["t", *numbered("q#"), *sample], sample)
        assert guess.section.effort.unit == unit
        assert ("the unit is not known" in guess.reasons[2]) == unknown


def test_numbers_count_joints_that_are_not_identified() -> None:
    every = (TWO[0], Coordinate("gripper_joint", "prismatic"), TWO[1])
    columns = ["t", *numbered("q#", "dq#", "tau#", count=3)]
    guess = guess_columns(TWO, columns, every=every)
    assert guess.joints == ("joint1", "joint2")
    assert guess.section.position == ("q1", "q3")
    assert guess.section.effort.columns == ("tau1", "tau3") and guess.velocity == ("dq1", "dq3")
    assert "other columns" not in guess.reasons[2]
    both = guess_columns(TWO, [*columns, *numbered("arm_q#", "arm_tau#")], every=every)
    assert both.section.position == "arm_q{}", "columns of the joints alone come first"


@pytest.mark.parametrize("stem", ["q#", "/joint_states/position/joint#", "joint#_pos"])
def test_efforts_that_are_missing_are_named(stem: str) -> None:
    words = "none look like the efforts of 2 joints"
    if "/" in stem:
        words = "messages of /joint_states have positions, but no values of efforts"
    with pytest.raises(LogError) as caught:
        guess_columns(TWO, ["t", *numbered(stem)])
    assert (
        words if "/" in stem else "none look like the efforts of 2 joints"
    ) in caught.value.wrong
    assert ("--beside OTHER" in caught.value.wrong) == ("/" not in stem)


def test_signals_of_a_robot_alone() -> None:
    signals, reasons = guess_signals(robot_of(TWO), ["t", *numbered("q#", "tau#")])
    assert signals.position == ("q1", "q2") and signals.effort == ("tau1", "tau2")
    assert len(reasons) == 3


def test_currents_need_a_robot_file() -> None:
    with pytest.raises(ModelError) as caught:
        guess_signals(robot_of(TWO), ["t", *numbered("q#", "current#_A")])
    assert "has no drive gain" in caught.value.wrong
    assert "steelyard init" in caught.value.where and "Nm/A" in caught.value.fix


def test_a_log_of_some_joints_needs_a_robot_file() -> None:
    columns = ["t", "q_arm1", "q_lift", "tau_arm1", "tau_lift"]
    with pytest.raises(LogError) as caught:
        guess_signals(robot_of(MIXED), columns)
    assert "none for arm_2_joint, gripper_joint" in caught.value.wrong
    assert "steelyard init" in caught.value.fix


def test_positions_of_motors_are_reported_with_what_they_need() -> None:
    with pytest.raises(LogError) as caught:
        guess_signals(robot_of(TWO), ["t", *numbered("q_motor#", "tau#")])
    assert 'coordinates = "motor"' in caught.value.fix
    assert "[robot.transmission] ratios" in caught.value.fix


def test_a_column_beside_currents_without_a_unit_is_named() -> None:
    guess = guess_columns(TWO, ["t", *numbered("q#"), "current1_A", "current2_A"])
    assert "but not of" not in guess.reasons[2]
    guess = guess_columns(MIXED[:2], ["t", "q_lift", "q_arm1", "effort_lift_raw", "current_arm1_A"])
    assert guess.section.effort.unit == ("N", "A")
    assert "not of effort_lift_raw: assumed in N; check unit and gain" in guess.reasons[2]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (numbered("q#", "tau#"), "no column looks like time"),
        (["t", *numbered("tau#")], "none look like the positions of 2 joints"),
        (
            ["t", *numbered("j#", "b#", "tau#")],
            'of 2 joints; if these are, write [signals] position = "j{}" or '
            '[signals] position = "b{}"',
        ),
        (
            ["t", *numbered("q#"), "b0", "b1", "x5"],
            'if these are, write [signals.effort] columns = ["b0", "b1"]',
        ),
        (["t", *numbered("q#")], "none look like the efforts of 2 joints"),
        (
            ["t", *numbered("q#", "tau#", count=3)],
            "3 columns look like positions (q1, q2, q3), but the robot model has 2 joints (",
        ),
        (
            ["t", *numbered("q#", "torque_counts#")],
            "efforts are in counts, which have no unit: torque_counts1",
        ),
    ],
)
def test_what_cannot_be_guessed_is_an_error(columns: list[str], words: str) -> None:
    with pytest.raises(LogError) as caught:
        guess_columns(TWO, columns)
    assert words in caught.value.wrong
    assert ", ".join(columns) in caught.value.where
    assert "[signals.effort] columns" in caught.value.fix


@pytest.mark.parametrize(
    ("position", "columns", "found"),
    [
        (("q1_rad", "q2_rad"), "q1_rad q2_rad dq2_rad_s dq1_rad_s", ("dq1_rad_s", "dq2_rad_s")),
        (("q_lift_m", "q_a1"), "dq_a1_rad_s dq_lift_m_s dq_a2", ("dq_lift_m_s", "dq_a1_rad_s")),
        (("actual_q_0",), "actual_qd_0 target_qd_0 actual_qd_1", ("actual_qd_0",)),
        (("elbow_position",), "elbow_velocity wrist_velocity", ("elbow_velocity",)),
        (("q1", "q2"), "dq1 tau1 tau2", ()),
        (("q1",), "dq1 qd1", ()),
    ],
)  # fmt: skip
def test_velocities_that_stand_beside_positions(
    position: tuple[str, ...], columns: str, found: tuple[str, ...]
) -> None:
    assert velocities_beside(position, columns.split()) == found


def test_efforts_that_change_are_preferred_and_others_listed() -> None:
    """As of a driver that leaves its torques at zero, and logs currents too."""
    columns = numbered("Torque#", "TorqueCur#", "Cur#")
    rows = np.sin(np.arange(99.0))
    sample = {name: 0.0 * rows if name.startswith("Torque#"[:-1]) else rows for name in columns}
    sample |= {name: rows for name in numbered("TorqueCur#")}
    guess = guess_columns(TWO, ["t", *numbered("q#"), *columns], sample)
    assert guess.section.effort.columns == "TorqueCur{}" and guess.section.effort.unit == "Nm"
    reason = next(reason for reason in guess.reasons if reason.startswith("efforts are"))
    assert "other columns that may be efforts: Torque{}, Cur{}: use them" in reason
    both = guess_columns(TWO, ["t", *numbered("q#", "current#", "tau#")])
    assert both.section.effort.columns == "tau{}"
    plain = guess_columns(TWO, ["t", *numbered("q#", "tau#")])
    assert not any("other columns" in reason for reason in plain.reasons)


def test_names_of_joints_behind_their_quantity() -> None:
    names = [f"panda_joint{k}" for k in (1, 2)]
    robot = tuple(replace(c, name=name) for c, name in zip(TWO, names, strict=True))
    columns = ["t", *(f"{what}_{name}" for what in ("pos", "eff") for name in reversed(names))]
    guess = guess_columns(robot, columns)
    assert guess.section.effort.columns == "eff_panda_joint{}"
    assert guess.section.position == "pos_panda_joint{}"


@pytest.mark.parametrize(("stem", "told"), [("goal_position_#", True), ("target_qd_#", False)])
def test_targets_of_positions_beside_efforts_are_told(stem: str, told: bool) -> None:
    guess = guess_columns(TWO, ["t", *numbered("q#", "tau#", stem)])
    assert any("targets are logged too" in reason for reason in guess.reasons) == told
