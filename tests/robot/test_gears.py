"""Transmissions, and signals of the motors' side, against matrices worked out by hand."""

import json

import numpy as np
import pytest

from steelyard.base.arrays import json_values
from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import build_transmission
from steelyard.robot.file.sections import EffortSection, SignalsSection, TransmissionSection
from steelyard.robot.file.signals import Signals, signals_from_dict
from steelyard.robot.file.signals_from_tables import build_signals
from steelyard.robot.robot import Coordinate, Transmission

JOINTS = ("elbow", "wrist")
COORDINATES = tuple(Coordinate(name, "revolute") for name in JOINTS)
WRIST = np.array([[50.0, 0.0], [40.0, -40.0]])


def place(*keys: object) -> str:
    return " ".join(map(str, keys))


def gears(**given: object) -> Transmission:
    return build_transmission(TransmissionSection.model_validate(given), JOINTS, place)


def signals(
    transmission: Transmission | None, effort: dict[str, object] | None = None, **given: object
) -> Signals:
    effort_keys = {"columns": "e{}", "kind": "motor_torque", "unit": "Nm", "side": "motor"}
    section = SignalsSection.model_validate(
        {"time": "t", "position": "q{}", "effort": {**effort_keys, **(effort or {})}, **given}
    )
    return build_signals(section, COORDINATES, place, transmission)


def test_ratios_are_the_diagonal_and_couplings_come_on_top() -> None:
    plain = gears(ratios=[50, -40])
    assert plain.motors == ("motor_1", "motor_2") and not plain.coupled
    np.testing.assert_array_equal(plain.matrix, [[50.0, 0.0], [0.0, -40.0]])
    coupling = [
        {"motor": "b", "joint": "elbow", "ratio": 30.0},
        {"motor": "b", "joint": "elbow", "ratio": 10.0},
    ]
    coupled = gears(motors=["a", "b"], ratios=[50, -40], coupling=coupling)
    assert coupled.motors == ("a", "b") and coupled.coupled
    np.testing.assert_array_equal(coupled.matrix, WRIST)


def test_a_matrix_may_be_given_whole_and_coupled_further() -> None:
    np.testing.assert_array_equal(gears(matrix=WRIST.tolist()).matrix, WRIST)
    extra = [{"motor": "motor_1", "joint": "wrist", "ratio": 2.0}]
    found = gears(matrix=WRIST.tolist(), coupling=extra).matrix
    np.testing.assert_array_equal(found, WRIST + [[0.0, 2.0], [0.0, 0.0]])


ERRORS = {
    "idle motor": ({"ratios": [50, 0]}, "cannot be inverted: 'motor_2' turns no joint",
                   "robot transmission", "every motor must turn some joint"),
    "twins": ({"matrix": [[50, 10], [-100, -20]]}, "motor_1, motor_2 turn with the same "
              "combinations of joints", "robot transmission", "check ratios, coupling and matrix"),
    "nearly twins": ({"matrix": [[50, 10], [50, 10.0000001]]}, "cannot be inverted: motor_1",
                     "robot transmission", "no combination of joints"),
    "both": ({"ratios": [1, 2], "matrix": [[1, 0], [0, 1]]}, "ratios or a matrix, one of them",
             "robot transmission", "matrix = [[...], ...]"),
    "neither": ({}, "ratios or a matrix, one of them", "robot transmission", "ratios = [...]"),
    "too few ratios": ({"ratios": [1]}, "1 ratios are given for 2 joints", "transmission ratios",
                       "one ratio per identified joint"),
    "too few rows": ({"matrix": [[1, 0]]}, "the transmission matrix is not 2 x 2", "matrix",
                     "one row per motor"),
    "short row": ({"matrix": [[1, 0], [1]]}, "the transmission matrix is not 2 x 2", "matrix",
                  "one ratio per identified joint"),
    "too few motors": ({"ratios": [1, 2], "motors": ["a"]}, "1 motors are named for 2 joints",
                       "transmission motors", "elbow, wrist"),
    "unknown motor": ({"ratios": [1, 2], "coupling": [{"motor": "motr_1", "joint": "elbow",
                       "ratio": 1.0}]}, "'motr_1' is none of the robot's motors", "coupling 0",
                      "did you mean 'motor_1'"),
    "unknown joint": ({"ratios": [1, 2], "coupling": [{"motor": "motor_1", "joint": "elbwo",
                       "ratio": 1.0}]}, "'elbwo' is none of the robot's joints", "coupling 0",
                      "did you mean 'elbow'"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_transmissions_that_cannot_be(case: str) -> None:
    given, wrong, where, fix = ERRORS[case]
    with pytest.raises(ModelError) as caught:
        gears(**given)  # type: ignore[arg-type]
    assert wrong in caught.value.wrong
    assert where in caught.value.where and fix in caught.value.fix


def test_badly_scaled_gears_are_no_singular_ones() -> None:
    assert np.array_equal(gears(ratios=[1e-6, 1e6]).matrix, np.diag([1e-6, 1e6]))


def test_three_motors_name_only_those_that_are_tied() -> None:
    section = TransmissionSection.model_validate(
        {"matrix": [[1, 0, 0], [0, 2, 2], [0, 3, 3]], "motors": ["a", "b", "c"]}
    )
    with pytest.raises(ModelError, match="cannot be inverted: b, c turn"):
        build_transmission(section, ("x", "y", "z"), place)


def test_positions_and_efforts_of_coupled_motors() -> None:
    found = signals(gears(matrix=WRIST.tolist()), {"gain": [2.0, 3.0]}, coordinates="motor")
    assert found.position_map is not None and found.effort_map is not None
    inverse = np.array([[1 / 50, 0.0], [1 / 50, -1 / 40]])
    np.testing.assert_allclose(found.position_map, inverse, rtol=1e-14)
    by_hand = np.array([[50.0 * 2.0, 40.0 * 3.0], [0.0, -40.0 * 3.0]])
    np.testing.assert_allclose(found.effort_map, by_hand, rtol=1e-14)
    assert np.array_equal(found.gains, [1.0, 1.0])
    logged = np.array([[0.3, -0.2], [1.0, 2.0], [0.0, 0.5]])
    np.testing.assert_allclose(found.logged_efforts(logged @ by_hand.T), logged, atol=1e-14)


def test_currents_of_coupled_motors_become_torques() -> None:
    current = {"kind": "motor_current", "unit": "A", "gain": [0.2, 0.1]}
    found = signals(gears(matrix=WRIST.tolist()), current)
    assert found.effort_units == ("Nm", "Nm") and found.position_map is None
    assert found.effort_map is not None
    np.testing.assert_allclose(found.effort_map, WRIST.T @ np.diag([0.2, 0.1]))


def test_gears_without_coupling_are_only_gains() -> None:
    current = {"kind": "motor_current", "unit": "A", "gain": [0.2, 0.1]}
    found = signals(gears(ratios=[50, -40]), current)
    assert found.effort_map is None and found.effort_units == ("A", "A")
    np.testing.assert_allclose(found.gains, [10.0, -4.0])
    found = signals(gears(ratios=[50, -40]), {**current, "gain": ["identify", 0.1]})
    assert found.unknown_gains == (True, False)
    np.testing.assert_allclose(found.gains[1], -4.0)


def test_signals_of_joints_are_left_alone() -> None:
    joint = {"kind": "joint_torque", "side": "joint"}
    found = signals(gears(matrix=WRIST.tolist()), joint)
    assert found.position_map is found.effort_map is found.position_offset is None


SIDES = {
    "no gears for positions": ({}, {"coordinates": "motor"}, None, "has no transmission",
                               "signals coordinates", "[robot.transmission]"),
    "no gears for efforts": ({}, {}, None, "has no transmission", "signals effort side",
                             "or a matrix"),
    "joint torque of motors": ({"kind": "joint_torque"}, {}, WRIST, "'joint_torque' is not one of "
                               "the motors", "signals effort side", 'kind = "motor_torque"'),
    "unknown gain behind coupled gears": (
        {"kind": "motor_current", "unit": "A", "gain": ["identify", 1.0]}, {}, WRIST,
        "gains behind coupled gears cannot be identified", "signals effort gain", "torque const"),
    "offsets": ({}, {"position_offset": [0.1]}, WRIST, "1 offsets are given for 2",
                "signals position_offset", "one per joint"),
}  # fmt: skip


@pytest.mark.parametrize("case", SIDES)
def test_sides_that_do_not_fit(case: str) -> None:
    effort, given, matrix, wrong, where, fix = SIDES[case]
    if case == "no gears for positions":
        effort = {"kind": "joint_torque", "side": "joint"}
    transmission = None if matrix is None else Transmission(("a", "b"), matrix)
    with pytest.raises(ModelError) as caught:
        signals(transmission, effort, **given)
    assert wrong in caught.value.wrong
    assert where in caught.value.where and fix in caught.value.fix


def full() -> Signals:
    return signals(
        gears(matrix=WRIST.tolist()),
        {"gain": [0.1, -0.3]},
        coordinates="motor",
        position_offset=[0.25, -1.0 / 3.0],
    )


def test_signals_with_maps_round_trip_exactly() -> None:
    text = json.dumps(json_values(full()))
    again = signals_from_dict(json.loads(text))
    assert json.dumps(json_values(again)) == text
    for name in ("position_map", "position_offset", "effort_map", "gains"):
        np.testing.assert_array_equal(getattr(again, name), getattr(full(), name))
    assert again.unknown_gains == (False, False)
    plain = signals(None, {"kind": "joint_torque", "side": "joint"})
    assert signals_from_dict(json.loads(json.dumps(json_values(plain)))).effort_map is None


@pytest.mark.parametrize("name", ["position_map", "position_offset", "effort_map"])
def test_a_damaged_map_is_refused(name: str) -> None:
    data = json.loads(json.dumps(json_values(full())))
    data[name] = data[name][:1]
    with pytest.raises(ValueError):
        signals_from_dict(data)


def test_an_effort_section_knows_its_words() -> None:
    with pytest.raises(ValueError, match="'joint' or 'motor'"):
        EffortSection.model_validate({"columns": "e", "kind": "motor_torque", "unit": "Nm",
                                      "side": "rotor"})  # fmt: skip


def test_signs_turn_what_is_logged_before_the_gears_and_the_zero() -> None:
    turned = signals(
        gears(matrix=WRIST.tolist()),
        coordinates="motor",
        position_unit="deg",
        position_sign=[1, -1],
        position_offset=[0.0, 1.0],
        velocity="v{}",
        velocity_sign=[-1, 1],
    )
    np.testing.assert_allclose(turned.position_scale, np.deg2rad([1.0, -1.0]))
    assert turned.velocity_scale is not None
    np.testing.assert_array_equal(turned.velocity_scale, [-1.0, 1.0])
    text = json.dumps(json_values(turned))
    assert json.dumps(json_values(signals_from_dict(json.loads(text)))) == text


def test_offsets_may_be_left_to_be_identified() -> None:
    some = signals(gears(ratios=[50, -40]), position_offset=[0.5, "identify"])
    every = signals(gears(ratios=[50, -40]), position_offset="identify")
    assert some.unknown_offsets == (False, True) and every.unknown_offsets == (True, True)
    assert some.position_offset is not None and some.position_offset.tolist() == [0.5, 0.0]
    again = signals_from_dict(json.loads(json.dumps(json_values(some))))
    assert again.unknown_offsets == (False, True)
    with pytest.raises(ValueError, match="position_offset"):
        signals(None, position_offset=[0.5, "find"])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"position_sign": [1]}, "1 signs are given for 2 identified joints"),
        ({"velocity_sign": [1, -1]}, "velocity_sign is given, but no velocity columns"),
    ],
)
def test_signs_that_do_not_fit(given: dict[str, object], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        signals(gears(ratios=[50, -40]), **given)


@pytest.mark.parametrize("sign", [2, 0, 0.5, "-"])
def test_a_sign_is_one_or_minus_one(sign: object) -> None:
    with pytest.raises(ValueError, match="position_sign"):
        signals(None, position_sign=[1, sign])


@pytest.mark.parametrize("kind", ["motor_current", "motor_torque"])
def test_percents_need_a_gain(kind: str) -> None:
    effort = {"kind": kind, "unit": "%", "side": "joint"}
    found = signals(None, {**effort, "gain": [0.5, -2.0]})
    assert found.effort_units == ("%", "%") and found.gains.tolist() == [0.5, -2.0]
    assert found.effort_scale.tolist() == [1.0, 1.0]
    with pytest.raises(ModelError) as caught:
        signals(None, effort)
    for words in (
        "'e1' holds percent of an unknown effort",
        "'elbow' has no drive gain",
        "Nm/% per",
    ):
        assert words in str(caught.value)


def test_a_joint_torque_is_in_no_percent() -> None:
    with pytest.raises(ModelError, match="unit '%' does not fit the joint torque of 'elbow'"):
        signals(None, {"kind": "joint_torque", "unit": "%", "side": "joint", "gain": 1.0})
