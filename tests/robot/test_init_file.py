import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import ModelError
from steelyard.estimate.identified_model import BAND
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.file.sections import PriorSection, ProcessingSection
from steelyard.robot.init.draft_robot_file import assigned, drafted, path_from, proposed
from steelyard.robot.init.guess_efforts_and_gears import link_side
from steelyard.robot.robot import Limits

DATA = os.environ.get("STEELYARD_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="STEELYARD_DATA names no folder with robots")

# model, log, number of joints found, effort kind
ROBOTS = {
    "ur10e": (
        "ur10e/ur10e.urdf",
        "ur10e/identification/ur-20_02_05-20sec_8harm.parquet",
        6,
        "motor_current",
    ),
    "ur10e old": (
        "ur10e/ur10e.urdf",
        "ur10e/identification/ur-19_09_27-11_32_02.parquet",
        6,
        "motor_current",
    ),
    "panda": (
        "panda/panda_arm.urdf",
        "panda/panda_gaz2019_trajectory1.parquet",
        7,
        "link_torque",
    ),
    "panda with hand": (
        "../models/panda_description/urdf/panda.urdf",
        "panda/panda_gaz2019_trajectory1.parquet",
        7,
        "link_torque",
    ),
    "ar5": ("rokae_ar5/ar5.urdf", "rokae_ar5/ar5_run1_rows0_2300.parquet", 7, "joint_torque"),
    "tiago": (
        "tiago/tiago_48_schunk.urdf",
        "tiago/tiago_run1_rows0_5600.parquet",
        8,
        "motor_current",
    ),
}

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_l"/>
<axis xyz="0 0 1"/>{extra}</joint><link name="{name}_l"/>"""
LIMIT = '<limit lower="{}" upper="{}" velocity="1" effort="2"/>'


def urdf(path: Path, *joints: tuple[str, str, str, str]) -> Path:
    inside = "".join(
        JOINT.format(name=name, kind=kind, parent=parent, extra=extra)
        for name, kind, parent, extra in joints
    )
    path.write_text(f'<robot name="r"><link name="base"/>{inside}</robot>')
    return path


def test_the_path_of_the_model_is_the_shorter_of_relative_and_absolute(tmp_path: Path) -> None:
    model = urdf(tmp_path / "r.urdf", ("a", "revolute", "base", LIMIT.format(-1, 1)))
    near = tmp_path / "near"
    deep = tmp_path.joinpath(*(["far"] * len(str(tmp_path))))
    assert path_from(near, model) == "../r.urdf"
    assert path_from(deep, model) == model.as_posix()
    assert 'urdf = "../r.urdf"' in round_trip(model, near / "r.toml", None)[1]


def round_trip(
    model: Path, output: Path, columns: list[str] | None, sample: dict | None = None
) -> tuple[LoadedRobot, str]:
    output.parent.mkdir(parents=True, exist_ok=True)
    proposal = proposed(model)
    text = drafted(proposal, assigned(proposal, columns, sample), output).text
    output.write_text(text, encoding="utf-8")
    return load_robot(output), text


@needs_data
@pytest.mark.parametrize("name", ROBOTS)
def test_real_robots_and_logs(name: str, tmp_path: Path) -> None:
    model, log, n, kind = ROBOTS[name]
    frame = pl.read_parquet(Path(DATA or "", log))
    sample = {column: frame[column].head(2000).to_numpy() for column in frame.columns}
    path = Path(DATA or "", model)
    loaded, text = round_trip(path, tmp_path / "deep" / "er" / "x.toml", frame.columns, sample)
    assert loaded.robot.n == n
    assert not any("no position was given" in note for note in loaded.notes)
    assert loaded.signals is not None and loaded.signals.effort_kind == kind
    assert set(loaded.signals.columns) <= set(frame.columns)
    assert np.all(loaded.signals.position_scale == 1.0) and loaded.signals.time_scale == 1.0
    assert loaded.terms is not None
    behind = kind == "link_torque"
    assert ("rotor_inertia" in [term.description for term in loaded.terms]) is not behind
    comments = " ".join(" ".join(line.lstrip("# ") for line in text.splitlines()).split())
    assert ('set kind = "joint_torque" and add "rotor_inertia" to' in comments) is behind


@pytest.mark.parametrize(
    ("robot", "joint", "name"),
    [
        ("panda", "panda_joint1", "panda"),
        ("arm", "fr3_joint1", "fr3"),
        ("lbr_iiwa_14_r820", "joint_a1", "lbr"),
        ("GEN3_ROBOTIQ", "joint_1", "gen3"),
        ("gen3_lite", "joint_1", ""),
        ("expanda", "pandan", ""),
        ("ur10e", "shoulder_pan_joint", ""),
    ],
)
def test_robots_with_sensors_behind_the_gears_are_known_by_name(
    robot: str, joint: str, name: str
) -> None:
    assert link_side(robot, [joint]) == name


@needs_data
def test_fingers_are_locked_and_limits_taken_over(tmp_path: Path) -> None:
    path = Path(DATA or "").parent / "models/panda_description/urdf/panda.urdf"
    loaded, text = round_trip(path, tmp_path / "panda.toml", None)
    bare = load_robot(path).robot
    assert loaded.robot.joint_names == tuple(f"panda_joint{k}" for k in range(1, 8))
    assert "[robot.locked]\npanda_finger_joint1 = 0.0" in text
    for one, other in zip(loaded.robot.coordinates, bare.coordinates, strict=False):
        assert one.limits == other.limits


def test_hands_by_structure(tmp_path: Path) -> None:
    """A sliding pair on one link, and a leaf with a follower; locked within their limits."""
    slide = LIMIT.format(0.01, 0.05)
    model = urdf(
        tmp_path / "r.urdf",
        ("turn", "revolute", "base", LIMIT.format(-1, 1)),
        ("left", "prismatic", "turn_l", slide),
        ("right", "prismatic", "turn_l", slide),
    )
    loaded, text = round_trip(model, tmp_path / "r.toml", None)
    assert loaded.robot.joint_names == ("turn",)
    assert "left = 0.01\nright = 0.01" in text
    proposal = proposed(model)
    hands = drafted(proposal, assigned(proposal, None, None), tmp_path / "r.toml").hands
    assert hands == ("left", "right")
    model = urdf(
        tmp_path / "r.urdf",
        ("turn", "revolute", "base", LIMIT.format(-1, 1)),
        ("a", "revolute", "turn_l", LIMIT.format(0, 1)),
        ("b", "revolute", "turn_l", LIMIT.format(0, 1) + '<mimic joint="a"/>'),
    )
    assert round_trip(model, tmp_path / "r.toml", None)[0].robot.joint_names == ("turn",)


def test_a_slide_with_a_mimic_that_is_logged_by_name_is_an_axis_of_the_arm(tmp_path: Path) -> None:
    model = urdf(
        tmp_path / "r.urdf",
        ("yaw", "revolute", "base", LIMIT.format(-1, 1)),
        ("insertion", "prismatic", "yaw_l", LIMIT.format(0, 0.3)),
        ("weight", "prismatic", "yaw_l", LIMIT.format(0, 0.3) + '<mimic joint="insertion"/>'),
    )
    columns = ["t", "q_yaw", "q_insertion", "tau_yaw", "tau_insertion"]
    ramp = dict.fromkeys(columns, np.linspace(0.0, 0.2, 50))
    joints = round_trip(model, tmp_path / "r.toml", columns, ramp)[0].robot.joint_names
    assert joints == ("yaw", "insertion")
    for less in (columns[:-1], columns):  # no effort, or one that never changes
        still = ramp | {"tau_insertion": np.zeros(50)}
        alone = round_trip(model, tmp_path / "r.toml", less, still)[0]
        assert alone.robot.joint_names == ("yaw",)


def test_a_mimic_inside_the_arm_is_no_hand(tmp_path: Path) -> None:
    model = urdf(
        tmp_path / "r.urdf",
        ("a", "revolute", "base", LIMIT.format(0, 1)),
        ("b", "revolute", "a_l", LIMIT.format(0, 1) + '<mimic joint="a" multiplier="-1"/>'),
        ("c", "revolute", "b_l", LIMIT.format(0, 1)),
    )
    assert round_trip(model, tmp_path / "r.toml", None)[0].robot.joint_names == ("a", "c")


def test_a_range_of_one_point_beside_a_speed(tmp_path: Path) -> None:
    """`lower="0" upper="0"` says nothing; the limits that `init` writes then have a speed alone."""
    model = urdf(tmp_path / "r.urdf", ("a", "revolute", "base", LIMIT.format(0, 0)))
    loaded, text = round_trip(model, tmp_path / "r.toml", None)
    assert "[robot.limits.a]\nvelocity = 1.0\neffort = 2.0" in text
    assert loaded.robot.coordinates[0].limits == Limits(velocity=1.0, effort=2.0)


def test_a_robot_of_fingers_only_keeps_them(tmp_path: Path) -> None:
    model = urdf(tmp_path / "r.urdf", ("finger", "revolute", "base", LIMIT.format(0, 1)))
    assert round_trip(model, tmp_path / "r.toml", None)[0].robot.joint_names == ("finger",)


def test_strange_names_and_columns_survive(tmp_path: Path) -> None:
    name = 'ellbögen "1" # x'.replace('"', "&quot;")
    model = urdf(tmp_path / "r.urdf", (name, "continuous", "base", ""))
    columns = ["time\n[evil]", 'q "1"\\', "tau\n= 1", "b\x01ad"]
    loaded, text = round_trip(model, tmp_path / "r.toml", columns)
    assert loaded.robot.joint_names == ('ellbögen "1" # x',)
    assert loaded.signals is not None
    assert loaded.signals.columns == ("time\n[evil]", 'q "1"\\', "tau\n= 1")


def test_without_a_log_the_signals_are_a_template_that_works(tmp_path: Path) -> None:
    model = urdf(
        tmp_path / "r.urdf",
        ("a", "revolute", "base", LIMIT.format(0, 1)),
        ("b", "prismatic", "a_l", LIMIT.format(0, 1)),
    )
    output = tmp_path / "r.toml"
    loaded, text = round_trip(model, output, None)
    assert loaded.signals is None and "no log was given" in text
    head, template = text.split("leading #.\n")
    lines = template.split("\n\n")[0].splitlines()
    output.write_text(head + "\n" + "\n".join(line.removeprefix("# ") for line in lines))
    signals = load_robot(output).signals
    assert signals is not None and signals.position == ("q1", "q2")


def test_every_key_that_is_commented_out_is_right(tmp_path: Path) -> None:
    """Uncommented, `key = value` lines of the other sections load too."""
    model = urdf(tmp_path / "r.urdf", ("a", "revolute", "base", LIMIT.format(0, 1)))
    output = tmp_path / "r.toml"
    _, text = round_trip(model, output, ["t", "q1", "dq1", "tau1"])
    keys = ("source", "velocity", "velocity_unit", "velocity_delay", "gain", "delay", "outliers",
            "repeats", "saturation", "resampling", "motion", "effort", "cutoff")  # fmt: skip
    for key in keys:
        assert f"\n# {key} = " in text
        text = text.replace(f"\n# {key} = ", f"\n{key} = ")
    output.write_text(text)
    loaded = load_robot(output)
    assert loaded.signals is not None
    assert loaded.signals.velocity == ("dq1",) and loaded.signals.velocity_delay == 0.005
    assert loaded.processing == ProcessingSection(motion="auto")  # the defaults
    assert loaded.prior == PriorSection() and loaded.validation.cutoff == BAND


def test_the_side_of_torque_columns_is_left_to_be_checked(tmp_path: Path) -> None:
    model = urdf(tmp_path / "r.urdf", ("a", "revolute", "base", LIMIT.format(0, 1)))
    loaded, text = round_trip(model, tmp_path / "r.toml", ["t", "q1", "tau1"])
    assert loaded.terms is not None
    assert "rotor_inertia" in [term.description for term in loaded.terms]
    words = " ".join(text.replace("#", "").split())
    assert "the side of the gears" in words and 'set kind = "link_torque" below' in words
    behind = (tmp_path / "r.toml").read_text().replace('"joint_torque"\n', '"link_torque"\n')
    (tmp_path / "r.toml").write_text(behind)
    with pytest.raises(ModelError, match="'rotor_inertia' acts on the motors' side"):
        model_with_open_friction(load_robot(tmp_path / "r.toml"))
    (tmp_path / "r.toml").write_text(behind.replace('"rotor_inertia", "coulomb"', '"coulomb"'))
    assert len(model_with_open_friction(load_robot(tmp_path / "r.toml")).terms) == 4


def test_mjcf_is_named_as_such(tmp_path: Path) -> None:
    model = tmp_path / "r.xml"
    model.write_text(
        '<mujoco model="m"><worldbody><body><joint name="j"/>'
        '<geom type="sphere" size=".1"/></body></worldbody></mujoco>'
    )
    loaded, text = round_trip(model, tmp_path / "r.toml", None)
    assert 'mjcf = "r.xml"' in text and loaded.robot.joint_names == ("j",)


def test_a_robot_file_is_refused(tmp_path: Path) -> None:
    model = urdf(tmp_path / "r.urdf", ("a", "revolute", "base", LIMIT.format(0, 1)))
    round_trip(model, tmp_path / "r.toml", None)
    with pytest.raises(ModelError, match="already a robot file"):
        proposed(tmp_path / "r.toml")
