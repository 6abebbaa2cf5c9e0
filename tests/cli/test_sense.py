"""What only looks like a result is refused; what `simulate` writes can be identified."""

import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from cli.mistakes import LOG, ROBOT

Command = Any


@pytest.mark.parametrize(
    ("logs", "words"),
    [
        ((LOG, LOG), "fitted twice"),
        ((f"{LOG}@0:4", f"{LOG}@3:6"), "fitted twice"),
        ((f"{LOG}#0:900", f"{LOG}#800:"), "fitted twice"),
        ((LOG, "--validate", LOG), "both fitted and validated"),
        ((f"{LOG}@0:4", "--validate", f"{LOG}@3.5:6"), "both fitted and validated"),
    ],
)
def test_no_stretch_counts_twice(
    logs: tuple[str, ...], words: str, command: Command, tmp_path: Path
) -> None:
    done = command("identify", ROBOT, *logs, "-o", tmp_path / "o")
    assert done.exit_code == 2 and words in done.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.slow
def test_an_effort_that_never_changes_is_no_effort(
    given: Path, command: Command, tmp_path: Path
) -> None:
    table = pl.read_csv(given / "identification.csv")
    table.with_columns(pl.lit(7.0).alias("tau3_Nm")).write_csv(tmp_path / "dead.csv")
    done = command("identify", ROBOT, tmp_path / "dead.csv", "-o", tmp_path / "o")
    assert done.exit_code == 2
    assert "effort of elbow (column 'tau3_Nm') never changes" in done.stderr


@pytest.mark.slow
def test_a_simulated_log_looks_as_the_robot_file_says(
    given: Path, command: Command, tmp_path: Path
) -> None:
    text = (given / "demo_arm.toml").read_text()
    a = text.index("[signals]")
    (tmp_path / "demo_arm.urdf").write_text((given / "demo_arm.urdf").read_text())
    (tmp_path / "arm.toml").write_text(
        text[:a]
        + """[signals]
time = "ms"
time_unit = "ms"
position = "angle_{}"
position_unit = "deg"
[signals.effort]
columns = "i_{joint}"
kind = "motor_current"
unit = "mA"
gain = [10.0, -12.0, 8.0]
"""
    )
    robot = tmp_path / "arm.toml"
    simulated = command("simulate", robot, "--period", "3", "-o", tmp_path / "sim", "--json")
    assert simulated.exit_code == 0, simulated.stderr
    columns = pl.read_csv(tmp_path / "sim" / "log.csv").columns
    assert columns[:2] == ["ms", "angle_1"] and len(columns) == 7
    log = tmp_path / "sim" / "log.csv"
    done = command("identify", robot, log, "-o", tmp_path / "o", "--json")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["identification"][0]["mean_percent_moving"] < 3.0
    truth = json.loads((tmp_path / "sim" / "truth.json").read_text())
    found = {p["name"]: p for p in result["parameters"]}
    for joint in truth["smoothing"]:
        got, true = found[f"viscous.{joint}"], truth["parameters"][f"viscous.{joint}"]["value"]
        assert abs(got["value"] - true) < 6 * got["std"] + 0.05 * true
