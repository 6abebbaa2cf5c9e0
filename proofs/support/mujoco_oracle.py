"""What MuJoCo makes of an MJCF: torques, regressor and pins of its tree."""

import copy
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from proofs.support.model_oracles import ROUNDED, Following, without_dirt

from steelyard.base.arrays import Array


class MjcfOracle:
    """MuJoCo's tree of an MJCF, compiled, under its gravity even where the file switches that off.

    The reader keeps the vector too, and says so: a flag for a simulation takes no robot's weight.
    """

    def __init__(self, model: Any, cleaned: bool) -> None:
        self.model = cleaned_model(model) if cleaned else copy.copy(model)
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        self.data = mujoco.MjData(self.model)
        kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        single = [k for k in range(model.njnt) if mujoco.mjtJoint(int(model.jnt_type[k])) in kinds]
        self.joints = tuple(model.joint(k).name or f"joint_{k}" for k in single)
        self._names = dict(zip(single, self.joints, strict=True))
        self._places = [int(model.jnt_qposadr[k]) for k in single]
        self._columns = [int(model.jnt_dofadr[k]) for k in single]
        self.rest = dict(zip(self.joints, model.qpos0[self._places].tolist(), strict=True))
        self.rest_of = dict(self.rest)
        self.following: dict[str, Following] = {}
        self._pins: list[int] = []
        for k in range(model.neq):
            self._equality(k)

    def _equality(self, k: int) -> None:
        model, kind = self.model, mujoco.mjtEq(int(self.model.eq_type[k]))
        if not model.eq_active0[k]:
            return
        if kind == mujoco.mjtEq.mjEQ_CONNECT:
            self._pins.append(k)
        if kind == mujoco.mjtEq.mjEQ_TENDON and int(model.eq_obj2id[k]) < 0:
            self._two_joints(int(model.eq_obj1id[k]), float(model.eq_data[k][0]))
        if kind != mujoco.mjtEq.mjEQ_JOINT or np.any(model.eq_data[k][2:5]):
            return
        name = self._names[int(model.eq_obj1id[k])]
        start, ratio = (float(x) for x in model.eq_data[k][:2])
        if int(model.eq_obj2id[k]) < 0:
            self.rest[name] += start
            return
        master = self._names[int(model.eq_obj2id[k])]
        offset = self.rest[name] + start - ratio * self.rest[master]
        self.following[name] = Following(master, ratio, offset)

    def _two_joints(self, tendon: int, longer: float) -> None:
        """A fixed tendon of two joints, `longer` than at the reference: one follows the other."""
        model, first = self.model, int(self.model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        kinds = {int(model.wrap_type[w]) for w in wraps}
        if len(wraps) != 2 or kinds != {int(mujoco.mjtWrap.mjWRAP_JOINT)}:
            return
        names = [self._names[int(model.wrap_objid[w])] for w in wraps]
        if names[1] in self.following:
            names.reverse()
        grows = []
        for name in names:
            moved = np.array([self.rest[j] + (j == name) for j in self.joints])
            self._set(moved, np.zeros(len(moved)))
            mujoco.mj_tendon(model, self.data)
            grows.append(float(self.data.ten_length[tendon] - model.tendon_length0[tendon]))
        ratio = -grows[0] / grows[1]
        offset = self.rest[names[1]] + longer / grows[1] - ratio * self.rest[names[0]]
        self.following[names[1]] = Following(names[0], ratio, offset)

    def pull(self, gravity: Array) -> None:
        """Set gravity [m/s²] in the root's frame."""
        self.model = copy.copy(self.model)
        self.model.opt.gravity = gravity

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques of bodies and gravity alone; all shapes `(n_joints, N)`."""
        found = np.empty_like(q)
        result = np.empty(self.model.nv)
        for k in range(q.shape[1]):
            self._set(q[:, k], dq[:, k])
            self.data.qacc[:] = 0.0
            self.data.qacc[self._columns] = ddq[:, k]
            mujoco.mj_rne(self.model, self.data, 1, result)
            found[:, k] = result[self._columns]
        return found

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Pinocchio's, of the body behind the last joint of each, shape `(n_joints, N, p)`."""
        twin, numbers, last = pinocchio_twin(self.model)
        bodies = [10 * k + number for k in last for number in range(10)]
        data, rest = twin.createData(), np.array([self.rest_of[name] for name in self.joints])
        columns = [numbers[name] for name in self.joints]
        found = []
        for k in range(q.shape[1]):
            state = np.zeros((3, twin.nv))
            state[:, columns] = q[:, k] - rest, dq[:, k], ddq[:, k]
            full = pin.computeJointTorqueRegressor(twin, data, *state).reshape(twin.nv, -1)
            found.append(full[np.ix_(columns, bodies)])
        return np.array(found).transpose(1, 0, 2)

    def gaps(self, q: Array) -> tuple[Array, Array, Any]:
        """Of pins at one state, see `Oracle`."""
        self._set(q, np.zeros(len(q)))
        lacks, slopes = [], []
        for k in self._pins:
            ends = self._ends(k)
            lacks.append(ends[0][1] - ends[1][1])
            slopes.append(self._jacobian(mujoco.mj_jac, ends))
        if not lacks:
            return np.zeros(0), np.zeros((0, len(q))), lambda dq: np.zeros(0)

        def rate(dq: Array) -> Array:
            self._set(q, dq)
            pins = [self._jacobian(mujoco.mj_jacDot, self._ends(k)) for k in self._pins]
            return np.asarray(np.vstack(pins) @ dq)

        return np.concatenate(lacks), np.vstack(slopes), rate

    def _ends(self, k: int) -> list[tuple[int, Array]]:
        """Bodies and points [m, in the world] of a pin."""
        model, data = self.model, self.data
        numbers = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
        if mujoco.mjtObj(int(model.eq_objtype[k])) == mujoco.mjtObj.mjOBJ_SITE:
            return [(int(model.site_bodyid[n]), data.site_xpos[n].copy()) for n in numbers]
        points = np.reshape(model.eq_data[k][:6], (2, 3))
        return [
            (n, data.xpos[n] + data.xmat[n].reshape(3, 3) @ p)
            for n, p in zip(numbers, points, strict=True)
        ]

    def _jacobian(self, of: Any, ends: list[tuple[int, Array]]) -> Array:
        parts = []
        for body, point in ends:
            part = np.zeros((3, self.model.nv))
            of(self.model, self.data, part, None, point, body)
            parts.append(part)
        return np.asarray((parts[0] - parts[1])[:, self._columns])

    def _set(self, q: Array, dq: Array) -> None:
        data = self.data
        data.qpos[:], data.qvel[:] = self.model.qpos0, 0.0
        data.qpos[self._places], data.qvel[self._columns] = q, dq
        for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            step(self.model, data)


def pinocchio_twin(model: Any) -> tuple[Any, dict[str, int], list[int]]:
    """The joints of an MJCF in Pinocchio, free and ball joints fixed where the file has them.

    Returns:
        The model, its joints at zero where MuJoCo's are at `qpos0`; their numbers by name; and the
        numbers of those that carry a body: the joints of one body before its last carry none.
    """
    twin = pin.Model()
    numbers: dict[str, int] = {}
    last: list[int] = []
    twin.gravity.linear = np.array(model.opt.gravity)
    ends = {0: (0, pin.SE3.Identity())}
    models = {
        mujoco.mjtJoint.mjJNT_HINGE: pin.JointModelRevoluteUnaligned,
        mujoco.mjtJoint.mjJNT_SLIDE: pin.JointModelPrismaticUnaligned,
    }
    for body in range(1, model.nbody):
        carrier, frame = ends[int(model.body_parentid[body])]
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, model.body_quat[body])
        frame = frame * pin.SE3(matrix.reshape(3, 3), model.body_pos[body].copy())
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            kind = models.get(mujoco.mjtJoint(int(model.jnt_type[joint])))
            if kind is None:
                continue
            name = model.joint(joint).name or f"joint_{joint}"
            anchor = pin.SE3(np.eye(3), model.jnt_pos[joint].copy())
            numbers[name] = len(numbers)
            axis = kind(model.jnt_axis[joint].copy())
            carrier = twin.addJoint(carrier, axis, frame * anchor, name)
            frame = anchor.inverse()
        if carrier and carrier != ends[int(model.body_parentid[body])][0]:
            last.append(carrier - 1)
        ends[body] = carrier, frame
    return twin, numbers, last


def cleaned_model(model: Any) -> Any:
    """A copy whose placements and axes have no rounded angles."""
    found = copy.copy(model)
    for quaternion in found.body_quat:
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, quaternion)
        mujoco.mju_mat2Quat(quaternion, without_dirt(matrix.reshape(3, 3)).ravel())
    for axis in found.jnt_axis:
        axis[np.abs(axis) < ROUNDED] = 0.0
        axis /= max(float(np.linalg.norm(axis)), 1e-300)
    return found


ABSENT = r"[Ee]rror opening file|[Rr]esource|No such file"
"""What MuJoCo says of a file that is not there."""


@lru_cache(maxsize=1)
def compiled(path: Path) -> tuple[Any, str]:
    """MuJoCo's model of an MJCF, without its meshes where they are absent and not needed.

    Returns:
        The model, `None` where there is none; and why there is none.
    """
    try:
        return mujoco.MjModel.from_xml_path(str(path)), ""
    except (ValueError, mujoco.FatalError) as error:
        first = " ".join(str(error).split())
    if not re.search(ABSENT, first):
        return None, first
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if needed := _needed_meshes(spec):
            return None, f"mesh needed: the mass of body '{needed[0]}' comes from a mesh; {first}"
        for body in spec.bodies:
            if (
                _free(body) and not body.explicitinertial
            ):  # welded to the world, it needs no mass of its own
                body.explicitinertial, body.mass, body.inertia = True, 1.0, np.ones(3)
        return without_meshes(spec).compile(), ""
    except (ValueError, mujoco.FatalError) as error:
        return None, f"{first}; without meshes: {' '.join(str(error).split())}"


def without_meshes(spec: Any) -> Any:
    """The same specification without shapes of files, and without looks."""
    for geom in [g for g in spec.geoms if _of_file(g)]:
        spec.delete(geom)
    for kind in ("skins", "meshes", "hfields", "materials", "textures"):
        for item in list(getattr(spec, kind)):
            spec.delete(item)
    for geom in spec.geoms:
        geom.material = ""
    for site in spec.sites:
        site.material = ""
    return spec


def _of_file(geom: Any) -> bool:
    """Whether a geom's shape comes from a file."""
    return bool(geom.meshname or geom.hfieldname) or geom.type == mujoco.mjtGeom.mjGEOM_MESH


def _free(body: Any) -> bool:
    return any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)


def _needed_meshes(spec: Any) -> list[str]:
    """Moving bodies whose mass properties come from a mesh."""
    found = []
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    low, high = spec.compiler.inertiagrouprange
    waiting = [(body, False) for body in spec.worldbody.bodies]
    while waiting:
        body, moves = waiting.pop()
        moves = moves or (bool(list(body.joints)) and not _free(body))
        waiting += [(child, moves) for child in body.bodies]
        heavy = [
            g for g in body.geoms
            if _of_file(g) and low <= g.group <= high
            and g.mass != 0.0 and (g.density != 0.0 or g.mass > 0.0)
        ]  # fmt: skip
        if moves and heavy and (always or not body.explicitinertial):
            found.append(body.name)
    return found
