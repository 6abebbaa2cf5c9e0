"""`steelyard validate` as a gate, and what the terminal shows without and with `--verbose`."""

import json
from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import LOG, PLAIN
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.post_fit_checks import doubts_of_fit
from steelyard.estimate.identified_model import IdentifiedModel

OTHER = "../given/validation.csv"


def scaled(path: Path, factor: float) -> pl.DataFrame:
    table = pl.read_csv(path)
    efforts = [name for name in table.columns if name.startswith("tau")]
    return table.with_columns(pl.col(name) * factor for name in efforts)


@pytest.mark.slow
def test_the_limit_decides_the_exit_code(identified: Path, command: Command) -> None:
    error = json.loads(command("validate", identified, OTHER, "--json").stdout)[0]
    (pooled,) = error["headline"]["pooled"]
    assert pooled == error["verdict"]["errors"][0] and pooled["unit"] == "Nm"
    share = pooled["percent_of_used"]
    below = command("validate", identified, OTHER, "--max-error", 1.01 * share)
    above = command("validate", identified, OTHER, "--max-error", 0.99 * share)
    assert (below.exit_code, above.exit_code) == (0, 1)
    assert "is above --max-error" in above.stdout and "--max-error" not in below.stdout
    assert command("validate", identified, OTHER, "--max-error", 0.0, "--json").exit_code == 1


def test_a_fitted_log_leads_to_another_one(identified: Path, command: Command) -> None:
    said = " ".join(command("validate", identified, f"{LOG}@1.5:4").stdout.split())
    assert "log another motion and run: steelyard validate MODEL OTHER_LOG" in said
    assert f"next # error on another motion steelyard validate {identified} OTHER_LOG" in said
    assert "next " not in command("validate", identified, OTHER).stdout


def test_a_limit_needs_a_run_that_was_not_fitted(identified: Path, command: Command) -> None:
    assert command("validate", identified, f"{LOG}@1.5:4").exit_code == 0
    done = command("validate", identified, f"{LOG}@1.5:4", "--max-error", 50)
    assert done.exit_code == 1
    assert "No error on unseen motion to compare with --max-error 50 %" in done.stdout


def test_a_repeated_motion_is_below_no_limit(
    identified: Path, command: Command, tmp_path: Path
) -> None:
    table = pl.read_csv(LOG)
    efforts = [name for name in table.columns if name.startswith("tau")]
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(table), len(efforts)))
    again = table.with_columns(table[name] + noise[:, k] for k, name in enumerate(efforts))
    again.write_csv(tmp_path / "again.csv")
    done = command("validate", identified, tmp_path / "again.csv", "--max-error", 50)
    words = " ".join(done.stdout.split())
    assert done.exit_code == 1 and "no validation on other motions" in words
    assert "No error on unseen motion to compare with --max-error 50 %" in words
    assert command("validate", identified, tmp_path / "again.csv").exit_code == 0


@pytest.mark.slow
def test_an_error_has_a_reason_and_the_command_that_shows_it(
    identified: Path, given: Path, command: Command
) -> None:
    scaled(given / "validation.csv", 1000.0).write_csv("milli.csv")
    done = command("validate", identified, "milli.csv")
    words = " ".join(done.stdout.split())
    assert done.exit_code == 1 and words.startswith("POOR: ")
    assert "most likely reason of the error: efforts are logged in a unit 1000 times" in words
    assert f"next steelyard check ROBOT milli.csv --model {identified}" in words
    copy(given / "demo_arm.toml", "demo_arm.toml")
    words = " ".join(command("validate", identified, "milli.csv").stdout.split())
    assert f"next steelyard check demo_arm.toml milli.csv --model {identified}" in words


@pytest.mark.slow
def test_a_log_without_motion_validates_gravity(
    identified: Path, given: Path, command: Command
) -> None:
    table = pl.read_csv(given / "validation.csv")
    model = steelyard.load_model(identified)
    q = [0.3, 0.6, -0.8]
    rng = np.random.default_rng(2)
    columns = {name: np.zeros(len(table)) for name in table.columns if name.startswith("dq")}
    for k, (angle, torque) in enumerate(zip(q, model.gravity(q).tolist(), strict=True), 1):
        columns[f"q{k}_rad"] = angle + 1e-6 * rng.standard_normal(len(table))
        columns[f"tau{k}_Nm"] = 1.02 * torque + 0.01 * rng.standard_normal(len(table))
    still = table.with_columns(pl.Series(name, values) for name, values in columns.items())
    still.write_csv("still.csv")
    done = command("validate", identified, "still.csv", "--json")
    (run,) = json.loads(done.stdout)
    assert (done.exit_code, run["verdict"]["level"]) == (0, "good")
    assert run["headline"]["at_rest"] and all(j["moving"] for j in run["headline"]["joints"])
    shown = " ".join(command("validate", identified, "still.csv").stdout.split())
    assert "GOOD: Predicts unseen postures with an error of" in shown
    assert "pooled over 3 joints, at rest" in shown and "the log validates gravity only" in shown
    robot = "../given/demo_arm.toml"
    refused = command("identify", robot, "still.csv", "-o", "out")
    assert refused.exit_code == 2
    options = ("--no-check", "-o", "out")
    fitted = command("identify", robot, f"{LOG}@0:4", "--validate", "still.csv", *options)
    assert fitted.exit_code == 0 and "Predicts unseen postures" in fitted.stdout


@pytest.mark.slow
def test_validate_does_not_report_on_the_fit(
    identified: Path, command: Command, tmp_path: Path
) -> None:
    brief = command("validate", identified, OTHER).stdout
    whole = command("validate", identified, OTHER, "-v", "-o", tmp_path / "out").stdout
    for words in ("base parameters", "condition number"):
        assert words not in brief + whole
    assert "cut-offs" not in brief and "note: cut-offs" in whole
    assert "in the validation band" in whole and "in the validation band" not in brief
    page = (tmp_path / "out" / "report.html").read_text()
    assert 'id="verdict"' in page and 'id="parameters"' not in page


@pytest.mark.slow
def test_identify_prints_a_good_result_in_25_lines(
    identified: Path, given: Path, command: Command
) -> None:
    text = (identified.parent / "terminal.txt").read_text()
    lines = text.splitlines()
    assert lines[0].startswith("GOOD: ") and len(lines) <= 25
    assert f"steelyard export {identified} --to urdf" in text
    robot = given / "demo_arm.toml"
    options = (*PLAIN, "-o", "out", "--verbose")
    done = command("identify", robot, f"{LOG}@0:4", "--validate", OTHER, *options)
    assert "normalised condition number" in done.stdout and "note: cut-offs" in done.stdout
    assert "normalised condition number" not in text and "note: cut-offs" not in text


def test_what_is_doubtful_of_the_fit_limits_the_verdict_on_any_log(
    given: Path, identified: Path
) -> None:
    model, log = steelyard.load_model(identified), given / "validation.csv"
    plain = steelyard.validate(model, log)
    doubt = Finding.doubtful("runs disagree", "χ² 99", fix=Fix("look")).by("runs")
    kept = tuple(doubts_of_fit([doubt, replace(doubt, check="unseen log")], ()))
    origin = replace(model.provenance, doubts=kept)
    doubted = replace(model, provenance=origin)
    again = IdentifiedModel.from_dict(json.loads(doubted.text()))
    found = steelyard.validate(again, log)
    assert (plain.verdict.level, found.verdict.level) == ("good", "fair")
    (limit,) = [one for one in found.verdict.limitations if "runs disagree" in one.text]
    assert limit.text == "runs disagree (χ² 99). look"
    assert found.to_dict()["logs"][0]["verdict"]["level"] == "fair"
