from pathlib import Path

import mujoco
import numpy as np
import pytest

from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.mechanism import Mechanism, is_placeholder
from steelyard.robot.models.mjcf import read_mjcf

WORLD = """
<mujoco model="arm">{options}
  <worldbody>
    <body name="one"><joint name="a" axis="0 1 0"{a}/><geom size=".1" pos=".2 0 0"/>
      <body name="two" pos=".4 0 0"><joint name="b" axis="0 1 0"{b}/><geom size=".1" pos=".2 0 0"/>
        <site name="tip" pos=".3 0 .1"/>
        <body name="three" pos=".4 0 0"><joint name="c" type="slide" axis="1 0 0"{c}/>
          <geom size=".1"/><site name="end"/></body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="own"><joint joint="c" coef="-.5"/></fixed>
    <fixed name="braked" actuatorfrcrange="-3 4"><joint joint="c" coef="1"/></fixed>
    <fixed name="both"><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed>
    <spatial name="cable"><site site="tip"/><site site="end"/></spatial>
  </tendon>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def written(
    folder: Path, actuators: str, a: str = "", b: str = "", c: str = "", options: str = ""
) -> Path:
    path = folder / "arm.xml"
    path.write_text(WORLD.format(actuators=actuators, a=a, b=b, c=c, options=options))
    return path


def limits_of(mechanism: Mechanism) -> dict[str, float]:
    return {joint.name: joint.limits.effort for joint in mechanism.movable}


def extreme(path: Path, joint: str) -> tuple[float, float]:
    """Least and greatest `qfrc_actuator` at the ends of the actuators' controls."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, dof = mujoco.MjData(model), model.joint(joint).dofadr[0]
    rng, seen = np.random.default_rng(0), []
    for _ in range(300):
        data.qpos[:] = rng.uniform(-1.0, 1.0, model.nq)
        data.act[:] = rng.choice([-1.0, 1.0], model.na) * 2.0
        data.ctrl[:] = rng.choice([-1e9, 1e9], model.nu)
        mujoco.mj_forward(model, data)
        seen.append(data.qfrc_actuator[dof])
    return min(seen), max(seen)


BOUNDED = {
    "force range": ('<position joint="a" kp="9" forcerange="-30 30"/>', "", "a"),
    "gear": ('<motor joint="a" forcerange="-30 30" gear="-2.5"/>', "", "a"),
    "control of a motor": ('<motor joint="b" ctrlrange="-3 3" gear="20"/>', "", "b"),
    "gain and gear": (
        '<general joint="b" gainprm="4" ctrlrange="-3 5" gear="-2" biastype="affine" '
        'biasprm="1 0 0"/>',
        "",
        "b",
    ),
    "asymmetry": ('<motor joint="a" forcerange="-7 30"/>', "", "a"),
    "the smaller of both": (
        '<motor joint="c" ctrlrange="-3 3" gear="2" forcerange="-2 9"/>',
        "",
        "c",
    ),
    "two on one joint": (
        '<motor joint="a" forcerange="-7 30"/><motor joint="a" ctrlrange="0 4" gear="-3"/>',
        "",
        "a",
    ),
    "one is switched off": (
        '<motor joint="a" forcerange="-7 7"/><motor joint="a" ctrlrange="-4 4" group="3"/>',
        '<option actuatorgroupdisable="3"/>',
        "a",
    ),
    "an antagonistic pair": (
        '<motor joint="a" ctrlrange="0 5"/><motor joint="a" ctrlrange="0 6" gear="-1"/>',
        "",
        "a",
    ),
    "a filter that is limited": (
        '<general joint="a" gainprm="3" ctrlrange="-4 4" dyntype="filter" dynprm=".1" '
        'actlimited="true" actrange="-2 2"/>',
        "",
        "a",
    ),
    "a tendon of one joint": ('<motor tendon="own" gear="3" forcerange="-8 6"/>', "", "c"),
}


@pytest.mark.parametrize("case", BOUNDED)
def test_limits_are_what_mujocos_actuators_can_give(tmp_path: Path, case: str) -> None:
    actuators, options, joint = BOUNDED[case]
    path = written(tmp_path, actuators, options=options)
    least, most = extreme(path, joint)
    limits = limits_of(read_mjcf(path))
    assert limits.pop(joint) == pytest.approx(min(-least, most), rel=1e-12)
    assert set(limits.values()) == {np.inf}


def test_the_joints_own_range_bounds_their_sum(tmp_path: Path) -> None:
    actuators = '<position joint="a" kp="5"/><motor joint="b" forcerange="-9 9"/>'
    path = written(
        tmp_path, actuators, a=' actuatorfrcrange="-8 5"', b=' actuatorfrcrange="-20 20"'
    )
    limits = limits_of(read_mjcf(path))
    assert limits == {"a": 5.0, "b": 9.0, "c": np.inf}
    for joint in ("a", "b"):
        least, most = extreme(path, joint)
        assert limits[joint] == pytest.approx(min(-least, most))


UNBOUNDED = {
    "a setpoint is no force": '<position joint="a" ctrlrange="-2 2"/>',
    "nor is a velocity": '<velocity joint="a" kv="3" ctrlrange="-2 2"/>',
    "one of two is unbounded": '<motor joint="a" forcerange="-7 7"/><position joint="a"/>',
    "another pulls two joints": '<motor joint="a" forcerange="-7 7"/><motor tendon="both"/>',
    "what integrates": '<general joint="a" dyntype="integrator" ctrlrange="-1 1" gainprm="3"/>',
    "a tendon limits the sum of two": '<position tendon="braked"/><motor tendon="braked"/>',
    "a placeholder": '<motor joint="a" forcerange="-999999 999999"/>',
}


@pytest.mark.parametrize("case", UNBOUNDED)
def test_what_is_no_limit_of_effort(tmp_path: Path, case: str) -> None:
    limits = limits_of(read_mjcf(written(tmp_path, UNBOUNDED[case])))
    assert limits == dict.fromkeys("abc", np.inf)


def test_weight_that_actuators_hold_beyond_their_range_leaves_the_joints_own(
    tmp_path: Path,
) -> None:
    motor = '<motor joint="a" forcerange="-7 7"/>'
    relieved = ' actuatorgravcomp="true"'
    assert limits_of(read_mjcf(written(tmp_path, motor, relieved)))["a"] == np.inf
    both = f'{relieved} actuatorfrcrange="-9 9"'
    assert limits_of(read_mjcf(written(tmp_path, motor, both)))["a"] == 9.0


def loaded(path: Path, tables: str = "") -> LoadedRobot:
    toml = path.with_suffix(".toml")
    toml.write_text(f'[robot]\nmjcf = "{path.name}"\n{tables}')
    return load_robot(toml)


def test_limits_that_are_not_one_joints_are_named(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        '<motor name="pull" tendon="both" forcerange="-2 2"/>'
        '<motor name="wire" tendon="cable" ctrlrange="-2 2"/><motor tendon="both"/>',
    )
    (note,) = load_robot(path).notes
    assert note.startswith("limits of actuators that act through tendons or sites are no limits")
    assert note.endswith("(state [robot.limits.JOINT] effort): 'pull', 'wire'")
    given = "".join(f"[robot.limits.{name}]\neffort = 5.0\n" for name in "ab")
    assert loaded(path, given).notes == (note.replace("'pull', ", ""),)
    assert not loaded(path, given + "[robot.limits.c]\neffort = 5.0\n").notes


def test_actuators_of_one_way_are_named(tmp_path: Path) -> None:
    path = written(tmp_path, '<motor joint="c" ctrlrange="0 5"/>')
    (note,) = load_robot(path).notes
    assert note.startswith("actuators with one direction of force are not a limit")
    assert note.endswith(": c") and limits_of(read_mjcf(path))["c"] == np.inf


@pytest.mark.parametrize("effort", [0.0, -1.0, 1e3, 999.0, 1e4, 1e5, 999999.0, 1e6, 3e6, 3.4e38])
def test_placeholders(effort: float) -> None:
    assert is_placeholder(effort)


@pytest.mark.parametrize("effort", [1.0, 10.0, 99.0, 100.0, 330.0, 1001.0, 2000.0, 5e4, np.inf])
def test_limits_that_may_be_meant(effort: float) -> None:
    assert not is_placeholder(effort)


LIMITED = """<robot name="r"><link name="base"/><link name="l"/><link name="m"/>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/>
<limit lower="-1" upper="1" velocity="2" effort="{}"/></joint>
<joint name="k" type="prismatic"><parent link="l"/><child link="m"/>
<limit lower="-1" upper="1" velocity="2" effort="{}"/></joint></robot>"""


def test_placeholders_of_a_urdf_are_named_and_resolved(tmp_path: Path) -> None:
    urdf, toml = tmp_path / "r.urdf", tmp_path / "r.toml"
    urdf.write_text(LIMITED.format("1000", "99999"))
    found = load_robot(urdf)
    assert [joint.limits.effort for joint in found.robot.coordinates] == [np.inf, np.inf]
    lines = [note for note in found.notes if "placeholder" in note]
    assert len(lines) == 1 and lines[0].endswith("effort): j (1000 Nm), k (99999 N)")
    toml.write_text('[robot]\nurdf = "r.urdf"\n[robot.limits.j]\neffort = 1000.0\n')
    edited = load_robot(toml)
    assert [joint.limits.effort for joint in edited.robot.coordinates] == [1000.0, np.inf]
    lines = [note for note in edited.notes if "placeholder" in note]
    assert len(lines) == 1 and lines[0].endswith("effort): k (99999 N)")


def test_limits_of_zero_are_unknown_without_a_word(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(LIMITED.format("0", "-1"))
    found = load_robot(path)
    assert [joint.limits.effort for joint in found.robot.coordinates] == [np.inf, np.inf]
    assert not any("effort" in note for note in found.notes)
