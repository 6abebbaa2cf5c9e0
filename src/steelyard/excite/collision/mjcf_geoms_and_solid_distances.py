"""MuJoCo: geoms of MJCF files, and distances between convex solids."""

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import ModelError
from steelyard.excite.collision.solids_and_shapes import (
    WITHOUT_MESH_ADVICE,
    Ball,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Shape,
    Solid,
    obstacle,
    placed,
)
from steelyard.robot.models.mjcf import Compiled, compiled, rotation_of
from steelyard.robot.models.mjcf_equalities_and_forces import joints_of, name_of
from steelyard.robot.robot import Frame

FARTHEST_DISTANCE = 1e6  # no two solids are farther apart [m]

_GEOM = mujoco.mjtGeom

_GEOMS: Mapping[type[Solid], tuple[Any, Callable[[Any], Sequence[float]]]] = {
    Ball: (_GEOM.mjGEOM_SPHERE, lambda ball: (ball.radius, 0.0, 0.0)),
    Box: (_GEOM.mjGEOM_BOX, lambda box: [edge / 2.0 for edge in box.size]),
    Ellipsoid: (_GEOM.mjGEOM_ELLIPSOID, lambda ellipsoid: ellipsoid.semi),
    Cylinder: (_GEOM.mjGEOM_CYLINDER, lambda rod: (rod.disc, rod.length / 2.0, 0.0)),
    Capsule: (_GEOM.mjGEOM_CAPSULE, lambda rod: (rod.disc, rod.length / 2.0, 0.0)),
    HalfSpace: (_GEOM.mjGEOM_SPHERE, lambda _: (1.0, 0.0, 0.0)),  # a stand-in that is never used
}
"""Kinds and sizes of the geoms of solids."""

_SOLIDS: Mapping[Any, Callable[[float, float, float], Solid]] = {
    _GEOM.mjGEOM_PLANE: lambda x, y, z: HalfSpace(),
    _GEOM.mjGEOM_SPHERE: lambda x, y, z: Ball(x),
    _GEOM.mjGEOM_BOX: lambda x, y, z: Box((2.0 * x, 2.0 * y, 2.0 * z)),
    _GEOM.mjGEOM_ELLIPSOID: lambda x, y, z: Ellipsoid((x, y, z)),
    _GEOM.mjGEOM_CYLINDER: lambda x, y, z: Cylinder(x, 2.0 * y),
    _GEOM.mjGEOM_CAPSULE: lambda x, y, z: Capsule(x, 2.0 * y),
}
"""Solids of kinds of geoms, by their sizes."""


class Distances:
    """Signed distances between pairs of solids, by GJK and EPA on MuJoCo's geoms.

    MuJoCo's model has one free-standing geom per solid. Its origin and axes in the frame of its
    solid are `_position`, shape `(G, 3)` [m], and `_rotation`, shape `(G, 3, 3)`.
    """

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.balanceinertia = True
        spec.memory = 1 << 22
        for number, solid in enumerate(solids):
            if isinstance(solid, Hull):
                corners = solid.vertices.astype(np.float32).ravel()
                spec.add_mesh(name=f"{number}", uservert=corners)
                spec.worldbody.add_geom(type=_GEOM.mjGEOM_MESH, meshname=f"{number}")
            else:
                kind, size = _GEOMS[type(solid)]
                spec.worldbody.add_geom(type=kind, size=size(solid))
        self._model = spec.compile()
        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        self._position = data.geom_xpos.copy()
        self._rotation = data.geom_xmat.reshape(-1, 3, 3).copy()
        self._spare = list[Any]()

    def between(
        self, pairs: NDArray[np.intp], samples: NDArray[np.intp], at: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Distances of `H` pairs of solids `(H, 2)`, each at a sample, ascending, `(H,)`.

        None is a half-space. Axes `(N, G, 3, 3)` and origins `(N, G, 3)` [m] are those of all
        solids at all samples. Distances, `(H,)` [m], are negative by the depth of an overlap. Also
        the nearest points of both, `(H, 2, 3)` [m]; of an overlap those that would touch first if
        the solids were drawn apart.
        """
        # memory for the solver takes longer to get than a hundred distances
        model, data = self._model, self._spare.pop() if self._spare else mujoco.MjData(self._model)
        place, turn = data.geom_xpos, data.geom_xmat
        used, samples = np.unique(samples, return_inverse=True)
        rotations = at[0][used] @ self._rotation
        positions = at[1][used] + (at[0][used] @ self._position[..., None])[..., 0]
        flat = rotations.reshape(*rotations.shape[:2], 9)
        distances, points = np.empty(len(pairs)), np.empty((len(pairs), 6, 1))
        measure, last = mujoco.mj_geomDistance, -1
        work = zip(pairs[:, 0].tolist(), pairs[:, 1].tolist(), samples.tolist(), strict=True)
        for k, (first, second, sample) in enumerate(work):
            if sample != last:
                place[:], turn[:] = positions[sample], flat[sample]
                last = sample
            distances[k] = measure(model, data, first, second, FARTHEST_DISTANCE, points[k])
        self._spare.append(data)
        return distances, points.reshape(-1, 2, 3)


def mjcf_shapes(
    path: Path, frames: Mapping[str, Frame], skip: Collection[str]
) -> tuple[tuple[Shape, ...], frozenset[frozenset[str]], frozenset[str]]:
    """Shapes of an MJCF robot, pairs of links that it excludes, and other links with shapes."""
    file = compiled(path)
    model, shapes = file.model, list[Shape]()
    names = {
        geom: name_of(model, "body", int(model.geom_bodyid[geom])) for geom in _colliding(model)
    }
    for geom, name in names.items():
        if name in skip or name not in frames:
            continue
        # a link's origin is the anchor of its body's last joint
        joints = joints_of(model, int(model.geom_bodyid[geom]))
        anchor = model.jnt_pos[joints[-1]] if joints else np.zeros(3)
        solid, position = _solid(file, geom, name, path), model.geom_pos[geom] - anchor
        rotation = rotation_of(model.geom_quat[geom])
        shapes.append(placed(frames[name], name, solid, position, rotation))
    return tuple(shapes), _excluded(model), frozenset(names.values()) - frames.keys()


def mjcf_world(path: Path) -> tuple[Shape, ...]:
    """Shapes of a cell's MJCF, its joints at their reference positions."""
    file = compiled(path)
    model, data = file.model, mujoco.MjData(file.model)
    mujoco.mj_kinematics(model, data)
    shapes = []
    for geom in _colliding(model):
        name = name_of(model, "body", int(model.geom_bodyid[geom]))
        solid, rotation = _solid(file, geom, name, path), data.geom_xmat[geom].reshape(3, 3)
        shapes.append(obstacle(name, solid, data.geom_xpos[geom], rotation))
    return tuple(shapes)


def _colliding(model: Any) -> list[int]:
    active = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [int(geom) for geom in np.flatnonzero(active)]


def _excluded(model: Any) -> frozenset[frozenset[str]]:
    """Pairs of bodies that `<exclude>` names, or whose geoms' masks let them pass."""
    pairs = set()
    for signature in model.exclude_signature:
        bodies = (int(signature) >> 16, int(signature) & 0xFFFF)
        pairs.add(frozenset(name_of(model, "body", body) for body in bodies))
    masks = by_key(
        (
            name_of(model, "body", model.geom_bodyid[k]),
            (model.geom_contype[k], model.geom_conaffinity[k]),
        )
        for k in _colliding(model)
    )
    for first, mine in masks.items():
        for second, theirs in masks.items():
            meet = any((a & d) or (c & b) for a, b in mine for c, d in theirs)
            if first < second and not meet:
                pairs.add(frozenset((first, second)))
    return frozenset(pairs)


def _solid(file: Compiled, geom: int, link: str, path: Path) -> Solid:
    """The solid of a colliding geom; its mesh must be there."""
    if geom in file.stand_ins:
        raise ModelError(
            f"the collision mesh '{file.stand_ins[geom]}' of link '{link}' is not there",
            where=str(path),
            fix="put the file where the MJCF looks for it (see its meshdir), or "
            f"{WITHOUT_MESH_ADVICE}",
        )
    model = file.model
    kind, size = _GEOM(int(model.geom_type[geom])), [float(s) for s in model.geom_size[geom]]
    if kind in _SOLIDS:
        return _SOLIDS[kind](*size)
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return Hull(model.mesh_vert[first : first + count].astype(np.float64))
    raise ModelError(
        f"link '{link}' has a colliding geom of kind {kind.name[7:].lower()}, which is not convex",
        where=str(path),
        fix="replace it by boxes or meshes, or name the link under skip to ignore its shapes",
    )
