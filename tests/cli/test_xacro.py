"""Xacro files on the command line, with their arguments behind them."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from steelyard.cli.options_with_several_values import expanded
from steelyard.robot.file.robot_file import load_robot

Command = Callable[..., Result]
LINK = """<link name="{0}"><inertial><origin xyz="0 0 0.1"/><mass value="${{mass}}"/>
  <inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{1}" type="revolute"><parent link="{2}"/><child link="{0}"/><axis xyz="0 1 0"/>
  <origin xyz="0 0 0.3"/><limit lower="-2" upper="2" effort="100" velocity="2"/></joint>"""
ARM = f"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="$(arg name)">
<xacro:arg name="name" default="arm"/><xacro:arg name="mass" default="2"/>
<xacro:property name="mass" value="$(arg mass)"/><link name="base"/>
{LINK.format("upper", "j1", "base")}{LINK.format("lower", "j2", "upper")}</robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(ARM)
    return path


def test_arguments_belong_to_the_file() -> None:
    words = ["check", "a.xacro", "name:=left", "run.csv", "two:=a b", "--json"]
    assert expanded(words) == ["check", "a.xacro name:=left two:=a b", "run.csv", "--json"]
    assert expanded(["init", "a.urdf", "x:=1"]) == ["init", "a.urdf x:=1"]


@pytest.mark.slow
def test_from_a_xacro_file_to_a_model(command: Command, arm: Path, tmp_path: Path) -> None:
    given = (arm, "name:=left", "mass:=3")
    done = command("simulate", *given, "--seed", 1, "--period", 2, "-o", tmp_path / "sim")
    assert done.exit_code == 0, done.output
    log, file = tmp_path / "sim/log.csv", tmp_path / "left.toml"
    done = command("init", *given, log, "-o", file)
    assert done.exit_code == 0, done.output
    assert 'xacro.arguments = {name = "left", mass = "3"}' in file.read_text()
    assert [b.inertia.mass for b in load_robot(file).robot.bodies] == [3.0, 3.0]
    note = "arm.urdf.xacro is expanded with name:=left mass:=3"
    assert note in done.stdout
    for robot in ([file], given):
        checked = json.loads(command("check", *robot, log, "--quick", "--json").stdout)
        assert note in checked["notes"]
        out = tmp_path / f"out{len(robot)}"
        done = command("identify", *robot, log, "--no-check", "-o", out)
        assert done.exit_code == 0, done.output
        provenance = json.loads((out / "model.json").read_text())["provenance"]
        assert {"robot arm.urdf.xacro", "robot arm.urdf"} <= set(provenance["inputs"])
        assert note in provenance["notes"]
    made = tmp_path / "made.urdf"
    done = command("export", tmp_path / "out1", "--model", *given, "-o", made)
    assert done.exit_code == 0, done.output
    assert 'name="left"' in made.read_text() and "<xacro:" not in made.read_text()


def test_the_name_of_the_robot_file(
    command: Command, arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm.parent)
    assert command("init", arm).exit_code == 0
    text = (arm.parent / "arm.toml").read_text()
    assert 'urdf = "arm.urdf.xacro"' in text and "# xacro.arguments = {}" in text


def test_a_misspelt_argument(command: Command, arm: Path) -> None:
    done = command("init", arm, "nmae:=left")
    assert done.exit_code == 2
    assert "no argument 'nmae'" in done.output and "did you mean 'name'" in done.output
