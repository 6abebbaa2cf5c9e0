"""Distances of shapes at many samples: bounds for all of them, exact where it matters."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.excitation.shapes.poses import Poses, ShapeKinematics
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.shapes.solids import HalfSpace, height
from steelyard.robot.robot import Robot

Indices = NDArray[np.intp]

ROUNDING = 1e-9
"""What rounding may add to a bound that comes from the heights of two solids [m]."""


class Solver(Protocol):
    """What measures distances of solids; see `mujoco_geometry.Distances`."""

    def between(
        self, pairs: Indices, samples: Indices, at: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Signed distances `(H,)` and nearest points `(H, 2, 3)` of pairs at samples."""
        ...


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes on a robot and around it, and the pairs of them that matter.

    Attributes:
        shapes: `G` shapes.
        ways: Numbers of the two shapes of each pair, shape `(W, 2)`; of a pair with a half-space
            that is the second.
        kinematics: Where the shapes are.
    """

    shapes: tuple[Shape, ...]
    ways: Indices
    kinematics: ShapeKinematics = field(init=False)
    _solver: Solver = field(init=False)
    _flat: NDArray[np.bool_] = field(init=False)

    def __init__(
        self, robot: Robot, shapes: Sequence[Shape], ways: Sequence[tuple[int, int]]
    ) -> None:
        from steelyard.excitation.shapes.mujoco_geometry import Distances

        flat = [isinstance(shape.solid, HalfSpace) for shape in shapes]
        ordered = [(j, i) if flat[i] else (i, j) for i, j in ways]
        object.__setattr__(self, "shapes", tuple(shapes))
        object.__setattr__(self, "ways", np.array(ordered, dtype=np.intp).reshape(-1, 2))
        object.__setattr__(self, "kinematics", ShapeKinematics(robot, shapes))
        object.__setattr__(self, "_solver", Distances(tuple(s.solid for s in shapes)))
        object.__setattr__(self, "_flat", np.array(flat)[self.ways[:, 1]])

    def balls(self, poses: Poses) -> Array:
        """Lower bounds of all ways' distances from balls around the shapes, shape `(N, W)` [m]."""
        radius = np.array([shape.solid.radius for shape in self.shapes])
        first, second = self.ways.T
        apart = poses.centres[:, second] - poses.centres[:, first]
        with np.errstate(invalid="ignore"):
            gaps = np.sqrt(np.einsum("nwi,nwi->nw", apart, apart)) - radius[first] - radius[second]
        flat = self._flat
        normal = poses.rotations[:, second[flat]][..., 2]
        above = poses.centres[:, first[flat]] - poses.origins[:, second[flat]]
        gaps[:, flat] = np.einsum("nwi,nwi->nw", normal, above) - radius[first[flat]]
        return np.asarray(gaps - ROUNDING)

    def along(self, poses: Poses, ways: Indices, samples: Indices, normals: Array) -> Array:
        """Lower bounds of distances from the shapes' heights along a direction.

        Args:
            poses: Poses at `N` samples.
            ways: `H` numbers of ways.
            samples: `H` numbers of samples.
            normals: Unit vectors from the first shape to the second, shape `(H, 3)`; of a
                half-space its own is taken.

        Returns:
            Shape `(H,)` [m]; exact if the direction is that of the nearest points.
        """
        both = self.ways[ways].T
        own = -poses.rotations[samples, both[1], :, 2]
        normal = np.where(self._flat[ways][:, None], own, normals)
        apart = poses.origins[samples, both[1]] - poses.origins[samples, both[0]]
        bounds = np.einsum("hi,hi->h", normal, apart)
        for numbers, outwards in zip(both, (normal, -normal), strict=True):
            seen = np.einsum("hij,hi->hj", poses.rotations[samples, numbers], outwards)
            for number in np.unique(numbers):
                at = np.flatnonzero(numbers == number)
                bounds[at] -= height(self.shapes[number].solid, seen[at])
        return np.asarray(bounds - ROUNDING)

    def centre_lines(self, poses: Poses, ways: Indices, samples: Indices) -> Array:
        """Directions from centre to centre, shape `(H, 3)`."""
        first, second = self.ways[ways].T
        return directions(poses.centres[samples, second] - poses.centres[samples, first])

    def exact(self, poses: Poses, ways: Indices, samples: Indices) -> tuple[Array, Array, Array]:
        """Distances, nearest points and their direction.

        Args:
            poses: Poses at `N` samples.
            ways: `H` numbers of ways.
            samples: `H` numbers of samples, ascending.

        Returns:
            Signed distances, shape `(H,)` [m]; nearest points, shape `(H, 2, 3)`; unit vectors
            in which the distance grows as the second shape moves, shape `(H, 3)`, zero where the
            shapes touch in just a point.
        """
        distances, points = np.empty(len(ways)), np.empty((len(ways), 2, 3))
        flat = self._flat[ways]
        solid = np.flatnonzero(~flat)
        at = (poses.rotations, poses.origins)
        distances[solid], points[solid] = self._solver.between(
            self.ways[ways[solid]], samples[solid], at
        )
        for way in np.unique(ways[flat]):
            k = np.flatnonzero(ways == way)
            distances[k], points[k] = self._over_plane(poses, int(way), samples[k])
        normals = directions(points[:, 1] - points[:, 0])
        return distances, points, normals * np.where(distances < 0.0, -1.0, 1.0)[:, None]

    def _over_plane(self, poses: Poses, way: int, samples: Indices) -> tuple[Array, Array]:
        """Distances `(H,)` and nearest points `(H, 2, 3)` of a solid and a half-space."""
        first, second = self.ways[way]
        turn, normal = poses.rotations[samples, first], poses.rotations[samples, second][:, :, 2]
        solid = self.shapes[first].solid
        low = solid.farthest(-np.einsum("hij,hi->hj", turn, normal))
        low = poses.origins[samples, first] + np.einsum("hij,hj->hi", turn, low)
        above = np.einsum("hi,hi->h", normal, low - poses.origins[samples, second])
        return above, np.stack([low, low - above[:, None] * normal], axis=1)


def directions(vectors: Array) -> Array:
    """Vectors of length one, shape `(H, 3)`; those too short to have a direction become zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), 0.0)
