"""`identify --bootstrap`: in the terminal, in the report and as JSON."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from estimate.test_least_squares import data
from steelyard.base.progress import silent
from steelyard.estimate.estimator_register import offer_of
from steelyard.estimate.least_squares.weighted_and_recursive import WeightedLeastSquares
from steelyard.identify.fit import Fit

DRAWS = 20


@pytest.fixture(scope="module")
def drawn(given: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    from typer.testing import CliRunner

    from steelyard.cli.app import app

    folder = tmp_path_factory.mktemp("drawn") / "out"
    arguments = ["identify", str(given / "demo_arm.toml"), str(given / "identification.csv")]
    arguments += ["--bootstrap", str(DRAWS), "--no-check", "--json", "-o", str(folder)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return done.stdout, folder


def test_draws_stand_beside_what_was_stated(drawn: tuple[str, Path]) -> None:
    found = json.loads(drawn[0])
    again = found["bootstrap"]
    assert again["draws"] == DRAWS and again["failed"] == 0 and again["windows"] > 4
    stated = {row["name"]: row for row in found["parameters"]}
    assert [row["name"] for row in again["parameters"]] == list(stated)
    ratios = [row["std"] / stated[row["name"]]["std"] for row in again["parameters"]]
    assert 0.2 < np.median(ratios) < 3.0
    for row in again["parameters"]:
        assert row["value"] == stated[row["name"]]["value"]
        assert row["lower95"] < row["upper95"]


def test_the_report_has_a_section_for_it(drawn: tuple[str, Path], identified: Path) -> None:
    page = (drawn[1] / "report.html").read_text()
    assert "Bootstrap over time windows" in page and f"{DRAWS} draws of " in page
    assert "Bootstrap over time windows" not in (identified / "report.html").read_text()


def test_the_terminal_shows_it(command, given: Path, tmp_path: Path) -> None:
    log, out = f"{given / 'identification.csv'}@0:5", tmp_path / "out"
    arguments = ("identify", given / "demo_arm.toml", log, "--no-check", "-o", out)
    done = command(*arguments, "--bootstrap", DRAWS)
    assert done.exit_code == 0, done.output
    output = " ".join(done.output.split())
    assert (
        f"bootstrap: {DRAWS} draws of " in output and "of the stated standard deviation" in output
    )


def test_few_draws_are_refused(command, given: Path, tmp_path: Path) -> None:
    log = given / "identification.csv"
    done = command("identify", given / "demo_arm.toml", log, "--bootstrap", 5)
    assert done.exit_code == 2 and "20" in done.output


def test_data_of_one_window_lose_nothing() -> None:
    from steelyard.identify.refits import bootstrap_of

    information, *_ = data(np.full(4, 0.1))
    fit = SimpleNamespace(
        estimator=WeightedLeastSquares(),
        information=information,
        method=offer_of("WLS", ""),
        task=SimpleNamespace(progress=silent),
    )
    found, (note,) = bootstrap_of(cast(Fit, fit), DRAWS)
    assert found is None
    assert note.startswith("no bootstrap: a bootstrap needs several windows of time")
