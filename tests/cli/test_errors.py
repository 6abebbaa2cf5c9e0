"""Mistakes: one clear message, exit code 2, nothing left behind; broken rows are survived."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command, results
from cli.mistakes import LOG, ROBOT, SPOILT, USAGE, USER, Mistake, faults


@pytest.mark.parametrize("mistake", [*USER, *USAGE], ids=lambda mistake: mistake.name)
def test_mistakes_are_answered(mistake: Mistake, command: Command, work: Path) -> None:
    done = command(*mistake.arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert faults(mistake, done.exit_code, done.stdout, done.stderr, work) == []


@pytest.mark.parametrize("missing", [["a"], ["a", "b"]])
def test_new_parents_of_a_failed_output_go_too(
    missing: list[str], command: Command, tmp_path: Path
) -> None:
    folder = tmp_path.joinpath(*missing, "out")
    assert command("identify", ROBOT, f"{LOG}@0:0.9", "-o", folder).exit_code == 2
    assert not any(tmp_path.iterdir())


SOILED = "../given/soiled.csv"
OTHER = "../given/validation.csv"


@pytest.mark.slow
def test_broken_rows_are_dropped_counted_and_hardly_change_the_fit(
    identified: Path, command: Command, tmp_path: Path
) -> None:
    options = ("--no-check", "-o", tmp_path / "out")
    with results() as found:
        done = command("identify", ROBOT, SOILED, "--validate", OTHER, *options)
    assert done.exit_code == 0
    for text in (done.stdout, " ".join(found[0]["notes"])):
        words = " ".join(text.split())
        assert f"soiled: dropped {sum(SPOILT.values())} of 1501 rows" in words
        assert f"{SPOILT['NaN'] + SPOILT['cut short']} with a cell that is missing" in words
        assert f"{SPOILT['1e293']} with an implausible value" in words
    clean = json.loads((identified.parent / "printed.json").read_text())
    soiled, whole = (one["validation"][0]["mean_percent"] for one in (found[0], clean))
    assert soiled < 1.5 * whole


def test_noise_alone_is_no_motion(given: Path, command: Command, tmp_path: Path) -> None:
    table, rng = pl.read_csv(given / "identification.csv"), np.random.default_rng(0)
    sizes = {"q": 1e-5, "d": 1e-3, "t": 0.1}
    noise = {
        c: pl.lit(table[c][0]) + pl.Series(rng.normal(0.0, sizes[c[0]], table.height))
        for c in table.columns[1:]
    }
    table.with_columns(**noise).write_csv(tmp_path / "noise.csv")
    done = command("identify", ROBOT, tmp_path / "noise.csv", "-o", tmp_path / "o", "--json")
    assert done.exit_code == 2
    assert "no joint moves" in done.stderr
    assert not (tmp_path / "o").exists()
