"""`steelyard check` with its own suspicions: faults of a simulated arm are found and corrected."""

import json
import os
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.river_files import edited
from steelyard.check import case_from_files_and_precheck
from steelyard.check.all_checks import (
    CHECKS,
    CORRECTED_BY_FIX,
    MOTION_CHECKS_NAME,
    NOT_RUN,
    OF_MOTION,
    Diagnosis,
)
from steelyard.check.case_from_files_and_precheck import diagnosis_of
from steelyard.check.cases_and_checks import Case
from steelyard.check.finding import Finding
from steelyard.robot.file.robot_file import load_robot

CURRENTS = (
    ('"tau{}_Nm"', '"i{}"'),
    ('"joint_torque"', '"motor_current"'),
    ('unit = "Nm"', 'unit = "A"  # says the manual\ngain = [12.0, -12.0, 10.0]'),
)


@pytest.fixture(scope="module")
def simulated(given: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A robot file for currents in ampere, and a log that it describes."""
    from typer.testing import CliRunner

    from steelyard.cli.app import app

    folder = tmp_path_factory.mktemp("simulated")
    robot = edited(given, folder, *CURRENTS)
    arguments = ["simulate", str(robot), "--period", "5", "--seed", "3", "-o", str(folder / "sim")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return robot, folder / "sim" / "log.csv"


@pytest.mark.slow
def test_a_good_log_is_ok(simulated: tuple[Path, Path], command: Command) -> None:
    done = command("check", *simulated, "--json")
    printed = json.loads(done.stdout)
    assert done.exit_code == 0, [f for f in printed["findings"] if f["severity"] != "ok"]
    assert len({finding["check"] for finding in printed["findings"]}) >= 12


@pytest.mark.parametrize(
    ("check", "line"),
    [
        ("clock", ('"time_s"', '"time_s"\ntime_unit = "ms"')),
        ("position", ('"q{}_rad"', '"q{}_rad"\nposition_unit = "deg"')),
    ],
)
def test_efforts_are_not_judged_by_a_wrong_clock_or_positions_in_another_unit(
    check: str,
    line: tuple[str, str],
    simulated: tuple[Path, Path],
    given: Path,
    command: Command,
    tmp_path: Path,
) -> None:
    robot = edited(given, tmp_path, line, *CURRENTS)
    done = command("check", robot, simulated[1], "--json")
    printed = json.loads(done.stdout)
    assert done.exit_code == 2
    assert [f["check"] for f in printed["findings"] if f["severity"] != "ok"] == [check]
    key = {"clock": "time_unit", "position": "position_unit"}[check]
    assert [edit["path"] for edit in printed["edits"]] == [["signals", key]]
    left = {f["check"]: f["says"] for f in printed["findings"] if not f["answered"]}
    assert left == {MOTION_CHECKS_NAME: NOT_RUN.format(check) + CORRECTED_BY_FIX}
    assert not {f["check"] for f in printed["findings"]} & {check.name for check in OF_MOTION}


@pytest.mark.slow
def test_a_corrected_clock_is_that_of_the_proposed_cut(
    simulated: tuple[Path, Path], given: Path, command: Command, tmp_path: Path
) -> None:
    line = ('"time_s"', '"time_s"\ntime_unit = "ms"')
    done = command("check", edited(given, tmp_path, line, *CURRENTS), simulated[1], "--fix")
    (cut,) = re.findall(r"--validate \S+@([\d.]+):", done.stdout.replace("\n", " "))
    assert 0.5 < float(cut) < 100.0


@pytest.mark.slow
def test_currents_beside_a_model_file_need_a_robot_file(
    simulated: tuple[Path, Path], given: Path, command: Command, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    table = pl.read_csv(simulated[1])
    table.rename({f"i{k}": f"current{k}_A" for k in (1, 2, 3)}).write_csv(log)
    done = command("check", given / "demo_arm.urdf", log, "--quick")
    assert done.exit_code == 0, done.output
    last = " ".join(done.stdout.split("\n\n")[-1].split())
    assert last.startswith("next # identify needs a robot file for drive gains: steelyard init ")
    assert command("init", *last.split()[-2:], "-o", tmp_path / "new.toml").exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("measured", [True, False])
def test_set_points_beside_measured_efforts_get_no_gains(
    measured: bool,
    simulated: tuple[Path, Path],
    given: Path,
    command: Command,
    tmp_path: Path,
) -> None:
    table = pl.read_csv(simulated[1])
    gains = dict(zip(("i1", "i2", "i3"), (12e3, -12e3, 10e3), strict=True))
    targets = [(gain * pl.col(i)).alias(f"target_moment_{i[1]}") for i, gain in gains.items()]
    log = tmp_path / "log.csv"
    table.with_columns(targets).drop([] if measured else list(gains)).write_csv(log)
    robot = edited(given, tmp_path, ('"tau{}_Nm"', '"target_moment_{}"'))
    printed = json.loads(command("check", robot, log, "--fix", "--json").stdout)
    found = {f["check"]: f for f in printed["findings"] if f["severity"] != "ok"}
    assert "effort column 'target_moment_1' and 2 more" in found["set points"]["says"]
    left = [f["says"] for f in printed["findings"] if f["check"] == MOTION_CHECKS_NAME]
    if measured:
        assert "this log has 'i{}' too" in found["set points"]["fix"]["says"]
        assert left == [NOT_RUN.format("set points")] and found.keys() == {"set points"}
        assert not printed["fixed"]["changes"]
    else:
        assert not left and printed["edits"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "path", "value"),
    [
        ("mA", ["signals", "effort", "unit"], "mA"),
        ("ms", ["signals", "time_unit"], "ms"),
        ("degrees", ["signals", "position_unit"], "deg"),
    ],
)
def test_a_fault_is_found_and_the_fixed_file_is_ok(
    fault: str,
    path: list[str],
    value: str,
    simulated: tuple[Path, Path],
    command: Command,
    tmp_path: Path,
) -> None:
    robot, good = simulated
    table = pl.read_csv(good)
    scaled = {
        "mA": [pl.col(c) * 1e3 for c in table.columns if c.startswith("i")],
        "ms": [pl.col("time_s") * 1e3],
        "degrees": [pl.col(c) * np.rad2deg(1.0) for c in table.columns if c.startswith("q")],
    }
    log, target = tmp_path / "log.csv", tmp_path / "fixed.toml"
    table.with_columns(scaled[fault]).write_csv(log)
    stopped = command("identify", robot, log, "-o", tmp_path / "o")
    assert stopped.exit_code == 2 and f'{path[-1]} = "{value}"' in stopped.stderr
    done = command("check", robot, log, "--fix", target, "--json")
    printed = json.loads(done.stdout)
    assert printed["severity"] == "wrong"
    assert {"path": path, "value": value} in printed["edits"]
    if fault == "degrees":
        (found,) = (f for f in printed["findings"] if f["severity"] != "ok")
        assert "positions of all 3 joints are in deg: as declared" in found["says"]
    assert printed["fixed"]["severity"] == "ok" and done.exit_code == 0, printed["fixed"]
    assert load_robot(target).signals is not None
    assert command("check", target, log, "--quick").exit_code == 0
    assert "# says the manual" in target.read_text()


@pytest.mark.slow
def test_a_robot_mounted_sideways_is_found(
    simulated: tuple[Path, Path], given: Path, command: Command, tmp_path: Path
) -> None:
    model = 'urdf = "demo_arm.urdf"\n'
    robot = edited(given, tmp_path, (model, f"{model}gravity = [9.81, 0.0, 0.0]\n"), *CURRENTS)
    done = command("check", robot, simulated[1], "--fix", "--json")
    printed = json.loads(done.stdout)
    assert printed["severity"] == "wrong" and done.exit_code == 0
    assert load_robot(tmp_path / "arm-fixed.toml").robot.gravity[2] == pytest.approx(
        -9.81, abs=0.01
    )


def thinned(folder: Path, every: int) -> Path:
    """Every so many rows of the log of a TX40, which has 6000 a second."""
    data = os.environ.get("STEELYARD_DATA")
    if not data:
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    log = folder / "thinned.parquet"
    pl.read_parquet(Path(data) / "tx40" / "tx40_run1.parquet")[::every].write_parquet(log)
    return log


@pytest.mark.slow
def test_reversed_gravity_is_found_beside_joints_that_nothing_explains(
    tmp_path: Path, command: Command
) -> None:
    log = thinned(tmp_path, every=40)
    text = (Path(__file__).parents[2] / "examples" / "tx40.toml").read_text("utf-8")
    robot = tmp_path / "tx40.toml"
    robot.write_text(text.replace("[robot]", "[robot]\ngravity = [0.0, 0.0, 9.81]", 1), "utf-8")
    printed = json.loads(command("check", robot, log, "--quick", "--fix", "--json").stdout)
    assert printed["severity"] == "wrong"
    assert load_robot(tmp_path / "tx40-fixed.toml").robot.gravity.tolist() == [0.0, 0.0, -9.81]


@pytest.mark.slow
def test_a_wrong_transmission_leaves_the_check_inconclusive(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    examined: dict[tuple[str, bool], Diagnosis] = {}

    def once(case: Case, unread: Sequence[Finding], text: str, *, quick: bool) -> Diagnosis:
        """Of a log with one robot file, so that `identify` takes what `check` has found."""
        if (text, quick) not in examined:
            examined[text, quick] = diagnosis_of(case, unread, text, quick=quick)
        return examined[text, quick]

    monkeypatch.setattr(case_from_files_and_precheck, "diagnosis_of", once)
    monkeypatch.setattr(import_module("steelyard.check.check"), "diagnosis_of", once)
    log, right = thinned(tmp_path, every=10), Path(__file__).parents[2] / "examples" / "tx40.toml"
    done = command("check", right, log, "--quick")
    words = " ".join(done.stdout.split())
    assert done.exit_code == 0 and "Inconclusive" not in words
    assert "open transmission undecided" in words and "open gain undecided" in words
    text = right.read_text("utf-8").replace("-48.0", "48.0").partition("  # Rotor")[0]
    _, _, signals = right.read_text("utf-8").partition("\n[signals]")
    kept = (x for x in (f"{text}]\n\n[signals]{signals}").split("\n") if "position_off" not in x)
    wrong = tmp_path / "tx40.toml"
    wrong.write_text("\n".join(x for x in kept if not x.startswith("coupling")), "utf-8")
    done = command("check", wrong, log, "--quick")
    words = " ".join(done.stdout.split())
    assert (
        done.exit_code == 1 and "checks could not be decided; the robot file may be wrong" in words
    )
    assert "next # compare signs, gear ratios, couplings, position_offset" in words
    assert "steelyard identify" not in words
    done = command("identify", wrong, log, "--method", "OLS", "-o", tmp_path / "model")
    words = " ".join(done.stdout.split())
    assert (
        "! check of the logs: " in words
        and "checks could not be decided; the robot file may" in words
    )
    assert (
        f"next # open questions about the robot file steelyard check {wrong} {log}" in words
        and "--to urdf" not in words
    )
    assert len(examined) == 2


def test_the_document_lists_every_suspicion() -> None:
    document = Path(__file__).parents[2] / "docs" / "check.md"
    _, _, table = document.read_text("utf-8").partition("\n| check |")
    rows = table.partition("\n\n")[0]
    assert [s.name for s in CHECKS] == re.findall(r"^\| (\w[\w ]*?)(?: ²)? \|", rows, re.M)
