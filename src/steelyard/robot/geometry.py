"""Placements of frames, kept free of rounding dirt."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.robot.inertia import skew

DIRT = 2e-5
"""Entries of a rotation or an axis below this are zero: `1.5708` for pi/2 leaves 4e-6."""

ROUNDING = 1e-12
"""The same where model files are taken at their word: rounding errors of products alone."""


def turn(axis: ArrayLike, angle: float) -> Array:
    """Rotation by `angle` [rad] about the unit vector `axis`, shape `(3, 3)`."""
    k = skew(axis)
    matrix: Array = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return matrix


def rpy_rotation(roll: float, pitch: float, yaw: float) -> Array:
    r"""$R_z(\text{yaw})\,R_y(\text{pitch})\,R_x(\text{roll})$, angles in rad, shape `(3, 3)`."""
    x, y, z = np.eye(3)
    return turn(z, yaw) @ turn(y, pitch) @ turn(x, roll)


def clean_rotation(rotation: ArrayLike, dirt: float = DIRT) -> Array:
    r"""The rotation with entries below `dirt` set to zero, orthonormal to rounding.

    Rounded angles in model files would otherwise leave tiny entries that make dependent
    parameters look independent. Two steps of $R \leftarrow \tfrac12 R\,(3 - R^T R)$ restore
    orthonormality without touching exact zeros.
    """
    matrix = np.array(rotation, dtype=np.float64)
    matrix[np.abs(matrix) < dirt] = 0.0
    for _ in range(2):
        matrix = 0.5 * matrix @ (3.0 * np.eye(3) - matrix.T @ matrix)
    ones = np.abs(np.abs(matrix) - 1.0) < 1e-12
    matrix[ones] = np.sign(matrix[ones])
    return matrix + 0.0


def clean_axis(axis: ArrayLike, dirt: float = DIRT) -> Array:
    """The unit vector along `axis`, its entries below `dirt` set to zero.

    Raises:
        ValueError: The axis has no direction.
    """
    vector = np.array(axis, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if not 1e-9 < length < np.inf:
        raise ValueError("the axis has no direction")
    vector /= length
    vector[np.abs(vector) < dirt] = 0.0
    unit: Array = vector / np.linalg.norm(vector) + 0.0
    return unit


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame is in another: a point `p` is at `rotation @ p + position` there.

    Attributes:
        rotation: Shape `(3, 3)`, cleaned by `clean_rotation`.
        position: Shape `(3,)` [m], entries below a nanometre set to zero.
        dirt: What `clean_rotation` takes for zero, here and in products with this placement.
    """

    rotation: Array
    position: Array
    dirt: float

    def __init__(
        self,
        rotation: ArrayLike | None = None,
        position: ArrayLike = (0.0, 0.0, 0.0),
        dirt: float = ROUNDING,
    ) -> None:
        matrix = np.eye(3) if rotation is None else frozen(rotation, (3, 3))
        object.__setattr__(self, "rotation", frozen(clean_rotation(matrix, dirt)))
        object.__setattr__(self, "dirt", dirt)
        point = frozen(position, (3,))
        object.__setattr__(self, "position", frozen(np.where(np.abs(point) < 1e-9, 0.0, point)))

    def __matmul__(self, other: "Placement") -> "Placement":
        """A frame placed in this frame, seen from where this frame is placed."""
        return Placement(
            self.rotation @ other.rotation,
            self.position + self.rotation @ other.position,
            max(self.dirt, other.dirt),
        )
