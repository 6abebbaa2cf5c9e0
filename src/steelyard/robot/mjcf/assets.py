"""MJCF files compiled by MuJoCo, whether or not the meshes and images that they name are there."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import ModelError
from steelyard.robot.xml_reader import read_xml

_POINTER = b"version https://git-lfs"


@dataclass(frozen=True, eq=False)
class Compiled:
    """MuJoCo's model of a file.

    Attributes:
        model: The compiled model (`mujoco.MjModel`).
        stand_ins: Geoms whose mesh is absent, by number, and its name: small spheres stand there.
        without_inertia: Bodies whose inertia is computed from an absent mesh, by number, and its
            name: their inertia in `model` means nothing.
    """

    model: Any
    stand_ins: Mapping[int, str] = field(default_factory=dict)
    without_inertia: Mapping[int, str] = field(default_factory=dict)


def compiled(path: Path) -> Compiled:
    """MuJoCo's model of an MJCF, absent meshes, height fields and images replaced.

    The inertia of every other body is the one that MuJoCo computes with all files there.

    Raises:
        ModelError: MuJoCo cannot compile the file for another reason.
    """
    import mujoco

    _refuse_circle(path, (), set())
    try:
        return Compiled(mujoco.MjModel.from_xml_path(str(path)))
    except (ValueError, mujoco.FatalError) as error:
        first = error
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError):
        raise _refused(path, first) from None
    absent = _absent_meshes(spec, path.parent)
    replaced = _without_pictures(spec, path.parent)
    if not absent and not replaced:
        raise _refused(path, first)
    stand_ins, bodies = _stand_in(spec, absent)
    if bodies and spec.compiler.settotalmass > 0.0:
        raise ModelError(
            f"the masses are scaled to a total (settotalmass), and body '{bodies[0][0].name}' has "
            f"no <inertial>, while its mesh '{bodies[0][1]}' is absent",
            where=str(path),
            fix="put the mesh where the MJCF looks for it (see its meshdir)",
        )
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise _refused(path, error) from None
    return Compiled(
        model,
        {int(geom.id): mesh for geom, mesh in stand_ins},
        {int(body.id): mesh for body, mesh in bodies},
    )


def _refuse_circle(path: Path, above: tuple[Path, ...], fine: set[Path]) -> None:
    """Raise if a file attaches itself, or one that does: MuJoCo recurses until the process dies.

    Files that are absent, or no XML, are left to MuJoCo.

    Args:
        path: The file.
        above: The files that it is in.
        fine: Files that need no second look; those found here are added.
    """
    resolved = Path(os.path.realpath(path))
    if resolved in above:
        raise ModelError(
            "the file includes itself, or attaches itself as a model",
            where=str(above[-1]),
            fix=f"remove the element that names '{path.name}'",
        )
    if resolved in fine:
        return
    try:
        elements = list(read_xml(path).walk())
    except ModelError:
        return
    folders = {"", *(e.attributes["assetdir"] for e in elements if "assetdir" in e.attributes)}
    for element in elements:
        if element.tag in ("model", "include") and "file" in element.attributes:
            for folder in sorted(folders):
                inside = path.parent / folder / element.attributes["file"]
                _refuse_circle(inside, (*above, resolved), fine)
    fine.add(resolved)


def _refused(path: Path, error: Exception) -> ModelError:
    text = " ".join(str(error).split())
    return ModelError(
        f"MuJoCo cannot compile the file: {text}",
        where=str(path),
        fix="put the missing file where the MJCF looks for it"
        if "opening file" in text
        else "correct the MJCF there until `python -m mujoco.viewer --mjcf=FILE` shows it; a part "
        "that other files include cannot be read alone: give the file that includes it",
    )


def _there(file: str, folder: Path, below: str, strip: bool) -> bool:
    """Whether a file that the MJCF names is there, and not a pointer of git-lfs to it."""
    name = Path(file.replace("\\", "/"))
    names = [name, Path(name.name)] if strip else [name]
    for place in (base / one for base in (folder / below, folder) for one in names):
        if os.path.isfile(place):
            with place.open("rb") as content:
                return content.read(len(_POINTER)) != _POINTER
    return False


def _absent_meshes(spec: Any, folder: Path) -> dict[str, str]:
    """Meshes whose files are absent: name to file. They are removed."""
    absent = {}
    for mesh in list(spec.meshes):
        if mesh.file and not _there(mesh.file, folder, spec.meshdir, spec.strippath):
            absent[mesh.name or Path(mesh.file).stem] = mesh.file
            spec.delete(mesh)
    return absent


def _without_pictures(spec: Any, folder: Path) -> bool:
    """Replace absent textures and height fields, remove absent skins; whether any was absent."""
    import mujoco

    replaced = False
    for texture in spec.textures:
        files = [f for f in (texture.file, *texture.cubefiles) if f]
        if not all(_there(f, folder, spec.texturedir, spec.strippath) for f in files):
            texture.file, texture.cubefiles = "", [""] * 6
            texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
            texture.width, texture.height, replaced = 1, 1, True
    for field_ in spec.hfields:
        if field_.file and not _there(field_.file, folder, spec.meshdir, spec.strippath):
            field_.file, field_.nrow, field_.ncol, replaced = "", 2, 2, True
            field_.userdata = np.zeros(4)
    for skin in list(spec.skins):
        if skin.file and not _there(skin.file, folder, spec.meshdir, spec.strippath):
            spec.delete(skin)
            replaced = True
    return replaced


def _stand_in(
    spec: Any, absent: Mapping[str, str]
) -> tuple[list[tuple[Any, str]], list[tuple[Any, str]]]:
    """Put spheres for the geoms of absent meshes.

    Returns:
        The geoms, and the bodies whose inertia needs them, each with the mesh's name.
    """
    import mujoco

    geoms, bodies = [], []
    for body in spec.bodies:
        needed = False
        for geom in body.geoms:
            if (mesh := geom.meshname) not in absent:
                continue
            geoms.append((geom, mesh))
            if not needed and _counts(spec, body, geom):
                bodies.append((body, mesh))
                needed = True
            geom.type, geom.size, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, (0.01, 0, 0), ""
            geom.mass = 1.0 if needed else 0.0
    return geoms, bodies


def _counts(spec: Any, body: Any, geom: Any) -> bool:
    """Whether a body's inertia is computed from a geom of it."""
    import mujoco

    kind, (first, last) = spec.compiler.inertiafromgeom, spec.compiler.inertiagrouprange
    always = kind == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    never = kind == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    if body.name == "world" or never or (body.explicitinertial and not always):
        return False
    weightless = geom.density == 0.0 if np.isnan(geom.mass) else geom.mass == 0.0
    return first <= geom.group <= last and not weightless
