"""Numbers put into a robot's own URDF: what is no matter of them stays byte by byte."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import invented
from invented import ball
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.export.model_files.export_model_file import exported, refuse_changed
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.simulate.ground_truth import random_truth
from weighed import identified_of

ARM = """<?xml version='1.0' encoding="UTF-8"?>
<!-- drawn by hand: Größe -->
<robot name="arm">
  <link name="base">
    <inertial><mass value="20"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="wheel" type="continuous"><parent link="base"/><child link="tyre"/></joint>
  <link name="tyre"/>
  <joint name="lift" type='prismatic'>
    <origin xyz="0 0 1"/>
    <parent link="base"/>
    <child link="column"/>
    <axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" effort="10" velocity="1"/>
  </joint>
  <link name="column"/>
  <joint name="pan" type="revolute">
    <parent link="column"/>
    <child link="upper"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
    <dynamics damping="9" friction="9"/> <!-- guessed -->
  </joint>
  <link name="upper">
    <visual><geometry><mesh filename="package://arm/upper.stl" scale="1 1 1"/></geometry></visual>
    <!-- from the maker -->
    <inertial>
      <origin xyz="0.1 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.025"/>
    </inertial>
  </link>
  <joint name="tilt" type="revolute">
    <origin xyz="0.4 0 0" rpy="0 0.3 0"/>
    <parent link="upper"/>
    <child link="fore"/>
    <axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <link name="fore" />
  <joint name="grip" type="revolute">
    <origin xyz="0.2 0 0"/>
    <parent link="fore"/>
    <child link="finger"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <link name="finger">
    <inertial>
      <mass value="0.2"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/>
    </inertial>
  </link>
</robot>
"""
FILE = """[robot]
urdf = "arm.urdf"
joints = ["pan", "tilt"]
[robot.locked]
lift = 0.25
grip = 0.7
"""


@pytest.fixture
def arm(tmp_path: Path) -> IdentifiedModel:
    """Two joints of the arm, the lift and the grip locked; its files are in the folder."""
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    (tmp_path / "arm.toml").write_text(FILE)
    robot = load_robot(tmp_path / "arm.toml").robot
    values = {
        f"{name}.{body.name}": value
        for seed, body in enumerate(robot.bodies)
        for name, value in zip(INERTIAL_NAMES, ball(seed).ten, strict=True)
    }
    return identified_of(robot, [RigidBody(), Viscous(), Offset()], values)


def edited(identified: IdentifiedModel, original: Path) -> str:
    """The text of the edited file, after it was read again."""
    made = exported(identified, "urdf", original)
    path = original.parent / "edited.urdf"
    path.write_text(made.text, encoding="utf-8", newline="")
    refuse_changed(path, made)
    return made.text


@pytest.mark.parametrize("given", ["arm.urdf", "arm.toml"])
def test_only_numbers_change(given: str, arm: IdentifiedModel, tmp_path: Path) -> None:
    text = edited(arm, tmp_path / given)
    for kept in (
        "<!-- drawn by hand: Größe -->\n<!--\n  arm: identified with",
        '<inertial><mass value="20"/><inertia ixx="1" iyy',
        '<joint name="wheel" type="continuous"><parent link="base"/><child link="tyre"/></joint>',
        'filename="package://arm/upper.stl" scale="1 1 1"/>',
        "    <!-- from the maker -->\n    <inertial>\n      <origin xyz=",
        "/> <!-- guessed -->\n",
        '  <link name="column"/>\n',
    ):
        assert kept in text
    assert text.count("<inertial>") == 3
    head = text.partition("-->\n<robot")[0]
    assert "lumped into that link" in head and "constant efforts (offset): pan" in head
    body = text[text.index("<robot") :]
    untouched = set(ARM.splitlines()) & set(body.splitlines())
    assert len(untouched) == 29


def test_links_that_move_as_one_hand_over_their_mass(arm: IdentifiedModel, tmp_path: Path) -> None:
    text = edited(arm, tmp_path / "arm.urdf")
    assert re.search(
        r'<link name="finger">\s*<!-- mass and inertia are among those of \'fore\' -->\s*</link>',
        text,
    )
    assert re.search(r'<link name="fore">\n    <inertial>\n      <origin xyz=', text)
    assert 'damping="9"' not in text and text.count("<dynamics damping=") == 2
    for joint in ("lift", "grip"):
        was = "prismatic" if joint == "lift" else "revolute"
        assert re.search(rf'name="{joint}" type="fixed"><!-- was {was}; locked at', text)
    assert text.count("<axis") == 2 and text.count("<limit") == 2


def test_pinocchio_finds_the_identified_torque(arm: IdentifiedModel, tmp_path: Path) -> None:
    edited(arm, tmp_path / "arm.urdf")
    model = pin.buildModelFromUrdf(str(tmp_path / "edited.urdf"))
    assert list(model.names) == ["universe", "pan", "tilt", "wheel"]
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 20, 2))
    wanted = arm.torque(Motion(np.arange(20), q, dq, ddq)) - arm.estimate.values.values[-2:]
    data = model.createData()
    for k in range(20):
        full = np.array([*q[k], 1.0, 0.0])
        rates, jerks = np.array([*dq[k], 0.0]), np.array([*ddq[k], 0.0])
        torque = pin.rnea(model, data, full, rates, jerks) + model.damping * rates
        assert np.abs(torque[:2] - wanted[k]).max() < 1e-9


@pytest.mark.parametrize("change", ["crlf", "bom", "one line"])
def test_layouts_of_other_editors(change: str, arm: IdentifiedModel, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    if change == "bom":
        path.write_bytes(b"\xef\xbb\xbf" + ARM.encode())
    elif change == "crlf":
        path.write_bytes(ARM.replace("\n", "\r\n").encode())
    else:
        path.write_text(re.sub(r">\s+<", "><", ARM), encoding="utf-8")
    text = edited(arm, path)
    assert text.startswith("<?xml")
    assert ("\r\n" in text) == (change == "crlf")
    assert not re.search(r"(?<!\r)\n", text) or change != "crlf"


def test_a_mimic_joint_stays(tmp_path: Path) -> None:
    robot = invented.mimic(tmp_path)
    text = edited(identified_of(robot), tmp_path / "mimic.urdf")
    assert '<mimic joint="shoulder" multiplier="-1.5" offset="0.2"/>' in text
    assert text.count("<dynamics") == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name="finger"', 'name="thumb"', "the parent|the child|has no link 'finger'"),
        ('"0.4 0 0"', '"0.5 0 0"', "link 'fore' has another pose or axis"),
        ('<link name="fore" />', '<link name="fore">', "not valid XML"),
        ("<robot", "<!DOCTYPE r [<!ENTITY e 'e'>]>\n<robot", "entities"),
    ],
)
def test_another_robots_file_is_refused(
    old: str, new: str, words: str, arm: IdentifiedModel, tmp_path: Path
) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(ModelError, match=words):
        edited(arm, path)


def test_a_link_that_is_missing_is_named(arm: IdentifiedModel, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace('"finger"', '"thumb"'), encoding="utf-8")
    with pytest.raises(ModelError, match="has no link 'finger'") as error:
        edited(arm, path)
    assert "identified with" in error.value.fix


def test_untouched_links_that_cannot_exist_are_named(arm: IdentifiedModel, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace('ixx="1" iyy', 'ixx="-1" iyy'), encoding="utf-8")
    made = exported(arm, "urdf", path)
    (sentence,) = made.impossible
    assert sentence.startswith("base: a principal moment of inertia is negative (-1 ")
    assert (
        f"not physically consistent in the original file:\n    - {sentence}\n"
        in made.text.partition("<robot")[0]
    )
    assert exported(arm, "urdf").impossible == ()
    # a link that gets numbers, or loses its own, does not matter
    path.write_text(ARM.replace('ixx="0.0', 'ixx="-0.0'), encoding="utf-8")
    assert exported(arm, "urdf", path).impossible == ()


def test_other_encodings_are_refused(arm: IdentifiedModel, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(ARM.replace("UTF-8", "iso-8859-1").encode("iso-8859-1"))
    with pytest.raises(ModelError, match="not UTF-8"):
        edited(arm, path)


def test_an_mjcf_is_not_edited(arm: IdentifiedModel, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="not into MJCF"):
        exported(arm, "mjcf", tmp_path / "arm.urdf")
    path = tmp_path / "arm.xml"
    path.write_text("<mujoco/>")
    with pytest.raises(ModelError, match="no URDF to insert the values into"):
        exported(arm, "urdf", path)


@pytest.mark.parametrize("name", ["ur10e", "panda", "tiago"])
def test_real_robots(name: str, tmp_path: Path) -> None:
    robot = invented.measured(name)
    file = Path(invented.__file__).parent.parent / "examples" / f"{name}.toml"
    values = random_truth(robot, 0).values.as_dict()
    made = exported(identified_of(robot, values=values), "urdf", file)
    path = tmp_path / "edited.urdf"
    path.write_text(made.text, encoding="utf-8")
    refuse_changed(path, made)
    model = pin.buildModelFromUrdf(str(path))
    assert set(robot.joint_names) <= set(model.names)
    source = load_robot(file).sources[-1].path.read_text(encoding="utf-8")
    assert made.text.count("<mesh") == source.count("<mesh")


def test_numbers_go_into_a_file_whose_axes_are_tilted(tmp_path: Path) -> None:
    """Turns that are no rounding errors may have a product with entries as small as one."""
    links = ("base", "a", "b", "c")
    joints = zip(links, links[1:], ("0.003 0 0", "0 0.003 0", "1.5708 0 0"), strict=False)
    kinds = {"a": "fixed", "b": "revolute", "c": "revolute"}
    path = tmp_path / "tilted.urdf"
    path.write_text(
        '<robot name="tilted"><link name="base"/>'
        + "".join(
            f"""<link name="{child}"><inertial><origin xyz="0.1 0.02 0.03"/><mass value="2"/>
            <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="j_{child}" type="{kinds[child]}"><parent link="{parent}"/>
            <child link="{child}"/><origin xyz="0.3 0 0.1" rpy="{turn}"/><axis xyz="0 0 1"/>
            <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>"""
            for parent, child, turn in joints
        )
        + "</robot>"
    )
    for snap in ("true", "false"):
        text = f"[robot]\nurdf = '{path}'\nsnap_angles = {snap}\n"
        robot = load_robot("robot.toml", text=text).robot
        assert (
            0.0
            < np.abs(robot.bodies[0].rotation[np.nonzero(robot.bodies[0].rotation)]).min()
            < 2e-5
        )
        assert "<robot" in edited(identified_of(robot), path)
