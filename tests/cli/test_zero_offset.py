"""`position_offset = "identify"`: offsets of joints are found, kept in the model and used."""

import json
from pathlib import Path

import pytest

from check.fitted import log
from cli.conftest import Command
from cli.river_files import edited
from short_arm import without_wrist
from steelyard.simulate.ground_truth import random_truth

TO_IDENTIFY = ('position = "q{}_rad"', 'position = "q{}_rad"\nposition_offset = "identify"')
OFFSET = 0.2


@pytest.mark.slow
def test_offsets_are_identified_and_used_for_other_logs(command: Command, tmp_path: Path) -> None:
    loaded, robot = without_wrist(tmp_path), tmp_path / "demo_arm.toml"
    line = '[signals]\nposition_offset = "identify"\n'
    robot.write_text(robot.read_text().replace("[signals]\n", line))
    fitted, other = (tmp_path / f"{name}.parquet" for name in ("fitted", "other"))
    for seed, path in enumerate((fitted, other), start=1):
        log(path, random_truth(loaded.robot, 1), seed, (0.0, OFFSET, 0.0))
    out = tmp_path / "out"
    options = ("--no-check", "-o", out, "--json")
    done = command("identify", robot, fitted, "--validate", other, *options)
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    found = result["zero_offsets"]
    assert abs(found["values"][1] - OFFSET) < found["half_width"][1] < 0.1 * OFFSET
    assert found["half_width"][0] is None
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
    unit = ('unit = "Nm"', 'unit = "A"\ngain = ["identify", 1.0, 1.0]')
    robot = edited(given, tmp_path, TO_IDENTIFY, currents, unit)
    done = command("identify", robot, given / "identification.csv", "--no-check")
    assert done.exit_code != 0
    assert "zero offsets and drive gains cannot be identified together" in done.output
