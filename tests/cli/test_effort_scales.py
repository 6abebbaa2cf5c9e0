"""Efforts whose scale is off: found with the parameters, reported, and used for other logs."""

import json
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.river_files import edited
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.identified_model import load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.identify import fit as fitting
from steelyard.identify.fit import _unscaled_because
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot

OFF = {2: 1.25}


def scaled(given: Path, name: str, folder: Path) -> Path:
    """A log in which a torque sensor reads too much."""
    path = folder / f"{name}.csv"
    table = pl.read_csv(given / path.name)
    table.with_columns(pl.col(f"tau{k}_Nm") * x for k, x in OFF.items()).write_csv(path)
    return path


@pytest.fixture
def logs(given: Path, tmp_path: Path) -> list[Path]:
    return [scaled(given, name, tmp_path) for name in ("identification", "validation")]


@pytest.mark.slow
def test_scales_are_found_and_used_for_other_logs_unless_they_are_off(
    given: Path, command: Command, tmp_path: Path, logs: list[Path]
) -> None:
    robot, out = edited(given, tmp_path), tmp_path / "out"
    done = command(
        "identify", robot, logs[0], "--validate", logs[1], "-o", out, "--json", "--no-check"
    )
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    found = result["effort_scales"]
    for k, (value, half) in enumerate(zip(found["values"], found["half_width"], strict=True), 1):
        assert abs(value - OFF.get(k, 1.0)) < half
    assert found["values"][1] - found["half_width"][1] > 1.0
    assert found["left_out_error_percent"] < found["left_out_error_without_percent"]
    assert any("a scale of the efforts is estimated per joint" in note for note in result["notes"])
    remarks = [x["says"] for x in result["limitations"] if x["check"] == "effort scales"]
    assert len(remarks) == 1 and f"shoulder_lift {str(found['values'][1])[:4]}" in remarks[0]
    assert "explains more" not in remarks[0]
    assert 'id="effort_scales"' in (out / "report.html").read_text()
    written = json.loads((out / "model.json").read_text())
    gains, kept = written["signals"]["gains"], written["effort_scales"]
    assert gains == pytest.approx([1.0 / x for x in found["values"]])
    assert kept["values"] == found["values"]
    half = [1.96 * row[k] ** 0.5 * found["values"][k] for k, row in enumerate(kept["covariance"])]
    assert half == pytest.approx(found["half_width"], rel=1e-3)
    headline = result["validation"][0]["headline"]
    shares = [joint["percent_of_used"] for joint in headline["joints"]]
    logged = [joint["percent_of_used"] for joint in headline["as_logged"]["joints"]]
    assert logged[1] > 15.0 > 5.0 > shares[1], "the sensor of joint 2 reads 25 % too much"
    assert result["verdict"]["errors_as_logged"] == headline["as_logged"]["pooled"]
    model = load_model(out)
    still = np.zeros(model.robot.n)
    efforts = model.torque(still + 0.3, still, still) * found["values"]
    np.testing.assert_allclose(model.effort(still + 0.3, still, still), efforts, rtol=1e-12)
    again = command("validate", out, logs[1], "--json")
    alone = json.loads(again.stdout)[0]["mean_percent"]
    assert alone == pytest.approx(result["validation"][0]["mean_percent"])

    robot.write_text(robot.read_text() + '\n[estimation]\neffort_scales = "off"\n')
    arguments = ("identify", robot, logs[0], "--validate", logs[1], "--json", "--no-check")
    off = json.loads(command(*arguments, "-o", tmp_path / "off").stdout)
    assert off["effort_scales"] is None and off["validation_without_scales"] == []
    (plain,), (beside,) = off["validation"], result["validation_without_scales"]
    known, without = (one["headline"]["pooled"][0] for one in (plain, beside))
    assert without["error"] == pytest.approx(known["error"], rel=1e-3)
    page = (out / "report.html").read_text()
    assert "Without scales (effort_scales =" in unescape(page)


@pytest.mark.slow
def test_scales_are_not_adopted_while_the_side_of_the_gears_is_open(
    given: Path,
    command: Command,
    tmp_path: Path,
    logs: list[Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def all_zero(estimate: Estimate, effort_kind: str) -> tuple[tuple[str, ...], int]:
        asked.append(effort_kind)
        return ("rotor_inertia.a", "rotor_inertia.b"), 2

    monkeypatch.setattr(fitting, "rotors_at_zero", all_zero)
    robot, out = edited(given, tmp_path), tmp_path / "out"
    done = command("identify", robot, logs[0], "-o", out, "--json", "--no-check")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["effort_scales"] is None and asked == ["joint_torque"]
    (note,) = (note for note in result["notes"] if "no scales of the efforts are adopted" in note)
    assert "with them 2 of 2 rotor inertias are zero" in note
    model = load_model(out)
    assert model.effort_scales is None and model.signals.gains.tolist() == [1.0] * model.robot.n


@pytest.mark.slow
@pytest.mark.parametrize(
    ("written", "words"),
    [
        ('method = "least_squares"\neffort_scales = "auto"', 'with method = "least_squares"'),
        (
            'weights = "equal"\neffort_scales = "auto"',
            'with weights = "equal", which small scales of the largest residuals lessen',
        ),
        ('method = "least_squares"', None),
        ('method = "least_squares"\neffort_scales = "off"', None),
    ],
)
def test_scales_that_are_requested_in_vain_are_reported(
    given: Path, command: Command, tmp_path: Path, written: str, words: str | None
) -> None:
    robot = edited(given, tmp_path)
    robot.write_text(f"{robot.read_text()}\n[estimation]\n{written}\n")
    log = given / "identification.csv"
    done = command("identify", robot, log, "-o", tmp_path / "out", "--json", "--no-check")
    notes = [note for note in json.loads(done.stdout)["notes"] if "has no effect" in note]
    assert notes == ([f'effort_scales = "auto" has no effect {words}'] if words else [])


def test_scales_are_of_motors_behind_coupled_gears(given: Path, tmp_path: Path) -> None:
    loaded = load_robot(edited(given, tmp_path))
    model = model_with_open_friction(loaded)
    estimator = Consistent(base_parameters(model), default_knowledge(model))
    assert loaded.signals is not None
    for gears, words in ((None, ""), (np.eye(3), "with coupled gears")):
        run = SimpleNamespace(
            recording=SimpleNamespace(signals=replace(loaded.signals, effort_map=gears))
        )
        ground = SimpleNamespace(gains=None, runs=(run,))
        why = _unscaled_because(loaded, cast(Any, ground), estimator)
        assert why.startswith(words) and bool(why) == bool(words)


@pytest.mark.slow
def test_a_clean_log_gets_none(identified: Path) -> None:
    printed = json.loads((identified.parent / "printed.json").read_text())
    assert printed["effort_scales"] is None
