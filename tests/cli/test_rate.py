"""Logs without a column of time: the robot file says their rate."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import PLAIN
from cli.river_files import edited
from steelyard.robot.file.signals import ROW
from steelyard.robot.file.toml_schema import tomllib

RATE = 250.0


@pytest.fixture
def timeless(given: Path, tmp_path: Path) -> Path:
    table = pl.read_csv(given / "identification.csv")
    even = pl.Series("time_s", np.arange(len(table)) / RATE)
    table.with_columns(even).write_csv(tmp_path / "timed.csv")
    table.drop("time_s").write_csv(tmp_path / "run.csv")
    return tmp_path / "run.csv"


def base(folder: Path) -> dict[str, float]:
    return steelyard.load_model(folder).estimate.parameters.as_dict()


@pytest.mark.slow
def test_init_takes_a_rate_and_the_estimate_is_that_of_the_timed_log(
    command: Command, given: Path, timeless: Path, tmp_path: Path
) -> None:
    robot, timed = tmp_path / "arm.toml", timeless.with_name("timed.csv")
    urdf = given / "demo_arm.urdf"
    shown = command("init", urdf, timeless, "--rate", RATE, "-o", robot)
    assert shown.exit_code == 0, shown.output
    assert "time is the number of the row at the 250 Hz that were given" in shown.stdout
    signals = tomllib.loads(robot.read_text())["signals"]
    assert signals["rate"] == RATE and "time" not in signals
    checked = " ".join(command("check", robot, timeless, "--quick", "-v").stdout.split())
    assert "250 Hz, steps of 4 ms, uniform, as declared: the log has no column of time" in checked
    done = command("identify", robot, timeless, *PLAIN, "-o", tmp_path / "a")
    assert done.exit_code == 0, done.output
    assert command("identify", urdf, timed, *PLAIN, "-o", tmp_path / "b").exit_code == 0
    mine, other = base(tmp_path / "a"), base(tmp_path / "b")
    assert mine.keys() == other.keys()
    for name, value in mine.items():
        assert value == pytest.approx(other[name], rel=1e-3, abs=1e-4)
    pl.read_csv(given / "validation.csv").drop("time_s").write_csv(tmp_path / "next.csv")
    done = command("validate", tmp_path / "a" / "model.json", f"{tmp_path / 'next.csv'}@0.1:1.5")
    assert done.exit_code == 0, done.output


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 10.0])
def test_a_rate_that_velocities_contradict_is_named_with_the_true_one(
    command: Command, given: Path, timeless: Path, tmp_path: Path, factor: float
) -> None:
    robot, rate = tmp_path / "arm.toml", factor * RATE
    table = pl.read_csv(timeless)
    steps = {c: np.gradient(table[c].to_numpy(), 1.0 / RATE) for c in table.columns if c[0] == "q"}
    table.with_columns(**{f"d{c}_s": v for c, v in steps.items()}).write_csv(tmp_path / "run2.csv")
    shown = command(
        "init", given / "demo_arm.urdf", tmp_path / "run2.csv", "--rate", rate, "-o", robot
    )
    assert shown.exit_code == 1, shown.output
    words = (
        f"at the {rate:g} Hz that were given, velocities are {1.0 / factor:g} times the derivative"
    )
    assert words in shown.stdout and f"the rate is {RATE:g} Hz" in shown.stdout
    assert "CHECK, contradictory" in robot.read_text()
    fixed = tmp_path / "fixed.toml"
    done = command("check", robot, tmp_path / "run2.csv", "--quick", "--fix", fixed, "--json")
    printed = json.loads(done.stdout)
    assert [f["check"] for f in printed["findings"] if f["severity"] == "wrong"] == ["clock"]
    assert tomllib.loads(fixed.read_text())["signals"]["rate"] == RATE


def test_init_without_a_rate_asks_for_it(
    command: Command, given: Path, timeless: Path, tmp_path: Path
) -> None:
    robot = tmp_path / "arm.toml"
    shown = command("init", given / "demo_arm.urdf", timeless, "-o", robot)
    assert shown.exit_code == 2 and not robot.exists()
    assert "no column looks like time" in shown.stderr
    assert "--rate HZ: all other columns are recognised" in shown.stderr
    assert command("init", given / "demo_arm.urdf", timeless, "--rate", RATE, "-o", robot)
    pl.read_csv(timeless).drop("tau1_Nm").write_csv(tmp_path / "less.csv")
    shown = command(
        "init", given / "demo_arm.urdf", tmp_path / "less.csv", "-o", tmp_path / "b.toml"
    )
    assert "to do fill in [signals]" in shown.stdout


def test_without_a_rate_it_is_requested(
    command: Command, given: Path, timeless: Path, tmp_path: Path
) -> None:
    done = command("identify", given / "demo_arm.urdf", timeless, "-o", tmp_path / "o")
    assert done.exit_code == 2
    words = " ".join(done.output.split())
    assert "no column looks like time" in words and "steelyard init URDF LOG --rate HZ" in words


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        ("", "neither a column of time nor a rate"),
        ('time = "time_s"\nrate = 250.0', "both a column of time and a rate"),
        ("rate = -250.0", "rate"),
    ],
)
def test_one_clock_is_declared(
    command: Command, given: Path, timeless: Path, tmp_path: Path, clock: str, words: str
) -> None:
    robot = edited(given, tmp_path, ('time = "time_s"', clock))
    done = command("identify", robot, timeless, "-o", tmp_path / "o")
    assert done.exit_code == 2 and words in " ".join(done.output.split())


@pytest.mark.slow
def test_a_simulated_log_without_a_clock_comes_at_the_declared_rate(
    command: Command, given: Path, tmp_path: Path
) -> None:
    robot = edited(given, tmp_path, ('time = "time_s"', "rate = 200.0"))
    done = command("simulate", robot, "--period", "2", "-o", tmp_path / "s")
    assert done.exit_code == 0, done.output
    assert not {"time_s", ROW} & set(pl.read_csv(tmp_path / "s" / "log.csv").columns)
    checked = command("check", robot, tmp_path / "s" / "log.csv", "--quick", "--json")
    clock = next(f for f in json.loads(checked.stdout)["findings"] if f["check"] == "clock")
    assert (
        clock["severity"] == "ok" and "200 Hz, steps of 5 ms, uniform, as declared" in clock["says"]
    )
    odd = edited(given, tmp_path, ('time = "time_s"', "rate = 93.0"))
    other = command("simulate", odd, "--period", "2", "-o", tmp_path / "o")
    assert other.exit_code == 0, other.output
    rows = [len(pl.read_csv(tmp_path / name / "log.csv")) for name in ("s", "o")]
    assert abs(rows[1] - rows[0] * 93.0 / 200.0) <= 1.0
    fast = edited(given, tmp_path, ('time = "time_s"', "rate = 2000.0"))
    refused = command("simulate", fast, "--period", "1", "-o", tmp_path / "f")
    assert refused.exit_code == 2 and "2000 rows a second" in refused.output


@pytest.mark.parametrize("rate", ["0", "-3", "nan", "inf", "1e9", "fast"])
def test_a_rate_that_no_log_has_is_refused(
    command: Command, given: Path, timeless: Path, tmp_path: Path, rate: str
) -> None:
    robot = tmp_path / "arm.toml"
    done = command("init", given / "demo_arm.urdf", timeless, "--rate", rate, "-o", robot)
    assert done.exit_code == 2 and "--rate" in done.output and not robot.exists()


def test_a_rate_belongs_to_a_log_and_replaces_its_clock_by_name(
    command: Command, given: Path, timeless: Path, tmp_path: Path
) -> None:
    urdf, robot = given / "demo_arm.urdf", tmp_path / "arm.toml"
    alone = command("init", urdf, "--rate", 100, "-o", robot)
    assert alone.exit_code == 2 and "without a log" in alone.output and not robot.exists()
    timed = timeless.with_name("timed.csv")
    shown = command("init", urdf, timed, "--rate", RATE, "-o", robot)
    assert "at the 250 Hz that were given, not time_s" in shown.stdout
