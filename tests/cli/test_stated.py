"""Drives that options of `steelyard init` state."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_schema import tomllib

URDF = "../given/demo_arm.urdf"
RATIOS = (100.0, -50.0, 30.0)


@pytest.fixture
def motors(given: Path, tmp_path: Path) -> Path:
    """The log of the arm with three joints, its signals named as of motors."""
    table = pl.read_csv(given / "identification.csv")
    table.columns = [
        name.replace("q", "q_motor", 1)
        if name.startswith("q")
        else name.replace("tau", "tau_motor")
        for name in table.columns
    ]
    table.write_csv(tmp_path / "motors.csv")
    return tmp_path / "motors.csv"


@pytest.fixture
def currents(given: Path, tmp_path: Path) -> Path:
    """The same log, its efforts named as currents."""
    table = pl.read_csv(given / "identification.csv")
    table.columns = [
        f"current{name[3]}_A" if name.startswith("tau") else name for name in table.columns
    ]
    table.write_csv(tmp_path / "currents.csv")
    return tmp_path / "currents.csv"


def test_gears_are_written_with_their_coupling(
    command: Command, given: Path, motors: Path, tmp_path: Path
) -> None:
    robot, joints = tmp_path / "arm.toml", load_robot(given / "demo_arm.urdf").robot.joint_names
    options = ("--ratios", "100,-50,30", "--coupling", f"{joints[2]}, {joints[1]}, 8")
    done = command("init", URDF, motors, *options, "-o", robot)
    assert done.exit_code == 0, done.output
    assert "zeros     joints are assumed at zero where their motors are" in done.stdout
    loaded = load_robot(robot)
    expected = np.diag(RATIOS)
    expected[2, 1] = 8.0
    assert loaded.robot.transmission is not None and loaded.terms is not None
    assert loaded.robot.transmission.matrix.tolist() == expected.tolist()
    coupled = [term.description for term in loaded.terms if not isinstance(term.description, str)]
    assert [term["law"] for term in coupled] == ["rotor_inertia", "coulomb", "viscous"]


@pytest.mark.parametrize("motor_side", [True, False])
def test_zeros_are_written(
    motor_side: bool, command: Command, given: Path, motors: Path, tmp_path: Path
) -> None:
    robot, log = tmp_path / "arm.toml", motors if motor_side else given / "identification.csv"
    ratios = ("--ratios", "1,1,1") if motor_side else ()
    done = command("init", URDF, log, *ratios, "--zeros", "0,-90deg,1.5", "-o", robot)
    assert done.exit_code == 0 and "zeros     joints" not in done.stdout
    signals = load_robot(robot).signals
    assert signals is not None and signals.position_offset is not None
    assert signals.position_offset.tolist() == pytest.approx([0.0, -np.pi / 2.0, 1.5])


def test_gains_are_written(command: Command, currents: Path, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    done = command("init", URDF, currents, "--gains", "12 9.5 -10", "-o", robot)
    assert done.exit_code == 0 and "gains from --gains." in done.stdout
    signals = load_robot(robot).signals
    assert signals is not None and signals.gains.tolist() == [12.0, 9.5, -10.0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--ratios", "100,-50"), "'100,-50' is not 3 numbers other than zero"),
        (("--ratios", "1,1,1", "--coupling", "elbow,32"), "'elbow,32' is not MOTOR,JOINT,RATIO"),
        (("--ratios", "1,1,1", "--coupling", "elbw,elbow,2"), "there is no joint 'elbw'"),
        (("--coupling", "elbow,elbow,2"), "a coupling is given without gear ratios"),
        (("--zeros", "0,90deg"), "'0,90deg' is not 3 positions"),
        (("--zeros", "0,-90,1.5"), "looks like degrees\n  where  --zeros\n  fix    write -90deg"),
        (("--side", "joint", "--ratios", "1,2,3"), "signals are of joints, as --side joint says"),
    ],
)
def test_wrong_options_are_explained(
    options: tuple[str, ...], words: str, command: Command, motors: Path, tmp_path: Path
) -> None:
    done = command("init", URDF, motors, *options, "-o", tmp_path / "arm.toml")
    assert done.exit_code == 2 and words in done.stderr
    assert not (tmp_path / "arm.toml").exists()


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--ratios", "100,-50,30"), ("motor_torque", "motor", "Nm")),
        (("--ratios", "100,-50,30", "--side", "motor"), ("motor_torque", "motor", "Nm")),
        (("--gains", "1,2,3"), ("motor_current", "joint", "A")),
        (("--gains", "1,2,3", "--ratios", "100,-50,30"), ("motor_current", "motor", "A")),
    ],
)
def test_what_is_stated_counts_more_than_names(
    options: tuple[str, ...],
    expected: tuple[str, str, str],
    command: Command,
    given: Path,
    tmp_path: Path,
) -> None:
    robot = tmp_path / "arm.toml"
    done = command("init", URDF, given / "identification.csv", *options, "-o", robot)
    assert done.exit_code == 0, done.output
    section = load_robot(robot).signals
    assert section is not None
    effort = tomllib.loads(robot.read_text())["signals"]["effort"]
    assert (effort["kind"], effort.get("side", "joint"), effort["unit"]) == expected
    gains = np.array([1.0, 2.0, 3.0]) if "--gains" in options else np.ones(3)
    ratios = RATIOS if "--ratios" in options else np.ones(3)
    assert np.allclose(section.gains, gains * ratios)


def test_the_side_of_the_joints_counts_more_than_names_of_motors(
    command: Command, motors: Path, tmp_path: Path
) -> None:
    robot = tmp_path / "arm.toml"
    done = command("init", URDF, motors, "--side", "joint", "-o", robot)
    loaded = load_robot(robot)
    assert "torque at the joints, as stated" in done.stdout and loaded.signals is not None
    assert loaded.robot.transmission is None and loaded.signals.position_map is None


def test_options_have_no_effect_without_a_log(command: Command, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    alone = command("init", URDF, "--gains", "1,1,1", "-o", robot)
    assert alone.exit_code == 2 and "--gains is given without a log" in alone.stderr
    assert not robot.exists()
