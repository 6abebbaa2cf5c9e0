import numpy as np
import pytest
from pydantic import ValidationError

from oracles import body_positions, pinocchio_torque
from steelyard.robot.file.sections import DHRow, DHSection
from steelyard.robot.inertia_and_placement import turn
from steelyard.robot.models.denavit_hartenberg import DHConvention, dh_mechanism
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import reduced

ROWS = (
    DHRow(
        a=0.1,
        alpha=0.4,
        d=0.3,
        theta=0.2,
        mass=2.0,
        com=(0.1, 0.2, -0.1),
        inertia_com=(0.1, 0, 0.2, 0, 0, 0.2),
    ),
    DHRow(
        a=0.5, alpha=-np.pi / 2, d=0.05, theta=-0.6, kind="prismatic", mass=1.0, com=(0.0, 0.1, 0.3)
    ),
    DHRow(a=0.2, alpha=np.pi / 2, d=-0.1, theta=np.pi / 2, mass=0.5, com=(0.3, 0.0, 0.1)),
)


def screw(a: float, alpha: float, d: float, theta: float, convention: str) -> np.ndarray:
    """The textbooks' closed forms of one row."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    if convention == "standard":  # Spong, eq. 3.10
        rows = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d]]
    else:  # Craig, eq. 3.6
        rows = [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -sa * d], [st * sa, ct * sa, ca, ca * d]]
    return np.array([*rows, [0, 0, 0, 1]])


def dh_frames(q: np.ndarray, convention: str) -> list[np.ndarray]:
    """DH frames 1, 2, ... in the base."""
    frames = [np.eye(4)]
    for row, x in zip(ROWS, q, strict=True):
        slides = row.kind == "prismatic"
        d, theta = row.d + x * slides, row.theta + x * (not slides)
        frames.append(frames[-1] @ screw(row.a, row.alpha, d, theta, convention))
    return frames[1:]


def body_frames(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """The bodies' frames in the base, by the definition of `Body`."""
    frames: list[np.ndarray] = []
    for body, x in zip(robot.bodies, body_positions(robot, q), strict=True):
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = body.rotation, body.position
        moved = np.eye(4)
        if body.kind == "prismatic":
            moved[:3, 3] = body.axis * x
        else:
            moved[:3, :3] = turn(body.axis, x)
        frames.append((frames[body.parent] if body.parent >= 0 else np.eye(4)) @ own @ moved)
    return frames


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_centres_of_mass_are_where_the_table_puts_them(convention: DHConvention) -> None:
    robot, _ = reduced(dh_mechanism(ROWS, convention))
    q = np.array([0.3, 0.7, -1.1])
    for row, dh, own, body in zip(
        ROWS, dh_frames(q, convention), body_frames(robot, q), robot.bodies, strict=True
    ):
        assert np.allclose((own @ [*body.inertia.com, 1.0]), dh @ [*row.com, 1.0])
        given = np.zeros((3, 3))
        given[np.triu_indices(3)] = np.array(row.inertia_com)[[0, 1, 3, 2, 4, 5]]
        given = given + np.triu(given, 1).T
        in_base = dh[:3, :3] @ given @ dh[:3, :3].T
        assert np.allclose(own[:3, :3] @ body.inertia.inertia_com @ own[:3, :3].T, in_base)


def test_the_frame_of_the_ten_numbers() -> None:
    """Modified: DH frame i. Standard: on the joint's axis, x axis of DH frame i."""
    q = np.array([0.3, 0.7, -1.1])
    modified, _ = reduced(dh_mechanism(ROWS, "modified"))
    for own, dh in zip(body_frames(modified, q), dh_frames(q, "modified"), strict=True):
        assert np.allclose(own, dh)
    standard, _ = reduced(dh_mechanism(ROWS, "standard"))
    for row, own, dh in zip(ROWS, body_frames(standard, q), dh_frames(q, "standard"), strict=True):
        assert np.allclose(own[:3, 0], dh[:3, 0])
        assert np.allclose(own[:3, 3] + row.a * own[:3, 0], dh[:3, 3])


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_holding_torque_is_the_gradient_of_the_potential(convention: DHConvention) -> None:
    robot, _ = reduced(dh_mechanism(ROWS, convention), gravity=[1.0, 2.0, -9.0])
    q, still = np.array([0.3, 0.7, -1.1]), np.zeros(3)

    def potential(at: np.ndarray) -> float:
        frames = dh_frames(at, convention)
        centres = [f @ [*row.com, 1.0] for row, f in zip(ROWS, frames, strict=True)]
        return -sum(r.mass * c[:3] @ robot.gravity for r, c in zip(ROWS, centres, strict=True))

    step = 1e-5 * np.eye(3)
    expected = [(potential(q + h) - potential(q - h)) / 2e-5 for h in step]
    assert np.allclose(pinocchio_torque(robot, q, still, still), expected, atol=1e-7)


def test_names_and_unknown_masses() -> None:
    robot, notes = reduced(dh_mechanism([DHRow(joint="waist"), DHRow(a=1.0)], name="arm"))
    assert robot.joint_names == ("waist", "joint_2") and robot.name == "arm"
    assert not robot.bodies[0].known and "link_1, link_2" in notes[0]


def test_an_empty_table_is_an_error() -> None:
    with pytest.raises(ValidationError, match="at least 1 item"):
        DHSection.model_validate({"convention": "standard", "links": []})
