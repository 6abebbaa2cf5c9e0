from pathlib import Path

import mujoco
import pytest

from steelyard.base.errors import ModelError, OpenModelError
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.init.draft_robot_file import assigned, drafted, proposed
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot_from_mechanism import reduced

BALL = '<geom type="sphere" size=".05" pos=".1 .02 0" mass=".7"/>'
HAND = """
<body name="driver" pos=".2 0 0"><joint name="driver_joint" axis="0 1 0"/>{ball}
  <body name="coupler" pos=".1 0 0"><joint name="coupler_joint" axis="0 1 0"/>{ball}</body>
</body>
<body name="link" pos=".2 0 -.1"><joint name="link_joint" axis="0 1 0"/>{ball}</body>
"""
PIN = '<connect name="close" body1="coupler" body2="link" anchor=".1 0 0"/>'
MOTORS = '<motor joint="shoulder"/><motor joint="elbow"/>'


def arm(tmp_path: Path, hand: str, equality: str, end: str = "") -> Path:
    path = tmp_path / "robot.xml"
    path.write_text(f"""
    <mujoco><compiler angle="radian"/><worldbody><body name="upper">
      <joint name="shoulder" axis="0 1 0"/>{BALL}
      <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0"/>{BALL}
        {hand.format(ball=BALL)}</body></body>
      <body name="cube"><freejoint/>{BALL}</body>
      <body name="target" mocap="true"/></worldbody>
    <equality>{equality}</equality>{end}</mujoco>""")
    return path


def begun(path: Path) -> tuple[str, LoadedRobot]:
    """The robot file that init writes, and what is read from it."""
    target = path.with_name("new.toml")
    proposal = proposed(path)
    target.write_text(drafted(proposal, assigned(proposal, None, None), target).text)
    return target.read_text(), load_robot(target)


def test_a_loop_that_no_actuator_drives_is_locked(tmp_path: Path) -> None:
    path = arm(tmp_path, HAND, PIN)
    with pytest.raises(ModelError, match="the passive ones are not given") as caught:
        load_robot(path)
    assert "`steelyard init` writes a robot file that locks the loops" in caught.value.fix
    path = arm(tmp_path, HAND, PIN, f"<actuator>{MOTORS}</actuator>")
    text, loaded = begun(path)
    assert loaded.robot.joint_names == ("shoulder", "elbow") and loaded.robot.loops == ()
    reason = (
        "# Locked: in a loop of a hand, or in one whose joints have no actuator of their own.\n"
    )
    assert f"{reason}driver_joint = 0.0\ncoupler_joint = 0.0\nlink_joint = 0.0\n" in text


def test_what_else_a_robot_file_must_say_is_no_matter_of_loops(tmp_path: Path) -> None:
    ball = f'<body name="eye" pos=".1 0 .1"><joint name="gaze" type="ball"/>{BALL}</body>'
    with pytest.raises(OpenModelError, match="ball joint") as caught:
        load_robot(arm(tmp_path, HAND + ball, PIN))
    assert "gaze = 0.0 under [robot.locked]" in caught.value.fix
    assert "locks the loops" not in caught.value.fix


def test_a_loop_of_fingers_is_locked_whatever_drives_it(tmp_path: Path) -> None:
    motors = f'<actuator>{MOTORS}<motor joint="finger_joint"/></actuator>'
    path = arm(tmp_path, HAND.replace("driver_joint", "finger_joint"), PIN, motors)
    text, loaded = begun(path)
    assert loaded.robot.joint_names == ("shoulder", "elbow") and "\nfinger_joint = 0.0" in text


def test_a_driven_loop_is_kept(tmp_path: Path) -> None:
    path = arm(tmp_path, HAND, PIN, f'<actuator>{MOTORS}<motor joint="driver_joint"/></actuator>')
    _, loaded = begun(path)
    assert loaded.robot.joint_names == ("shoulder", "elbow", "driver_joint")
    assert [c.name for c in loaded.robot.passive] == ["coupler_joint", "link_joint"]


def test_a_loop_that_nothing_says_how_to_close_is_locked(tmp_path: Path) -> None:
    motors = (
        f'<actuator>{MOTORS}<motor joint="driver_joint"/><motor joint="link_joint"/></actuator>'
    )
    proposal = proposed(arm(tmp_path, HAND, PIN, motors))
    assert proposal.loaded.robot.joint_names == ("shoulder", "elbow")
    assert "whose passive joints are ambiguous" in proposal.notes[0]


def test_a_hand_alone_is_identified_by_what_its_tendon_pulls(tmp_path: Path) -> None:
    path = tmp_path / "hand.xml"
    path.write_text(f"""
    <mujoco><worldbody><body name="palm">{HAND.format(ball=BALL)}</body></worldbody>
    <tendon><fixed name="t"><joint joint="driver_joint" coef="1"/></fixed></tendon>
    <equality>{PIN}</equality><actuator><motor tendon="t"/></actuator></mujoco>""")
    _, loaded = begun(path)
    assert loaded.robot.joint_names == ("driver_joint",)
    assert [c.name for c in loaded.robot.passive] == ["coupler_joint", "link_joint"]
    carried = arm(
        tmp_path,
        HAND,
        PIN,
        f"""
    <tendon><fixed name="t"><joint joint="driver_joint" coef="1"/></fixed></tendon>
    <actuator>{MOTORS}<motor tendon="t"/></actuator>""",
    )
    assert begun(carried)[1].robot.joint_names == ("shoulder", "elbow")


TWO = """
<body name="left" pos=".2 0 0"><joint name="left_j" axis="0 1 0" ref=".2"/>{ball}
  <site name="start"/></body>
<body name="right" pos=".2 0 0"><joint name="right_j" axis="0 1 0"/>{ball}
  <site name="end" pos=".1 0 0"/></body>"""
TENDON = """<tendon><fixed name="t">
  <joint joint="left_j" coef="1"/><joint joint="right_j" coef="-2"/>
</fixed></tendon>"""
CABLE = """<tendon><spatial name="t"><site site="start"/><site site="end"/></spatial></tendon>"""
TIES = {
    "polynomial": (
        '<joint name="e" joint1="left_j" joint2="right_j" polycoef="0 1 2 0 0"/>',
        "",
        "a joint equality that is not proportional",
    ),
    "weld": ('<weld name="e" body1="left" body2="right"/>', "", "a weld"),
    "tendon": ('<tendon name="e" tendon1="t"/>', CABLE, "a tendon equality"),
}


@pytest.mark.parametrize("case", TIES)
def test_joints_of_other_equalities_are_locked(case: str, tmp_path: Path) -> None:
    equality, end, what = TIES[case]
    path = arm(tmp_path, TWO, equality, end)
    with pytest.raises(ModelError, match=f"joints are tied by {what}") as caught:
        load_robot(path)
    assert "equality 'e'" in caught.value.where
    assert "left_j = 0.2, right_j = 0 under [robot.locked]" in caught.value.fix
    text, loaded = begun(path)
    assert f"# Locked: tied by {what}.\nleft_j = 0.2\nright_j = 0.0\n" in text
    assert loaded.robot.joint_names == ("shoulder", "elbow")
    robot, _ = reduced(read_mjcf(path), ["shoulder", "elbow"])
    assert robot.joint_names == ("shoulder", "elbow")


def test_a_joint_that_follows_two_others_ties_them(tmp_path: Path) -> None:
    both = "".join(
        f'<joint name="{master}" joint1="left_j" joint2="{master}"/>'
        for master in ("right_j", "elbow")
    )
    path = arm(tmp_path, TWO, both)
    with pytest.raises(ModelError, match="joint equality that is one too many") as caught:
        load_robot(path)
    assert "equality 'elbow'" in caught.value.where
    assert "right_j = 0, elbow = 0 under [robot.locked]" in caught.value.fix


def test_a_tendon_of_two_joints_that_keeps_its_length_makes_one_follow(tmp_path: Path) -> None:
    tie = '<tendon tendon1="t" polycoef=".1 0 0 0 0"/>'
    path = arm(tmp_path, TWO, tie, TENDON)
    robot, _ = reduced(read_mjcf(path))
    assert robot.joint_names == ("shoulder", "elbow", "left_j")
    follower = robot.bodies[-1]
    assert (follower.joint, follower.ratio) == ("right_j", 0.5)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    places = [int(model.joint(name).qposadr[0]) for name in ("left_j", "right_j")]
    data.qpos[places] = 0.5, follower.ratio * 0.5 + follower.offset
    mujoco.mj_forward(model, data)
    assert data.efc_pos[: data.ne] == pytest.approx(0.0, abs=1e-12) and data.ne == 1


def test_tendons_make_chains_of_followers_and_no_circles(tmp_path: Path) -> None:
    more = '<body name="third"><joint name="third_j"/>{ball}</body>'
    joints = [("left_j", "right_j"), ("third_j", "right_j"), ("third_j", "left_j")]
    tendons = "".join(
        f'<fixed name="t{k}"><joint joint="{a}" coef="1"/><joint joint="{b}" coef="1"/></fixed>'
        for k, (a, b) in enumerate(joints)
    )
    ties = "".join(f'<tendon name="e{k}" tendon1="t{k}"/>' for k in range(3))
    path = arm(tmp_path, TWO + more, ties, f"<tendon>{tendons}</tendon>")
    mechanism = read_mjcf(path)
    masters = {j.name: j.mimic.master for j in mechanism.joints if j.mimic}
    assert masters == {"right_j": "left_j", "third_j": "right_j"}
    assert [coupling.name for coupling in mechanism.couplings] == ["e2"]


def test_a_joint_held_by_an_equality_is_locked(tmp_path: Path) -> None:
    proposal = proposed(arm(tmp_path, TWO, '<joint joint1="left_j" polycoef=".1 0 0 0 0"/>'))
    assert proposal.locked == {"left_j": pytest.approx(0.3)}
    assert proposal.loaded.robot.joint_names == ("shoulder", "elbow", "right_j")


@pytest.mark.parametrize("other", ["target", "cube"])
def test_welds_to_targets_and_loose_bodies_are_left_out(other: str, tmp_path: Path) -> None:
    path = arm(tmp_path, TWO, f'<weld name="grasp" body1="{other}" body2="left"/>')
    robot, notes = reduced(read_mjcf(path))
    assert robot.joint_names == ("shoulder", "elbow", "left_j", "right_j")
    assert f"the weld of '{other}' and 'left' is left out" in notes


def test_a_weld_that_nothing_moves_says_nothing(tmp_path: Path) -> None:
    hand = '<body name="pad">{ball}</body>'
    robot, notes = reduced(read_mjcf(arm(tmp_path, hand, '<weld body1="pad" body2="lower"/>')))
    assert robot.joint_names == ("shoulder", "elbow")
    assert notes == ("left out, as it is not part of the robot: cube",)


def test_a_hand_alone_is_refused_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "hand.xml"
    hand = TWO.format(ball=BALL)
    path.write_text(f"""<mujoco><worldbody>{hand}</worldbody>
    <equality><weld body1="left" body2="right"/></equality></mujoco>""")
    with pytest.raises(ModelError, match=r"locked: left_j, right_j \(tied by a weld\)") as caught:
        proposed(path)
    assert "the robot that carries this hand" in caught.value.fix
