import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from closed_chains import CHAINS, Oracle, five_bar, parallelogram, spatial, twin_loops
from invented import ball
from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.loop_closures import closest, gaps, loop_equations, residual
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot import LoopClosure, Robot, robot_from_dict, robot_to_dict
from steelyard.robot.robot_from_mechanism import reduced


@pytest.mark.parametrize("name", CHAINS)
def test_the_slopes_are_the_derivative(name: str) -> None:
    robot = CHAINS[name]()
    q = np.random.default_rng(0).uniform(-1.0, 1.0, robot.n_joints)
    steps = 1e-6 * np.eye(robot.n_joints)
    numeric = [(residual(robot, q + s)[0] - residual(robot, q - s)[0]) / 2e-6 for s in steps]
    assert np.allclose(residual(robot, q)[1], np.transpose(numeric), atol=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_assemblies_close_for_mujoco_too(name: str) -> None:
    robot = CHAINS[name]()
    equations = loop_equations(robot)
    assert np.array_equal(equations.assembly[: robot.n], robot.assembly[: robot.n])
    assert Oracle(robot).gap(equations.assembly) < 1e-9


def test_planar_pins_give_two_equations_and_a_ball_three() -> None:
    assert loop_equations(five_bar()).loops == (0, 0)
    assert loop_equations(twin_loops()).loops == (0, 0, 1, 1)
    assert loop_equations(spatial()).loops == (0, 0, 0)
    assert np.array_equal(loop_equations(five_bar()).directions, np.eye(3)[:2])


def test_a_tilted_plane_has_its_directions_in_it() -> None:
    robot = CHAINS["palletizer"]()
    equations, normal = loop_equations(robot), robot.bodies[1].rotation @ [0.0, 0.0, 1.0]
    assert np.allclose(equations.directions @ normal, 0.0, atol=1e-12)
    assert not equations.depends[:, [0, 2]].any(), "the column and the hand are outside the loop"


def test_joints_far_from_the_assembly_are_brought_there() -> None:
    robot = five_bar()
    folded = robot.changed(assembly=[2.4, 0.6, 0.0, 0.0])
    assert gaps(folded, loop_equations(folded).assembly).max() < 1e-9


def test_closest_comes_as_near_as_the_bars_reach() -> None:
    robot = five_bar()
    start = np.array([np.pi, 0.0, 0.0, 0.0])
    elbows = np.array([[-0.3, 0.0], [0.53, 0.05]])
    apart = np.linalg.norm(elbows[1] - elbows[0]) - 0.4 - np.hypot(0.45, 0.02)
    assert apart < 0.0
    short = robot.changed(loops=(LoopClosure("tip", (1, 3), [[0.2, 0.0, 0.0], [0.3, 0.0, 0.0]]),))
    apart = np.linalg.norm(elbows[1] - elbows[0]) - 0.5
    assert gaps(short, closest(short, start, [2, 3]))[0] == pytest.approx(apart, abs=1e-9)


def _three_motors() -> Robot:
    robot = five_bar()
    moved = (*robot.coordinates, robot.passive[0])
    return robot.changed(coordinates=moved, passive=robot.passive[1:])


def _short() -> Robot:
    robot = five_bar()
    return robot.changed(loops=(LoopClosure("tip", (1, 3), [[0.1, 0.0, 0.0], [0.12, 0.0, 0.0]]),))


def _flat() -> Robot:
    bars = (ball(1), ball(2), ball(3), ball(4))
    return parallelogram(bars, 0.2, 0.3).changed(assembly=np.zeros(4))


ERRORS: dict[str, tuple[Callable[[], Robot], str, str]] = {
    "count": (_three_motors, "2 independent equations, but there is 1 passive joint", "name 2"),
    "reach": (
        _short,
        "does not close in the reference configuration: closure error 0.",
        "[robot.assembly]",
    ),
    "dead": (_flat, "it is singular", "away from singularities"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ERRORS)
def test_loops_that_cannot_be_used(case: str) -> None:
    spoilt, wrong, fix = ERRORS[case]
    with pytest.raises(ModelError) as caught:
        loop_equations(spoilt())
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert "loop 'tip'" in caught.value.where


def test_a_robot_with_loops_survives_json() -> None:
    robot = five_bar().changed(open_loops="drop")
    again = robot_from_dict(json.loads(json.dumps(robot_to_dict(robot))))
    assert robot_to_dict(again) == robot_to_dict(robot)
    assert again.open_loops == "drop" and again.loops[0].bodies == (1, 3)
    assert [c.name for c in again.passive] == ["left_fore_joint", "right_fore_joint"]


def _inertial(x: float, mass: float) -> str:
    return (
        f'<inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
        '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
    )


def _joint(name: str, parent: str, child: str, at: str, limits: str = "") -> str:
    kind = "revolute" if limits else "continuous"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="0 0 1"/>{limits}</joint>\n'
    )


LIMIT = '<limit lower="{}" upper="{}" velocity="5" effort="50"/>'
URDF = (
    '<robot name="bars"><link name="base"/>'
    + "".join(f'<link name="l{k}">{_inertial(0.1 * k, 0.5 + k)}</link>\n' for k in (1, 2, 3, 4))
    + '<link name="tip"/>'
    + _joint("j1", "base", "l1", "0 0 0", LIMIT.format(1.9, 2.9))
    + _joint("j2", "base", "l2", "0.25 0 0.05", LIMIT.format(0.1, 1.1))
    + _joint("j3", "l1", "l3", "0.3 0 0.05")
    + _joint("j4", "l2", "l4", "0.28 0 0")
    + '<joint name="weld" type="fixed"><parent link="l3"/><child link="tip"/>'
    '<origin xyz="0.4 0 0" rpy="0 0 0.5"/></joint></robot>'
)
TOML = """[robot]
urdf = "bars.urdf"
joints = ["j1", "j2"]
passive = ["j3", "j4"]

[[robot.loops]]
name = "tip"
links = ["tip", "l4"]
points = [[0, 0, 0], [0.45, 0.02, 0]]

[robot.assembly]
j1 = 2.4
j2 = 0.6
j3 = -1.5
j4 = 1.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bars.urdf").write_text(URDF)
    return tmp_path


def written(folder: Path, text: str) -> Path:
    path = folder / "bars.toml"
    path.write_text(text)
    return path


def test_a_robot_file_closes_a_urdf(folder: Path) -> None:
    loaded = load_robot(written(folder, TOML))
    robot = loaded.robot
    assert robot.joint_names == ("j1", "j2")
    assert [c.name for c in robot.passive] == ["j3", "j4"]
    assert [b.coordinate for b in robot.bodies] == [0, 2, 1, 3]
    (loop,) = robot.loops
    assert loop.bodies == (1, 3) and np.allclose(loop.points[0], [0.4, 0.0, 0.0])
    assert gaps(robot, robot.assembly).max() < 1e-9
    assert robot.assembly[2] < 0.0 < robot.assembly[3], "it stays assembled as it was"
    assert "j3 at -1.826 rad" in loaded.notes[-1]


def test_an_assembly_that_closes_is_not_spoken_of(folder: Path) -> None:
    first = load_robot(written(folder, TOML)).robot
    text = TOML[: TOML.index("j3 = -1.5")]
    text += f"j3 = {first.assembly[2]:.5f}\nj4 = {first.assembly[3]:.5f}\n"
    assert load_robot(written(folder, text)).notes == ()


def test_joints_of_loops_that_are_not_identified_are_passive(folder: Path) -> None:
    robot = load_robot(written(folder, TOML.replace('passive = ["j3", "j4"]\n', ""))).robot
    assert [c.name for c in robot.passive] == ["j3", "j4"]


def test_open_loops_can_be_dropped(folder: Path) -> None:
    assert load_robot(written(folder, TOML)).robot.open_loops == "stop"
    text = TOML.replace("passive", 'open_loops = "drop"\npassive')
    assert load_robot(written(folder, text)).robot.open_loops == "drop"


def test_a_loop_locked_where_it_closes_is_rigid(folder: Path) -> None:
    q = load_robot(written(folder, TOML)).robot.assembly
    text = f'[robot]\nurdf = "bars.urdf"\njoints = ["j4"]\n{TOML[TOML.index("[[") :]}'
    text = text[: text.index("[robot.assembly]")] + "[robot.locked]\n"
    text = text.replace('"l4"]', '"l2"]').replace("[0.45, 0.02, 0]", "[{}, {}, 0]")
    point = 0.3 * np.exp(1j * q[0]) + 0.4 * np.exp(1j * (q[0] + q[2])) - 0.25
    point *= np.exp(-1j * q[1])
    text = text.format(point.real, point.imag)
    text += "".join(f"j{k} = {float(x)!r}\n" for k, x in zip((1, 2, 3), q[:3], strict=True))
    assert load_robot(written(folder, text)).robot.loops == ()
    with pytest.raises(ModelError, match="loop 'tip' is locked open: closure error"):
        load_robot(written(folder, text.replace("j3 = -1", "j3 = -2")))


FILE_ERRORS = {
    "link": ('"tip", "l4"', '"tip", "l44"', "no link 'l44'", "line 8", "'l4'"),
    "joint": ('"j3", "j4"', '"j3", "jj4"', "no joint 'jj4'", "line 4", "'j4'"),
    "count": ('"j3", "j4"]', '"j4"]\n#', "2 independent equations, but there is 1", "line", "2 of"),
    "many": (
        'joints = ["j1", "j2"]\npassive = ["',
        'joints = ["j1"]\npassive = ["j2", "',
        "2 independent equations, but there are 3 passive joints: j2, j3, j4",
        "line 6",
        "name 2 of the loops' joints",
    ),
    "open": (
        "[0.45",
        "[1.45",
        "loop 'tip' does not close in the reference configuration",
        "line 6",
        "points",
    ),
    "offset": ("0.02, 0]", "0.02, 0.01]", "closure error 0.01 m", "line 6", "correct"),
    "unsaid": (
        'joints = ["j1", "j2"]\npassive = ["j3", "j4"]\n',
        "",
        "of the loop joints j1, j3, j2, j4",
        "line 4",
        "[robot] passive = [...]",
    ),
    "all": (
        'joints = ["j1", "j2"]\npassive = ["',
        'passive = ["j1", "j2", "',
        "every joint is passive",
        "line 1",
        "only the joints that the loops determine",
    ),
    "treelike": ("[[robot.loops]]", "[[rubbish]]", "unknown key 'rubbish'", "line 6", "robot"),
    "no loops": (TOML[TOML.index("[[") :], "", "but the robot has no loops", "line 1", "[[robot."),
    "assembly": ("j3 = -1.5", "j5 = 3", "no joint 'j5'", "line 14", "j3"),
    "locked": (
        '"j3", "j4"]',
        '"j3"]\nlocked = {j4 = 1.945}',
        "2 independent equations, but there is 1 passive joint",
        "line 7",
        "name 2",
    ),
    "twice": (
        "[robot.assembly]",
        '[[robot.loops]]\nname = "tip"\nlinks = ["l1", "l2"]\npoints = [[0,0,0], [0,0,0]]\n'
        "[robot.assembly]",
        "two loops have the name 'tip'",
        "line 11",
        "name of its own",
    ),
    "base": ("joints", 'base = "l1"\njoints', "joint 'j1' is to be identified but", "", "base"),
}


@pytest.mark.parametrize("case", FILE_ERRORS)
def test_robot_file_errors(case: str, folder: Path) -> None:
    old, new, wrong, where, fix = FILE_ERRORS[case]
    assert old in TOML
    with pytest.raises(ModelError) as caught:
        load_robot(written(folder, TOML.replace(old, new, 1)))
    assert wrong in caught.value.wrong
    assert where in caught.value.where and fix in caught.value.fix


MJCF = """<mujoco model="bars"><option gravity="0 -9.81 0"/>
<default><geom type="capsule" size=".02" mass="1"/></default>
<worldbody>
  <body name="l1" euler="0 0 130"><joint name="j1" axis="0 0 1" pos="0 0 0"/>
    <geom fromto="0 0 0 .3 0 0"/>
    <body name="l3" pos=".3 0 0" euler="0 0 -95"><joint name="j3" axis="0 0 1" ref="10"/>
      <geom fromto="0 0 0 .4 0 0"/><site name="end3" pos=".4 0 0"/></body></body>
  <body name="l2" pos=".25 .05 0" euler="0 0 40"><joint name="j2" axis="0 0 1" pos="0 0 .1"/>
    <geom fromto="0 0 0 .28 0 0"/>
    <body name="l4" pos=".28 0 0" euler="0 0 90"><joint name="j4" axis="0 0 1" pos="0 0 .1"/>
      <geom fromto="0 0 0 .45 0 0"/></body></body>
</worldbody>
{}
<actuator><motor joint="j2"/><motor joint="j1"/></actuator>
</mujoco>
"""
CONNECT = '<equality><connect name="tip" body1="l3" body2="l4" anchor=".4 0 0"/></equality>'


def _mjcf(folder: Path) -> Path:
    path = folder / "bars.xml"
    path.write_text(MJCF.format(CONNECT))
    return path


def test_connect_is_a_pin_between_joints_without_actuator(tmp_path: Path) -> None:
    path = _mjcf(tmp_path)
    robot, _ = reduced(read_mjcf(path))
    assert robot.joint_names == ("j1", "j2")
    assert [c.name for c in robot.passive] == ["j3", "j4"]
    assert robot.loops[0].name == "tip"
    model = mujoco.MjModel.from_xml_path(str(path))
    assert np.allclose(robot.assembly, model.qpos0[[0, 2, 1, 3]], atol=1e-9)
    data = mujoco.MjData(model)
    order = [model.joint(c.name).qposadr[0] for c in robot.joints]
    for step in (0.1, 0.2):
        q = robot.assembly + [step, -0.5 * step, 0.0, 0.0]
        q = closest(robot, q, [2, 3])
        data.qpos[order] = q
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos).max() < 1e-9


def test_connected_sites_are_the_same_pin(tmp_path: Path) -> None:
    by_bodies = reduced(read_mjcf(_mjcf(tmp_path)))[0]
    points = by_bodies.loops[0].points
    sites = '<equality><connect name="tip" site1="end3" site2="end4"/></equality>'
    text = MJCF.format(sites)
    site = f'<site name="end4" pos="{points[1][0]} {points[1][1]} {points[1][2] + 0.1}"/>'
    path = tmp_path / "sites.xml"
    path.write_text(text.replace('<geom fromto="0 0 0 .45 0 0"/>', site + '<geom size=".1 .1"/>'))
    by_sites = reduced(read_mjcf(path))[0]
    assert np.allclose(by_sites.loops[0].points, points, atol=1e-9)


FOUR_BAR = """<mujoco><worldbody><body name="crank" euler="0 0 80">
<joint name="c" axis="0 0 1"/><geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/>
<body name="rod" pos=".2 0 0" euler="0 0 -60"><joint name="r" axis="0 0 1"/>
<geom type="capsule" size=".01" fromto="0 0 0 .5 0 0"/>
<body name="lever" pos=".5 0 0" euler="0 0 -100"><joint name="l" axis="0 0 1"/>
<geom type="capsule" size=".01" fromto="0 0 0 .4 0 0"/></body></body></body></worldbody>
<equality><connect body1="lever" anchor=".4 0 0"/></equality>
<actuator><motor joint="c"/></actuator></mujoco>"""


def test_a_pin_to_the_world(tmp_path: Path) -> None:
    path = tmp_path / "four.xml"
    path.write_text(FOUR_BAR)
    robot, _ = reduced(read_mjcf(path))
    assert robot.joint_names == ("c",) and robot.loops[0].bodies == (2, -1)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = closest(robot, np.array([0.4, 0.0, 0.0]), [1, 2])
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-9


def test_a_bare_mjcf_without_actuators_says_what_to_name(tmp_path: Path) -> None:
    path = tmp_path / "bare.xml"
    path.write_text(MJCF.format(CONNECT).replace('<motor joint="j2"/><motor joint="j1"/>', ""))
    with pytest.raises(ModelError) as caught:
        reduced(read_mjcf(path))
    assert "j1, j3, j2, j4" in caught.value.wrong and "passive = [...]" in caught.value.fix
    assert str(path) in caught.value.where and "equality 'tip'" in caught.value.where
    toml = tmp_path / "robot.toml"
    toml.write_text('[robot]\nmjcf = "bare.xml"\npassive = ["j1", "j3"]\n')
    assert load_robot(toml).robot.joint_names == ("j2", "j4")
