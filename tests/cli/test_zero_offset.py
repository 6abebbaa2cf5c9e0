"""`position_offset = "identify"`: offsets of joints are found, kept in the model and used."""

import json
from pathlib import Path

import polars as pl
import pytest

from cli.conftest import Command
from cli.river_files import edited

ASKED = ('position = "q{}_rad"', 'position = "q{}_rad"\nposition_offset = "identify"')
OFFSET = 0.2


def shifted(given: Path, name: str, folder: Path) -> Path:
    """A log whose second encoder reads less than the joint's position."""
    path = folder / f"{name}.parquet"
    table = pl.read_parquet(given / path.name)
    table.with_columns(pl.col("q2_rad") - OFFSET).write_parquet(path)
    return path


def test_offsets_are_identified_and_used_for_other_logs(
    given: Path, command: Command, tmp_path: Path
) -> None:
    robot = edited(given, tmp_path, ASKED)
    fitted, other = (shifted(given, name, tmp_path) for name in ("identification", "validation"))
    out = tmp_path / "out"
    done = command("identify", robot, fitted, "--validate", other, "-o", out, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    found = result["zero_offsets"]
    assert abs(found["values"][1] - OFFSET) < found["half_width"][1] < OFFSET
    assert found["half_width"][0] is None and found["half_width"][5] is None
    assert "zero offsets identified" in " ".join(result["notes"])
    assert 'id="zero_offsets"' in (out / "report.html").read_text()
    again = command("validate", out, other, "--json")
    assert again.exit_code == 0, again.output
    alone = json.loads(again.stdout)[0]["mean_percent"]
    assert alone == pytest.approx(result["validation"][0]["mean_percent"])
    signals = json.loads((out / "model.json").read_text())["signals"]
    assert signals["position_offset"] == found["values"]


def test_offsets_and_gains_are_not_identified_at_once(
    given: Path, command: Command, tmp_path: Path
) -> None:
    currents = ('"joint_torque"', '"motor_current"')
    unit = ('unit = "Nm"', 'unit = "A"\ngain = ["identify", 1.0, 1.0, 1.0, 1.0, 1.0]')
    robot = edited(given, tmp_path, ASKED, currents, unit)
    done = command("identify", robot, given / "identification.parquet", "--no-check")
    assert done.exit_code != 0
    assert "zero offsets and drive gains cannot be identified at once" in done.output
