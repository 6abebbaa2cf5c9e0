"""Corners of meshes from STL and OBJ files, found from where a model names them."""

import struct
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError

READABLE = (".stl", ".obj")
"""Endings of meshes that can be read."""

_HEAD, _FACET = 84, 50


def find_mesh(name: str, model: Path) -> Path | None:
    """The file that a model means by a mesh's name, or none.

    A name is absolute, relative to the model's folder, or `package://PACKAGE/...`. A package is
    looked for by its name in the model's folder and in every folder above it. Where that finds
    nothing, leading parts of the path are left out, one after the other, but for the file's own
    folder.

    Args:
        name: As the model writes it.
        model: The model's path.
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
    """All corners of a mesh's faces, shape `(V, 3)`, each once.

    Args:
        path: An STL or OBJ file.
        where: What names it, for messages.

    Raises:
        ModelError: The file is of another kind, or not what its ending says.
    """
    if path.suffix.lower() not in READABLE:
        raise _refused(
            f"the mesh '{path}' is of an unsupported format ('{path.suffix}')",
            where,
            f"convert it to .stl or .obj and name that file, or {WITHOUT}",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _refused(
            f"the mesh '{path}' cannot be read: {error.strerror}", where, "check its permissions"
        ) from None
    try:
        points = _stl(data) if path.suffix.lower() == ".stl" else _obj(data)
    except (ValueError, IndexError) as error:
        points = np.empty((0, 3))
        what: object = error
    else:
        what = "it has no vertices" if not len(points) else "a vertex is not finite"
    if not len(points) or not np.isfinite(points).all():
        raise _refused(
            f"the mesh '{path}' is not an {path.suffix[1:].upper()} file: {what}",
            where,
            f"export it anew from a program that opens it, or {WITHOUT}",
        )
    return np.unique(points, axis=0)


WITHOUT = "name the link under `without` to ignore its shapes"
"""The other way out of a mesh that cannot be used."""


def _refused(wrong: str, where: str, fix: str) -> ModelError:
    return ModelError(wrong, where=where, fix=fix)


def _stl(data: bytes) -> Array:
    """Corners of a binary or written STL."""
    if len(data) >= _HEAD:
        count = struct.unpack("<I", data[_HEAD - 4 : _HEAD])[0]
        if len(data) == _HEAD + _FACET * count:
            facets = np.frombuffer(data[_HEAD:], dtype=np.uint8).reshape(count, _FACET)
            corners = np.ascontiguousarray(facets[:, 12:48]).view("<f4")
            return corners.reshape(-1, 3).astype(np.float64)
    if not data.lstrip().startswith(b"solid"):
        raise ValueError("its length does not fit its number of facets")
    return _numbers(data, b"vertex")


def _obj(data: bytes) -> Array:
    """Corners of an OBJ."""
    return _numbers(data, b"v")


def _numbers(data: bytes, word: bytes) -> Array:
    """Three numbers after a word at the start of lines."""
    lines = (line.split() for line in data.splitlines())
    rows = [[float(w) for w in words[1:4]] for words in lines if words and words[0] == word]
    if any(len(row) != 3 for row in rows):
        raise ValueError("a vertex does not have three numbers")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
