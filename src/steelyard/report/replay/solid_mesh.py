"""Convex solids as triangles, for pictures."""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.excitation.shapes.solids import Ellipsoid, HalfSpace, Hull, Solid

Faces = NDArray[np.uint32]

AROUND = 32
"""Corners around a round solid."""

WIDE = 3.0
"""Edge of the square that stands for a half-space [m]."""


def mesh_of(solid: Solid) -> tuple[Array, Faces]:
    """Corners `(V, 3)` [m] and triangles `(F, 3)`, counted so that their normals point outwards.

    A round solid becomes the hull of its farthest points in many directions.
    """
    if isinstance(solid, HalfSpace):
        x = 0.5 * WIDE
        square = np.array([[-x, -x, 0.0], [x, -x, 0.0], [x, x, 0.0], [-x, x, 0.0]])
        return square, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    if isinstance(solid, Hull):
        points = solid.vertices
    elif isinstance(solid, Ellipsoid):
        points = np.array(solid.semi) * _directions()
    else:
        points = solid.farthest(_directions())
    return _hull(np.unique(np.round(points, 9), axis=0))


def _directions() -> Array:
    """Unit vectors on circles of latitude, poles included, shape `(N, 3)`."""
    turn = 2.0 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, AROUND // 2)
    up, around = (x.ravel() for x in np.meshgrid(rise, turn))
    across = np.cos(up)
    return np.column_stack([across * np.cos(around), across * np.sin(around), np.sin(up)])


def _hull(points: Array) -> tuple[Array, Faces]:
    """The hull of points that are not all in a plane."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    used, faces = np.unique(found.simplices, return_inverse=True)
    faces = faces.reshape(found.simplices.shape)
    corners = points[used]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return corners, faces.astype(np.uint32)
