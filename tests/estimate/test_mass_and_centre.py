"""Mass and centre of mass of a whole robot with a floating base."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import steelyard
from floating_logs import HAND, IMU, dog, record
from steelyard.base.errors import ModelError
from steelyard.report.words import with_interval


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> steelyard.Identification:
    """The dog, of a noisy log in which a measured hand moves it."""
    folder = tmp_path_factory.mktemp("dog")
    log, _ = record(folder, noise=0.02)
    return steelyard.identify(dog(folder, IMU + HAND), log, check=False)


def test_mass_and_centre_are_those_of_all_links(fitted: steelyard.Identification) -> None:
    """Against a sum over links, whose places come from their frames."""
    model, robot = fitted.model, fitted.model.robot
    q = np.random.default_rng(0).uniform(-0.6, 0.6, (5, 4))
    full = np.hstack([np.zeros((5, 6)), q])
    total, first = 0.0, np.zeros((5, 3))
    for body in robot.bodies:
        at, axes = model.pose(full, body.name)
        total += body.inertia.mass
        first += body.inertia.mass * (at + axes @ body.inertia.com)
    found = model.mass_and_centre(q)
    assert abs(found.mass - total) <= 2.0 * found.mass_half_width < 0.05 * total
    off = np.abs(found.centre - first / total)
    assert found.centre.shape == found.half_width.shape == (5, 3)
    assert (off <= 2.0 * found.half_width).all() and (found.half_width < 0.02).all()
    same = model.mass_and_centre(full[2])
    assert np.allclose(same.centre, found.centre[2], rtol=1e-9) and same.centre.shape == (3,)


def test_the_report_says_what_the_whole_robot_weighs(fitted: steelyard.Identification) -> None:
    """On the page and in the terminal alike."""
    found = fitted.model.mass_and_centre(np.mean(fitted.model.motions[0].q, axis=0))
    words = f"whole robot: {with_interval(found.mass, found.mass_half_width)} kg, centre of mass in"
    printed = io.StringIO()
    fitted.show(Console(file=printed, width=10_000))
    assert words in fitted.report() and words in printed.getvalue()


def test_a_mass_that_nothing_shows_is_refused(
    fitted: steelyard.Identification, tmp_path: Path
) -> None:
    """Of a fixed base, and where a wrench is unknown."""
    log, _ = record(tmp_path)
    hung = steelyard.identify(dog(tmp_path, IMU + 'wrench = "unknown"\n'), log, check=False).model
    with pytest.raises(ModelError, match="wrench on its base is unknown"):
        hung.mass_and_centre(np.zeros(4))
