"""`model.json`: exact round trip, and errors for files that are not one."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import steelyard
from invented import tree
from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError, OutputError
from steelyard.base.motion import Motion
from steelyard.estimate.estimate import Estimate, KnownScales, Unidentifiable
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Limits
from steelyard.uses.control.feedforward import refuse_unknown_gains


@pytest.fixture
def identified() -> IdentifiedModel:
    model = Model(tree(), (RigidBody(), Coulomb(smoothing=0.05)))
    base = base_parameters(model)
    rng = np.random.default_rng(0)
    size = len(base)
    spread = rng.normal(size=(size, size))
    estimate = Estimate(
        "weighted least squares",
        Parameters(base.base_names, base.base_units, rng.normal(size=size)),
        spread @ spread.T,
        (Unidentifiable("x", ("y",)),),
        rng.random(4),
        np.full(4, 100.0),
        12.5,
        3.25,
    )
    names = tuple(f"c{k}" for k in range(8))
    signals = Signals(
        "t", 1e-3, names[:4], np.ones(4), None, None, names[4:], np.ones(4),
        "motor_current", ("A",) * 4, np.array([1.5, -2.0, 3.0, 0.1]),
    )  # fmt: skip
    origin = Provenance("0.1.0", {"robot x.toml": "ab"}, ("run@1:2",), ("a note",))
    return IdentifiedModel(model, base, estimate, (), signals, Cutoffs(20.0, 8.0, 5.0), origin)


def test_round_trip_is_exact(identified: IdentifiedModel, tmp_path: Path) -> None:
    folder = identified.save(tmp_path / "model")
    assert folder == tmp_path / "model"
    with pytest.raises(OutputError, match="exists already"):
        identified.save(folder)
    again = steelyard.load_model(folder)
    assert again.text() == identified.text()
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 9, 4))
    motion = Motion(np.arange(9), q, dq, ddq)
    torque = again.torque(motion)
    assert np.array_equal(torque, identified.torque(motion))
    stepper = again.start()
    for k in range(9):
        assert np.abs(stepper.step(q[k], dq[k], ddq[k]) - torque[k]).max() < 1e-12


def test_efforts_are_those_of_the_log(identified: IdentifiedModel) -> None:
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 9, 4))
    torque = identified.torque(q, dq, ddq)
    amperes = torque / [1.5, -2.0, 3.0, 0.1]
    np.testing.assert_allclose(identified.effort(q, dq, ddq), amperes, rtol=1e-12)
    np.testing.assert_allclose(identified.effort(q[0], dq[0], ddq[0]), amperes[0], rtol=1e-12)
    milli = replace(identified.signals, effort_scale=np.full(4, 1e-3))
    scales = KnownScales(identified.joints, np.array([0.7, 1.0, 1.1, 1.3]), np.eye(4))
    scaled = replace(milli, gains=milli.gains / scales.values)
    found = replace(identified, signals=scaled, effort_scales=scales).effort(q, dq, ddq)
    np.testing.assert_allclose(found, 1e3 * scales.values * amperes, rtol=1e-12)


def test_relative_gains_are_no_torques(identified: IdentifiedModel) -> None:
    refuse_unknown_gains(identified)
    relative = replace(identified.signals, gains=np.array([1.0, -2.0, 3.0, 0.1]))
    with pytest.raises(ModelError, match="the drive gain of joint .* is unknown"):
        refuse_unknown_gains(replace(identified, signals=relative))


def test_scales_of_efforts_are_kept(identified: IdentifiedModel, tmp_path: Path) -> None:
    spread = np.random.default_rng(2).normal(size=(4, 4))
    known = KnownScales(identified.joints, np.array([0.7, 1.0, 1.1, 1.3]), spread @ spread.T)
    path = tmp_path / "model.json"
    path.write_text(replace(identified, effort_scales=known).text())
    again = steelyard.load_model(path).effort_scales
    assert again is not None
    assert np.array_equal(again.values, known.values)
    assert np.array_equal(again.covariance, known.covariance)
    half = 1.96 * np.sqrt(np.diag(known.covariance)) * known.values
    assert again.half_width == pytest.approx(half, rel=1e-4)
    first = f"{identified.joints[0]} 0.700 ± {half[0]:.2g}, "
    assert repr(again).startswith(first) and repr(again).count("±") == 4
    data = json.loads(path.read_text())
    data["effort_scales"]["values"].pop()
    path.write_text(json.dumps(data))
    with pytest.raises(ModelError, match="4 joints need 4 scales of efforts with a covariance"):
        steelyard.load_model(path)
    del data["effort_scales"]
    path.write_text(json.dumps(data))
    assert steelyard.load_model(path).effort_scales is None


def test_a_robot_file_is_named_as_one(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text('[robot]\nurdf = "arm.urdf"\n')
    with pytest.raises(ModelError, match="the file is a robot file, not an identified model"):
        steelyard.load_model(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        ("not json", "not JSON"),
        ("[]", "not an identified model"),
        ('{"schema": "steelyard.model", "schema_version": 99}', "schema version 99"),
        ('{"schema": "steelyard.model", "schema_version": 4}', "incomplete or damaged"),
    ],
)
def test_other_files_are_refused(text: str | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ModelError, match=words):
        steelyard.load_model(path)


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("estimate", "values", [1.0]),
        ("estimate", "values", None),
        ("estimate", "covariance", -1.0),
        ("signals", "gains", [1.0]),
        ("signals", "gains", [1.0, 0.0, 1.0, 1.0]),
        ("signals", "position", ["q1"]),
        ("signals", "effort_units", ["A"]),
    ],
)
def test_a_damaged_value_is_refused(
    part: str, key: str, value: object, identified: IdentifiedModel, tmp_path: Path
) -> None:
    data = json.loads(identified.text())
    kept = data[part][key]
    if value is None:
        data[part][key] = [None, *kept[1:]]
    elif value == -1.0:
        kept[0][0] = value
    else:
        data[part][key] = value
    path = tmp_path / "model.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ModelError, match="incomplete or damaged"):
        steelyard.load_model(path)


@pytest.mark.parametrize(
    "key", ["position_map", "position_offset", "effort_map", "unknown_gains", "gains", "velocity"]
)
def test_a_key_of_the_signals_that_is_lost_is_named(
    key: str, identified: IdentifiedModel, tmp_path: Path
) -> None:
    data = json.loads(identified.text())
    del data["signals"][key]
    path = tmp_path / "model.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ModelError, match=f"it has no '{key}'"):
        steelyard.load_model(path)


@pytest.mark.parametrize(
    ("given", "meant"), [("steelyard-ur10x", "steelyard-ur10e"), ("demo", "demo/results")]
)
def test_a_missing_model_is_looked_for_beside_and_within(
    given: str, meant: str, tmp_path: Path
) -> None:
    for name in ("steelyard-ur10e", "demo/results"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "model.json").write_text("{}")
    with pytest.raises(ModelError, match="cannot be read") as caught:
        load_model(tmp_path / given)
    assert caught.value.fix == f"did you mean {tmp_path / meant}?"
    with pytest.raises(ModelError) as caught:
        load_model(tmp_path / "other" / "place")
    assert "output folder" in caught.value.fix


def test_degrees_cause_a_warning_in_the_line_of_the_user(identified: IdentifiedModel) -> None:
    robot, model = identified.robot, identified.model
    limited = [replace(one, limits=Limits(-6.3, 6.3)) for one in robot.coordinates]
    arm = replace(identified, model=Model(robot.changed(coordinates=limited), model.terms))
    still = np.zeros(robot.n)
    arm.torque(np.full(robot.n, 12.5), still, still)
    for of in (arm.torque, arm.effort, arm.friction):
        with pytest.warns(UserWarning, match="positions are in rad") as caught:
            of(np.full(robot.n, 90.0), still, still)
        assert caught[0].filename == __file__
    identified.torque(np.full(robot.n, 90.0), still, still)  # no limits
