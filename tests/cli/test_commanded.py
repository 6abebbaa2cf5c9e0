"""Scores of efforts that are predicted from the commanded motion of a log."""

import json
from pathlib import Path
from shutil import copytree

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import LOG, ROBOT
from steelyard.base.errors import LogError, ModelError

JOINTS = range(1, 4)
COLUMNS = {"commanded_position": "q_cmd{}_rad", "commanded_velocity": "dq_cmd{}_rad_s"}


@pytest.fixture(scope="module")
def following(identified: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The identified model, its robot file naming the columns of the commanded motion."""
    folder = tmp_path_factory.mktemp("following") / "model"
    copytree(identified, folder)
    data = json.loads((folder / "model.json").read_text())
    for key, pattern in COLUMNS.items():
        data["signals"][key] = [pattern.replace("{}", str(k)) for k in JOINTS]
    data["signals"]["commanded_velocity_scale"] = [1.0] * 3
    (folder / "model.json").write_text(json.dumps(data))
    return folder


def with_commands(given: Path, lead_s: float) -> pl.DataFrame:
    """The validation log with a commanded motion that is ahead of the measured one."""
    table = pl.read_csv(given / "validation.csv")
    t = table["time_s"].to_numpy()
    ahead = [
        pl.Series(f"{what}_cmd{k}_{unit}", np.interp(t + lead_s, t, table[f"{what}{k}_{unit}"]))
        for what, unit in (("q", "rad"), ("dq", "rad_s"))
        for k in JOINTS
    ]
    return table.with_columns(*ahead)


@pytest.mark.slow
def test_scores_are_those_of_the_commanded_columns(
    following: Path, given: Path, command: Command
) -> None:
    """Commands equal to the measured motion give the same errors, others give other ones."""
    with_commands(given, 0.0).write_csv("same.csv")
    with_commands(given, 0.05).write_csv("ahead.csv")
    measured = steelyard.validate(following, "same.csv").scores
    same = steelyard.validate(following, "same.csv", commanded=True).scores
    assert measured["predicted_from"].unique().to_list() == ["measured"]
    assert same["predicted_from"].unique().to_list() == ["commanded"]
    for figure in ("rmse", "mae", "relative_percent"):
        np.testing.assert_allclose(same[figure], measured[figure], rtol=1e-9)
    ahead = steelyard.validate(following, "ahead.csv", commanded=True).scores
    assert np.all(ahead["rmse"].to_numpy() > 1.05 * measured["rmse"].to_numpy())
    late = steelyard.validate(following, "ahead.csv").scores
    np.testing.assert_allclose(late["rmse"], measured["rmse"], rtol=1e-9)


def test_velocities_are_differentiated_where_none_are_commanded(
    following: Path, given: Path, command: Command
) -> None:
    data = json.loads((following / "model.json").read_text())
    data["signals"] |= {"commanded_velocity": None, "commanded_velocity_scale": None}
    data["signals"] |= {"velocity": None, "velocity_scale": None}
    Path("positions.json").write_text(json.dumps(data))
    table = with_commands(given, 0.0)
    table.drop(f"dq_cmd{k}_rad_s" for k in JOINTS).write_csv("positions.csv")
    scores = steelyard.validate("positions.json", "positions.csv", commanded=True).scores
    other = steelyard.validate("positions.json", "positions.csv").scores
    np.testing.assert_allclose(scores["rmse"], other["rmse"], rtol=1e-9)


@pytest.mark.slow
def test_the_terminal_and_the_report_say_so(following: Path, given: Path, command: Command) -> None:
    with_commands(given, 0.02).write_csv("ahead.csv")
    done = command("validate", following, "ahead.csv", "--commanded", "-o", "out")
    words = " ".join(done.stdout.split())
    assert "Predicts efforts of unseen motion from the commanded motion with an error of" in words
    assert "predicted from the commanded motion (q_cmd1_rad, q_cmd2_rad" in words
    assert "from the commanded motion" in (Path("out") / "report.html").read_text()
    assert "commanded" not in command("validate", following, "ahead.csv").stdout
    (log,) = json.loads(command("validate", following, "ahead.csv", "--commanded", "--json").stdout)
    assert log["predicted_from"] == "commanded" and log["limitations"] == []


@pytest.mark.slow
def test_identify_scores_validation_logs_from_commanded_motion(
    given: Path, command: Command
) -> None:
    with_commands(given, 0.05).write_csv("ahead.csv")
    text = (given / "demo_arm.toml").read_text().replace("demo_arm.urdf", f"{given}/demo_arm.urdf")
    named = "".join(f'{key} = "{pattern}"\n' for key, pattern in COLUMNS.items())
    Path("arm.toml").write_text(text.replace("[signals]\n", f"[signals]\n{named}"))
    found = steelyard.identify("arm.toml", LOG, "ahead.csv", check=False, commanded=True)
    by_log = {name: rows for (name,), rows in found.scores.table.group_by("run")}
    assert by_log["identification"]["predicted_from"].unique().to_list() == ["measured"]
    ahead = by_log["ahead"]
    assert ahead["predicted_from"].unique().to_list() == ["commanded"]
    again = steelyard.validate(found.model, "ahead.csv", commanded=True).scores
    np.testing.assert_allclose(ahead["rmse"], again["rmse"], rtol=1e-9)
    assert "from the commanded motion" in found.verdict.line
    with pytest.raises(LogError, match="no log to be predicted from its commanded motion"):
        steelyard.identify("arm.toml", LOG, commanded=True)


def test_columns_that_nobody_named(identified: Path, command: Command, following: Path) -> None:
    with pytest.raises(ModelError, match="columns of the commanded motion are not known"):
        steelyard.validate(identified, LOG, commanded=True)
    with pytest.raises(ModelError, match="columns of the commanded motion are not known"):
        steelyard.identify(ROBOT, LOG, "../given/validation.csv", commanded=True)
    with pytest.raises(LogError, match="q_cmd1_rad"):
        steelyard.validate(following, LOG, commanded=True)
