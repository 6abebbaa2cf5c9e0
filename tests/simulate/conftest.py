"""Robots for the tests of the virtual room."""

from collections.abc import Callable

import numpy as np
import pytest

from steelyard.base.arrays import Parameters, frozen
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import Inertia, turn
from steelyard.robot.models.xml_and_urdf import read_urdf
from steelyard.robot.robot import Body, Coordinate, JointKind, Limits, LoopClosure, Robot
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.simulate.ground_truth import Truth


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

    with as_file(files("steelyard.simulate") / "demo_arm.urdf") as path:
        return reduced(read_urdf(path))[0]


@pytest.fixture
def pendulum() -> Robot:
    """One kilogram at the end of half a metre, about y; hangs down at zero."""
    mass = Inertia.about_com(1.0, [0.0, 0.0, -0.5], np.eye(3) * 1e-3)
    axis = frozen([0.0, 1.0, 0.0])
    bob = Body("bob", "pivot", "revolute", -1, np.eye(3), np.zeros(3), axis, 0, inertia=mass)
    return Robot("pendulum", (bob,), (Coordinate("pivot", "revolute"),))


MakeTruth = Callable[..., Truth]


@pytest.fixture
def make_truth() -> MakeTruth:
    """A truth of a robot's nominal bodies, of terms, and of values by name; others are zero."""

    def make(robot: Robot, *laws: Term, smoothing: float = 0.01, **values: float) -> Truth:
        model = Model(robot, (RigidBody(), *laws))
        bodies = [p.name for p in RigidBody().parameters(robot)]
        known = dict.fromkeys(model.names, 0.0) | values
        known |= dict(zip(bodies, robot.nominal.ravel(), strict=True))
        parameters = Parameters(model.names, model.units, [known.pop(n) for n in model.names])
        assert not known
        return Truth(model, parameters, np.full(robot.n_joints, smoothing))

    return make


@pytest.fixture
def pendulum_truth(pendulum: Robot, make_truth: MakeTruth) -> Truth:
    """The pendulum without any friction."""
    return make_truth(pendulum, *DEFAULT_TERMS[1:])


@pytest.fixture(scope="session")
def four_bar() -> Robot:
    """A crank, a coupler and a rocker of unequal lengths; gravity in the plane of motion."""

    def bar(name: str, parent: int, position: tuple[float, float, float], joint: int) -> Body:
        mass = Inertia.about_com(1.0 + 0.3 * joint, [0.2, 0.02, 0.0], np.diag([2e-3, 2e-2, 2e-2]))
        axis = frozen([0.0, 0.0, 1.0])
        where = frozen(position)
        return Body(
            name, f"{name}_joint", "revolute", parent, np.eye(3), where, axis, joint,
            inertia=mass, known=True,
        )  # fmt: skip

    bodies = (
        bar("crank", -1, (0.0, 0.0, 0.0), 0),
        bar("coupler", 0, (0.4, 0.0, 0.0), 1),
        bar("rocker", -1, (0.7, 0.0, 0.0), 2),
    )
    loop = LoopClosure("pin", (1, 2), np.array([[0.5, 0.0, 0.0], [0.45, 0.0, 0.0]]))
    limits = Limits(0.7, 1.5, 2.0)
    return Robot(
        "four_bar",
        bodies,
        (Coordinate("crank_joint", "revolute", limits),),
        gravity=(0.0, -9.81, 0.0),
        passive=(Coordinate("coupler_joint", "revolute"), Coordinate("rocker_joint", "revolute")),
        loops=(loop,),
        assembly=[1.2, -1.2, 1.2],
    )


@pytest.fixture(scope="session")
def leg() -> Robot:
    """Two skew joints, quick to simulate."""
    rng = np.random.default_rng(8)
    limits = Limits(-1.5, 1.5, 3.0)
    bodies = tuple(
        Body(
            name, f"{name}_joint", "revolute", k - 1, np.eye(3), np.array([0.3 * k, 0.0, 0.0]),
            frozen(axis), k, inertia=inertia(rng, 3.0 - k), known=True,
        )
        for k, (name, axis) in enumerate((("thigh", [0.0, 1.0, 0.0]), ("shank", [0.0, 0.6, 0.8])))
    )  # fmt: skip
    joints = tuple(Coordinate(body.joint, "revolute", limits) for body in bodies)
    return Robot("leg", bodies, joints)
