"""`steelyard payload`: what it prints, writes and refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.conftest import Command
from cli.mistakes import leftovers
from steelyard.estimation.payload.load import PayloadEstimate
from steelyard.excitation.trajectories.random_fourier import random_fourier
from steelyard.motion import run
from steelyard.robot.inertia import Inertia
from steelyard.robot_file.file import load_robot
from steelyard.virtual.invent import random_truth
from steelyard.virtual.payload import Payload
from steelyard.virtual.robot import VirtualRobot
from steelyard.virtual.simulate import customary_sensors

LOAD = Inertia.about_com(1.5, (0.02, 0.05, 0.08), 0.004 * np.eye(3))
"""About the origin of the demo arm's last link."""


@pytest.fixture(scope="module")
def loaded(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo arm's log with a load on its last link."""
    robot = load_robot(given / "demo_arm.toml").robot
    truth = random_truth(robot, 0)
    carried = Payload(LOAD, robot.bodies[-1].name)
    sensors = customary_sensors(robot, truth)
    rig = VirtualRobot(robot, truth, sensors, seed=3, payload=carried)
    path = tmp_path_factory.mktemp("loaded") / "loaded.parquet"
    run(rig, random_fourier(robot, seed=11, period=3.0), path)
    return path


@pytest.mark.parametrize("together", [False, True])
def test_the_load_is_weighed(
    together: bool, loaded: Path, given: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    options = ["--unloaded", given / "identification.csv"] if together else []
    done = command("payload", identified, loaded, *options, "--json", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "payload.json").read_text())
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["payload.json"]
    assert abs(printed["mass"] - LOAD.mass) < 1.5 * printed["mass_half_width"] < 0.1
    error = np.abs(np.array(printed["centre"]) - LOAD.com)
    assert np.all(error < 1.5 * np.array(printed["centre_half_width"]))
    words = "from the unloaded and loaded runs" if together else "are the model's"
    assert words in " ".join(printed["notes"])


def test_the_table_names_frame_numbers_and_units(
    loaded: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, loaded)
    assert done.exit_code == 0, done.output
    last = load_robot_of(identified)
    words = " ".join(done.stdout.split())
    assert f"payload in frame '{last}'" in words
    for piece in ("mass", "kg", "centre x", "Iyz about the centre", "kg m²", "± 95 %"):
        assert piece in words
    assert "the inertia is" in words
    assert "note: friction and offsets are estimated per run, within 50 % of the model's" in words
    assert "drive gains" not in words


def load_robot_of(identified: Path) -> str:
    """The last link of an identified model."""
    printed = json.loads((identified / "model.json").read_text())
    return str(printed["model"]["robot"]["bodies"][-1]["name"])


def test_a_log_that_the_model_knows_is_reported(
    given: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, given / "identification.csv")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "the interval of the mass contains zero: no payload is detected" in words
    assert "centre" not in words
    assert "the model was identified from identification.csv" in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--frame", "falnge"), "there is no frame 'falnge'"),
        (("--unloaded", "../given/nothing.csv"), "no such log"),
        (("--unloaded", "{log}"), "is fitted twice"),
        (("-o", "../given"), "exists already"),
    ],
)
def test_mistakes(
    arguments: tuple[str, str],
    words: str,
    loaded: Path,
    identified: Path,
    command: Command,
    work: Path,
) -> None:
    done = command("payload", identified, loaded, *(a.format(log=loaded) for a in arguments))
    assert done.exit_code == 2 and done.stdout == ""
    assert words in done.stderr
    assert [line.split()[0] for line in done.stderr.splitlines()] == ["error:", "where", "fix"]
    assert leftovers(work) == []


def test_a_misspelt_frame_gets_the_nearest(
    loaded: Path, identified: Path, command: Command
) -> None:
    name = load_robot_of(identified)
    assert (
        f"did you mean '{name}'"
        in command("payload", identified, loaded, "--frame", name[:-1]).stderr
    )


def test_help_shows_an_example(command: Command) -> None:
    assert "Example: steelyard payload" in command("payload", "--help").stdout


def test_an_impossible_body_is_the_headline(
    loaded: Path, identified: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    ten = np.array([1.0, 0.0, 0.0, 0.0, -0.1, 0.0, 0.2, 0.0, 0.0, 0.2])
    wrong = PayloadEstimate("tool", "tip", ten, 1e-6 * np.eye(10), np.ones(6), np.ones(6))
    monkeypatch.setattr("steelyard.identification.payload.PayloadTask.done", lambda *_: wrong)
    done = command("payload", identified, loaded)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(
        "NOT PHYSICALLY CONSISTENT: a principal moment of inertia is negative"
    )
    printed = json.loads(command("payload", identified, loaded, "--json").stdout)
    assert printed["possible_body"] is False and "negative" in printed["flaw"]
