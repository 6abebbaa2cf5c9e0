"""`identify --bootstrap`: in the terminal, in the report and as JSON."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from typer.testing import CliRunner

from cli.conftest import results
from estimate.test_least_squares import data
from steelyard.base.progress import silent
from steelyard.cli.app import app
from steelyard.estimate.estimator_register import offer_of
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.identify.fit import Fit

DRAWS = 20
Drawn = tuple[dict[str, Any], str, Path]


@pytest.fixture(scope="module")
def drawn(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """Numbers, text and folder of one command."""
    folder = tmp_path_factory.mktemp("drawn") / "out"
    arguments = ["identify", str(given / "demo_arm.toml"), str(given / "identification.csv")]
    arguments += ["--bootstrap", str(DRAWS), "--no-check", "-o", str(folder)]
    with results() as found:
        done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return found[0], " ".join(done.stdout.split()), folder


def test_draws_stand_beside_what_was_stated(drawn: Drawn) -> None:
    found = drawn[0]
    again = found["bootstrap"]
    assert again["draws"] == DRAWS and again["failed"] == 0 and again["windows"] > 4
    stated = {row["name"]: row for row in found["parameters"]}
    assert [row["name"] for row in again["parameters"]] == list(stated)
    ratios = [row["std"] / stated[row["name"]]["std"] for row in again["parameters"]]
    assert 0.2 < np.median(ratios) < 3.0
    for row in again["parameters"]:
        assert row["value"] == stated[row["name"]]["value"]
        assert row["lower95"] < row["upper95"]


def test_the_report_has_a_section_for_it(drawn: Drawn, identified: Path) -> None:
    page = (drawn[2] / "report.html").read_text()
    assert "Bootstrap over time windows" in page and f"{DRAWS} draws of " in page
    assert "Bootstrap over time windows" not in (identified / "report.html").read_text()


@pytest.mark.slow
def test_the_terminal_shows_it(drawn: Drawn) -> None:
    shown = drawn[1]
    assert f"bootstrap: {DRAWS} draws of " in shown and "of the stated standard deviation" in shown


def test_few_draws_are_refused(command, given: Path, tmp_path: Path) -> None:
    log = given / "identification.csv"
    done = command("identify", given / "demo_arm.toml", log, "--bootstrap", 5)
    assert done.exit_code == 2 and "20" in done.output


def test_data_of_one_window_lose_nothing() -> None:
    from steelyard.identify.repeated_fits import bootstrap_of

    information, *_ = data(np.full(4, 0.1))
    fit = SimpleNamespace(
        estimator=WeightedLeastSquares(),
        fitted=SimpleNamespace(information=information),
        method=offer_of("WLS", ""),
        task=SimpleNamespace(progress=silent),
    )
    found, (note,) = bootstrap_of(cast(Fit, fit), DRAWS)
    assert found is None
    assert note.startswith("no bootstrap: a bootstrap needs several windows of time")
