import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from oracles import body_map, body_positions, pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.robot.models.xml_and_urdf import read_urdf
from steelyard.robot.robot_from_mechanism import reduced

DATA = os.environ.get("STEELYARD_DATA")
URDFS = [
    path
    for folder in ((Path(DATA), Path(DATA).parent / "models") if DATA else ())
    for path in sorted(folder.rglob("*.urdf"))
    if path.name != "ur3.urdf"  # an empty shell
]
needs_data = pytest.mark.skipif(not URDFS, reason="STEELYARD_DATA names no folder with URDFs")

HEAD = '<robot name="r">\n'
LINKS = '<link name="a"/>\n<link name="b"/>\n'


def joint(body: str = "", kind: str = "revolute", name: str = "j", ends: str = "") -> str:
    ends = ends or '<parent link="a"/><child link="b"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{body}</joint>\n'


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def written(text: str) -> Path:
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return path

    return written


def pinocchio_state(model: pin.Model, positions: dict[str, float]) -> np.ndarray:
    """Pinocchio's configuration; continuous joints are cosine and sine there."""
    q = pin.neutral(model)
    for name, x in positions.items():
        j = model.joints[model.getJointId(name)]
        q[j.idx_q : j.idx_q + j.nq] = [x] if j.nq == 1 else [np.cos(x), np.sin(x)]
    return q


def tolerance(path: Path) -> float:
    """Rounded angles are set right on reading: Pinocchio keeps them."""
    text = path.read_text()
    return 2e-4 if "1.5708" in text or "1.5708 " in text else 1e-7


@needs_data
@pytest.mark.parametrize("path", URDFS, ids=lambda p: p.name)
def test_bodies_are_pinocchios(path: Path) -> None:
    robot, _ = reduced(read_urdf(path))
    model = pin.buildModelFromUrdf(str(path))
    assert sorted(b.joint for b in robot.bodies) == sorted(model.names[1:])
    near = tolerance(path)
    for body in robot.bodies:
        index = model.getJointId(body.joint)
        oracle = model.inertias[index]
        if oracle.mass > 0.0:
            assert np.allclose(body.inertia.ten, oracle.toDynamicParameters(), atol=near)
        placement = model.jointPlacements[index]
        assert np.allclose(body.rotation, placement.rotation, atol=near)
        assert np.allclose(body.position, placement.translation, atol=near)
        parent = "universe" if body.parent < 0 else robot.bodies[body.parent].joint
        assert model.names[model.parents[index]] == parent


@needs_data
@pytest.mark.parametrize("path", URDFS, ids=lambda p: p.name)
def test_torque_is_pinocchios(path: Path) -> None:
    """Torques at a random state: axes, signs and mimics as well."""
    robot, _ = reduced(read_urdf(path))
    model = pin.buildModelFromUrdf(str(path))
    random = np.random.default_rng(7)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, robot.n))
    names = [b.joint for b in robot.bodies]
    columns = [model.joints[model.getJointId(n)].idx_v for n in names]
    s = body_map(robot)
    v, a = np.zeros((2, model.nv))
    v[columns], a[columns] = s @ dq, s @ ddq
    at = pinocchio_state(model, dict(zip(names, body_positions(robot, q), strict=True)))
    tau = s.T @ pin.rnea(model, model.createData(), at, v, a)[columns]
    near = 10.0 * tolerance(path) * max(1.0, np.abs(tau).max())
    assert np.allclose(pinocchio_torque(robot, q, dq, ddq), tau, atol=near)


@needs_data
@pytest.mark.parametrize("path", URDFS, ids=lambda p: p.name)
def test_locked_joints_merge_as_in_pinocchios_reduced_model(path: Path) -> None:
    mechanism = read_urdf(path)
    names = [j.name for j in mechanism.movable]
    mimics = [j.name for j in mechanism.joints if j.mimic is not None and j.movable]
    positions = {n: 0.3 + 0.1 * k for k, n in enumerate(names[1::2])}
    robot, _ = reduced(mechanism, names[0::2], locked=positions)
    followers = {
        m: (j.mimic.ratio * positions[j.mimic.master] + j.mimic.offset)
        for m in mimics
        if (j := mechanism.joint(m)).mimic and j.mimic.master in positions
    }
    full = pin.buildModelFromUrdf(str(path))
    at = pinocchio_state(full, positions | followers)
    model = pin.buildReducedModel(full, [full.getJointId(n) for n in positions | followers], at)
    assert sorted(b.joint for b in robot.bodies) == sorted(model.names[1:])
    near = tolerance(path)
    for body in robot.bodies:
        index = model.getJointId(body.joint)
        oracle = model.inertias[index]
        assert np.isclose(body.inertia.mass, oracle.mass)
        if oracle.mass > 0.0:
            assert np.allclose(body.inertia.ten, oracle.toDynamicParameters(), atol=near)
        assert np.allclose(body.position, model.jointPlacements[index].translation, atol=near)


def test_inertials_rotation_turns_the_tensor(write: Callable[[str], Path]) -> None:
    text = (
        HEAD + '<link name="a"/><link name="b"><inertial><origin xyz="0 0 1" rpy="0 0 1.5708"/>'
        '<mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>'
        "</link>" + joint('<axis xyz="0 0 2"/>') + "</robot>"
    )
    robot, _ = reduced(read_urdf(write(text)))
    assert np.allclose(robot.bodies[0].inertia.inertia_com, np.diag([2.0, 1.0, 2.5]), atol=1e-5)
    assert np.allclose(robot.bodies[0].inertia.com, [0.0, 0.0, 1.0])
    assert np.array_equal(robot.bodies[0].axis, [0.0, 0.0, 1.0])


def test_a_mass_without_a_tensor_is_a_point(write: Callable[[str], Path]) -> None:
    """As in Pinocchio: grippers are published so."""
    text = (
        HEAD + '<link name="a"/><link name="b"><inertial><origin xyz="0 0 0.5"/><mass value="2"/>'
        "</inertial></link>" + joint() + "</robot>"
    )  # fmt: skip
    robot, _ = reduced(read_urdf(write(text)))
    assert np.allclose(robot.bodies[0].inertia.ten, [2.0, 0, 0, 1.0, 0.5, 0, 0.5, 0, 0, 0])
    assert np.allclose(robot.bodies[0].inertia.inertia_com, 0.0)


def test_defaults(write: Callable[[str], Path]) -> None:
    """Axis x; no inertial; meshes that are not there; limits unknown where zero or absent."""
    visual = '<visual><geometry><mesh filename="package://none/x.dae"/></geometry></visual>'
    text = (
        HEAD + f'<link name="a">{visual}</link><link name="b"/>'
        + joint('<limit effort="0" velocity="0"/>') + "</robot>"
    )  # fmt: skip
    robot, notes = reduced(read_urdf(write(text)))
    body, limits = robot.bodies[0], robot.coordinates[0].limits
    assert np.array_equal(body.axis, [1.0, 0.0, 0.0]) and not body.known
    assert limits.lower == -np.inf and limits.velocity == np.inf and limits.effort == np.inf
    assert notes == ("no inertial in the model, nominal mass is zero: b",)


def test_one_limit_alone_means_zero_for_the_other(write: Callable[[str], Path]) -> None:
    text = HEAD + LINKS + joint('<limit upper="2" effort="1" velocity="1"/>') + "</robot>"
    limits = read_urdf(write(text)).joints[0].limits
    assert (limits.lower, limits.upper) == (0.0, 2.0)


def test_continuous_joints_have_no_range(write: Callable[[str], Path]) -> None:
    limit = '<limit lower="0" upper="1" effort="3" velocity="1"/>'
    text = HEAD + LINKS + joint(limit, "continuous") + "</robot>"
    robot, _ = reduced(read_urdf(write(text)))
    c = robot.coordinates[0]
    assert (c.kind, c.limits.lower, c.limits.upper, c.limits.effort) == (
        "revolute",
        -np.inf,
        np.inf,
        3.0,
    )


def test_prefixes_that_are_not_declared_are_passed_over(write: Callable[[str], Path]) -> None:
    limit = '<limit lower="-1" upper="1" drake:acceleration="2.5" effort="3" velocity="1"/>'
    group = '<drake:collision_filter_group name="g"/>\n'
    head = f'<?xml version="1.0"?>\n<!-- made by <robot> -->\n{HEAD}'
    path = write(head + LINKS + group + joint(limit) + "</robot>")
    mechanism = read_urdf(path)
    assert mechanism.joint("j").limits.upper == 1.0
    assert mechanism.joint("j").where.startswith(f"{path}, line 7")
    model = pin.buildModelFromXML(path.read_text())
    assert model.upperPositionLimit.tolist() == [1.0]


def test_blank_lines_may_stand_before_the_declaration(write: Callable[[str], Path]) -> None:
    path = write(f'\n \n<?xml version="1.0"?>\n{HEAD}{LINKS}{joint()}</robot>')
    assert read_urdf(path).joint("j").where.startswith(f"{path}, line 7")


INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
OTHER = '<parent link="b"/><child link="a"/>'

ERRORS = {
    "not a urdf": ("<sdf/>", "outermost element is <sdf>", "line 1", "MJCF"),
    "no links": ("<robot/>", "the robot has no links", "robot.urdf", "links and joints"),
    "xacro element": (
        '<robot xmlns:xacro="http://x/xacro">\n<xacro:include filename="x"/></robot>',
        "xacro template",
        "line 2",
        "or expand it first: xacro robot.urdf > robot.urdf",
    ),
    "xacro value": ('<robot>\n<link name="${n}"/></robot>', "xacro template", "line 2", "expand"),
    "no name": (HEAD + "<link/></robot>", "<link> has no attribute 'name'", "line 2", "name="),
    "no mass": (
        HEAD + f'<link name="a">\n<inertial>{INERTIA}</inertial></link></robot>',
        "<inertial> has no <mass> element",
        "line 3, <inertial>",
        "add a <mass>",
    ),
    "no izz": (
        HEAD + '<link name="a"><inertial><mass value="1"/>\n<inertia ixx="1" ixy="0" ixz="0" '
        'iyy="1" iyz="0"/></inertial></link></robot>',
        "<inertia> has no attribute 'izz'",
        "line 3",
        "izz=",
    ),
    "not a number": (
        HEAD + f'<link name="a"><inertial>\n<mass value="1,5"/>{INERTIA}</inertial></link></robot>',
        'value="1,5" of <mass> is not a finite number',
        "line 3",
        "value=",
    ),
    "nan": (
        HEAD + f'<link name="a"><inertial>\n<mass value="nan"/>{INERTIA}</inertial></link></robot>',
        'value="nan" of <mass> is not a finite number',
        "line 3",
        "value=",
    ),
    "two numbers": (
        HEAD + LINKS + joint('<origin xyz="1 2"/>') + "</robot>",
        'xyz="1 2" of <origin> is not 3 finite numbers',
        "line 4, <origin>",
        'xyz="0.0 0.0 0.0"',
    ),
    "two inertials": (
        HEAD + '<link name="a"><inertial/><inertial/></link></robot>',
        "<link> has 2 <inertial> elements",
        "line 2",
        "keep one",
    ),
    "unknown type": (
        HEAD + LINKS + joint(kind="revolut") + "</robot>",
        "joint 'j' is of type 'revolut', which is not known",
        "line 4, <joint name='j'>",
        "did you mean 'revolute'",
    ),
    "no child": (
        HEAD + LINKS + joint(ends='<parent link="a"/>') + "</robot>",
        "<joint> has no <child> element",
        "line 4, <joint name='j'>",
        "add a <child>",
    ),
    "unknown parent": (
        HEAD + LINKS + joint(ends='<parent link="base"/><child link="b"/>') + "</robot>",
        "the parent link 'base' of joint 'j' does not exist",
        "line 4",
        "the links are a, b",
    ),
    "zero axis": (
        HEAD + LINKS + joint('<axis xyz="0 0 0"/>') + "</robot>",
        "the axis of joint 'j' has no direction",
        "line 4",
        "not zero",
    ),
    "limits": (
        HEAD + LINKS + joint('<limit lower="1" upper="-1"/>') + "</robot>",
        "lower limit above its upper one (1 > -1)",
        "line 4",
        "swap",
    ),
    "twice a link": (
        HEAD + LINKS + '<link name="a"/></robot>',
        "link name 'a' is given twice",
        "line 4, <link name='a'>",
        "name of its own",
    ),
    "twice a joint": (
        HEAD + LINKS + joint() + joint(ends=OTHER) + "</robot>",
        "joint name 'j' is given twice",
        "line 5",
        "name of its own",
    ),
    "two roots": (
        HEAD + LINKS + "</robot>",
        "'a', 'b' have no parent joint",
        "line 3, <link name='b'>",
        "fixed joints",
    ),
    "two parents": (
        HEAD + LINKS + joint() + joint(name="k") + "</robot>",
        "link 'b' has two parent joints, 'j' and 'k'",
        "line 5",
        "cut the loop",
    ),
    "cycle": (
        HEAD + LINKS + joint() + joint(name="k", ends=OTHER) + "</robot>",
        "closed cycle: 'j', 'k'",
        "line 4",
        "one root link",
    ),
    "cycle aside": (
        HEAD + LINKS + '<link name="root"/>' + joint() + joint(name="k", ends=OTHER) + "</robot>",
        "closed cycle: 'j', 'k'",
        "line 4",
        "one root link",
    ),
    "mimic nothing": (
        HEAD + LINKS + joint('<mimic joint="jj"/>') + "</robot>",
        "joint 'j' mimics joint 'jj', which does not exist",
        "line 4",
        "no joints that move",
    ),
    "mimic itself": (
        HEAD + LINKS + joint('<mimic joint="j"/>') + "</robot>",
        "follow each other in a circle: j",
        "line 4",
        "remove its mimic",
    ),
    "broken": ("<robot>\n<link name=></robot>", "not valid XML", "line 2", "correct the XML"),
    "empty": ("", "not valid XML: no element found", "robot.urdf", "URDF"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_errors_say_what_where_and_how_to_correct(case: str, write: Callable[[str], Path]) -> None:
    text, wrong, where, fix = ERRORS[case]
    path = write(text)
    with pytest.raises(ModelError) as caught:
        read_urdf(path)
    assert wrong in caught.value.wrong
    assert str(path) in caught.value.where and where in caught.value.where
    assert fix in caught.value.fix


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        read_urdf(tmp_path / "none.urdf")
    with pytest.raises(ModelError, match="a folder"):
        read_urdf(tmp_path)


def test_binary_file(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    path.write_bytes(b"PAR1\x00\xff\x15\x04")
    with pytest.raises(ModelError, match="not valid XML"):
        read_urdf(path)


BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE robot [\n<!ENTITY a "aaaaaaaaaa">\n'
    + "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">\n' for k in range(9))
    + ']>\n<robot name="&j;"><link name="a"/></robot>'
)
REACHING = (
    '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]>\n'
    '<robot name="r"><link name="a">&x;</link></robot>'
)


@pytest.mark.parametrize("text", [BOMB, REACHING], ids=["bomb", "external"])
def test_entities_are_refused(text: str, write: Callable[[str], Path]) -> None:
    with pytest.raises(ModelError) as caught:
        read_urdf(write(text))
    assert "defines XML entities" in caught.value.wrong
    assert "line" in caught.value.where and "DOCTYPE" in caught.value.fix
