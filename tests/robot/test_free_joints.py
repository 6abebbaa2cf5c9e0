import pickle
from pathlib import Path

import mujoco
import numpy as np
import pytest

from oracles import pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.parallel_search import SearchBudget, task_of
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.init.draft_robot_file import assigned, drafted, proposed
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.simulate.simulate import simulate

BALL = '<geom type="sphere" size=".05" pos=".1 .02 0" mass=".7"/>'
CUBE = '<body name="{}" pos="1 0 0"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'


def leg(name: str) -> str:
    return f"""
    <body name="{name}_thigh" pos=".2 0 -.1">
      <joint name="{name}_hip" axis="0 1 0"/>{BALL}
      <body name="{name}_calf" pos="0 0 -.2"><joint name="{name}_knee" axis="0 1 0"/>{BALL}</body>
    </body>"""


def trunk(inside: str, name: str = "trunk") -> str:
    return f"""
    <body name="{name}" pos="0 0 .5" quat=".9 .1 .3 -.2">
      <freejoint name="{name}_root"/><geom type="box" size=".2 .1 .05" mass="5"/>{inside}
    </body>"""


ARM = f'<body name="upper"><joint name="shoulder" axis="0 1 0"/>{BALL}</body>'


def written(folder: Path, world: str, end: str = "") -> Path:
    path = folder / "robot.xml"
    path.write_text(f"<mujoco><worldbody>{world}</worldbody>{end}</mujoco>")
    return path


def robot_file(path: Path, lines: str) -> Path:
    file = path.with_suffix(".toml")
    key = "mjcf" if path.suffix == ".xml" else "urdf"
    file.write_text(f'[robot]\n{key} = "{path.name}"\n{lines}')
    return file


def test_a_fixed_trunk_is_mujocos_trunk_at_rest(tmp_path: Path) -> None:
    path = written(tmp_path, trunk(leg("left") + leg("right")) + CUBE.format("cube"))
    loaded = load_robot(robot_file(path, 'base = "trunk"'))
    robot = loaded.robot
    assert robot.joint_names == ("left_hip", "left_knee", "right_hip", "right_knee")
    assert loaded.floats and loaded.base == "trunk"
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(4):
        q, dq, ddq = rng.uniform(-1.0, 1.0, (3, robot.n))
        mujoco.mj_resetData(model, data)
        data.qpos[7:11], data.qvel[6:10], data.qacc[6:10] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        assert np.allclose(pinocchio_torque(robot, q, dq, ddq), data.qfrc_inverse[6:10])
    assert np.allclose(robot.gravity, data.xmat[1].reshape(3, 3).T @ [0.0, 0.0, -9.81])


def test_a_floating_trunk_is_mujocos_free_joint(tmp_path: Path) -> None:
    path = written(tmp_path, trunk(leg("left") + leg("right")) + CUBE.format("cube"))
    loaded = load_robot(robot_file(path, 'base = "floating"'))
    robot = loaded.robot
    assert robot.floating and robot.bodies[0].name == "trunk" and loaded.base == "floating"
    assert robot.joint_names[6:] == ("left_hip", "left_knee", "right_hip", "right_knee")
    assert loaded.notes == ("left out, as it is not part of the robot: cube",)
    assert load_robot(path, base="floating").robot.joint_names == robot.joint_names
    oracle = mujoco.MjModel.from_xml_path(str(path))
    oracle.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data, model = mujoco.MjData(oracle), Model(robot, (RigidBody(),)).prior
    assert model is not None
    rng, calf = np.random.default_rng(3), oracle.body("left_calf").id
    for _ in range(4):
        q, dq, ddq = rng.uniform(-1.0, 1.0, (3, robot.n))
        wrench = rng.normal(size=6)
        mujoco.mj_resetData(oracle, data)
        quaternion = rng.normal(size=4)
        data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        data.qpos[7:11] = q[6:]
        mujoco.mj_kinematics(oracle, data)
        turn = data.xmat[1].reshape(3, 3)
        data.qvel[:10], data.qacc[:10] = dq, ddq
        data.qacc[:3] = turn @ ddq[:3] + [0.0, 0.0, -9.81]
        at, axes = model.pose(q, "left_calf")
        foot = data.xmat[calf].reshape(3, 3)
        np.testing.assert_allclose(turn @ axes, foot, atol=1e-12)
        np.testing.assert_allclose(turn @ at + data.xpos[1], data.xpos[calf], atol=1e-12)
        mujoco.mj_comPos(oracle, data)
        mujoco.mj_inverse(oracle, data)
        pushed = np.zeros(oracle.nv)
        mujoco.mj_applyFT(
            oracle, data, foot @ wrench[:3], foot @ wrench[3:], data.xpos[calf], calf, pushed
        )
        wanted = (data.qfrc_inverse - pushed)[:10]
        wanted[:3] = turn.T @ wanted[:3]
        along = np.concatenate([axes @ wrench[:3], axes @ wrench[3:]])
        found = model.torque(q, dq, ddq) - model.jacobian(q, "left_calf").T @ along
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10)


def test_a_floating_base_that_is_not_clear_is_refused(tmp_path: Path) -> None:
    two = written(tmp_path, trunk(leg("left")) + trunk(leg("other"), "dog"))
    with pytest.raises(ModelError, match="several robots float: trunk, dog") as caught:
        load_robot(two, base="floating")
    assert caught.value.fix == "leave one of them in the model file"
    one = written(tmp_path, trunk(leg("left")).replace("left_hip", "base_rz"))
    with pytest.raises(ModelError, match="'base_rz' has the name of a coordinate"):
        load_robot(one, base="floating")
    one = written(tmp_path, trunk(leg("left")))
    with pytest.raises(ModelError, match="a mounting is given, and the base floats"):
        load_robot(robot_file(one, 'base = "floating"\n[robot.mounting]\nroll = 3.0'))
    with pytest.raises(ModelError, match="a simulation needs a robot whose base is at rest"):
        simulate(load_robot(one, base="floating"), tmp_path / "out")


def test_a_link_may_be_called_floating(tmp_path: Path) -> None:
    path = written(tmp_path, trunk(leg("left"), "floating"))
    assert not load_robot(path, base="floating").robot.floating


def test_gears_of_a_floating_robot_are_those_of_its_joints(tmp_path: Path) -> None:
    path = written(tmp_path, trunk(leg("left")))
    gears = "[robot.transmission]\nratios = [-50.0, 100.0]"
    robot = load_robot(robot_file(path, f'base = "floating"\n{gears}')).robot
    assert robot.transmission is not None
    assert robot.transmission.motors[5:] == ("base_rz", "motor_1", "motor_2")
    assert np.array_equal(np.diag(robot.transmission.matrix), [*[1.0] * 6, -50.0, 100.0])


def test_what_is_assumed_and_left_out_is_reported(tmp_path: Path) -> None:
    other = trunk(leg("other"), "dog")
    path = written(tmp_path, trunk(leg("left")) + other + CUBE.format("cube") + ARM)
    mechanism = read_mjcf(path)
    robot, notes = reduced(mechanism, base="trunk")
    assert robot.joint_names == ("left_hip", "left_knee")
    assert notes == (
        "base 'trunk' is assumed to be at rest, in the orientation of the model file: the free "
        "joint "
        "of 'trunk' is left out",
        "left out, as it is not part of the robot: dog, cube",
        "left out, as the base 'trunk' does not carry them: shoulder",
    )
    robot, notes = reduced(mechanism, base="left_thigh")
    assert robot.joint_names == ("left_knee",)
    assert "the free joint of 'trunk' is left out" in notes[0]
    assert "left out, as the base 'left_thigh' does not carry them: left_hip, shoulder" in notes
    assert not any("carry" in n for n in reduced(mechanism, ["left_knee"], base="left_thigh")[1])
    robot, notes = reduced(mechanism, base="world")
    assert robot.joint_names == ("shoulder",)
    assert notes == ("left out, as it is not part of the robot: trunk, dog, cube",)


def test_loose_bodies_are_left_out_beside_a_robot_that_stands(tmp_path: Path) -> None:
    plain = load_robot(written(tmp_path, ARM))
    loaded = load_robot(written(tmp_path, ARM + CUBE.format("red") + CUBE.format("blue")))
    assert loaded.notes == ("left out, as it is not part of the robot: red, blue",)
    assert not loaded.floats
    assert [frame.name for frame in loaded.robot.frames] == [f.name for f in plain.robot.frames]


def test_a_floating_robot_without_a_base_is_refused_with_the_lines(tmp_path: Path) -> None:
    path = written(tmp_path, ARM + trunk(leg("left")))
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert "link 'trunk' floats: its joint 'trunk_root' is a free joint" in caught.value.wrong
    assert 'base = "world" (1 joints) or base = "trunk" (2 joints)' in caught.value.fix
    assert "--fixed-base trunk" in caught.value.fix
    assert load_robot(path, base="trunk").robot.joint_names == ("left_hip", "left_knee")


def test_a_base_beside_a_robot_file_is_refused(tmp_path: Path) -> None:
    file = robot_file(written(tmp_path, ARM), "")
    with pytest.raises(ModelError, match="given beside a robot file") as caught:
        load_robot(file, base="upper")
    assert caught.value.fix == 'write base = "upper" under [robot] there'


def test_processes_that_search_motions_have_the_same_base(tmp_path: Path) -> None:
    loaded = load_robot(written(tmp_path, trunk(leg("left"))), base="trunk")
    tables = (loaded, Model(loaded.robot), None)
    tables, *_ = pickle.loads(task_of(tables, "gradient", SearchBudget(1.0), 0))
    assert tables[0].base == "trunk" and build(*tables).basis.joints == loaded.robot.n


def test_init_writes_the_base_with_most_joints(tmp_path: Path) -> None:
    path = written(tmp_path, ARM + trunk(leg("other"), "dog") + trunk(leg("a") + leg("b")))
    proposal = proposed(path)
    assert proposal.base == "trunk"
    (line,) = proposal.notes
    assert line == 'base = "trunk": 4 joints move beyond it, and 1 beyond world, 2 beyond dog'
    target = tmp_path / "new.toml"
    target.write_text(drafted(proposal, assigned(proposal, None, None), target).text)
    assert '\nbase = "trunk"\n' in target.read_text()
    loaded = load_robot(target)
    assert loaded.robot.joint_names == proposal.loaded.robot.joint_names
    assert np.allclose(loaded.robot.gravity, proposal.loaded.robot.gravity)
    one = proposed(written(tmp_path, trunk(leg("a")) + CUBE.format("cube")))
    assert one.notes == ('base = "trunk": the one link that floats and has joints beyond it',)


WRIST = f"""
<body name="upper"><joint name="shoulder" axis="0 1 0"/>{BALL}
  <body name="hand" pos=".2 0 0" quat=".9 .1 .3 -.2"><joint name="wrist" type="ball"/>{BALL}
    <body name="tip" pos=".1 0 0"><joint name="end" axis="0 0 1"/>{BALL}</body>
  </body>
</body>"""


def test_a_ball_joint_is_locked_where_the_file_has_it(tmp_path: Path) -> None:
    path = written(tmp_path, WRIST)
    with pytest.raises(ModelError, match="'wrist' is a ball joint") as caught:
        load_robot(path)
    assert "wrist = 0.0 under [robot.locked]" in caught.value.fix
    robot = load_robot(robot_file(path, "[robot.locked]\nwrist = 0.0")).robot
    assert robot.joint_names == ("shoulder", "end")
    stiff = load_robot(written(tmp_path, WRIST.replace('<joint name="wrist" type="ball"/>', "")))
    state = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2))
    assert np.allclose(pinocchio_torque(robot, *state), pinocchio_torque(stiff.robot, *state))


def test_a_ball_joint_has_no_other_position(tmp_path: Path) -> None:
    path = robot_file(written(tmp_path, WRIST), "[robot.locked]\nwrist = 0.3")
    with pytest.raises(ModelError, match="locked at 0.3, but has no such position") as caught:
        load_robot(path)
    assert "wrist = 0.0" in caught.value.fix


def test_a_ball_joint_is_locked_where_other_joints_are_listed(tmp_path: Path) -> None:
    robot, notes = reduced(read_mjcf(written(tmp_path, WRIST)), ["end"])
    assert robot.joint_names == ("end",)
    assert "locked at its position in the model file: ball joint wrist" in notes


def test_init_locks_ball_joints(tmp_path: Path) -> None:
    path = written(tmp_path, WRIST)
    target = tmp_path / "new.toml"
    proposal = proposed(path)
    target.write_text(drafted(proposal, assigned(proposal, None, None), target).text)
    assert "# Locked: a ball joint.\nwrist = 0.0\n" in target.read_text()
    assert load_robot(target).robot.joint_names == ("shoulder", "end")


URDF = """
<robot name="r">
  <link name="odom"/>
  <link name="body"><inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx=".1" ixy="0"
    ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
  <joint name="drive" type="{}"><parent link="odom"/><child link="body"/>
    <origin rpy="1.5707963267948966 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="j" type="continuous"><parent link="body"/><child link="arm"/></joint>
</robot>"""


@pytest.mark.parametrize("kind", ["floating", "fixed"])
def test_the_root_of_a_urdf_floats(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(URDF.format(kind))
    robot = load_robot(path, base="floating").robot
    assert robot.bodies[0].name == ("body" if kind == "floating" else "odom")
    assert robot.joint_names[6:] == ("j",) and robot.bodies[0].inertia.mass == 5.0
    assert np.allclose(robot.gravity, [0.0, 0.0, -9.81])


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_urdfs_float_too(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(URDF.format(kind))
    with pytest.raises(ModelError, match="link 'body' floats") as caught:
        load_robot(path)
    assert "line 8" in caught.value.where and 'base = "body"' in caught.value.fix
    robot = load_robot(robot_file(path, 'base = "body"')).robot
    assert robot.joint_names == ("j",)
    assert np.allclose(robot.gravity, [0.0, -9.81, 0.0])
    assert proposed(path).base == "body"


def test_a_ball_joint_alone_leaves_nothing_to_identify(tmp_path: Path) -> None:
    alone = '<body name="bob"><joint name="b" type="ball"/><geom size=".1"/></body>'
    with pytest.raises(
        ModelError, match=r"every joint would have to be locked: b \(a ball"
    ) as caught:
        proposed(written(tmp_path, alone))
    assert "a joint of one degree of freedom" in caught.value.fix
    assert "hand" not in caught.value.fix
