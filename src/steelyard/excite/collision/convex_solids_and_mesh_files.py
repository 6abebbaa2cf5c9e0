r"""Convex solids by their farthest point in any direction, and corners of meshes in STL and OBJ.

With the height $h(d) = \max_{x} d \cdot x$ of a solid in a direction, the signed distance of two
solids is $\max_{|d| = 1} -h_B(-d) - h_A(d)$: any direction gives a lower bound, the right one the
distance itself, or less the depth of an overlap.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError

FLAT_HULL_THICKNESS = 1e-4  # what a mesh without volume is thickened by to each side [m]


class Solid:
    """A convex solid in a frame of its own.

    The `radius` [m] is that of a ball around it, infinite for a half-space, and `centre`, shape
    `(3,)` [m], the middle of that ball: the origin, if not stated.
    """

    centre: Array = frozen(np.zeros(3))
    radius: float

    def farthest(self, directions: Array) -> Array:
        """A point of the solid that is farthest along each direction, both of shape `(N, 3)`."""
        raise NotImplementedError

    def _around(self, radius: float, *sizes: float) -> None:
        """Keep the radius, if all sizes are those of a solid."""
        if not all(0.0 < size < np.inf for size in sizes):
            kind = {"Ball": "sphere"}.get(type(self).__name__, type(self).__name__.lower())
            shown = ", ".join(f"{size:g}" for size in sizes)
            raise ValueError(f"a {kind} of {shown} m is not a solid")
        object.__setattr__(self, "radius", radius)


def height(solid: Solid, directions: Array) -> Array:
    """How far a solid reaches along directions `(N, 3)`, shape `(N,)`."""
    return np.asarray(np.einsum("ij,ij->i", solid.farthest(directions), directions))


@dataclass(frozen=True)
class Ball(Solid):
    """A sphere of a radius [m]."""

    radius: float

    def __post_init__(self) -> None:
        self._around(self.radius, self.radius)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self.radius * _unit(directions)


@dataclass(frozen=True)
class Box(Solid):
    """A box along the axes, by the full lengths of its edges [m]."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        x, y, z = self.size
        self._around(0.5 * float(np.linalg.norm(self.size)), x, y, z)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return np.copysign(np.array(self.size) / 2.0, directions)


@dataclass(frozen=True)
class Ellipsoid(Solid):
    """An ellipsoid along the axes, by its three semi-axes [m]."""

    semi: tuple[float, float, float]

    def __post_init__(self) -> None:
        x, y, z = self.semi
        self._around(max(self.semi), x, y, z)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        semi = np.array(self.semi)
        return semi * _unit(directions * semi)


@dataclass(frozen=True)
class _Round(Solid):
    """What turns about z with a radius `disc` [m]; the `length` along z [m] is without caps."""

    disc: float
    length: float

    def _end(self, directions: Array) -> Array:
        """The end of the axis that is farther along each direction."""
        return np.asarray(np.copysign([0.0, 0.0, self.length / 2.0], directions))


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder about z with flat ends."""

    def __post_init__(self) -> None:
        self._around(float(np.hypot(self.disc, self.length / 2.0)), self.disc, self.length)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self._end(directions) + self.disc * _unit(directions * (1.0, 1.0, 0.0))


@dataclass(frozen=True)
class Capsule(_Round):
    """All points near a piece of the z axis."""

    def __post_init__(self) -> None:
        self._around(self.disc + self.length / 2.0, self.disc, self.length)

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return self._end(directions) + self.disc * _unit(directions)


@dataclass(frozen=True, eq=False)
class Hull(Solid):
    """The convex hull of points; `vertices` are its corners, shape `(V, 3)` [m]."""

    vertices: Array

    def __init__(self, points: ArrayLike) -> None:
        object.__setattr__(self, "vertices", frozen(_corners(frozen(points, (None, 3)))))
        object.__setattr__(self, "centre", frozen(_ball(self.vertices)))
        self._around(float(np.linalg.norm(self.vertices - self.centre, axis=1).max()))

    def farthest(self, directions: Array) -> Array:
        """See `Solid`."""
        return np.asarray(self.vertices[np.argmax(directions @ self.vertices.T, axis=1)])


@dataclass(frozen=True)
class HalfSpace(Solid):
    """All points below the plane z = 0."""

    radius = np.inf

    def farthest(self, directions: Array) -> Array:
        """The origin: only the direction of z has a farthest point, and no other is requested."""
        if not np.allclose(directions, (0.0, 0.0, 1.0), atol=1e-6):
            raise ValueError("a half-space has no end but along z")
        return np.zeros_like(directions)


def _unit(vectors: Array) -> Array:
    """Vectors of length one; a zero vector becomes the x axis, which is as good as any."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, vectors, (1.0, 0.0, 0.0)) / np.where(length > 0.0, length, 1.0)


def _corners(points: Array) -> Array:
    """The points that span their hull; a flat set is thickened by `FLAT_HULL_THICKNESS`."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 1 or not np.isfinite(points).all():
        raise ValueError("the points of a hull are none, or not finite")
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        signs: Sequence[float] = (-FLAT_HULL_THICKNESS, FLAT_HULL_THICKNESS)
        cube = np.array([(x, y, z) for x in signs for y in signs for z in signs])
        thick = (points[:, None] + cube).reshape(-1, 3)
        return np.asarray(thick[ConvexHull(thick).vertices])


def _ball(points: Array, rounds: int = 200) -> Array:
    """Centre of a nearly smallest ball around points, shape `(3,)` [BadoiuClarkson2003]."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for step in range(2, rounds):
        far = points[np.argmax(np.linalg.norm(points - centre, axis=1))]
        centre = centre + (far - centre) / step
    return np.asarray(centre)


READABLE_MESHES = (".stl", ".obj")  # endings of meshes that can be read

_STL_HEAD_BYTES, _STL_FACET_BYTES = 84, 50


def find_mesh(name: str, model: Path) -> Path | None:
    """The file that a model means by a mesh's name, or none.

    A name is absolute, relative to the model's folder, or `package://PACKAGE/...`. A package is
    looked for by its name in the model's folder and in those above it, then with leading parts of
    the path left out, but for the file's own folder.
    """
    url = urlsplit(name)
    folder = model.resolve().parent
    if url.scheme == "file":
        path = Path(unquote(url.path))
        return path if path.is_file() else None
    if url.scheme not in ("package", "model"):
        path = folder / name
        return path if path.is_file() else None
    parts = [part for part in name.split("://", 1)[1].split("/") if part]
    for first in range(max(len(parts) - 1, 1)):
        for above in (folder, *folder.parents):
            path = above.joinpath(*parts[first:])
            if path.is_file():
                return path
    return None


def mesh_points(path: Path, where: str) -> Array:
    """All corners of the faces of an STL or OBJ file, shape `(V, 3)`, each once."""
    if path.suffix.lower() not in READABLE_MESHES:
        raise ModelError(
            f"the mesh '{path}' is of an unsupported format ('{path.suffix}')",
            where=where,
            fix=f"convert it to .stl or .obj and name that file, or {WITHOUT_MESH_ADVICE}",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        wrong = f"the mesh '{path}' cannot be read: {error.strerror}"
        raise ModelError(wrong, where=where, fix="check its permissions") from None
    try:
        points = _stl(data) if path.suffix.lower() == ".stl" else _numbers_of_obj(data, b"v")
        what = "a vertex is not finite" if len(points) else "it has no vertices"
    except (ValueError, IndexError) as error:
        points, what = np.empty((0, 3)), str(error)
    if not len(points) or not np.isfinite(points).all():
        raise ModelError(
            f"the mesh '{path}' is not an {path.suffix[1:].upper()} file: {what}",
            where=where,
            fix=f"export it anew from a program that opens it, or {WITHOUT_MESH_ADVICE}",
        )
    return np.unique(points, axis=0)


WITHOUT_MESH_ADVICE = "name the link under `without` to ignore its shapes"


def _stl(data: bytes) -> Array:
    if len(data) >= _STL_HEAD_BYTES:
        count = struct.unpack("<I", data[_STL_HEAD_BYTES - 4 : _STL_HEAD_BYTES])[0]
        if len(data) == _STL_HEAD_BYTES + _STL_FACET_BYTES * count:
            facets = np.frombuffer(data[_STL_HEAD_BYTES:], dtype=np.uint8).reshape(
                count, _STL_FACET_BYTES
            )
            corners = np.ascontiguousarray(facets[:, 12:48]).view("<f4")
            return corners.reshape(-1, 3).astype(np.float64)
    if not data.lstrip().startswith(b"solid"):
        raise ValueError("its length does not fit its number of facets")
    return _numbers_of_obj(data, b"vertex")


def _numbers_of_obj(data: bytes, word: bytes) -> Array:
    """Three numbers after a word at the start of lines."""
    lines = (line.split() for line in data.splitlines())
    rows = [[float(w) for w in words[1:4]] for words in lines if words and words[0] == word]
    if any(len(row) != 3 for row in rows):
        raise ValueError("a vertex does not have three numbers")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
