r"""Rigid bodies: their ten inertial numbers in every form, and placements of frames.

The canonical form is ten numbers in Pinocchio's order
`m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`: mass, first moment $h = m c$ and the inertia
about the **link frame's origin**. The pseudo-inertia is the symmetric 4 x 4 matrix
$J = \begin{bmatrix} \Sigma & h \ h^T & m \end{bmatrix}$ with
$\Sigma = \tfrac12 \mathrm{tr}(I)\,1 - I$; a body can exist if and only if $J \succeq 0$
[Wensing2018].
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields

INERTIAL_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_UNITS = ("kg", "kg m", "kg m", "kg m", *("kg m²",) * 6)
LEAST_INERTIA = 1e-12
"""What files give a body without mass, in kg and kg m²: simulators refuse moving bodies without."""
_LOWER = np.tril_indices(3)  # order of the six numbers
_PLACES = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])  # place of every entry among them


def skew(v: ArrayLike) -> Array:
    """The matrix of the cross product: `skew(v) @ x == cross(v, x)`."""
    x, y, z = np.asarray(v, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def symmetric(six: ArrayLike) -> Array:
    """The symmetric 3 x 3 matrix of `(xx, xy, yy, xz, yz, zz)`."""
    return np.take(np.asarray(six, dtype=np.float64), _PLACES)


def six_numbers(matrix: ArrayLike) -> Array:
    """`(xx, xy, yy, xz, yz, zz)` of a symmetric 3 x 3 matrix."""
    return np.asarray(np.asarray(matrix, dtype=np.float64)[_LOWER[::-1]])


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass [kg] of one rigid body, and its first moment `(3,)` [kg m] and inertia `(3, 3)` [kg m²].

    Both about the origin of its link frame; the first moment is mass times centre of mass.
    """

    mass: float
    first_moment: Array
    inertia_origin: Array

    def __init__(self, mass: float, first_moment: ArrayLike, inertia_origin: ArrayLike) -> None:
        moment, inertia = frozen(first_moment, (3,)), frozen(inertia_origin, (3, 3))
        set_fields(self, mass=float(mass), first_moment=moment, inertia_origin=inertia)

    @classmethod
    def zero(cls) -> "Inertia":
        """No mass at all."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def from_ten(cls, ten: ArrayLike) -> "Inertia":
        """From the ten numbers in Pinocchio's order."""
        ten = frozen(ten, (10,))
        return cls(ten[0], ten[1:4], symmetric(ten[4:]))

    @classmethod
    def about_com(cls, mass: float, com: ArrayLike, inertia_com: ArrayLike) -> "Inertia":
        """From the centre of mass `(3,)` [m] and the inertia about it, link axes [kg m²]."""
        c = skew(com)
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused later
            return cls(mass, mass * np.asarray(com), np.asarray(inertia_com) - mass * c @ c)

    @classmethod
    def from_pseudo(cls, pseudo: ArrayLike) -> "Inertia":
        """From the 4 x 4 pseudo-inertia."""
        pseudo = frozen(pseudo, (4, 4))
        sigma = pseudo[:3, :3]
        return cls(pseudo[3, 3], pseudo[:3, 3], np.trace(sigma) * np.eye(3) - sigma)

    @property
    def ten(self) -> Array:
        """The ten numbers in Pinocchio's order, shape `(10,)`."""
        return frozen([self.mass, *self.first_moment, *six_numbers(self.inertia_origin)])

    @property
    def com(self) -> Array:
        """Centre of mass, shape `(3,)` [m]; the origin for a massless body."""
        return self.first_moment / self.mass if self.mass else np.zeros(3)

    @property
    def inertia_com(self) -> Array:
        """Inertia about the centre of mass, link axes, shape `(3, 3)` [kg m²]."""
        c = skew(self.com)
        return self.inertia_origin + self.mass * c @ c

    @property
    def pseudo(self) -> Array:
        """The pseudo-inertia, shape `(4, 4)`."""
        pseudo = np.empty((4, 4))
        pseudo[:3, :3] = 0.5 * np.trace(self.inertia_origin) * np.eye(3) - self.inertia_origin
        pseudo[:3, 3] = pseudo[3, :3] = self.first_moment
        pseudo[3, 3] = self.mass
        return pseudo

    def moved(self, rotation: ArrayLike, position: ArrayLike) -> "Inertia":
        """The same body in a frame that sees this link frame with a rotation and position [m]."""
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = rotation, position
        with np.errstate(over="ignore", invalid="ignore"):  # likewise
            return Inertia.from_pseudo(placement @ self.pseudo @ placement.T)

    def __add__(self, other: "Inertia") -> "Inertia":
        """Two bodies rigidly joined; both in the same frame."""
        return Inertia(
            self.mass + other.mass,
            self.first_moment + other.first_moment,
            self.inertia_origin + other.inertia_origin,
        )

    @property
    def rounding(self) -> float:
        """What rounding may leave of principal moments about the centre of mass [kg m²]."""
        return 1e-15 * float(np.abs(self.inertia_origin).max())

    def flaw(self, tolerance: float = 1e-9) -> str | None:
        """Why no body can have these numbers; the tolerance is relative to the largest moment."""
        if not np.isfinite(self.ten).all():
            return "a value is not finite"
        if self.mass < 0.0:
            return f"the mass is negative ({self.mass:.4g} kg)"
        if self.mass == 0.0 and np.any(self.first_moment):
            return "the mass is zero but the first moment is not"
        moments = np.linalg.eigvalsh(self.inertia_com)
        slack = tolerance * max(float(np.abs(moments).max()), 1e-300) + self.rounding
        if moments[0] < -slack:
            return f"a principal moment of inertia is negative ({moments[0]:.4g} kg m²)"
        if moments[0] + moments[1] < moments[2] - slack:
            return (
                "the principal moments break the triangle inequality "
                f"({moments[0]:.4g} + {moments[1]:.4g} < {moments[2]:.4g} kg m²)"
            )
        return None


DIRT = 2e-5  # entries of a rotation or an axis below this are zero: `1.5708` for pi/2 leaves 4e-6

ROUNDING = 1e-12
"""The same where model files are taken at their word: rounding errors of products alone."""


def turn(axis: ArrayLike, angle: float) -> Array:
    """Rotation by `angle` [rad] about the unit vector `axis`, shape `(3, 3)`."""
    k = skew(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k)


def rpy_rotation(roll: float, pitch: float, yaw: float) -> Array:
    r"""$R_z(\text{yaw})\,R_y(\text{pitch})\,R_x(\text{roll})$, angles in rad, shape `(3, 3)`."""
    x, y, z = np.eye(3)
    return turn(z, yaw) @ turn(y, pitch) @ turn(x, roll)


def rpy_of(rotation: Array) -> Array:
    r"""Angles of $R_z(y) R_y(p) R_x(r)$, in the order `r, p, y`, shape `(3,)` [rad].

    The yaw is taken off first, so that the others are exact where yaw and roll turn alike.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    rest = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), pitch, yaw])


def clean_rotation(rotation: ArrayLike, dirt: float = DIRT) -> Array:
    r"""The rotation with entries below `dirt` set to zero, orthonormal to rounding.

    Rounded angles in model files would otherwise leave tiny entries that make dependent parameters
    look independent. Two steps of $R \leftarrow \tfrac12 R\,(3 - R^T R)$ keep exact zeros.
    """
    matrix = np.array(rotation, dtype=np.float64)
    matrix[np.abs(matrix) < dirt] = 0.0
    for _ in range(2):
        matrix = 0.5 * matrix @ (3.0 * np.eye(3) - matrix.T @ matrix)
    ones = np.abs(np.abs(matrix) - 1.0) < 1e-12
    matrix[ones] = np.sign(matrix[ones])
    return matrix + 0.0


def clean_axis(axis: ArrayLike, dirt: float = DIRT) -> Array:
    """The unit vector along `axis`, small entries zero; `ValueError` if it has no direction."""
    vector = np.array(axis, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if not 1e-9 < length < np.inf:
        raise ValueError("the axis has no direction")
    vector /= length
    vector[np.abs(vector) < dirt] = 0.0
    return np.asarray(vector / np.linalg.norm(vector) + 0.0)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame is in another: a point `p` is at `rotation @ p + position` there [m].

    The rotation is cleaned by `clean_rotation`, which takes entries below `dirt` for zero, here and
    in products; entries of the position below a nanometre are zero.
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
        point = frozen(position, (3,))
        point = frozen(np.where(np.abs(point) < 1e-9, 0.0, point))
        set_fields(self, rotation=frozen(clean_rotation(matrix, dirt)), position=point, dirt=dirt)

    def __matmul__(self, other: "Placement") -> "Placement":
        """A frame placed in this frame, seen from where this frame is placed."""
        with np.errstate(over="ignore", invalid="ignore"):  # likewise
            position = self.position + self.rotation @ other.position
        return Placement(self.rotation @ other.rotation, position, max(self.dirt, other.dirt))
