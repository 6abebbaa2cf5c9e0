"""Robots for the tests of the virtual room."""

import numpy as np
import pytest

from steelyard.arrays import frozen
from steelyard.robot.geometry import turn
from steelyard.robot.inertia import Inertia
from steelyard.robot.reduction import reduced
from steelyard.robot.robot import Body, Coordinate, JointKind, Limits, Robot
from steelyard.robot.urdf import read_urdf
from steelyard.virtual.truth import Truth


def inertia(rng: np.random.Generator, mass: float = 1.0) -> Inertia:
    root = rng.standard_normal((3, 3)) * 0.08
    second = root @ root.T + 1e-3 * np.eye(3)
    return Inertia.about_com(
        mass, rng.uniform(-0.1, 0.1, 3), mass * (np.trace(second) * np.eye(3) - second)
    )


@pytest.fixture
def tree() -> Robot:
    """A tree: skew axes, a prismatic joint, a mimic body, offsets and ratios, gravity aslant."""
    rng = np.random.default_rng(5)

    def body(
        name: str,
        kind: JointKind,
        parent: int,
        axis: tuple[float, float, float],
        coordinate: int,
        ratio: float = 1.0,
        offset: float = 0.0,
    ) -> Body:
        unit = frozen(np.array(axis) / np.linalg.norm(axis))
        rotation = turn([0.6, 0.0, 0.8], rng.uniform(-2, 2))
        position = frozen(rng.uniform(-0.3, 0.3, 3))
        joint = f"{name}_joint"
        return Body(
            name,
            joint,
            kind,
            parent,
            rotation,
            position,
            unit,
            coordinate,
            ratio,
            offset,
            inertia(rng),
            True,
        )

    bodies = (
        body("shoulder", "revolute", -1, (0, 0, 1), 0),
        body("lift", "prismatic", 0, (1, 2, -1), 1),
        body("left", "revolute", 1, (0.3, -1, 0.5), 2, offset=0.4),
        body("right", "revolute", 1, (0, 1, 0), 3, ratio=-2.0, offset=-0.1),
        body("follower", "revolute", 3, (1, 0, 0), 3, ratio=0.7, offset=0.2),
    )
    coordinates = (
        Coordinate("a", "revolute"),
        Coordinate("b", "prismatic"),
        Coordinate("c", "revolute", Limits(-2.0, 2.0, 2.0)),
        Coordinate("d", "revolute"),
    )
    return Robot("tree", bodies, coordinates, gravity=(3.0, -2.0, -9.0))


@pytest.fixture(scope="session")
def arm() -> Robot:
    """The demo arm that the package ships."""
    from importlib.resources import as_file, files

    with as_file(files("steelyard.virtual") / "demo_arm.urdf") as path:
        return reduced(read_urdf(path))[0]


@pytest.fixture
def pendulum() -> Robot:
    """One kilogram at the end of half a metre, about y; hangs down at zero."""
    mass = Inertia.about_com(1.0, [0.0, 0.0, -0.5], np.eye(3) * 1e-3)
    axis = frozen([0.0, 1.0, 0.0])
    bob = Body("bob", "pivot", "revolute", -1, np.eye(3), np.zeros(3), axis, 0, inertia=mass)
    return Robot("pendulum", (bob,), (Coordinate("pivot", "revolute"),))


@pytest.fixture
def pendulum_truth(pendulum: Robot) -> Truth:
    """The pendulum without any friction."""
    zero = np.zeros(1)
    return Truth(pendulum.nominal, zero, zero, zero, zero, np.array([0.01]))
