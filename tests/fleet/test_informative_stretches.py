"""Stretches of production logs that say most about a model's parameters."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import small_arm
import small_fleet
import steelyard
from steelyard.base.errors import LogError
from steelyard.cli.app import app
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, and a log of motion, of motion with a load, and of one joint alone."""
    place = tmp_path_factory.mktemp("stretches")
    (place / "arm.urdf").write_text(small_arm.URDF)
    (place / "arm.toml").write_text(small_fleet.ROBOT_FILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        small_fleet.write(place / "fit.parquet", small_fleet.log(0, 0))
        steelyard.identify("arm.toml", "fit.parquet", check=False).save("model")
        days = [
            small_fleet.log(0, 1), small_fleet.log(0, 2, mass=1.5),
            small_fleet.log(0, 3, motion=(1.0, 0.02)),
        ]  # fmt: skip
    names = [name for name in days[0] if name != "temp"]
    log = {name: np.concatenate([day[name] for day in days]) for name in names}
    log["t"] = np.arange(len(log["t"])) / small_fleet.RATE
    pl.DataFrame(log).write_csv(place / "day.csv")
    return place


def seconds_of(text: str) -> tuple[float, float]:
    start, stop = text.rpartition("@")[2].split(":")
    return float(start), float(stop)


def test_few_windows_hold_most_and_loads_are_left_out(folder: Path) -> None:
    found = steelyard.informative_stretches(folder / "model", folder / "day.csv")
    assert 0.95 <= found.share < 1.0 and found.chosen < 0.8 * (found.windows - found.unexplained)
    assert 10 <= found.unexplained <= 16  # of 25 s, in windows of 2 s
    for stretch in found.stretches:
        assert stretch.stop <= 27.5 or stretch.start >= 47.5
    inside = sum(s.stop - s.start for s in found.stretches if s.stop <= 27.5)
    assert inside > 0.7 * found.seconds  # where both joints move


def test_more_share_takes_more_windows_and_longer_ones_are_fewer(folder: Path) -> None:
    model, log = folder / "model", folder / "day.csv"
    some, most = (steelyard.informative_stretches(model, log, share=x) for x in (70.0, 99.0))
    assert some.chosen < most.chosen and some.share >= 0.7 and most.share >= 0.99
    assert steelyard.informative_stretches(model, log, window=5.0).windows < some.windows


def test_their_sums_identify(folder: Path) -> None:
    found = steelyard.informative_stretches(folder / "model", folder / "day.csv", share=95.0)
    few, every = (WeightedLeastSquares()(x) for x in (found.information, found.all_information))
    for (name, value), half in zip(few.parameters.as_dict().items(), few.half_width, strict=True):
        assert abs(value - every.parameters.as_dict()[name]) < 2.0 * half


def test_long_windows_are_logs_for_identify(folder: Path) -> None:
    found = steelyard.informative_stretches(
        folder / "model", folder / "day.csv", window=8.0, share=70.0
    )
    logs = [stretch.text for stretch in found.stretches]
    model = steelyard.identify(folder / "arm.toml", logs, check=False).model
    assert model.joints == ("joint1", "joint2")


def test_a_log_that_the_model_does_not_explain(folder: Path) -> None:
    table = pl.read_csv(folder / "day.csv").with_columns(pl.col("tau1") + 50.0)
    table.write_csv(folder / "other.csv")
    with pytest.raises(LogError, match="the model explains none of"):
        steelyard.informative_stretches(folder / "model", folder / "other.csv")


def test_command(folder: Path) -> None:
    arguments = ["log", "select", str(folder / "model"), str(folder / "day.csv"), "--share", "80"]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0, shown.output
    lines = shown.stdout.splitlines()
    starts = [seconds_of(line)[0] for line in lines]
    assert starts == sorted(starts) and "% of log det" in shown.stderr
    found = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert found["stretches"] == lines and found["share"] >= 0.8
