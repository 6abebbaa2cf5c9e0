"""A robot with a floating base, from logs to a model."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from floating_logs import HAND, IMU, TRACKED, dog, record
from steelyard.base.errors import DataError, LogError, ModelError

NOISE = 0.05


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    folder = tmp_path_factory.mktemp("dog")
    return folder, [str(record(folder, f"log{k}", seed=k, noise=NOISE)[0]) for k in range(2)]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["least_squares", "consistent"])
@pytest.mark.parametrize("sensor", [IMU, TRACKED])
def test_the_whole_body_is_identified(
    method: str, sensor: str, logs: tuple[Path, list[str]]
) -> None:
    folder, (first, second) = logs
    unseen = f"{second}@2:18"  # the log begins and ends in motion
    found = steelyard.identify(
        dog(folder, sensor + HAND), first, unseen, method=method, check=False
    )
    estimate, robot = found.model.estimate, found.model.robot
    base = found.model.base
    place = list(estimate.parameters.names).index("m.trunk")
    total = estimate.parameters.values[place]
    assert abs(total - 7.2) < 2.0 * estimate.half_width[place] + 1e-3
    prior = found.model.model.prior
    assert prior is not None
    true = dict(zip(base.base_names, base.base_values(prior.values.values), strict=True))
    off = [
        abs(value - true[name]) / half
        for name, value, half in zip(
            estimate.parameters.names, estimate.parameters.values, estimate.half_width, strict=True
        )
        if half > 0.0 and not name.startswith(("coulomb", "viscous", "rotor", "offset"))
    ]
    assert np.mean(np.array(off) < 1.0) > 0.8
    (score,) = found.content.scores
    assert score.errors.joints[0].joint == "base_x" and not score.errors.joints[0].driven
    assert all(joint.error < 2.0 * NOISE for joint in score.errors.joints)
    assert not any("not checked" in x.says for x in found.content.limitations)
    assert robot.floating


@pytest.mark.slow
def test_a_model_is_saved_and_used_on_logs(logs: tuple[Path, list[str]], tmp_path: Path) -> None:
    folder, (first, second) = logs
    found = steelyard.identify(dog(folder, IMU + HAND), first)
    found.save(tmp_path / "model")
    again = steelyard.load_model(tmp_path / "model")
    assert again.signals.base == found.model.signals.base
    (score,) = steelyard.validate(again, second).content.scores
    assert score.errors.joints[6].percent_of_used < 10.0
    for use in (
        lambda: again.observe("handle"),
        lambda: steelyard.export_code(again, tmp_path / "code"),
        lambda: steelyard.external_wrench(again, second, residual="momentum"),
        lambda: steelyard.identify(dog(folder, IMU + HAND), first, method="DIDIM"),
        lambda: steelyard.simulate(dog(folder, IMU + HAND), tmp_path / "simulated"),
    ):
        with pytest.raises(ModelError, match="needs a robot whose base is at rest"):
            use()


@pytest.mark.slow
def test_with_an_unknown_wrench_the_mass_of_the_base_is_not_seen(
    logs: tuple[Path, list[str]],
) -> None:
    folder, (first, _) = logs
    file = dog(folder, IMU + 'wrench = "unknown"\n')
    found = steelyard.identify(file, first, method="least_squares", check=False)
    assert "m.trunk" not in found.model.estimate.parameters.names
    assert "mx.fore_calf" in found.model.estimate.parameters.names


def test_workers_and_fleets_refuse_it(logs: tuple[Path, list[str]]) -> None:
    folder, files = logs
    robot = dog(folder, IMU + HAND)
    with pytest.raises(ModelError, match="whose base is at rest"):
        steelyard.identify(robot, files, cluster="local:1")
    with pytest.raises(ModelError, match="whose base is at rest"):
        steelyard.fleet(robot, files, names="{robot}/{day}")


def changed(folder: Path, log: str, name: str, factors: dict[str, float]) -> str:
    """A log with some columns, by the beginnings of their names, multiplied."""
    table = pl.read_parquet(log) if log.endswith(".parquet") else pl.read_csv(log)
    found = {
        c: pl.col(c) * factor
        for start, factor in factors.items()
        for c in table.columns
        if c.startswith(start)
    }
    path = folder / f"{name}.csv"
    table.with_columns(**found).write_csv(path)
    return str(path)


@pytest.mark.slow
def test_a_wrong_force_on_the_base_decides_the_verdict(logs: tuple[Path, list[str]]) -> None:
    folder, (first, second) = logs
    robot, unseen = dog(folder, IMU + HAND), f"{second}@2:18"
    clean = steelyard.identify(robot, first, unseen)
    assert not any(one.check == "force on the base" for one in clean.content.limitations)
    off = changed(folder, second, "off", {"hand_f": -1.0})
    with pytest.raises(DataError, match="contacts"):
        steelyard.identify(robot, first, f"{off}@2:18")
    found = steelyard.identify(robot, first, f"{off}@2:18", check=False)
    (one,) = (one for one in found.content.limitations if one.check == "force on the base")
    assert one.severity.name == "WRONG" and "of the weight" in one.says
    assert found.verdict.level == "poor"
    model = clean.model
    assert steelyard.validate(model, f"{off}@2:18").verdict.level == "poor"
    assert steelyard.validate(model, unseen).verdict.level == "good"


def test_what_carries_the_robot_must_be_measured(logs: tuple[Path, list[str]]) -> None:
    folder, (first, _) = logs
    with pytest.raises(LogError, match="is carried by"):
        steelyard.identify(dog(folder, IMU), first, check=False)
    light = changed(folder, first, "light", {"acc_": 0.1})
    with pytest.raises(LogError, match="has no gravity in it, or another unit"):
        steelyard.identify(dog(folder, IMU + HAND), light, check=False)
    with pytest.raises(DataError, match='the acceleration is in "g"'):
        steelyard.identify(dog(folder, IMU + HAND), light)
