"""`identify --sensitivity`: in the terminal, in the report and as JSON."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cli.conftest import results
from steelyard.cli.app import app

Swept = tuple[dict[str, Any], str, Path]


@pytest.fixture(scope="module")
def swept(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Swept:
    """Numbers, text and folder of one command."""
    folder = tmp_path_factory.mktemp("swept") / "out"
    arguments = ["identify", str(given / "demo_arm.toml"), str(given / "identification.csv")]
    arguments += ["--validate", str(given / "validation.csv"), "--sensitivity", "--no-check"]
    with results() as found:
        done = CliRunner().invoke(app, [*arguments, "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return found[0], done.stdout, folder


def test_fits_with_other_cutoffs_are_compared(swept: Swept) -> None:
    found = swept[0]
    fits = found["sensitivity"]["fits"]
    assert [fit["factor"] for fit in fits] == [0.5, 0.71, 1.0, 1.41, 2.0]
    (result,) = [fit for fit in fits if fit["factor"] == 1.0]
    assert result["median_shift_in_std"] == 0.0
    mean = found["validation"][0]["pooled_percent_moving"]
    assert result["validation_percent"] == pytest.approx(mean, rel=1e-12)
    for fit in fits:
        if fit is result or fit["failed"]:
            continue
        assert fit["median_shift_in_std"] > 0.0
        ratio = fit["matched_cutoff"] / result["matched_cutoff"]
        assert ratio == pytest.approx(fit["factor"], rel=0.06) or ratio < fit["factor"]
        assert fit["validation_percent"] < 10.0 * mean
    names = [row["name"] for row in found["sensitivity"]["parameters"]]
    assert names == [row["name"] for row in found["parameters"]]
    assert max(row["largest_shift_in_std"] for row in found["sensitivity"]["parameters"]) > 0.0


def test_the_report_has_a_section_for_it(swept: Swept, identified: Path) -> None:
    page = (swept[2] / "report.html").read_text()
    assert "Fits with other cut-offs" in page and "Largest parameter shifts" in page
    assert "Fits with other cut-offs" not in (identified / "report.html").read_text()


def test_the_terminal_shows_it(swept: Swept) -> None:
    assert "Fits with other cut-offs" in swept[1] and "x 1.41" in swept[1]
    assert "largest parameter shifts, in standard deviations" in swept[1]


def test_the_chain_is_noted_and_kept_by_the_model(identified: Path) -> None:
    page = (identified / "report.html").read_text()
    assert "processing: Hampel threshold 15 scaled MAD" in " ".join(page.split())
    model = json.loads((identified / "model.json").read_text())
    assert model["processing"]["outliers"] == 15.0 and model["processing"]["motion"]["method"]
