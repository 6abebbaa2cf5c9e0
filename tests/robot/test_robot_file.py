import hashlib
import json
import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.arrays import json_values
from steelyard.base.errors import ModelError
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.file.robot_file import load_robot, robot_text
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.signals import signals_from_dict
from steelyard.robot.file.toml_schema import checked

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = os.environ.get("STEELYARD_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="STEELYARD_DATA names no folder with robots")

URDF = """<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="3" effort="40"/></joint>
<joint name="lift" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
<limit lower="0.1" upper="0.4" velocity="1" effort="100"/></joint></robot>
"""
MJCF = """<mujoco model="one"><option gravity="0 0 -3"/><worldbody><body name="b">
<joint name="elbow" axis="0 1 0"/><geom type="sphere" size=".1" mass="1"/></body></worldbody>
</mujoco>
"""
ROBOT = '[robot]\nurdf = "two.urdf"\n'
EFFORT = '[signals.effort]\ncolumns = ["i1", "i2"]\nkind = "joint_torque"\nunit = ["Nm", "N"]\n'
SIGNALS = '[signals]\ntime = "t"\nposition = "q{}"\n' + EFFORT


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "two.urdf").write_text(URDF)
    (tmp_path / "one.xml").write_text(MJCF)
    return tmp_path


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_whole_robot_file(folder: Path) -> None:
    path = written(
        folder,
        """
[robot]
name = "mine"
source = "https://example.org"
urdf = "two.urdf"
joints = ["lift", "elbow"]
base = "a"
tip = "c"
mounting = {roll = 180}
[robot.limits]
elbow = {upper = 1.5, effort = 20}

[model]
terms = ["rigid_body", {law = "coulomb", smoothing = 0.005, joints = ["elbow"]}]

[signals]
time = "stamp"
time_unit = "ms"
position = "pos_{joint}"
position_unit = ["mm", "deg"]
velocity = ["v1", "v2"]
velocity_unit = ["mm/s", "rpm"]
velocity_delay = 0.01
commanded_position = "goal_{joint}"
commanded_velocity = ["g1", "g2"]
[signals.effort]
columns = ["i1", "i2"]
kind = "motor_current"
unit = "mA"
gain = [100, -5.5]

[processing]
motion_cutoff = 25
matched_cutoff = 8.5
rest_speed = 0.01

[validation]
cutoff = 4
""",
    )
    loaded = load_robot(path)
    robot, signals = loaded.robot, loaded.signals
    assert signals is not None and loaded.terms is not None
    assert (robot.name, robot.joint_names) == ("mine", ("lift", "elbow"))
    assert np.allclose(robot.gravity, [0.0, 0.0, 9.81])
    limits = robot.coordinates[1].limits
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-2.0, 1.5, 3.0, 20.0)
    assert signals.columns == ("stamp", "pos_lift", "pos_elbow", "v1", "v2", "i1", "i2")
    assert signals.time_scale == 1e-3 and signals.n == 2
    assert np.allclose(signals.position_scale, [1e-3, np.pi / 180])
    assert np.allclose(signals.velocity_scale, [1e-3, np.pi / 30])
    commanded = signals.of_commanded()
    assert commanded.columns == ("stamp", "goal_lift", "goal_elbow", "g1", "g2", "i1", "i2")
    assert np.allclose(commanded.velocity_scale, [1e-3, np.pi / 30])
    assert (signals.velocity_delay, commanded.velocity_delay) == (0.01, 0.0)
    again = signals_from_dict(json.loads(json.dumps(json_values(signals)))).of_commanded()
    assert again.columns == commanded.columns
    assert np.array_equal(again.velocity_scale, commanded.velocity_scale)
    assert np.allclose(signals.effort_scale, [1e-3, 1e-3])
    assert signals.effort_units == ("A", "A") and np.array_equal(signals.gains, [100, -5.5])
    assert [t.description for t in loaded.terms] == [
        "rigid_body",
        {"law": "coulomb", "smoothing": 0.005, "joints": ["elbow"]},
    ]
    assert "line 14, [model] terms[2]" in loaded.terms[1].where
    assert loaded.processing.motion_cutoff == 25.0 and loaded.processing.rest_speed == 0.01
    assert loaded.validation.cutoff == 4.0
    assert [s.path.name for s in loaded.sources] == ["robot.toml", "two.urdf"]
    assert loaded.sources[1].sha256 == hashlib.sha256(URDF.encode()).hexdigest()
    assert checked(path, robot_text(path), RobotFile)[0].robot.source == "https://example.org"


def test_a_model_alone_works_too(folder: Path) -> None:
    for name, joints in (("two.urdf", ("elbow", "lift")), ("one.xml", ("elbow",))):
        loaded = load_robot(folder / name)
        assert loaded.robot.joint_names == joints
        assert loaded.signals is None and loaded.terms is None
        assert loaded.processing.motion_cutoff is None and loaded.validation.cutoff is None
        assert [s.path.name for s in loaded.sources] == [name]


def test_mjcf_in_a_robot_file_keeps_its_gravity(folder: Path) -> None:
    loaded = load_robot(written(folder, '[robot]\nmjcf = "one.xml"'))
    assert np.array_equal(loaded.robot.gravity, [0.0, 0.0, -3.0])


@pytest.mark.parametrize(("unit", "turn"), [("rad", 1.5707963267948966), ("deg", 90.0)])
def test_dh_table(folder: Path, unit: str, turn: float) -> None:
    text = f"""
[robot]
name = "scara"
[robot.dh]
convention = "modified"
angle_unit = "{unit}"
[[robot.dh.links]]
joint = "shoulder"
[[robot.dh.links]]
kind = "prismatic"
alpha = {turn}
a = 0.4
mass = 2.0
com = [0.0, 0.1, 0]
inertia_com = [0.1, 0, 0.1, 0, 0, 0.1]
"""
    robot = load_robot(written(folder, text)).robot
    assert robot.name == "scara" and robot.joint_names == ("shoulder", "joint_2")
    assert np.array_equal(robot.bodies[1].rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert np.allclose(robot.bodies[1].inertia.first_moment, [0.0, 0.2, 0.0])


def test_environment_variables_in_paths(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = written(folder, '[robot]\nurdf = "${ROBOTS_HERE}/two.urdf"')
    monkeypatch.setenv("ROBOTS_HERE", str(folder))
    assert load_robot(path).robot.n == 2
    monkeypatch.delenv("ROBOTS_HERE")
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert caught.value.wrong == "the environment variable 'ROBOTS_HERE' is not set"
    assert "line 2, [robot] urdf" in caught.value.where
    assert "export ROBOTS_HERE=" in caught.value.fix


def test_locked_joints(folder: Path) -> None:
    robot = load_robot(written(folder, ROBOT + "locked = {lift = 0.3}")).robot
    assert robot.joint_names == ("elbow",)


def test_mounting_is_the_rotation_of_the_base(folder: Path) -> None:
    """Sideways as the source of the AR5's data says: Rz(-90) Ry(90) gives +x."""
    robot = load_robot(written(folder, ROBOT + "mounting = {pitch = 90, yaw = -90}")).robot
    assert np.array_equal(robot.gravity, [9.81, 0.0, 0.0])


def test_one_unit_means_the_joints_that_it_fits(folder: Path) -> None:
    text = SIGNALS.replace('time = "t"', 'time = "t"\nposition_unit = "deg"')
    signals = load_robot(written(folder, ROBOT + text)).signals
    assert signals is not None
    assert np.allclose(signals.position_scale, [np.pi / 180, 1.0])
    assert np.array_equal(signals.gains, [1.0, 1.0]) and signals.velocity is None


def test_one_gain_for_all(folder: Path) -> None:
    text = SIGNALS + "gain = -1"
    signals = load_robot(written(folder, ROBOT + text)).signals
    assert signals is not None and np.array_equal(signals.gains, [-1.0, -1.0])


def test_unit_gains_of_currents_are_noted(folder: Path) -> None:
    effort = EFFORT.replace("joint_torque", "motor_current").replace('["Nm", "N"]', '"A"')
    text = ROBOT + SIGNALS.replace(EFFORT, effort) + "gain = 1.0"
    assert "all drive gains are 1" in load_robot(written(folder, text)).notes[-1]


def test_windows_line_ends_and_byte_order_marks(folder: Path) -> None:
    path = folder / "robot.toml"
    path.write_bytes(b"\xef\xbb\xbf" + (ROBOT + SIGNALS).replace("\n", "\r\n").encode())
    assert load_robot(path).robot.n == 2


def signals(old: str, new: str) -> str:
    assert old in SIGNALS
    return ROBOT + SIGNALS.replace(old, new)


CURRENT = 'kind = "motor_current"\nunit = "A"'
TORQUE = 'kind = "joint_torque"\nunit = ["Nm", "N"]'
ERRORS = {
    "deep": (
        '[robot]\nurdf = "two.urdf"\njoints = ' + "[" * 3000,
        "nested too deeply",
        "robot.toml",
        "quotes",
    ),
    "long name": (f'[robot]\nurdf = "{"9" * 400}"', "does not exist", "urdf", "relative"),
    "syntax": ('[robot]\nurdf = two.urdf"', "not valid TOML", "robot.toml", "quotes"),
    "degrees": (signals('time = "t"', 'time = "t"\nposition_offset = [-90.0, 0.0]'),
                "-90 of 'elbow' looks like degrees", "position_offset", "write -1.5708"),
    "open list": (ROBOT + 'joints = ["elbow"\n# comment\ngravity = [0, 0, 1]', "not valid TOML",
                  "robot.toml", "left open above it"),
    "unknown key": (ROBOT + "jonits = []", "unknown key 'jonits'", "line 3, [robot] jonits",
                    "did you mean 'joints'"),
    "unknown deep key": (ROBOT + "[robot.limits]\nelbow = {uper = 1}", "unknown key 'uper'",
                         "line 4, [robot.limits.elbow] uper", "did you mean 'upper'"),
    "unknown dh key": ('[robot.dh]\nconvention = "standard"\n[[robot.dh.links]]\na = 1\n'
                       "[[robot.dh.links]]\nalfa = 1", "unknown key 'alfa'",
                       "line 6, [robot.dh.links[2]] alfa", "did you mean 'alpha'"),
    "unknown table": (ROBOT + "[procesing]", "unknown key 'procesing'", "line 3, [procesing]",
                      "did you mean 'processing'"),
    "missing table": ("[validation]\ncutoff = 1", "key 'robot' is missing", "robot.toml",
                      "add a [robot] table"),
    "missing key": (ROBOT + '[signals]\ntime = "t"\nposition = "q{}"', "neither columns of efforts",
                    "line 3, [signals]", "or target = ..., if joints follow targets"),
    "no number": (ROBOT + '[[knowledge]]\nkind = "mass"\nlink = "l1"\nlower = nan',
                  "'lower' is nan", "line 6, [knowledge[1]] lower", "write a number"),
    "wrong type": (ROBOT + "gravity = [0]", "the list 'gravity' is too short",
                   "line 3, [robot] gravity", "give it 3 entries"),
    "too long": (ROBOT + "gravity = [0, 0, 1, 2]", "cannot be used for 'gravity'",
                 "line 3, [robot] gravity", "at most 3"),
    "number in a list": (ROBOT + 'joints = ["elbow",\n 3]', "3 cannot be used", "line 4", "string"),
    "text for a number": (ROBOT + '[validation]\ncutoff = "8"', "'8' cannot be used for 'cutoff'",
                          "line 4, [validation] cutoff", "it should be a valid number"),
    "negative": (ROBOT + "[processing]\nrest_speed = -1", "-1", "line 4", "greater than 0"),
    "infinite": (ROBOT + "[processing]\nrest_speed = inf", "inf", "line 4", "finite"),
    "boolean": (ROBOT + "[processing]\nrest_speed = true", "True cannot", "line 4", "number"),
    "wrong word": (signals('"joint_torque"', '"torque"'), "'torque' cannot be used for 'kind'",
                   "[signals.effort] kind", "'joint_torque', 'link_torque' or 'gravity"),
    "fixed friction": (ROBOT + '[model]\nfriction = ["coulomb", "viscous"]', "for 'friction'",
                       "line 4, [model] friction", "fixed laws go into terms"),
    "no model": ("[robot]", "the robot has no model", "line 1, [robot]", "exactly one of"),
    "two models": (ROBOT + 'mjcf = "one.xml"', "the robot has urdf and mjcf", "line 1, [robot]",
                   "exactly one"),
    "no file": ('[robot]\nurdf = "tow.urdf"', "tow.urdf' does not exist", "line 2, [robot] urdf",
                "relative to the robot file"),
    "wrong kind": ('[robot]\nurdf = "one.xml"', "is not what its key 'urdf' says", "line 2",
                   "write mjcf"),
    "unknown joint": (ROBOT + 'joints = [\n"elbow",\n"lfit"]', "no joint 'lfit'", "line 5",
                      "did you mean 'lift'"),
    "unknown locked": (ROBOT + "[robot.locked]\nelbo = 0", "no joint 'elbo'", "line 4",
                       "did you mean 'elbow'"),
    "unknown limits": (ROBOT + "[robot.limits.elbo]\nupper = 0", "no joint 'elbo'", "line 3",
                       "did you mean 'elbow'"),
    "unknown tip": (ROBOT + 'tip = "d"', "no link 'd'", "line 3, [robot] tip", "links are a, b, c"),
    "unknown base": (ROBOT + 'base = "d"', "no link 'd'", "line 3, [robot] base", "links are"),
    "limits": (ROBOT + "[robot.limits]\nelbow = {upper = -3}", "a lower limit of -2 and an upper",
               "line 4, [robot.limits] elbow", "above"),
    "gravity twice": (ROBOT + "gravity = [0, 0, 1]\nmounting = {roll = 90}",
                      "gravity and mounting are both given", "line 3", "keep one"),
    "gravity in mm": (ROBOT + "gravity = [0, 0, -9810]", "gravity has a size of 9810 m/s²",
                      "line 3, [robot] gravity", "[0.0, 0.0, -9.81]"),
    "gravity in g": (ROBOT + "gravity = [0, 0, -0.981]", "gravity has a size of 0.981 m/s²",
                     "line 3, [robot] gravity", "in m/s²"),
    "term": (ROBOT + '[model]\nterms = ["a",\n{threshold = 1}]', "does not name its law", "line 5",
             "{law ="),
    "one column": (signals('"q{}"', '"q"'), "'q' is one column, but 2 joints", "line 5",
                   '"q{}" for q1, q2'),
    "count": (signals('"q{}"', '["q1"]'), "1 columns (q1) are given for 2 identified joints "
              "(elbow, lift)", "line 5, [signals] position", "one per joint"),
    "twice": (signals('"q{}"', '["i1", "q"]'), "column 'i1' is used twice, in signals.position and "
              "signals.effort.columns", "line 7, [signals.effort] columns", "own"),
    "twice in a list": (signals('"q{}"', '["q", "q"]'), "column 'q' is used twice, in "
                        "signals.position", "line 5, [signals] position", "own"),
    "joint twice": (ROBOT + 'joints = [\n"elbow",\n"lift",\n"elbow"]', "joint 'elbow' is listed "
                    "twice under joints", "line 6", "once"),
    "joint locked": (ROBOT + 'joints = ["elbow"]\n[robot.locked]\nelbow = 0.0', "joint 'elbow' is "
                     "locked, but also listed under joints", "line 3", "once"),
    "velocity unit": (signals('time = "t"', 'time = "t"\nvelocity_unit = "rad/s"'),
                      "velocity_unit is given, but no velocity columns", "line 5", "remove"),
    "commanded velocity": (signals('time = "t"', 'time = "t"\ncommanded_velocity = "v{}"'),
                           "commanded_velocity is given, but no commanded_position", "line 5",
                           "remove"),
    "commanded count": (signals('time = "t"', 'time = "t"\ncommanded_position = ["g"]'),
                        "1 columns (g) are given for 2", "line 5", "one per joint"),
    "commanded twice": (signals('time = "t"', 'time = "t"\ncommanded_position = ["i1", "g"]'),
                        "column 'i1' is used twice, in signals.commanded_position and "
                        "signals.effort.columns", "[signals.effort] columns", "own"),
    "units count": (signals('["Nm", "N"]', '["Nm"]'), "1 units are given for 2", "unit", "one per"),
    "unit unfit": (signals('time = "t"', 'time = "t"\nposition_unit = ["m", "m"]'),
                   "unit 'm' does not fit joint 'elbow', which is revolute", "line 5", "rad, deg"),
    "no current": (signals(TORQUE, CURRENT.replace('"A"', '["Nm", "N"]')),
                   "motor_current, but no unit is a current's: Nm, N", "unit", "motor_torque"),
    "torque unfit": (signals('["Nm", "N"]', '"Nm"'), "unit 'Nm' does not fit the joint torque of "
                     "'lift', which is prismatic", "unit", "use 'N' there"),
    "motor torque": (signals(TORQUE, 'kind = "motor_torque"\nunit = "A"'), "unit 'A' is a current",
                     "unit", "motor_current"),
    "no gain": (signals(TORQUE, CURRENT), "column 'i1' holds motor current, but joint 'elbow' has "
                "no drive gain", "[signals.effort] gain", "give gain = [...] in Nm/A per joint"),
    "gain count": (signals(TORQUE, CURRENT + "\ngain = [1.0]"), "1 gains are given for 2",
                   "line 10, [signals.effort] gain", "one per joint"),
    "gain zero": (signals(TORQUE, CURRENT + "\ngain = [1.0, 0]"), "the gain of joint 'lift' is "
                  "zero", "line 10, [signals.effort] gain", "may be negative"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_errors_name_the_line_and_the_nearest_key(case: str, folder: Path) -> None:
    text, wrong, where, fix = ERRORS[case]
    path = written(folder, text)
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert wrong in caught.value.wrong
    assert str(path) in caught.value.where and where in caught.value.where
    assert fix in caught.value.fix


def test_a_syntax_error_names_its_line(folder: Path) -> None:
    with pytest.raises(ModelError, match="at line 3, column"):
        load_robot(written(folder, ROBOT + "joints = [elbow]"))


def test_files_that_are_not_there_or_not_text(folder: Path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        load_robot(folder / "none.toml")
    path = folder / "robot.toml"
    path.write_bytes(b"\xff\xfe\x00[robot]")
    with pytest.raises(ModelError, match="not UTF-8"):
        load_robot(path)


LOGS = {
    "ur10e": ("ur10e/identification/ur-20_02_05-20sec_8harm.parquet", 6, 8.0),
    "panda": ("panda/panda_gaz2019_trajectory1.parquet", 7, 5.0),
    "rokae_ar5": ("rokae_ar5/ar5_run1_rows0_2300.parquet", 7, 4.0),
    "tiago": ("tiago/tiago_run1_rows0_5600.parquet", 5, 2.0),
}


@needs_data
@pytest.mark.parametrize("name", LOGS)
def test_examples_load_and_their_logs_have_the_columns(name: str) -> None:
    log, n, cutoff = LOGS[name]
    path = EXAMPLES / f"{name}.toml"
    loaded = load_robot(path)
    assert loaded.signals is not None and loaded.robot.n == n == loaded.signals.n
    assert loaded.validation.cutoff == cutoff
    assert checked(path, robot_text(path), RobotFile)[0].robot.source
    assert set(loaded.signals.columns) <= set(pl.read_parquet_schema(Path(DATA or "", log)))
    assert all(body.known for body in loaded.robot.bodies)


@needs_data
def test_ar5_hangs_sideways_and_tiago_lifts_against_gravity() -> None:
    ar5, tiago = (load_robot(EXAMPLES / f"{n}.toml").robot for n in ("rokae_ar5", "tiago"))
    assert np.linalg.norm(ar5.gravity) == pytest.approx(9.81, abs=2e-3)
    assert ar5.gravity[0] > 9.8  # it leans by about a degree
    assert tiago.coordinates[0].kind == "prismatic"
    lifted = sum(body.inertia.mass for body in tiago.bodies)
    links = read_mechanism(Path(DATA or "", "tiago/tiago_48_schunk.urdf")).links
    total = sum(link.inertia.mass for link in links if link.inertia is not None)
    assert 10.0 < lifted < total - 20.0  # the mobile base stands still and is left out
