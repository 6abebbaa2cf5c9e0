"""Tool boxes, planes and forbidden boxes: margins by Pinocchio, proofs by dense sampling."""

import numpy as np
import pinocchio as pin
import pytest

from exact_motions import MAKERS
from invented import dh_arm, measured, tree
from oracles import pinocchio_model
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.constraint_and_limits import Constraint
from steelyard.excite.constraints.tool_workspace import (
    MARKER_TOLERANCE,
    Marker,
    box_distance,
    keep_out,
    planes,
    tool_box,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.robot.robot import Frame, Robot

OFFSET = (0.02, -0.03, 0.1)


def centre(robot: Robot, body: int, q: Array) -> Array:
    """Where Pinocchio has the offset point of a body, shape `(3,)`."""
    model = pinocchio_model(robot)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.asarray(data.oMi[body + 1].act(np.array(OFFSET)))


def constraints(robot: Robot, marker: Marker | None = None) -> list[Constraint]:
    """One of each kind, by default on the last body."""
    sphere = marker or Marker(robot.bodies[-1].name, OFFSET, 0.07)
    return [
        tool_box(robot, sphere, (-0.3, None, 0.1), (0.4, 0.5, None)),
        planes(robot, sphere, [[1.0, 2.0, -2.0], [0.0, 0.0, 3.0]], [-1.2, 0.15]),
        keep_out(
            robot, sphere, [[0.2, 0.1, -0.5], [-1.0, -1.0, -1.0]], [[0.5, 0.4, 0.6], [0.0] * 3]
        ),
    ]


def test_margins_are_distances_from_the_walls() -> None:
    robot = tree()
    box, walls, boxes = constraints(robot)
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (40, 4))
    points = np.array([centre(robot, 3, row) for row in q])
    x, y, z = points.T
    expected = np.stack([x + 0.3, 0.4 - x, 0.5 - y, z - 0.1], axis=1) - 0.07
    np.testing.assert_allclose(box.margins(q, q, q).values[:, :4], expected, atol=1e-12)
    expected = np.stack([(x + 2 * y - 2 * z) / 3.0 + 0.4, z - 0.05], axis=1) - 0.07
    np.testing.assert_allclose(walls.margins(q, q, q).values[:, :2], expected, atol=1e-12)
    inner = np.random.default_rng(1).uniform(-1.0, 0.0, (30000, 3))
    inner[np.arange(30000), np.arange(30000) % 3] = np.repeat([-1.0, 0.0], 15000)
    found = boxes.margins(q, q, q).values[:, 1] + 0.07
    for point, distance in zip(points, found, strict=True):
        nearest = np.linalg.norm(inner - point, axis=1).min()
        sign = -1.0 if np.all((point > -1.0) & (point < 0.0)) else 1.0
        assert sign * nearest == pytest.approx(distance, abs=0.02)


def test_labels_say_what_every_margin_is() -> None:
    box, walls, boxes = constraints(tree())
    ball = "'tip' + (0.02, -0.03, 0.1) (ball of radius 70 mm)"
    assert box.labels == (
        f"x of {ball} above -0.3 m",
        f"x of {ball} below 0.4 m",
        f"y of {ball} below 0.5 m",
        f"z of {ball} above 0.1 m",
    )
    assert box.unit == "m"
    box, walls, boxes = constraints(tree(), Marker("slider"))
    assert box.labels[0] == "x of 'slider' above -0.3 m"
    assert walls.labels[1] == "'slider' above plane 2"
    assert boxes.labels[1] == "'slider' out of box 2"
    for constraint in (box, walls, boxes):
        assert constraint.scope == "tool point only"
        assert len(constraint.labels) == len(constraint.activation_distance)


@pytest.mark.parametrize("kind", range(3))
def test_derivatives_are_central_differences(kind: int) -> None:
    constraint = constraints(tree())[kind]
    q, h = np.random.default_rng(3).uniform(-1.0, 1.0, (30, 4)), 1e-6
    by_q = constraint.margins(q, q, q).by_q
    for j in range(4):
        step = h * np.eye(4)[j]
        later, earlier = (constraint.margins(q + s, q, q).values for s in (step, -step))
        np.testing.assert_allclose(by_q[:, :, j], (later - earlier) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
@pytest.mark.parametrize("kind", range(3))
def test_proofs_hold_and_are_near(make, kind: int) -> None:
    motion = make(np.random.default_rng(11))
    constraint = constraints(dh_arm())[kind]
    proven = constraint.proven(motion)
    t = np.linspace(0.0, motion.duration, 100_000)
    sampled = constraint.margins(motion.derivative(t, 0), t, t).values.min(axis=0)
    assert np.all(proven <= sampled)
    assert np.all(sampled - proven <= 1.2 * MARKER_TOLERANCE)


def test_panda_in_its_box() -> None:
    robot = measured("panda")
    rng = np.random.default_rng(0)
    start = [0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.0]
    motion = FourierMotion.from_free(start, 0.3 * rng.standard_normal((7, 8)), 10.0)
    box = tool_box(robot, Marker("panda_link8"), (-0.75, -0.75, 0.1), (0.75, 0.75, 1.2))
    proven = box.proven(motion)
    t = np.linspace(0.0, 10.0, 100_000)
    sampled = box.margins(motion.derivative(t, 0), t, t).values.min(axis=0)
    assert np.all(proven <= sampled) and np.all(sampled - proven < MARKER_TOLERANCE)
    assert proven.min() < 0.0, "this motion leaves its box, and the proof must say so"


def test_distance_from_a_box() -> None:
    beyond = np.array([[-1.0, -0.2, -0.4], [3.0, -1.0, 4.0], [0.0, -1.0, -1.0]])
    np.testing.assert_allclose(box_distance(beyond), [-0.2, 5.0, 0.0])


@pytest.mark.parametrize(
    ("make", "wrong", "fix"),
    [
        (lambda r, m: tool_box(r, m, (0, 0, 1), (1, 1, 1)), "empty along z: from 1 to 1", "below"),
        (lambda r, m: tool_box(r, Marker("tipp"), [0] * 3, [1] * 3), "frame 'tipp'", "'tip'"),
        (lambda r, m: planes(r, m, [[0, 0, 0]], [1]), "no direction", "normal"),
        (
            lambda r, m: keep_out(r, m, [[0] * 3] * 2, [[1] * 3, [1, 0, 1]]),
            "box 2 is empty",
            "corner",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, wrong: str, fix: str) -> None:
    robot = tree()
    with pytest.raises(ModelError, match=wrong) as caught:
        make(robot, Marker("tip"))
    assert fix in caught.value.fix


def test_a_frame_of_the_base_is_refused() -> None:
    robot = tree()
    fixed = robot.changed(frames=(Frame("plate", -1, np.eye(3), np.zeros(3)),))
    with pytest.raises(ModelError, match="'plate' is fixed to the base") as caught:
        tool_box(fixed, Marker("plate"), [0] * 3, [1] * 3)
    assert "'tip'" in caught.value.fix
