"""`identify --each`, `reduce --each`, `steelyard.repeated`: estimations of single logs."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import steelyard
from cli.conftest import Command
from steelyard.base.errors import DataError
from steelyard.cli.app import app

CUTOFFS = "[processing]\nmotion_cutoff = 15\nmatched_cutoff = 5\nrest_speed = 0.02\n"


@pytest.fixture(scope="module")
def robot(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo arm with settings that do not depend on the log."""
    file = tmp_path_factory.mktemp("each") / "arm.toml"
    text = (given / "demo_arm.toml").read_text().replace("demo_arm.urdf", f"{given}/demo_arm.urdf")
    assert "[processing]" not in text
    file.write_text(text + CUTOFFS)
    return file


@pytest.fixture(scope="module")
def logs(given: Path) -> list[str]:
    return [f"{given / 'identification.csv'}", f"{given / 'validation.csv'}"]


@pytest.fixture(scope="module")
def done(robot: Path, logs: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of one command, terminal output beside it."""
    folder = tmp_path_factory.mktemp("done")
    options = ["--each", "--method", "OLS", "--no-check", "-o", str(folder / "out")]
    found = CliRunner().invoke(app, ["identify", str(robot), *logs, *options])
    assert found.exit_code == 0, found.output
    (folder / "terminal.txt").write_text(found.stdout)
    return folder


@pytest.mark.slow
def test_each_log_alone_gives_what_its_own_identification_gives(
    robot: Path, logs: list[str], done: Path
) -> None:
    models = [
        steelyard.identify(robot, log, check=False, method="OLS").model.estimate for log in logs
    ]
    with (done / "out" / "repeated.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == list(models[0].parameters.names)
    for row in rows:
        own = [model.parameters.as_dict()[row["name"]] for model in models]
        listed = [float(row[name]) for name in ("identification", "validation")]
        np.testing.assert_allclose(listed, own, rtol=1e-6, atol=1e-9)
        assert float(row["mean"]) == pytest.approx(np.mean(own), rel=1e-6, abs=1e-9)
        assert float(row["std"]) == pytest.approx(np.std(own, ddof=1), rel=1e-6, abs=1e-9)
        assert row["count"] == "2"


def test_terminal_and_report_show_the_table(done: Path) -> None:
    terminal = " ".join((done / "terminal.txt").read_text().split())
    assert "Estimates from each log alone: 2 estimations" in terminal
    assert "std: sample (1/(N - 1)); relative: over the mean" in terminal
    page = (done / "out" / "report.html").read_text()
    assert "Mean and sample (1/(N - 1)) standard deviation over identification, validation" in page


def test_one_log_alone_has_no_scatter(robot: Path, logs: list[str]) -> None:
    found = steelyard.identify(robot, logs[:1], check=False, method="OLS", each=True)
    assert found.repeated is None and found.to_dict()["repeated"] is None
    assert any(
        "no scatter over logs: 1 estimation has no scatter" in n for n in found.content.notes
    )


def test_a_reduced_model_is_estimated_from_each_log(
    done: Path, logs: list[str], command: Command, work: Path
) -> None:
    options = ("--criterion", "contribution", "--stop", "one_fewer", "--each")
    made = command("reduce", done / "out", *logs, *options, "-o", work / "small")
    assert made.exit_code == 0, made.output
    assert "Estimates from each log alone: 2 estimations" in " ".join(made.output.split())
    assert "Estimates from each log alone" in (work / "small" / "report.html").read_text()
    small = steelyard.load_model(work / "small")
    alone = [
        steelyard.reduce(small, log, stop="refit").model.estimate.parameters.as_dict()
        for log in logs
    ]
    with (work / "small" / "repeated.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == list(small.estimate.parameters.names)
    for row in rows:
        own = [values[row["name"]] for values in alone]
        listed = [float(row[name]) for name in ("identification", "validation")]
        np.testing.assert_allclose(listed, own, rtol=1e-6, atol=1e-9)
        assert float(row["mean"]) == pytest.approx(np.mean(own), rel=1e-6, abs=1e-9)
        relative = 100.0 * np.std(own, ddof=1) / abs(np.mean(own))
        assert float(row["relative_percent"]) == pytest.approx(relative, rel=1e-5)


def test_a_reduced_model_of_one_log_has_no_scatter(done: Path, logs: list[str]) -> None:
    found = steelyard.reduce(done / "out", logs[0], stop="one_fewer", each=True)
    assert found.repeated is None and found.to_dict()["repeated"] is None
    assert any("no scatter over logs" in note for note in found.content.notes)


def test_models_that_were_identified_one_by_one(
    done: Path, identified: Path, robot: Path, logs: list[str]
) -> None:
    found = steelyard.repeated([done / "out", identified], population=True)
    row = found.table.row(0, named=True)
    values = [row["1"], row["2"]]
    assert row["std"] == pytest.approx(0.5 * abs(values[0] - values[1]))
    assert row["relative_percent"] == pytest.approx(100.0 * row["std"] / abs(np.mean(values)))
    assert found.to_dict()["deviation"] == "population"
    assert found.csv().splitlines()[0].startswith("name,unit,count,mean,std,relative_percent")
    assert "population (1/N)" in str(found) and row["name"] in str(found)


def test_models_that_have_no_common_table_are_refused(identified: Path) -> None:
    model = steelyard.load_model(identified)
    with pytest.raises(DataError, match="1 estimation has no scatter"):
        steelyard.repeated([model])
    other = replace(model, base=replace(model.base, coefficients=2.0 * model.base.coefficients))
    with pytest.raises(DataError, match="of model 2 is the combination"):
        steelyard.repeated([model, other])
