"""What contacts of unknown force hide, and the motions that show it."""

from pathlib import Path

import numpy as np
import pytest

from floating_logs import FLAG, HAND, IMU, TOE, dog, record
from steelyard.estimate.information import hidden_by_contacts as hiding
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_regressor,
)
from steelyard.estimate.information.hidden_by_contacts import (
    Stance,
    hidden_parameters,
    stances_of,
)
from steelyard.identify.fit_preparation import contact_notes
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.runs.runs_of_named_logs import load_runs

BOTH = FLAG + FLAG.replace("fore", "hind")
POSTURE = (*(0.0,) * 6, 0.1, 0.4, -0.1, 0.5)


def of(folder: Path, contacts: str) -> tuple[Regressor, BaseSignals]:
    loaded = load_robot(dog(folder, IMU + contacts))
    assert loaded.signals is not None and loaded.signals.base is not None
    return base_regressor(Model(loaded.robot, (RigidBody(),))), loaded.signals.base


def mass_at_toe(regressor: Regressor, leg: str) -> np.ndarray:
    """Base parameters of a point mass at the toe: it never moves, and the floor carries it."""
    robot = regressor.model.robot
    frame = {frame.name: frame for frame in robot.frames}[f"{leg}_foot"]
    place = frame.rotation @ np.array(TOE) + frame.position
    ten = Inertia.about_com(1.0, place, np.zeros((3, 3))).ten
    values = np.zeros(len(regressor.base.names))
    carrier = robot.bodies[frame.body].name
    for name, x in zip(
        ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"), ten, strict=True
    ):
        values[regressor.base.names.index(f"{name}.{carrier}")] = x
    return np.asarray(regressor.base.base_values(values))


def test_a_mass_where_a_foot_stands_is_hidden(tmp_path: Path) -> None:
    regressor, base = of(tmp_path, BOTH)
    rows = hiding._rows(regressor, base, Stance((True, True), POSTURE))
    size = np.linalg.norm(rows)
    for leg in ("fore", "hind"):
        assert np.linalg.norm(rows @ mass_at_toe(regressor, leg)) < 1e-7 * size
    found = hidden_parameters(regressor, base, [Stance((True, True), POSTURE)])
    assert found.combinations >= 2 and {"m.trunk", "mz.fore_calf"} <= set(found.names)
    assert found.shows[0] == ("a squat on all contacts", found.combinations)
    assert f"{found.combinations} combinations of {len(found.names)} parameters" in found.note
    assert found.shows[-1][1] == 0 and found.note.endswith("would show all")


def test_a_foot_that_is_lifted_shows_its_own(tmp_path: Path) -> None:
    regressor, base = of(tmp_path, BOTH)
    rows = hiding._rows(regressor, base, Stance((False, True), POSTURE))
    shown = np.linalg.norm(rows @ mass_at_toe(regressor, "fore"))
    assert shown > 1e-2 * np.linalg.norm(rows)
    in_turn = [Stance((False, True), POSTURE), Stance((True, False), POSTURE)]
    assert hidden_parameters(regressor, base, in_turn).note == ""


@pytest.mark.slow
def test_what_is_hidden_is_told_of_runs(tmp_path: Path) -> None:
    log, _ = record(tmp_path, push=30.0)
    file = dog(tmp_path, IMU + HAND + FLAG)
    runs = load_runs(file, log)
    regressor = base_regressor(Model(load_robot(file).robot, (RigidBody(),)))
    stances = stances_of(runs)
    assert {stance.touching for stance in stances} == {(False,), (True,)}
    (taken,) = contact_notes(regressor, runs)
    assert "fore_foot 5" in taken and "in brackets only for the margin" in taken
    assert contact_notes(regressor, load_runs(dog(tmp_path, IMU + HAND), log)) == ()
