"""Where bodies and their shapes are, for many samples at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, frozen
from steelyard.excitation.shapes.shapes import Shape
from steelyard.robot.robot import Robot
from steelyard.robot.skeleton import bodies_along


@dataclass(frozen=True, eq=False)
class Poses:
    """All shapes and all joints' axes at `N` samples, in the base frame.

    Attributes:
        rotations: Axes of the solids, shape `(N, G, 3, 3)`.
        origins: Origins of the solids, shape `(N, G, 3)` [m].
        centres: Centres of the balls around them, shape `(N, G, 3)` [m].
        axes: Axes of the bodies' joints, shape `(N, B, 3)`.
        anchors: A point on each of these axes, shape `(N, B, 3)` [m].
    """

    rotations: Array
    origins: Array
    centres: Array
    axes: Array
    anchors: Array


@dataclass(frozen=True, eq=False)
class ShapeKinematics:
    """Forward kinematics of a robot's bodies and what is fixed to them.

    Attributes:
        robot: A tree without loops.
        carriers: Body of each shape, plus one; 0 is the base. Shape `(G,)`.
        rotations: Axes of each solid in its body's frame, shape `(G, 3, 3)`.
        positions: Origins there, shape `(G, 3)` [m].
        centres: Centres of the balls around the solids there, shape `(G, 3)` [m].
    """

    robot: Robot
    carriers: NDArray[np.intp] = field(init=False)
    rotations: Array = field(init=False)
    positions: Array = field(init=False)
    centres: Array = field(init=False)

    def __init__(self, robot: Robot, shapes: Sequence[Shape]) -> None:
        object.__setattr__(self, "robot", robot)
        carriers = np.array([shape.body + 1 for shape in shapes], dtype=np.intp)
        object.__setattr__(self, "carriers", carriers)
        object.__setattr__(self, "rotations", frozen(np.array([s.rotation for s in shapes])))
        object.__setattr__(self, "positions", frozen(np.array([s.position for s in shapes])))
        centres = [s.position + s.rotation @ s.solid.centre for s in shapes]
        object.__setattr__(self, "centres", frozen(np.array(centres)))

    def __call__(self, q: Array) -> Poses:
        """Poses at positions of the joints, shape `(N, n)`."""
        rotation, origin = bodies_along(self.robot, q)
        axes = [(r @ b.axis) for r, b in zip(rotation[1:], self.robot.bodies, strict=True)]
        count, shapes = len(q), len(self.carriers)
        frames = np.empty((count, shapes, 3, 3))
        places = np.empty((2, count, shapes, 3))
        for carrier, which, own in self._carried:
            # one product per body: a stack of small ones would take several times as long
            turned = (rotation[carrier].reshape(-1, 3) @ own).reshape(count, 3, -1, 5)
            frames[:, which] = turned[..., :3].transpose(0, 2, 1, 3)
            places[:, :, which] = turned[..., 3:].transpose(3, 0, 2, 1)
            places[:, :, which] += origin[carrier][:, None]
        origins, centres = places
        return Poses(frames, origins, centres, np.stack(axes, axis=1), np.stack(origin[1:], axis=1))

    @cached_property
    def _carried(self) -> list[tuple[int, NDArray[np.intp], Array]]:
        """Per body that has shapes their numbers, and rotations, origins, centres side by side."""
        found = []
        for carrier in np.unique(self.carriers):
            which = np.flatnonzero(self.carriers == carrier)
            at = np.stack([self.positions[which], self.centres[which]], axis=2)
            own = np.concatenate([self.rotations[which], at], axis=2)
            found.append((int(carrier), which, own.transpose(1, 0, 2).reshape(3, -1)))
        return found
