"""MJCF files, compiled by MuJoCo, also where the meshes and images that they name are absent."""

import math
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.robot.inertia_and_placement import Inertia, Placement, turn
from steelyard.robot.mechanism import Joint, Link, Mechanism, MechanismJointKind, Mimic
from steelyard.robot.models import mjcf_equalities_and_forces as parts
from steelyard.robot.models.mjcf_equalities_and_forces import WORLD, name_of
from steelyard.robot.models.xml_and_urdf import Element, read_root, read_xml, refuse_device
from steelyard.robot.robot import Limits

_POINTER = b"version https://git-lfs"
_FOLDERS = ("assetdir", "meshdir", "texturedir")
_REPEATING = ("replicate", "composite", "flexcomp")  # elements whose counts multiply
_LARGE = re.compile(r"(?<![\d.])[1-9]\d{5}|[\d.][eE]\+?[1-9]|\d[KMGTPE]\b")
"""Numbers of six digits and more."""
_GRIDS = ("hfield", "texture")  # elements of rows and columns, whose numbers multiply
_LARGE_SIDE = re.compile(r"(?<![\d.])[1-9]\d{4}")  # numbers of five digits and more
_ABSURD = {tag: re.compile(r"(?<![\d.])\d{8,}(?![\d.])") for tag in _REPEATING}
_ABSURD["size"] = re.compile(r"^ *\d{10,} *$")
"""Counts that no model has, by element."""
MOST_SECONDS = 60  # time that a model with large counts may take to compile
MOST_CPU_SECONDS = 12  # the same of the processor, where the system can limit it
MOST_MEMORY = 4 << 30  # bytes of memory that it may take, where the system can limit it
_FAILURES = (ValueError, RuntimeError, mujoco.FatalError)  # where a file cannot be compiled
_COMPILE = """
import sys
sys.path[:] = filter(None, sys.path)  # no module of the folder that this is run in
try:
    import resource
except ImportError:
    limits = {}
else:
    limits = {resource.RLIMIT_AS: int(sys.argv[2]), resource.RLIMIT_CPU: int(sys.argv[3])}
for kind, most in limits.items():
    try:
        resource.setrlimit(kind, (most, most))
    except (OSError, ValueError):  # a stricter one is set already
        pass
import mujoco
try:
    mujoco.MjModel.from_xml_path(sys.argv[1])
except (ValueError, mujoco.FatalError):
    pass
"""


@dataclass(frozen=True, eq=False)
class Compiled:
    """MuJoCo's model of a file (`mujoco.MjModel`).

    `stand_ins` are geoms whose mesh is absent, by number, and its name: small spheres stand there.
    `without_inertia` are bodies whose inertia needs such a mesh, likewise: it means nothing in
    `model`.
    """

    model: Any
    stand_ins: Mapping[int, str] = field(default_factory=dict)
    without_inertia: Mapping[int, str] = field(default_factory=dict)


def compiled(path: Path) -> Compiled:
    """MuJoCo's model; what is absent is replaced, all other bodies' inertias are the same."""
    elements = _elements(path, (), set())
    for element in elements:
        for name, text in element.attributes.items():
            if name != "memory" and element.tag in _ABSURD and _ABSURD[element.tag].search(text):
                raise ModelError(
                    f"{name} of <{element.tag}> is {text[:30]}",
                    where=str(path),
                    fix="make the counts and sizes in the MJCF smaller",
                )
    values = ((e.tag, text) for e in elements for text in e.attributes.values())
    # a number may be a count that fills the memory
    if any(
        tag in _REPEATING or _LARGE.search(text) or (tag in _GRIDS and _LARGE_SIDE.search(text))
        for tag, text in values
    ):
        _refuse_endless(path)
    try:
        return Compiled(mujoco.MjModel.from_xml_path(str(path)))
    except _FAILURES as error:
        first = error
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except _FAILURES:
        raise _refused(path, first) from None
    absent = _absent_meshes(spec, path.parent)
    replaced = _without_pictures(spec, path.parent)
    if not absent and not replaced:
        raise _refused(path, first)
    stand_ins, bodies = _replace_absent_meshes(spec, absent)
    if bodies and spec.compiler.settotalmass > 0.0:
        raise ModelError(
            f"the masses are scaled to a total (settotalmass), and body '{bodies[0][0].name}' has "
            f"no <inertial>, while its mesh '{bodies[0][1]}' is absent",
            where=str(path),
            fix="put the mesh where the MJCF looks for it (see its meshdir)",
        )
    try:
        model = spec.compile()
    except _FAILURES as error:
        raise _refused(path, error) from None
    return Compiled(
        model,
        {int(geom.id): mesh for geom, mesh in stand_ins},
        {int(body.id): mesh for body, mesh in bodies},
    )


def _elements(path: Path, above: tuple[Path, ...], fine: set[Path]) -> list[Element]:
    """The elements of a file and of those that it includes.

    A file that attaches itself, or one that does, is refused: MuJoCo recurses until the process
    dies. So is a device or a pipe, which MuJoCo would read without end. Files that are absent, or
    no XML, are left to MuJoCo. `above` are the files that it is in, `fine` those that need no
    second look; those found here are added.
    """
    resolved = Path(os.path.realpath(path))
    if resolved in above:
        raise ModelError(
            "the file includes itself, or attaches itself as a model",
            where=str(above[-1]),
            fix=f"remove the element that names '{path.name}'",
        )
    if resolved in fine:
        return []
    refuse_device(path)
    try:
        elements = list(read_xml(path).walk())
    except ModelError:
        return []
    found = list(elements)
    folders = {""} | {e.attributes[k] for e in elements for k in _FOLDERS if k in e.attributes}
    for element in elements:
        for file in (element.attributes[k] for k in element.attributes if k.startswith("file")):
            for folder in sorted(folders):
                if element.tag in ("model", "include"):
                    found += _elements(path.parent / folder / file, (*above, resolved), fine)
                else:
                    refuse_device(path.parent / folder / file)
    fine.add(resolved)
    return found


def _refuse_endless(path: Path) -> None:
    """Compile a model in a process of its own first, and refuse one that is beyond its bounds."""
    limits = (str(MOST_MEMORY), str(MOST_CPU_SECONDS))
    command = [sys.executable, "-c", _COMPILE, str(path), *limits]
    try:
        failed = subprocess.run(command, capture_output=True, timeout=MOST_SECONDS).returncode
    except subprocess.TimeoutExpired:
        failed = 1
    if failed:
        raise ModelError(
            f"MuJoCo does not compile the file within {MOST_CPU_SECONDS} s of the processor, "
            f"{MOST_SECONDS} s in all and {MOST_MEMORY >> 30} GiB of memory",
            where=str(path),
            fix="make the counts and sizes in the MJCF smaller (replicate, size, hfield, texture)",
        )


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


def _replace_absent_meshes(
    spec: Any, absent: Mapping[str, str]
) -> tuple[list[tuple[Any, str]], list[tuple[Any, str]]]:
    """Put spheres for geoms of absent meshes; those, and bodies whose inertia needs them."""
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
    kind, (first, last) = spec.compiler.inertiafromgeom, spec.compiler.inertiagrouprange
    always = kind == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    never = kind == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    if body.name == "world" or never or (body.explicitinertial and not always):
        return False
    weightless = geom.density == 0.0 if np.isnan(geom.mass) else geom.mass == 0.0
    return first <= geom.group <= last and not weightless


def read_mjcf(path: Path) -> Mechanism:
    """The mechanism of an MJCF file.

    The world is the root link. A body with several joints becomes a chain with frames without
    mass between; a link's frame has the body's axes and its origin at the joint's anchor. Joint
    equalities of first order become mimics, `connect` becomes a pin, `ref` is kept (positions are
    MuJoCo's `qpos`). Limits of effort are those of the actuators. Armature, damping and friction
    are no part of the mechanism: they are identified. Springs are listed, and whatever else the
    mechanism is without (gravity that is switched off or compensated, tendons, fluids) is noted.

    Free and ball joints are kept as such, and equalities that are neither of these as couplings:
    a robot has neither. A body whose inertia is computed from a mesh that is absent has none.

    Raises:
        ModelError: MuJoCo cannot compile the file.
    """
    fix = "give an MJCF (<mujoco>), a URDF (<robot>) or a robot file (.toml)"
    root = read_root(path, "mujoco", "an MJCF", fix)
    given = compiled(path)
    if given.model.nbody == 1 and root.all("body"):
        raise ModelError(
            "its bodies stand outside <worldbody>: a part of a model, not a robot",
            where=str(path),
            fix="give the file that includes it, often in the same folder",
        )
    name = root.attributes.get("model") or path.stem
    actuators = parts.Actuators.of(given.model)
    return _Reading(path, given.model, given.without_inertia, actuators).mechanism(name)


@dataclass(frozen=True)
class _Reading:
    path: Path
    model: Any
    without_inertia: Mapping[int, str]
    actuators: parts.Actuators
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)

    def mechanism(self, name: str) -> Mechanism:
        self.links.append(Link(WORLD, None, str(self.path)))
        equalities = parts.Equalities(self.path, self.model)
        mimics = equalities.mimics()
        origins = {0: Placement()}
        for body in range(1, self.model.nbody):
            origins[body] = self._body(body, origins[int(self.model.body_parentid[body])], mimics)
        pins, (couplings, notes) = equalities.pins(origins), equalities.couplings()
        driven, pulled = self._driven()
        return Mechanism(
            name,
            self.links,
            self.joints,
            self.model.opt.gravity,
            str(self.path),
            pins=pins,
            driven=driven,
            pulled=pulled,
            rest=self._rest(equalities.offsets()) if pins or couplings else {},
            springs=parts.springs_of(self.model),
            statements=[*self.actuators.notes(), *parts.passive_notes(self.model)],
            couplings=couplings,
            notes=notes,
        )

    def _rest(self, offsets: Mapping[str, float]) -> dict[str, float]:
        """Reference positions of the joints of one degree of freedom, where equalities hold."""
        numbers = {name_of(self.model, "joint", k): k for k in range(self.model.njnt)}
        return {
            j.name: parts.reference(self.model, numbers[j.name]) + offsets.get(j.name, 0.0)
            for j in self.joints
            if j.movable
        }

    def _driven(self) -> tuple[list[str], list[str]]:
        """Joints with an actuator of their own, and those that tendons of actuators run over."""
        model, kinds = self.model, mujoco.mjtTrn
        own = np.isin(
            model.actuator_trntype, (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
        )
        through = model.actuator_trnid[model.actuator_trntype == int(kinds.mjTRN_TENDON), 0]
        wraps = [wrap for tendon in through for wrap in parts.wraps_of(model, int(tendon))]
        pulled = dict.fromkeys(k for kind, k, _ in wraps if kind == mujoco.mjtWrap.mjWRAP_JOINT)
        found = (model.actuator_trnid[own, 0].tolist(), pulled)
        driven, over = ([name_of(model, "joint", k) for k in joints] for joints in found)
        return driven, over

    def _body(self, body: int, parent_origin: Placement, mimics: dict[int, Mimic]) -> Placement:
        """Adds the body and its joints; returns the body's frame in its link's frame."""
        model = self.model
        name = name_of(model, "body", body)
        where = f"{self.path}, body '{name}'"
        parent_body = int(model.body_parentid[body])
        parent = name_of(self.model, "body", parent_body) if parent_body else WORLD
        start = parent_origin @ Placement(rotation_of(model.body_quat[body]), model.body_pos[body])
        joints = parts.joints_of(model, body)
        if not joints:
            self.joints.append(Joint(f"{name}_fixed", "fixed", parent, name, start, where=where))
            anchor = np.zeros(3)
        for joint in joints:
            anchor = frozen(model.jnt_pos[joint])
            last = joint == joints[-1]
            child = name if last else f"{name}/{name_of(model, 'joint', joint)}"
            placement = start @ Placement(position=anchor)
            self.joints.append(self._joint(joint, parent, child, placement, mimics))
            if not last:
                self.links.append(Link(child, Inertia.zero(), where, massless=True))
            parent, start = child, Placement(position=-anchor)
        origin = Placement(position=-anchor)
        lacks = self.without_inertia.get(body, "")
        inertia = None if lacks else self._inertia(body, origin)
        self.links.append(Link(name, inertia, where, lacks=lacks))
        return origin

    def _inertia(self, body: int, origin: Placement) -> Inertia | None:
        model = self.model
        mass = float(model.body_mass[body])
        if mass == 0.0 and not np.any(model.body_inertia[body]):
            return None
        principal = Inertia.about_com(mass, (0.0, 0.0, 0.0), np.diag(model.body_inertia[body]))
        in_body = principal.moved(rotation_of(model.body_iquat[body]), model.body_ipos[body])
        return in_body.moved(origin.rotation, origin.position)

    def _joint(
        self, joint: int, parent: str, child: str, placement: Placement, mimics: dict[int, Mimic]
    ) -> Joint:
        model = self.model
        name, kind = name_of(model, "joint", joint), mujoco.mjtJoint(int(model.jnt_type[joint]))
        where = f"{self.path}, joint '{name}'"
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            free: MechanismJointKind = "floating" if kind == mujoco.mjtJoint.mjJNT_FREE else "ball"
            return Joint(name, free, parent, child, placement, where=where)
        axis, ref = frozen(model.jnt_axis[joint]), parts.reference(model, joint)
        slide = kind == mujoco.mjtJoint.mjJNT_SLIDE
        at_zero = Placement(position=-ref * axis) if slide else Placement(turn(axis, -ref))
        limited = bool(model.jnt_limited[joint])
        lower, upper = model.jnt_range[joint] if limited else (-math.inf, math.inf)
        return Joint(
            name,
            "prismatic" if slide else "revolute" if limited else "continuous",
            parent,
            child,
            placement @ at_zero,
            axis,
            Limits(float(lower), float(upper), effort=float(self.actuators.limits[joint])),
            mimics.get(joint),
            where,
        )


def rotation_of(quaternion: Array) -> Array:
    """The rotation matrix of a unit quaternion `w, x, y, z`."""
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)
