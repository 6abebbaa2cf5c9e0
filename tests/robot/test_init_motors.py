"""`steelyard init` and signals of the motors' side, and values that contradict the model."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import LogError, ModelError
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.init.draft_robot_file import Draft, assigned, drafted, proposed
from steelyard.robot.init.draft_tables import Known
from steelyard.robot.init.guess_columns import Guess, guess_columns
from steelyard.robot.init.guess_efforts_and_gears import Gears, regressed
from steelyard.robot.robot import Coordinate, Limits

LIMITED = tuple(
    Coordinate(name, "revolute", Limits(-3.0, 3.0, 2.0, 50.0)) for name in ("joint1", "joint2")
)
Q = np.array([np.sin(np.linspace(0.0, 9.0, 300)), np.cos(np.linspace(0.0, 7.0, 300))])
R = np.array([[100.0, 0.0], [32.0, -50.0]])
URDF = """<robot name="r"><link name="base"/>{joints}{gears}</robot>"""
JOINT = """<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="2" effort="50"/></joint><link name="l{k}">
<inertial><mass value="2"/><origin xyz="0.1 0 0"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1"
iyz="0" izz="0.1"/></inertial></link>"""
GEAR = """<transmission name="t{k}"><type>transmission_interface/SimpleTransmission</type>
<joint name="joint{k}"/><actuator name="m{k}"><mechanicalReduction>{ratio}</mechanicalReduction>
</actuator></transmission>"""


def written(
    folder: Path, columns: dict[str, np.ndarray], *ratios: float, known: Known | None = None
) -> tuple[Draft, Path]:
    model, output = folder / "r.urdf", folder / "r.toml"
    joints = JOINT.format(k=1, parent="base") + JOINT.format(k=2, parent="l1")
    gears = "".join(GEAR.format(k=k + 1, ratio=ratio) for k, ratio in enumerate(ratios))
    model.write_text(URDF.format(joints=joints, gears=gears))
    proposal = proposed(model)
    assignment = assigned(proposal, list(columns), columns)
    draft = drafted(proposal, assignment, output, known or Known())
    output.write_text(draft.text)
    return draft, output


def log(**names: np.ndarray) -> dict[str, np.ndarray]:
    """Columns `name1` and `name2` of each, after time."""
    found = {"t": np.arange(300) * 0.01}
    return found | {f"{name}{k + 1}": rows[k] for name, rows in names.items() for k in range(2)}


def guessed(**names: np.ndarray) -> Guess:
    columns = log(**names)
    return guess_columns(LIMITED, list(columns), columns)


def test_a_template_for_motors_loads_once_it_is_filled_in(tmp_path: Path) -> None:
    draft, output = written(tmp_path, log(q_motor=R @ Q, tau_motor=Q))
    assert draft.unreadable and "gear ratios are unknown" in draft.missing[0][0]
    with pytest.raises(ModelError, match=r"the robot has no transmission"):
        load_robot(output)
    for old, new in (
        ("# [robot.transmission]", "[robot.transmission]"),
        ("# ratios = [?, ?]", "ratios = [100.0, -50.0]"),
        (
            '# coupling = [{motor = "motor_2", joint = "joint1", ratio = ?}]',
            'coupling = [{motor = "motor_2", joint = "joint1", ratio = 32.0}]',
        ),
        ("  # {law", "  {law"),
        ("# position_offset = [0.0, 0.0]", "position_offset = [0.5, 0.0]"),
    ):
        assert old in draft.text
        draft_text = output.read_text().replace(old, new)
        output.write_text(draft_text)
    loaded = load_robot(output)
    _compare(loaded, R)
    assert len(model_with_open_friction(loaded).terms) == 8


def _compare(loaded: LoadedRobot, matrix: np.ndarray) -> None:
    assert loaded.robot.transmission is not None and loaded.signals is not None
    np.testing.assert_allclose(loaded.robot.transmission.matrix, matrix, rtol=1e-12)
    assert loaded.signals.effort_kind == "motor_torque"


def test_gears_from_positions_of_both_sides(tmp_path: Path) -> None:
    offset = np.array([[3.0], [-1.0]])
    draft, output = written(tmp_path, log(q=Q, q_motor=R @ Q + offset, tau_motor=Q))
    assert not draft.missing and not draft.unreadable
    loaded = load_robot(output)
    _compare(loaded, R)
    assert loaded.signals is not None and loaded.signals.position == ("q1", "q2")
    assert "CHECK: by regression" in draft.text
    assert len(model_with_open_friction(loaded).terms) == 8


def test_gears_are_not_regressed_from_noise_or_a_resting_joint() -> None:
    found = regressed([*(R @ Q)], [*Q])
    assert found is not None and found.ratios == (100.0, -50.0)
    assert found.coupling == ((1, 0, 32.0),)
    assert regressed([*(R @ Q)], [Q[0], np.zeros(300)]) is None
    noise = np.random.default_rng(0).normal(size=(2, 300))
    assert regressed([*(R @ Q + noise)], [*Q]) is None


def test_gears_of_the_model_file(tmp_path: Path) -> None:
    draft, output = written(tmp_path, log(q_motor=R @ Q, tau_motor=Q), 100.0, -50.0)
    _compare(load_robot(output), np.diag([100.0, -50.0]))
    assert "from <transmission> of the model file" in draft.text
    assert written(tmp_path, log(q_motor=R @ Q, tau_motor=Q), 1.0, 1.0)[0].unreadable


def test_gears_that_were_answered(tmp_path: Path) -> None:
    known = Known(gears=Gears((100.0, -50.0), (), "ratios as answered"))
    draft, output = written(tmp_path, log(q_motor=R @ Q, tau_motor=Q), known=known)
    assert not draft.missing
    _compare(load_robot(output), np.diag([100.0, -50.0]))


def test_positions_far_beyond_the_limits_are_of_motors() -> None:
    far = log(q_rad=4.0 * R @ Q, tau=Q)
    within_in_degrees = log(q_rad=R @ Q, tau=Q)
    of_motors = log(q_rad=R @ Q, tau_motor=Q)
    for columns, geared in ((far, False), (within_in_degrees, True), (of_motors, False)):
        guess = guess_columns(LIMITED, list(columns), columns, geared=geared)
        assert guess.section.coordinates == "motor" and guess.section.position_unit == "rad"
        assert "times the joints' limits" in guess.reasons[1]


@pytest.mark.parametrize("name", ["q", "q_rad"])
@pytest.mark.parametrize("rate", ["rad/s", "deg/s"])
def test_degrees_are_recognised_whatever_their_names_say(name: str, rate: str) -> None:
    scale = 1.0 if rate == "rad/s" else 180.0 / np.pi
    derivative = np.gradient(Q, 0.01, axis=1)
    guess = guessed(**{name: np.rad2deg(Q), "dq_rad_s": scale * derivative, "tau": Q})
    assert guess.section.coordinates == "joint" and not guess.contradictions
    assert guess.section.position_unit == "deg" and guess.velocity_unit in (rate, None)
    assert (guess.velocity_unit is None) == (rate == "rad/s")
    assert ("though their names say rad" in guess.reasons[1]) == (name == "q_rad")


def test_counts_of_encoders_are_refused() -> None:
    with pytest.raises(LogError, match="counts of encoders"):
        guessed(q=np.round(R @ Q * 4096.0), tau=Q)


def test_values_that_contradict_the_limits_are_named(tmp_path: Path) -> None:
    columns = log(q=Q * [[5.0], [1.0]], tau=np.array([[10.0], [900.0]]) * Q)
    draft, output = written(tmp_path, columns)
    whys = [why for why, _ in draft.missing]
    assert len(whys) == 2 and not draft.unreadable
    assert "up to 1.7 times for joint1 (q1):" in whys[0]
    assert "for joint2 (tau2) with 50 Nm:" in whys[1]
    assert draft.text.count("CHECK, contradictory") == 2
    assert load_robot(output).signals is not None


def test_positions_that_are_found_are_in_the_template(tmp_path: Path) -> None:
    draft, _ = written(tmp_path, log(q=Q))
    assert 'position = ["q1", "q2"]' in draft.text and draft.guess is None
    assert "none look like the efforts of 2 joints" in draft.missing[0][0]
