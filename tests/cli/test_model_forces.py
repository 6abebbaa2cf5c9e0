"""What an MJCF says of forces reaches whoever uses it."""

import json
from pathlib import Path

import pytest

from cli.conftest import Command
from steelyard.excite.design_problem_from_tables import build
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot

MJCF = """
<mujoco model="sprung"><compiler angle="radian"/><option><flag gravity="disable"/></option>
  <worldbody>
    <body><joint name="a" axis="0 1 0" range="-1 1" stiffness="3" springref=".2"/>
      <geom size=".1" pos=".3 0 0"/>
      <body pos=".5 0 0"><joint name="b" axis="0 1 0" range="-1 1"/><geom size=".1" pos=".2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="a" kp="100" gear="2" forcerange="-300 400"/>
    <position joint="b" kp="100" {second}/>
  </actuator>
</mujoco>
"""


@pytest.fixture
def mjcf(tmp_path: Path) -> Path:
    path = tmp_path / "sprung.xml"
    path.write_text(MJCF.format(second='forcerange="-99999 99999"'))
    return path


@pytest.mark.slow
def test_notes_of_the_model_file_are_reported_by_every_command(
    command: Command, mjcf: Path, tmp_path: Path
) -> None:
    run, toml = tmp_path / "run", tmp_path / "made.toml"
    shown = command("simulate", mjcf, "--period", "4", "-o", run).stdout
    notes = load_robot(mjcf).notes
    assert len(notes) == 3 and all(f"note        {note}" in shown for note in notes)
    made = json.loads(command("init", mjcf, run / "log.csv", "-o", toml, "--json").stdout)
    assert sorted(made["notes"]) == sorted(notes)
    checked = json.loads(command("check", mjcf, run / "log.csv", "--json").stdout)
    assert set(notes) <= set(checked["notes"])
    assert load_robot(toml).notes == tuple(note for note in notes if "placeholder" in note)


def test_torques_are_limited_by_the_range_of_forces(mjcf: Path) -> None:
    gap = "torque is not limited for joints without a known effort limit: 'b'"
    for second, limits, notes in (
        ('forcerange="-99999 99999"', [600.0], [gap]),
        ('forcerange="-40 40"', [600.0, 40.0], []),
    ):
        mjcf.write_text(MJCF.format(second=second))
        toml = mjcf.with_name("motion.toml")
        toml.write_text(
            f'[robot]\nmjcf = "{mjcf.name}"\n[excitation.limits]\nshare = 1.0\n'
            "[excitation.collision]\nbodies = false\n"
        )
        loaded = load_robot(toml)
        problem = build(loaded, model_with_open_friction(loaded))
        (torque,) = problem.constraints
        assert torque.limits.tolist() == limits
        assert [note for note in problem.notes if "torque is not limited" in note] == notes


def test_limited_torques_hold_the_springs_that_terms_stand_for(mjcf: Path) -> None:
    toml = mjcf.with_name("motion.toml")
    still = JointState([0.7, 0.0], [0.0, 0.0], [0.0, 0.0])
    for term, sprung in (
        ("", 0.0),
        (', {law = "spring", joints = ["a"], free = 0.2}', 3.0 * 0.5),
        (', {law = "spring", joints = ["a"], free = "unknown"}', 3.0 * 0.5),
    ):
        toml.write_text(
            f'[robot]\nmjcf = "{mjcf.name}"\ngravity = [0.0, 0.0, 0.0]\n[model]\n'
            f'terms = ["rigid_body"{term}]\n[excitation.collision]\nbodies = false\n'
        )
        loaded = load_robot(toml)
        model = model_with_open_friction(loaded)
        (torque,) = build(loaded, model).constraints
        ((values, _),) = torque.cases
        assert model.torque_of(still, values)[0] == pytest.approx(sprung)
        assert ("springs" in torque.scope) == bool(term)
