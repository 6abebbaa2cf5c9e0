"""Rows of a fitted log are refused, its motion once more is called repeated."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.mistakes import LOG, PLAIN, ROBOT


@pytest.fixture
def copied(given: Path, tmp_path: Path) -> Path:
    """The identified log without its first rows, with other stamps and six digits."""
    table = pl.read_csv(given / "identification.csv")[3:]
    path = tmp_path / "copied.parquet"
    table = table.with_columns(pl.exclude("time_s").cast(pl.Float32).cast(pl.Float64))
    table.with_columns(pl.col("time_s") + 5.0).write_parquet(path)
    return path


@pytest.fixture
def repeated(given: Path, tmp_path: Path) -> Path:
    """The motion of the identified log once more, with noise of its own."""
    table = pl.read_csv(given / "identification.csv")
    rng = np.random.default_rng(0)
    efforts = [name for name in table.columns if name.startswith("tau")]
    noisy = {
        name: table[name].to_numpy()
        + 0.01 * np.std(table[name].to_numpy()) * rng.normal(size=len(table))
        for name in efforts
    }
    path = tmp_path / "again.parquet"
    table.with_columns(**noisy).write_parquet(path)
    return path


@pytest.mark.slow
def test_rows_of_a_fitted_log_do_not_test_it(
    command: Command, copied: Path, tmp_path: Path
) -> None:
    options = ("--no-check", "-o", tmp_path / "o")
    done = command("identify", ROBOT, LOG, "--validate", copied, *options)
    assert done.exit_code == 2 and "the same samples as 'identification'" in done.stderr
    assert "both fitted and validated" in done.stderr
    done = command("identify", ROBOT, LOG, copied, *options)
    assert done.exit_code == 2 and "count twice in the fit" in done.stderr
    assert not (tmp_path / "o").exists()


def test_validate_knows_rows_that_were_fitted(
    command: Command, identified: Path, copied: Path
) -> None:
    (run,) = json.loads(command("validate", identified, copied, "--json").stdout)
    assert run["fitted"]
    assert "copied was fitted" in " ".join(command("validate", identified, copied).stdout.split())


@pytest.mark.slow
def test_a_repeated_motion_is_not_called_unseen(
    command: Command, identified: Path, repeated: Path, tmp_path: Path
) -> None:
    options = (*PLAIN, "-o", tmp_path / "o", "--json")
    done = command("identify", ROBOT, LOG, "--validate", repeated, *options)
    (run,) = json.loads(done.stdout)["validation"]
    assert (run["motion"], run["repeats"]) == ("repeated", "identification")
    page = (tmp_path / "o" / "report.html").read_text()
    assert "On repeated motions" in page and "On validation runs" not in page
    shown = " ".join(command("validate", identified, repeated).stdout.split())
    assert "Predicts repeated motion with an error of" in shown and "unseen" not in shown
    assert "repeats the motion of identification" in shown
    assert "no validation on other motions" in shown
