"""Plain least squares with known parameters of the robot file, from the command to the report."""

import json
from pathlib import Path

import numpy as np
import pytest

import steelyard
from cli.conftest import Command
from steelyard.base.errors import ModelError
from steelyard.excite.design_problem_and_information import earlier_of

TABLES = """
[[knowledge]]
kind = "parameter"
parameter = "viscous.joint2"
value = 0.0

[[knowledge]]
kind = "parameter"
parameter = "coulomb.joint1"
value = 1.25

[[knowledge]]
kind = "parameter"
parameter = "viscous.joint1"
upper = 40.0
"""


@pytest.fixture
def known(given: Path, command: Command) -> Path:
    """A robot file with known friction in the folder of the test, its model beside it."""
    text = (given / "demo_arm.toml").read_text().replace("demo_arm.urdf", f"{given}/demo_arm.urdf")
    joints = steelyard.load_robot(given / "demo_arm.toml").robot.joint_names
    tables = TABLES.replace("joint1", joints[0]).replace("joint2", joints[1])
    Path("arm.toml").write_text(text + tables)
    return Path("arm.toml")


@pytest.mark.slow
def test_known_values_are_met_and_named(known: Path, given: Path, command: Command) -> None:
    log = given / "identification.csv"
    done = command("identify", known, log, "--method", "WLS", "--no-check", "-v", "-o", "out")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "2 known: " in words and ", 2 known" in words
    assert "WLS uses of [[knowledge]] only values of whole base parameters, not: 'viscous." in words
    model = steelyard.load_model("out")
    names = steelyard.load_robot(known).robot.joint_names
    estimate = model.estimate
    values, std = (
        estimate.parameters.as_dict(),
        dict(zip(estimate.parameters.names, estimate.std, strict=True)),
    )
    for name, value in ((f"viscous.{names[1]}", 0.0), (f"coulomb.{names[0]}", 1.25)):
        assert values[name] == value and std[name] == 0.0 and name in estimate.known
    csv = Path("out/parameters.csv").read_text().splitlines()
    (line,) = (row for row in csv if row.startswith(f"coulomb.{names[0]},"))
    assert ",1.25," in line and ",known," in line
    assert ", 2 known" in Path("out/report.html").read_text()
    assert model.reference[0].known == estimate.known
    torque = model.friction(np.zeros(3), np.full(3, 0.5), np.zeros(3))
    assert torque[1] == pytest.approx(values[f"coulomb.{names[1]}"], rel=1e-3)
    assert set(estimate.known) <= set(earlier_of(model).removed)
    with pytest.raises(ModelError, match="parameters with a value from"):
        steelyard.reduce(model, log)


@pytest.mark.slow
def test_without_them_nothing_changes(given: Path, command: Command) -> None:
    log = f"{given / 'identification.csv'}@0:6"
    found = steelyard.identify(given / "demo_arm.toml", log, check=False, method="OLS")
    assert found.to_dict()["known"] == [] and "known" not in str(found)
    data = json.loads(found.model.text())
    assert data["estimate"]["known"] == []
