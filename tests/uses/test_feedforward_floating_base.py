"""Torques of a robot with a floating base along a motion, and the contacts that carry it."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import steelyard
from floating_logs import FLAG, HAND, IMU, JOINTS, axes_at, dog, record, waves
from steelyard.base.errors import SteelyardError
from steelyard.base.motion import Motion
from steelyard.cli.app import app
from steelyard.estimate.identified_model import IdentifiedModel


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    """The dog in a hand's grip, identified from an exact log; its fore foot has a switch."""
    folder = tmp_path_factory.mktemp("dog")
    logs = [record(folder, f"fit{k}", seed=k)[0] for k in range(2)]
    return steelyard.identify(dog(folder, IMU + FLAG + HAND), logs, check=False).model


def test_a_hand_carries_what_it_carried(model: IdentifiedModel, tmp_path: Path) -> None:
    """Torques of the joints, and force and moment of the hand, are those of the exact log."""
    path, motion = record(tmp_path, seed=7)
    log = pl.read_parquet(path)
    found = steelyard.feedforward(model, motion, contacts=["handle"])
    logged = log.select(f"tau_{name}" for name in JOINTS).to_numpy()
    assert np.abs(found.torque - logged).max() < 2e-3 * np.abs(logged).max()
    assert [joint.name for joint in found.joints] == list(JOINTS)
    hand = log.select([f"hand_f{x}" for x in "xyz"] + [f"hand_m{x}" for x in "xyz"]).to_numpy()
    turned = model.pose(motion.q, "handle")[1]
    of_base = np.einsum("nij,nkj->nki", turned, hand.reshape(-1, 2, 3)).reshape(-1, 6)
    assert found.carried is not None
    assert np.abs(found.carried.forces["handle"] - of_base).max() < 0.1  # of 60 N
    given = steelyard.feedforward(model, motion, forces={"handle": of_base})
    assert np.abs(given.torque - logged).max() < 2e-3 * np.abs(logged).max()
    assert not given.warnings and not any("share" in note for note in given.notes)
    assert given.to_dict()["contacts"][0]["friction"] is None  # no orientation: not known


def test_a_table_has_the_place_of_the_base_in_the_world(
    model: IdentifiedModel, tmp_path: Path
) -> None:
    """Its torques are those of the samples of the motion; contacts are in the written table."""
    _, motion = record(tmp_path, seed=3, seconds=4.0)
    yaw, pitch, roll = Rotation.from_matrix(axes_at(motion.t, 3)).as_euler("ZYX").T
    place = waves(motion.t, 53, 3, 0.05)[0]
    columns = {"time_s": motion.t}
    for k, axis in enumerate("xyz"):
        columns |= {f"q_base_{axis}": place[:, k], f"q_base_r{axis}": (roll, pitch, yaw)[k]}
    columns |= {f"q_{name}": motion.q[:, 6 + k] for k, name in enumerate(JOINTS)}
    pl.DataFrame(columns).write_csv(tmp_path / "motion.csv")
    exact = steelyard.feedforward(model, motion, contacts=["handle"])
    found = steelyard.feedforward(model, tmp_path / "motion.csv", contacts=["handle"])
    assert exact.carried is not None and found.carried is not None
    inner = slice(50, -50)  # a spline of a table without speeds is not exact at its ends
    scale = np.abs(exact.torque).max()
    assert np.abs(found.torque - exact.torque)[inner].max() < 1e-3 * scale
    forces = (x.carried.forces["handle"] for x in (found, exact) if x.carried is not None)
    assert np.abs(np.subtract(*forces))[inner].max() < 0.1
    (_, least, most, friction) = next(found.carried.loads())
    assert 40.0 < least < most < 100.0 and 0.0 < friction < 1.0  # a dog of 7 kg that sways
    found.write(tmp_path / "torques.csv")
    written = pl.read_csv(tmp_path / "torques.csv")
    assert written.columns[-6:] == [f"{w}_handle_{x}" for w in ("force", "moment") for x in "xyz"]
    assert written.height == len(found.motion)
    told = ["feedforward", str(model.save(tmp_path / "model")), str(tmp_path / "motion.csv")]
    told += ["-o", str(tmp_path / "by_command.csv"), "--contacts", "handle", "--contacts"]
    done = CliRunner().invoke(app, [*told, "fore_foot"])
    assert done.exit_code == 0 and "handle: carries" in done.output, done.output
    assert "fore_foot: carries" in done.output


def test_several_contacts_share_by_the_least_forces(model: IdentifiedModel, tmp_path: Path) -> None:
    """No other forces that carry the base are smaller, and joints feel them."""
    _, motion = record(tmp_path, seed=5, seconds=1.0)
    alone = steelyard.feedforward(model, motion, contacts=["handle"])
    both = steelyard.feedforward(model, motion)
    assert alone.carried is not None and both.carried is not None
    assert set(both.carried.forces) == {"handle", "fore_foot"}
    size = [sum(np.sum(f**2, axis=1) for f in x.carried.forces.values()) for x in (both, alone)]
    assert (size[0] < size[1]).all()
    assert np.abs(both.carried.missing).max() < 1e-6
    assert any("share" in note for note in both.notes)
    assert np.abs(both.torque - alone.torque).max() > 0.1


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"contacts": ["fore_foot"]}, "do not carry the base"),  # a point gives no moment
        ({"contacts": []}, "do not carry the base"),
    ],
)
def test_what_contacts_cannot_give_is_said(
    model: IdentifiedModel, tmp_path: Path, asked: dict[str, list[str]], said: str
) -> None:
    _, motion = record(tmp_path, seed=5, seconds=1.0)
    found = steelyard.feedforward(model, motion, **asked)  # type: ignore[arg-type]
    assert any(said in warning for warning in found.warnings)


def test_a_floor_does_not_pull(model: IdentifiedModel, tmp_path: Path) -> None:
    """A base that falls faster than its weight lets it."""
    t = np.linspace(0.0, 0.5, 200)
    columns = {"time_s": t, "q_base_z": -9.0 * t**2}
    columns |= {f"q_base_{axis}": 0.0 * t for axis in ("x", "y", "rx", "ry", "rz")}
    columns |= {f"q_{name}": 0.0 * t for name in JOINTS}
    pl.DataFrame(columns).write_csv(tmp_path / "fall.csv")
    found = steelyard.feedforward(model, tmp_path / "fall.csv", contacts=["handle"])
    assert any("pull the floor" in warning for warning in found.warnings)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"contacts": ["tail"]}, "no contact on 'tail'"),
        ({"forces": {"tail": [[0.0, 0.0, 1.0]] * 250}}, "tail"),
        ({"forces": {"handle": [[0.0, 0.0, 1.0]]}}, "shape"),
        ({"forces": {"handle": [[0.0, 0.0, 1.0]] * 250}, "contacts": ["handle"]}, "together"),
    ],
)
def test_contacts_that_are_not_there_are_refused(
    model: IdentifiedModel, tmp_path: Path, asked: dict[str, object], said: str
) -> None:
    _, motion = record(tmp_path, seed=5, seconds=1.0)
    with pytest.raises(SteelyardError, match=said):
        steelyard.feedforward(model, motion, **asked)  # type: ignore[arg-type]


def test_a_table_needs_the_place_of_the_base_by_name(
    model: IdentifiedModel, tmp_path: Path
) -> None:
    """Numbered columns may count the joints alone."""
    rows = {"time_s": [0.0, 0.1, 0.2], **{f"q{k}": [0.0] * 3 for k in range(1, 11)}}
    pl.DataFrame(rows).write_csv(tmp_path / "numbers.csv")
    with pytest.raises(SteelyardError, match="a column 'q_base_x';"):
        steelyard.feedforward(model, tmp_path / "numbers.csv")


def test_what_a_hoist_holds_is_not_on_the_contacts(tmp_path: Path) -> None:
    log, motion = record(tmp_path)
    held = dog(tmp_path, IMU + 'wrench = "unknown"\n')
    model = steelyard.identify(held, log, check=False).model
    found = steelyard.feedforward(model, motion)
    assert found.carried is not None and not found.carried.forces and not found.warnings


def test_a_round_contact_needs_an_orientation(tmp_path: Path) -> None:
    """Samples of a motion have none."""
    ball = FLAG + "radius = 0.02\n"
    log, motion = record(tmp_path)
    file = dog(tmp_path, IMU + 'orientation = "q{}"\n' + ball + HAND)
    model = steelyard.identify(file, log, check=False).model
    with pytest.raises(SteelyardError, match="orientation of the base"):
        steelyard.feedforward(model, motion)


def test_an_arm_has_no_contacts(small_arm: Path) -> None:
    rest = np.zeros((2, 2))
    with pytest.raises(SteelyardError, match="base floats"):
        still = Motion([0.0, 1.0], rest, rest, rest)
        steelyard.feedforward(small_arm / "arm-model", still, contacts=["tool"])
