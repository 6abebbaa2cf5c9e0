"""Mesh files that models name: where they are, and the corners of STL and OBJ files."""

import struct
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError

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
        raise _refused_mesh(
            f"the mesh '{path}' is of an unsupported format ('{path.suffix}')",
            where,
            f"convert it to .stl or .obj and name that file, or {WITHOUT_MESH_ADVICE}",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _refused_mesh(
            f"the mesh '{path}' cannot be read: {error.strerror}", where, "check its permissions"
        ) from None
    try:
        points = _stl(data) if path.suffix.lower() == ".stl" else _numbers_of_obj(data, b"v")
        what = "a vertex is not finite" if len(points) else "it has no vertices"
    except (ValueError, IndexError) as error:
        points, what = np.empty((0, 3)), str(error)
    if not len(points) or not np.isfinite(points).all():
        raise _refused_mesh(
            f"the mesh '{path}' is not an {path.suffix[1:].upper()} file: {what}",
            where,
            f"export it anew from a program that opens it, or {WITHOUT_MESH_ADVICE}",
        )
    return np.unique(points, axis=0)


WITHOUT_MESH_ADVICE = "name the link under `without` to ignore its shapes"


def _refused_mesh(wrong: str, where: str, fix: str) -> ModelError:
    return ModelError(wrong, where=where, fix=fix)


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
