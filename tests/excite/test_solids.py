"""Convex solids: none reaches farther than its farthest point."""

import numpy as np
import pytest

from steelyard.excite.collision.solids_and_shapes import (
    FLAT_HULL_THICKNESS,
    Ball,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Solid,
    height,
)

CORNERS = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.2], [0.05, 0.05, 0.05]])
SOLIDS: list[Solid] = [
    Ball(0.3),
    Box((0.2, 0.4, 0.6)),
    Ellipsoid((0.1, 0.2, 0.3)),
    Cylinder(0.1, 0.5),
    Capsule(0.1, 0.5),
    Hull(CORNERS),
]


def inside(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Whether points are in a solid, by its definition."""
    x, y, z = points.T
    if isinstance(solid, Ball):
        return np.linalg.norm(points, axis=1) <= solid.radius
    if isinstance(solid, Box):
        return np.all(np.abs(points) <= np.array(solid.size) / 2.0, axis=1)
    if isinstance(solid, Ellipsoid):
        return np.sum((points / solid.semi) ** 2, axis=1) <= 1.0
    if isinstance(solid, Cylinder):
        return (np.hypot(x, y) <= solid.disc) & (np.abs(z) <= solid.length / 2.0)
    if isinstance(solid, Capsule):
        beyond = np.maximum(np.abs(z) - solid.length / 2.0, 0.0)
        return np.hypot(np.hypot(x, y), beyond) <= solid.disc
    return np.all(points >= 0.0, axis=1) & (points @ (1 / 0.4, 1 / 0.3, 1 / 0.2) <= 1.0)


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda s: type(s).__name__)
def test_the_farthest_point_is_of_the_solid_and_none_is_farther(solid: Solid) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.6, 0.6, (20_000, 3))
    points = points[inside(solid, points)]
    directions = rng.normal(size=(50, 3))
    far = solid.farthest(directions)
    reach = height(solid, directions)
    middle = points.mean(axis=0)
    assert inside(solid, middle + (far - middle) * (1.0 - 1e-9)).all()
    assert np.all(points @ directions.T <= reach + 1e-12)
    assert np.all(np.linalg.norm(far - solid.centre, axis=1) <= solid.radius * (1.0 + 1e-12))


def test_a_hull_without_volume_is_thickened() -> None:
    plate = Hull([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    up = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(height(plate, up), [FLAT_HULL_THICKNESS, 1.0 + FLAT_HULL_THICKNESS])
    assert height(Hull([[0, 0, 0.5]]), up)[0] == pytest.approx(0.5 + FLAT_HULL_THICKNESS)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Ball(0.0),
        lambda: Box((1.0, -1.0, 1.0)),
        lambda: Box((1.0,)),
        lambda: Box((1.0, 1.0)),
        lambda: Cylinder(np.inf, 1.0),
        lambda: Ellipsoid((1.0, 1.0)),  # type: ignore[arg-type]
        lambda: Hull(np.empty((0, 3))),
        lambda: Hull([[np.nan, 0, 0]]),
        lambda: Hull([[1e12, 0, 0]]),
        lambda: Hull(1e160 * CORNERS),
        lambda: HalfSpace().farthest(np.array([[0.0, 0.0, -1.0]])),
    ],
)
def test_what_is_no_solid_is_refused(wrong: object) -> None:
    with pytest.raises(ValueError), np.errstate(over="ignore"):
        wrong()  # type: ignore[operator]
