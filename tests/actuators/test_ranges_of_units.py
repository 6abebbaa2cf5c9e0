"""Ranges over several robots: what they hold, and how they are written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from proofs.support.servo_arm import URDF
from typer.testing import CliRunner

from steelyard.actuators.actuator_model import ActuatorModel
from steelyard.actuators.actuator_parameters import ActuatorValues, free_parameters
from steelyard.actuators.ranges_of_units import range_of, ranges_of_units
from steelyard.base.errors import ModelError
from steelyard.cli.app import app
from steelyard.estimate.identified_model import Provenance
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import TargetSignals

PARTS = ("stiffness", "damping", "coulomb", "armature", "delay", "zero")
STD = 0.05


def model(folder: Path, number: int, **given: object) -> ActuatorModel:
    """Actuators as one robot's log `number` has them, with intervals of 5 %."""
    (folder / "servos.urdf").write_text(URDF)
    robot = load_robot(folder / "servos.urdf").robot
    values = ActuatorValues.of(
        (1.0, 1.0), **{"stiffness": 10.0, "damping": 0.5, "coulomb": 0.1, "armature": 0.02} | given
    )
    free = free_parameters(PARTS, {}, 2)
    signals = TargetSignals(
        "time", 1.0, ("q1", "q2"), ("u1", "u2"), np.ones(2), (1.0, 1.0), (None, None)
    )
    origin = Provenance("1", {"robot a": "0", "identification log": str(number)}, ("log",), ())
    return ActuatorModel(
        robot, signals, values, free, STD**2 * np.eye(len(free)), np.ones(len(free)), 1.0,
        np.full(2, 1e-3), (), 0.005, (), (), (), (), np.zeros((2, 2)), origin,
    )  # fmt: skip


@pytest.mark.parametrize("units", [2, 3, 12])
@pytest.mark.parametrize("between", [0.2, 0.0])
def test_ranges_hold_the_share_of_robots_that_they_state(units: int, between: float) -> None:
    rng, held, differ = np.random.default_rng(0), [], []
    for _ in range(4000):
        y = between * rng.standard_normal(units) + STD * rng.standard_normal(units)
        middle, half, apart = range_of(y, np.full(units, STD))
        new = between * rng.standard_normal() + STD * rng.standard_normal()
        held.append(abs(new - middle) <= half)
        differ.append(apart)
    assert 0.93 < np.mean(held) <= (0.97 if between and units > 2 else 1.0)
    assert (abs(np.mean(differ) - 0.05) < 0.015) == (between == 0.0)


def test_robots_that_differ_are_told_from_those_that_do_not(tmp_path: Path) -> None:
    stiffness, seen = (8.0, 10.0, 13.0, 11.0), {}
    models = [model(tmp_path, k, stiffness=(x, 10.0)) for k, x in enumerate(stiffness)]
    seen = {(one.name, one.joint): one for one in ranges_of_units(models)}
    first, second = seen["stiffness", "shoulder"], seen["stiffness", "elbow"]
    assert first.differ and not second.differ and first.units == 4
    assert first.low < 8.0 and first.high > 13.0 and first.middle == pytest.approx(10.34, abs=0.01)
    assert second.high / second.low < 1.6
    assert ("zero", "shoulder") not in seen and ("delay", "all") in seen
    ratio = seen["damping / stiffness", "shoulder"]
    assert ratio.differ and ratio.unit == "Nm s/rad per Nm/rad"
    assert ratio.middle == pytest.approx(0.5 / np.exp(np.log(stiffness).mean()), rel=0.02)


def test_models_that_say_nothing_of_several_robots_are_refused(tmp_path: Path) -> None:
    one, other = model(tmp_path, 1), model(tmp_path, 2)
    robot = replace(other.robot, coordinates=other.robot.coordinates[::-1])
    for models, wrong in (
        ([one], "one robot shows no spread"),
        ([one, model(tmp_path, 1)], "same log"),
        ([one, replace(other, robot=robot)], "their joints are elbow, shoulder"),
    ):
        with pytest.raises(ModelError, match=wrong):
            ranges_of_units(models)


def test_the_command_writes_ranges_into_the_head(tmp_path: Path) -> None:
    for k in range(3):
        other = replace(model(tmp_path, k, stiffness=8.0 + k), stated=("load_friction",) * (k > 1))
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / "model.json").write_text(other.text())
    given = ["export", str(tmp_path / "0"), *("--unit", str(tmp_path / "1"))]
    given += ["--unit", str(tmp_path / "2"), "--to"]
    for form, end in (("mjcf", "xml"), ("usd", "usda"), ("isaaclab", "py"), ("mjlab", "py")):
        path = tmp_path / f"{form}.{end}"
        done = CliRunner().invoke(app, [*given, form, "-o", str(path), "--json"])
        assert done.exit_code == 0, done.output
        ranges = json.loads(done.stdout)["ranges"]
        assert {one["units"] for one in ranges} == {3}
        text = path.read_text("utf-8")
        assert "Over 3 robots" in text and "stiffness of elbow: 8.96 [" in text
        assert "Laws of these robots differ (load_friction)" in text
    done = CliRunner().invoke(app, [*given, "mjcf", "-o", str(tmp_path / "said.xml")])
    assert "ranges over 3 robots, which differ in stiffness" in done.stdout


def test_other_robots_are_refused_beside_a_model_of_efforts(small_arm: Path) -> None:
    given = [str(small_arm / "arm-model"), "--unit", str(small_arm / "servo-model"), "--to", "urdf"]
    done = CliRunner().invoke(app, ["export", *given])
    assert done.exit_code == 2 and "is for models of actuators" in done.output
