"""Logs of arms with prismatic and revolute joints, whose columns have units of both kinds."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from steelyard.base.errors import LogError
from steelyard.cli.app import app
from steelyard.robot.init.guess_columns import guess_columns
from steelyard.robot.robot import Coordinate, Limits

SCARA = (
    Coordinate("shoulder", "revolute"),
    Coordinate("elbow", "revolute"),
    Coordinate("lift", "prismatic", Limits(-0.2, 0.0)),
    Coordinate("wrist", "revolute"),
)
LINKS = """
  <link name="upper_arm"><inertial><origin xyz="0.12 0 0.02"/><mass value="4"/>
    <inertia ixx="0.01" iyy="0.05" izz="0.055" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="forearm"><inertial><origin xyz="0.1 0 0.03"/><mass value="3"/>
    <inertia ixx="0.008" iyy="0.03" izz="0.033" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="quill"><inertial><origin xyz="0 0 0.05"/><mass value="1.2"/>
    <inertia ixx="0.006" iyy="0.006" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="flange"><inertial><origin xyz="0.02 0 -0.02"/><mass value="0.8"/>
    <inertia ixx="0.002" iyy="0.002" izz="0.0015" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
JOINTS = (
    ("shoulder", "revolute", "base", "upper_arm", "0 0 0.2", (-2.2, 2.2, 4, 120)),
    ("elbow", "revolute", "upper_arm", "forearm", "0.25 0 0", (-2.5, 2.5, 6, 60)),
    ("lift", "prismatic", "forearm", "quill", "0.2 0 0", (-0.2, 0.0, 1, 200)),
    ("wrist", "revolute", "quill", "flange", "0 0 -0.05", (-3.1, 3.1, 12, 20)),
)


def scara() -> str:
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 0 1"/>'
        f'<limit lower="{low}" upper="{high}" velocity="{speed}" effort="{effort}"/></joint>'
        for name, kind, parent, child, xyz, (low, high, speed, effort) in JOINTS
    )
    return f'<robot name="scara"><link name="base"/>{LINKS}{joints}</robot>'


def columns(position: list[str], velocity: list[str] | None = None) -> list[str]:
    return ["t", *position, *(velocity or []), "tau1_Nm", "tau2_Nm", "tau3_N", "tau4_Nm"]


@pytest.mark.parametrize(
    ("position", "unit"),
    [
        (["q1_rad", "q2_rad", "q3_m", "q4_rad"], None),
        (["q1_deg", "q2_deg", "q3_mm", "q4_deg"], ("deg", "deg", "mm", "deg")),
        (["q1_deg", "q2_deg", "q3_m", "q4_deg"], ("deg", "deg", "m", "deg")),
        (["q0 [rad]", "q1 [rad]", "q2 [mm]", "q3 [rad]"], ("rad", "rad", "mm", "rad")),
    ],
)
def test_units_are_those_of_the_joints_kinds(position: list[str], unit: object) -> None:
    guess = guess_columns(SCARA, columns(position))
    assert guess.section.position == tuple(position)
    assert guess.section.position_unit == unit
    assert guess.section.effort.unit == ("Nm", "Nm", "N", "Nm")


def test_names_of_joints_with_units() -> None:
    position = [f"position_{c.name} [{'m' if c.kind == 'prismatic' else 'rad'}]" for c in SCARA]
    names = ["t", *position, *(f"effort_{c.name}" for c in SCARA)]
    guess = guess_columns(SCARA, names)
    assert guess.section.position == tuple(position)


@pytest.mark.parametrize(
    ("position", "odd"),
    [
        (["q1_m", "q2_rad", "q3_rad", "q4_rad"], r"shoulder \(perhaps q1_m\)"),
        (["q1_rad", "q2_rad", "q3_m", "q3_mm", "q4_rad"], r"lift \(perhaps q3_m, q3_mm\)"),
    ],
    ids=["of another joint", "twice"],
)
def test_units_that_are_not_those_of_the_joints_are_not_taken(
    position: list[str], odd: str
) -> None:
    with pytest.raises(LogError, match=f"no column is recognised as that of {odd}"):
        guess_columns(SCARA, columns(position))


@pytest.mark.slow
def test_a_simulated_scara_is_identified_without_a_change(tmp_path: Path) -> None:
    urdf, robot, run = (tmp_path / name for name in ("scara.urdf", "scara.toml", "run"))
    urdf.write_text(scara())

    def steelyard(*arguments: object) -> None:
        done = CliRunner().invoke(app, [str(a) for a in arguments])
        assert done.exit_code == 0, done.output

    log = run / "log.csv"
    steelyard("simulate", urdf, "--period", 4, "--seed", 1, "-o", run)
    steelyard("init", urdf, log, "-o", robot)
    steelyard("identify", robot, log, "-o", tmp_path / "out")
    estimate = json.loads((tmp_path / "out" / "model.json").read_text())["estimate"]
    found = dict(zip(estimate["names"], estimate["values"], strict=True))
    true = json.loads((run / "truth.json").read_text())["parameters"]
    lifted = true["m.quill"]["value"] + true["m.flange"]["value"]
    assert found["m.quill"] == pytest.approx(lifted, rel=0.05)
    assert found["coulomb.elbow"] == pytest.approx(true["coulomb.elbow"]["value"], rel=0.05)
