"""`identify --sensitivity`: in the terminal, in the report and as JSON."""

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def swept(given: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    from typer.testing import CliRunner

    from steelyard.cli.app import app

    folder = tmp_path_factory.mktemp("swept") / "out"
    arguments = ["identify", str(given / "demo_arm.toml"), str(given / "identification.csv")]
    arguments += ["--validate", str(given / "validation.csv"), "--sensitivity", "--no-check"]
    done = CliRunner().invoke(app, [*arguments, "--json", "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return done.stdout, folder


def test_fits_with_other_cutoffs_are_compared(swept: tuple[str, Path]) -> None:
    found = json.loads(swept[0])
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


def test_the_report_has_a_section_for_it(swept: tuple[str, Path], identified: Path) -> None:
    page = (swept[1] / "report.html").read_text()
    assert "Fits with other cut-offs" in page and "Largest parameter shifts" in page
    assert "Fits with other cut-offs" not in (identified / "report.html").read_text()


@pytest.mark.slow
def test_the_terminal_shows_it(command, given: Path, tmp_path: Path) -> None:
    log, out = f"{given / 'identification.csv'}@0:5", tmp_path / "out"
    options = ("--sensitivity", "--no-check", "-o", out)
    done = command("identify", given / "demo_arm.toml", log, *options)
    assert done.exit_code == 0, done.output
    assert "Fits with other cut-offs" in done.output and "x 1.41" in done.output
    assert "largest parameter shifts, in standard deviations" in done.output


def test_the_chain_is_noted_and_kept_by_the_model(identified: Path) -> None:
    page = (identified / "report.html").read_text()
    assert "processing: Hampel threshold 15 scaled MAD" in " ".join(page.split())
    model = json.loads((identified / "model.json").read_text())
    assert model["processing"]["outliers"] == 15.0 and model["processing"]["motion"]["method"]
