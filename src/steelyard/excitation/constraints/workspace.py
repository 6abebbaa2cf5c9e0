"""Spheres on frames of the robot that stay inside a box, or on one side of planes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.excitation.constraints.bounding import Stretches
from steelyard.excitation.constraints.constraint import Margins
from steelyard.excitation.constraints.markers import (
    ROOM,
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
        activation_distance=np.full(len(every), ROOM),
        points=points_of(robot, markers, name),
        which=tuple(k for k, *_ in every),
        normals=np.array([normal for _, _, normal, _, _ in every]),
        levels=np.array([level + marker.radius for _, marker, _, level, _ in every]),
    )
