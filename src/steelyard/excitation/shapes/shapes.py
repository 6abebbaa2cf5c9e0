"""Collision shapes of robots, tools and cells, each fixed to a body."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.excitation.shapes.solids import HalfSpace, Solid
from steelyard.robot.robot import Frame

Origin = Literal["link", "tool", "world"]
"""Whose a shape is: a link's of the model, a tool's or a payload's, or the cell's."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid on a body.

    Attributes:
        name: The link, tool or obstacle that it is a part of.
        body: Index of the body that carries it; -1 is the base, and the world.
        rotation: Shape `(3, 3)`, axes of the solid in the body's frame.
        position: Shape `(3,)` [m], origin of the solid in the body's frame.
        solid: What it is.
        origin: Whose it is.
    """

    name: str
    body: int
    rotation: Array
    position: Array
    solid: Solid
    origin: Origin = "link"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3)))
        object.__setattr__(self, "position", frozen(self.position, (3,)))


@dataclass(frozen=True, eq=False)
class Geometry:
    """The shapes of a robot.

    Attributes:
        shapes: In the order of the model file.
        parents: The link that carries a link, for all links but the root.
        never: Pairs of links that the model itself lets pass through each other.
        skipped: Links whose shapes are left out.
        notes: What the user should know, one sentence each.
    """

    shapes: tuple[Shape, ...]
    parents: Mapping[str, str] = field(default_factory=dict)
    never: frozenset[frozenset[str]] = frozenset()
    skipped: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "parents", MappingProxyType(dict(self.parents)))


def obstacle(
    name: str,
    solid: Solid,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
) -> Shape:
    """A thing that stands still in the cell, placed in the robot's base frame."""
    base = Frame(name, -1, np.eye(3), np.zeros(3))
    return placed(base, name, solid, position, rotation, "world")


def wall(name: str, normal: ArrayLike, offset: float) -> Shape:
    """A plane that nothing may go behind: kept is `normal @ p >= offset` in the base frame.

    Args:
        name: What it is called.
        normal: Shape `(3,)`, of any length but zero.
        offset: [m] for a normal of length one.

    Raises:
        ModelError: The normal has no direction.
    """
    vector = frozen(normal, (3,))
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise ModelError(
            f"the normal of the plane '{name}' has no direction",
            where=f"plane '{name}'",
            fix="give the direction of the free side, such as 0, 0, 1 for a floor",
        )
    z = vector / length
    side = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(side, z) / np.linalg.norm(np.cross(side, z))
    rotation = np.column_stack([x, np.cross(z, x), z])
    return obstacle(name, HalfSpace(), z * offset / length, rotation)


def placed(
    frame: Frame,
    name: str,
    solid: Solid,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
    origin: Origin = "link",
) -> Shape:
    """A solid that is placed in a frame, as a shape on the frame's body."""
    turned = np.eye(3) if rotation is None else frozen(rotation, (3, 3))
    if not np.allclose(turned @ turned.T, np.eye(3), atol=1e-6):
        raise ValueError(f"the rotation of '{name}' is not a rotation")
    at = frame.position + frame.rotation @ frozen(position, (3,))
    return Shape(name, frame.body, frame.rotation @ turned, at, solid, origin)
