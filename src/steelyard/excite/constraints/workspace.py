"""Spheres on frames of the robot that stay inside a box, and out of boxes of the cell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.bounding import Stretches
from steelyard.excite.constraints.constraint import Margins
from steelyard.excite.constraints.markers import (
    MARKER_ROOM,
    Marker,
    SphereDistances,
    paths,
    points_of,
)
from steelyard.robot.robot import Robot

_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class HalfSpaces(SphereDistances):
    r"""Spheres that stay on one side of planes, $n \cdot p - \rho \ge d$.

    Attributes:
        normals: Unit vectors into the allowed side, shape `(k, 3)`.
        levels: Least value of $n \cdot p$, radius included, shape `(k,)` [m].
    """

    normals: Array
    levels: Array

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Distances from the planes at states of shape `(N, n)`."""
        positions, slopes = self.points(q)
        chosen = list(self.which)
        values = (positions[:, chosen] * self.normals).sum(axis=2) - self.levels
        by_q = (self.normals[:, None, :] @ slopes[:, chosen])[:, :, 0]
        return Margins(values, by_q=by_q)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = paths(self.points, stretches)
        values, lower = np.empty((2, len(self.which), len(stretches.middle)))
        for k, (point, normal) in enumerate(zip(self.which, self.normals, strict=True)):
            values[k], lower[k] = path.along(point, normal)[:, 0] - self.levels[k]
        return values, lower


def tool_box(
    robot: Robot,
    markers: Sequence[Marker],
    lower: Sequence[float | None],
    upper: Sequence[float | None],
    name: str = "tool box",
) -> HalfSpaces:
    """Spheres that stay inside a box along the base frame's axes.

    Args:
        robot: The robot.
        markers: The spheres.
        lower: Least x, y and z [m]; `None` where it is open.
        upper: Greatest, likewise.
        name: For certificates and messages.

    Raises:
        ModelError: The box is empty or open everywhere, or a frame does not exist.
    """
    sides = []
    for axis, low, high in zip(range(3), lower, upper, strict=True):
        if low is not None and high is not None and not low < high:
            raise ModelError(
                f"the box is empty along {_AXES[axis]}: from {low:g} to {high:g} m",
                where=name,
                fix="give a lower bound below the upper one",
            )
        normal = np.eye(3)[axis]
        if low is not None:
            sides.append((normal, low, f"{_AXES[axis]} of {{}} above {low:g} m"))
        if high is not None:
            sides.append((-normal, -high, f"{_AXES[axis]} of {{}} below {high:g} m"))
    if not sides:
        raise ModelError(
            "the box is open on all sides",
            where=name,
            fix="give at least one bound, or leave the box out",
        )
    return _half_spaces(robot, markers, sides, name)


def planes(
    robot: Robot,
    markers: Sequence[Marker],
    normals: ArrayLike,
    levels: ArrayLike,
    name: str = "planes",
) -> HalfSpaces:
    r"""Spheres that stay on one side of planes, $n \cdot p \ge d$.

    Args:
        robot: The robot.
        markers: The spheres.
        normals: $n$, into the allowed side, of any length, shape `(s, 3)`.
        levels: $d$ for the unit vector, the distance of the plane from the base, shape `(s,)` [m].
        name: For certificates and messages.

    Raises:
        ModelError: A normal has no direction, or a frame does not exist.
    """
    vectors = frozen(normals, (None, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    if not len(vectors) or not np.all(lengths > 1e-9):
        raise ModelError(
            "a plane has no direction" if len(vectors) else "there are no planes",
            where=name,
            fix="give every plane a normal that is not zero, such as [0, 0, 1]",
        )
    sides = [
        (n / size, float(d), f"{{}} above plane {number}")
        for number, (n, size, d) in enumerate(
            zip(vectors, lengths, frozen(levels, (len(vectors),)), strict=True), start=1
        )
    ]
    return _half_spaces(robot, markers, sides, name)


def _half_spaces(
    robot: Robot,
    markers: Sequence[Marker],
    sides: Sequence[tuple[Array, float, str]],
    name: str,
) -> HalfSpaces:
    """Every sphere on every side: normal, level and label."""
    every = [(k, m, *side) for k, m in enumerate(markers) for side in sides]
    return HalfSpaces(
        name,
        labels=tuple(label.format(marker.title) for _, marker, _, _, label in every),
        activation_distance=np.full(len(every), MARKER_ROOM),
        points=points_of(robot, markers, name),
        which=tuple(k for k, *_ in every),
        normals=np.array([normal for _, _, normal, _, _ in every]),
        levels=np.array([level + marker.radius for _, marker, _, level, _ in every]),
    )


@dataclass(frozen=True, eq=False)
class KeepOut(SphereDistances):
    """Spheres that stay out of boxes; distances are to the nearest face, edge or corner.

    Attributes:
        radii: Per margin the radius of its sphere, shape `(k,)` [m].
        centres: Of the boxes, shape `(k, 3)` [m].
        halves: Half their edges, shape `(k, 3)` [m].
    """

    radii: Array
    centres: Array
    halves: Array

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Distances from the boxes at states of shape `(N, n)`."""
        positions, slopes = self.points(q)
        chosen = list(self.which)
        apart = positions[:, chosen] - self.centres
        beyond = np.abs(apart) - self.halves
        values = box_distance(beyond) - self.radii
        direction = _steepest(beyond) * np.where(apart < 0.0, -1.0, 1.0)
        by_q = (direction[:, :, None, :] @ slopes[:, chosen])[:, :, 0]
        return Margins(values, by_q=by_q)

    def _bound(self, stretches: Stretches) -> tuple[Array, Array]:
        path = paths(self.points, stretches)
        values, lower = np.empty((2, len(self.which), len(stretches.middle)))
        for k, point in enumerate(self.which):
            place = np.stack([path.along(point, axis) for axis in np.eye(3)], axis=-1)
            values[k], lower[k] = (self._least(k, bounds) for bounds in place)
        return values, lower

    def _least(self, k: int, bounds: Array) -> Array:
        """Least distance while each coordinate is within bounds, `(2, B, 3)`: shape `(B,)`."""
        above, below = bounds[0] - self.centres[k], self.centres[k] - bounds[1]
        distance = box_distance(np.maximum(above, below) - self.halves[k])
        return np.asarray(distance - self.radii[k])


def keep_out(
    robot: Robot,
    markers: Sequence[Marker],
    lower: ArrayLike,
    upper: ArrayLike,
    name: str = "forbidden boxes",
) -> KeepOut:
    """Spheres that stay out of boxes along the base frame's axes.

    Args:
        robot: The robot.
        markers: The spheres.
        lower: Least x, y and z of every box, shape `(b, 3)` [m].
        upper: Greatest, likewise.
        name: For certificates and messages.

    Raises:
        ModelError: A box is empty, or a frame does not exist.
    """
    low, high = checked_boxes(lower, upper, name)
    every = [(k, m, b) for k, m in enumerate(markers) for b in range(len(low))]
    boxes = [b for _, _, b in every]
    return KeepOut(
        name,
        labels=tuple(f"{m.title} out of box {b + 1}" for _, m, b in every),
        activation_distance=np.full(len(every), MARKER_ROOM),
        points=points_of(robot, markers, name),
        which=tuple(k for k, _, _ in every),
        radii=np.array([m.radius for _, m, _ in every]),
        centres=(0.5 * (low + high))[boxes],
        halves=(0.5 * (high - low))[boxes],
    )


def checked_boxes(lower: ArrayLike, upper: ArrayLike, name: str) -> tuple[Array, Array]:
    """Corners of boxes, shape `(b, 3)` each [m].

    Raises:
        ModelError: There is none, or one is empty.
    """
    low = frozen(lower, (None, 3))
    high = frozen(upper, low.shape)
    if not len(low) or not np.all(low < high):
        raise ModelError(
            f"box {int(np.argmin((low < high).all(axis=1))) + 1} is empty"
            if len(low)
            else "there are no boxes",
            where=name,
            fix="give every box a lower corner below its upper one in x, y and z",
        )
    return low, high


def box_distance(beyond: Array) -> Array:
    """Signed distance from a box, from how far each coordinate is beyond its faces, `(..., 3)`."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))


def _steepest(beyond: Array) -> Array:
    """Derivative of `box_distance`, shape `(..., 3)`; at an edge inside that of one face."""
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1, keepdims=True)
    inside = np.eye(3)[beyond.argmax(axis=-1)]
    return np.where(length > 0.0, outside / np.where(length > 0.0, length, 1.0), inside)
