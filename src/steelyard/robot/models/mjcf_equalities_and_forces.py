r"""Equality constraints, efforts of actuators, springs and other passive forces of a compiled MJCF.

Equalities become mimics and pins, or couplings that only locked joints satisfy. MuJoCo clamps the
force of every actuator, maps it to the joints by the moments of its transmission and clamps the sum
of a joint once more: `actuatorfrcrange` of the joint, `forcerange` of its actuators and `ctrlrange`
of plain motors all count. A sum within $[a, b]$ is a limit of $\min(-a, b)$, the same both ways.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.robot.inertia_and_placement import Placement
from steelyard.robot.mechanism import Coupling, JointSpring, Mimic, ModelNote, Pin

_FOLLOWING = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
"""Activations that stay within the range of the control."""

_GENERIC = 0.3  # distance from the reference at which no moment is zero by chance [rad; m]


def name_of(model: Any, kind: str, index: int) -> str:
    """The name of an element of MuJoCo's model, or one made of its kind and number."""
    return str(getattr(model, kind)(index).name) or f"{kind}_{index}"


def posed(model: Any) -> Any:
    """The data of a compiled model at a posture of no symmetry, with all lengths and moments."""
    data = mujoco.MjData(model)
    for joint in single_joints(model):
        data.qpos[model.jnt_qposadr[joint]] += _GENERIC + 0.01 * joint
    for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_transmission):
        step(model, data)
    return data


def single_joints(model: Any) -> list[int]:
    """Numbers of the joints of one degree of freedom."""
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return [k for k in range(model.njnt) if mujoco.mjtJoint(int(model.jnt_type[k])) in kinds]


def joints_of(model: Any, body: int) -> range:
    """Numbers of a body's own joints."""
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))


def joints_to(model: Any, body: int) -> list[int]:
    """Numbers of the joints between the world and a body."""
    joints = list[int]()
    while body > 0:
        joints += joints_of(model, body)
        body = int(model.body_parentid[body])
    return joints


def wraps_of(model: Any, tendon: int) -> list[tuple[Any, int, float]]:
    """What a tendon runs over: kind, number and coefficient of each."""
    first = int(model.tendon_adr[tendon])
    rows = slice(first, first + int(model.tendon_num[tendon]))
    wraps = zip(model.wrap_type[rows], model.wrap_objid[rows], model.wrap_prm[rows], strict=True)
    return [(mujoco.mjtWrap(int(kind)), int(number), float(x)) for kind, number, x in wraps]


@dataclass(frozen=True, eq=False)
class Actuators:
    """Actuators, and their efforts per force, `(nactuator, nv)`: of several outputs the sizes."""

    model: Any
    moments: Array

    @classmethod
    def of(cls, model: Any) -> "Actuators":
        """Those of a compiled model."""
        data, outputs = posed(model), np.zeros((model.nout, model.nv))
        if outputs.size:
            where = (data.moment_rownnz, data.moment_rowadr, data.moment_colind)
            mujoco.mju_sparse2dense(outputs, data.actuator_moment, *where)
        moments = np.zeros((model.nactuator, model.nv))
        for actuator, (first, count) in enumerate(
            zip(model.actuator_outadr, model.actuator_outnum, strict=True)
        ):
            rows = outputs[first : first + count]
            moments[actuator] = rows[0] if count == 1 else np.abs(rows).sum(axis=0)
        return cls(model, frozen(moments))

    @cached_property
    def limits(self) -> Array:
        """The greatest effort either way that the file lets every joint have, `(njnt,)` [Nm; N].

        Infinite where it states none, not positive where actuators push one way only, or act on
        several joints at once.
        """
        limits = np.full(self.model.njnt, np.inf)
        for joint in single_joints(self.model):
            lower, upper = self._joint_range(joint)
            limits[joint] = min(-lower, upper)
        return frozen(limits)

    def notes(self) -> list[ModelNote]:
        """Limits that are not limits of one joint."""
        notes = []
        for actuator in range(self.model.nactuator):
            dofs = np.flatnonzero(self.moments[actuator])
            touched = [k for k in single_joints(self.model) if self.model.jnt_dofadr[k] in dofs]
            joints = tuple(name_of(self.model, "joint", k) for k in touched)
            limited = np.isfinite(self._force_range(actuator)).any()
            if limited and joints and not self._of_one_joint(actuator):
                what = (
                    "limits of actuators that act through tendons or sites are no limits of one "
                    "joint (state [robot.limits.JOINT] effort): "
                )
                item = f"'{name_of(self.model, 'actuator', actuator)}'"
                notes.append(ModelNote(what, item, joints, "efforts"))
        for joint in np.flatnonzero(self.limits <= 0.0):
            what = (
                "actuators with one direction of force are not a limit (state [robot.limits.JOINT] "
                "effort): "
            )
            named = name_of(self.model, "joint", int(joint))
            notes.append(ModelNote(what, named, (named,), "efforts"))
        return notes

    def _joint_range(self, joint: int) -> tuple[float, float]:
        """Least and greatest `qfrc_actuator` of a joint; unbounded if nothing bounds it."""
        model, moments = self.model, self.moments[:, self.model.jnt_dofadr[joint]]
        groups, off = model.actuator_group, int(model.opt.disableactuator)
        acting = [
            int(k)
            for k in np.flatnonzero(moments)
            if not (0 <= groups[k] <= 30 and off >> int(groups[k]) & 1)
        ]
        lower, upper = -np.inf, np.inf
        if acting and all(map(self._of_one_joint, acting)) and not model.jnt_actgravcomp[joint]:
            ends = np.array([moments[k] * self._force_range(k) for k in acting])
            lower, upper = ends.min(axis=1).sum(), ends.max(axis=1).sum()
        if model.jnt_actfrclimited[joint]:
            lower, upper = np.clip([lower, upper], *model.jnt_actfrcrange[joint])
        return float(lower), float(upper)

    def _of_one_joint(self, actuator: int) -> bool:
        """Whether the actuator acts on one joint alone, alike at every posture."""
        model, kind = self.model, mujoco.mjtTrn(int(self.model.actuator_trntype[actuator]))
        if kind == mujoco.mjtTrn.mjTRN_TENDON:
            wrapped, *_ = wraps_of(model, int(model.actuator_trnid[actuator, 0]))[0]
            constant = wrapped == mujoco.mjtWrap.mjWRAP_JOINT
        else:
            constant = kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        return bool(constant and np.count_nonzero(self.moments[actuator]) == 1)

    def _force_range(self, actuator: int) -> Array:
        """Least and greatest force of one actuator, `(2,)`."""
        model, ends = self.model, self._motor_range(actuator)
        if mujoco.mjtTrn(int(model.actuator_trntype[actuator])) == mujoco.mjtTrn.mjTRN_TENDON:
            tendon = model.actuator_trnid[actuator, 0]
            through = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)
            # MuJoCo limits only the sum of several
            alone = np.sum(through & (model.actuator_trnid[:, 0] == tendon)) == 1
            if model.tendon_actfrclimited[tendon] and alone:
                ends = np.clip(ends, *model.tendon_actfrcrange[tendon])
        if model.actuator_forcelimited[actuator]:
            ends = np.clip(ends, *model.actuator_forcerange[actuator])
        return ends

    def _motor_range(self, actuator: int) -> Array:
        """Gain times the range of the control, for motors without feedback; else unbounded."""
        model, control = self.model, int(self.model.actuator_ctrladr[actuator])
        bias = mujoco.mjtBias(int(model.actuator_biastype[actuator]))
        constants = model.actuator_biasprm[actuator, :3]
        known = bias == mujoco.mjtBias.mjBIAS_NONE or (
            bias == mujoco.mjtBias.mjBIAS_AFFINE and not np.any(constants[1:])
        )
        gain = mujoco.mjtGain(int(model.actuator_gaintype[actuator]))
        plain = (
            model.actuator_plugin[actuator] < 0
            and gain == mujoco.mjtGain.mjGAIN_FIXED
            and mujoco.mjtDyn(int(model.actuator_dyntype[actuator])) in _FOLLOWING
            and model.actuator_ctrllimited[control]
            and not int(model.opt.disableflags) & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL.value
        )
        if not (plain and known):
            return np.array([-np.inf, np.inf])
        ends = model.actuator_ctrlrange[control]
        if model.actuator_actlimited[actuator]:
            ends = np.clip(ends, *model.actuator_actrange[actuator])
        ends = model.actuator_gainprm[actuator, 0] * ends
        if bias == mujoco.mjtBias.mjBIAS_AFFINE:
            ends = ends + constants[0]
        return np.sort(ends)


def springs_of(model: Any) -> dict[str, JointSpring]:
    """Springs of the joints of a compiled model, by joint, unless the file switches springs off."""
    if _off(model, mujoco.mjtDisableBit.mjDSBL_SPRING):
        return {}
    springs = {}
    for joint in single_joints(model):
        free = float(model.qpos_spring[model.jnt_qposadr[joint]])
        stiffness = float(model.jnt_stiffness[joint])
        linear = not np.any(model.jnt_stiffnesspoly[joint])
        if stiffness or not linear:
            springs[name_of(model, "joint", joint)] = JointSpring(stiffness, free, linear)
    return springs


def passive_notes(model: Any) -> list[ModelNote]:
    """What the file says of gravity, tendons and fluids that the robot is without."""
    notes = list[ModelNote]()
    if not np.any(model.opt.gravity):
        what = "the MJCF has no gravity, so the robot has none: state it as gravity under [robot]"
        notes.append(ModelNote(what, answer="gravity"))
    elif _off(model, mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        shown = "[" + ", ".join(f"{g:g}" for g in model.opt.gravity) + "] m/s²"
        what = (
            f"the MJCF disables gravity; the robot has {shown} anyway: state gravity "
            "under [robot], [0.0, 0.0, 0.0] for none"
        )
        notes.append(ModelNote(what, answer="gravity"))
    notes += [*_compensation_notes(model), *_tendon_notes(model)]
    density, viscosity = float(model.opt.density), float(model.opt.viscosity)
    if density != 0.0 or viscosity != 0.0:
        what = (
            f"forces of a fluid in the MJCF (density {density:g} kg/m³, viscosity {viscosity:g} "
            "Pa s) are not in the model"
        )
        notes.append(ModelNote(what))
    return notes


def _off(model: Any, bit: Any) -> bool:
    return bool(int(model.opt.disableflags) & bit.value)


def _compensation_notes(model: Any) -> list[ModelNote]:
    """Joints that do not carry in simulation what they carry here.

    Where a joint's actuators compensate (`actuatorgravcomp`), its efforts hold the weight.
    """
    off = not np.any(model.opt.gravity) or _off(model, mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    compensated = [] if off else np.flatnonzero(model.body_gravcomp).tolist()
    relieved = {joint for body in compensated for joint in joints_to(model, body)}
    what = (
        "gravity compensation of bodies in the MJCF (gravcomp) is not in the robot; efforts logged "
        'without weight have kind = "gravity_compensated_torque": '
    )
    return [
        ModelNote(what, name_of(model, "joint", joint), (name_of(model, "joint", joint),), "weight")
        for joint in single_joints(model)
        if joint in relieved and not model.jnt_actgravcomp[joint]
    ]


def _tendon_notes(model: Any) -> list[ModelNote]:
    lengths = np.zeros((model.ntendon, model.nv))
    if lengths.size:
        where = (model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind)
        mujoco.mju_sparse2dense(lengths, posed(model).ten_J, *where)
    springy = not _off(model, mujoco.mjtDisableBit.mjDSBL_SPRING)
    notes = []
    for tendon in range(model.ntendon):
        causes = {
            "stiffness": springy
            and (model.tendon_stiffness[tendon] or np.any(model.tendon_stiffnesspoly[tendon])),
            "damping": model.tendon_damping[tendon] or np.any(model.tendon_dampingpoly[tendon]),
            "friction": model.tendon_frictionloss[tendon],
            "armature": model.tendon_armature[tendon],
        }
        acting = [cause for cause, there in causes.items() if there]
        dofs = np.flatnonzero(lengths[tendon])
        pulled = [k for k in single_joints(model) if model.jnt_dofadr[k] in dofs]
        joints = [name_of(model, "joint", k) for k in pulled]
        if acting and joints:
            what = (
                "forces of tendons in the MJCF are not in the model unless a term represents them "
            )
            name = name_of(model, "tendon", tendon)
            item = f"'{name}' on {', '.join(joints)} ({', '.join(acting)})"
            notes.append(ModelNote(what + "(along = {...}): ", item, tuple(joints)))
    return notes


WORLD = "world"
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


def reference(model: Any, joint: int) -> float:
    """The reference position of a hinge or slide joint [rad; m]."""
    return float(model.qpos0[int(model.jnt_qposadr[joint])])


@dataclass(frozen=True)
class Equalities:
    """The active equality constraints of a file."""

    path: Path
    model: Any

    def mimics(self) -> dict[int, Mimic]:
        r"""Joints in proportion to another, $q_1 - r_1 = c_0 + c_1 (q_2 - r_2)$, $r$ references.

        A fixed tendon of two joints that keeps its length, $a_1 (q_1 - r_1) + a_2 (q_2 - r_2) = d$,
        is one as well: its second joint follows the first, or where that follows already, the first
        the second.
        """
        mimics = dict[int, Mimic]()
        for joint, master, offset, ratio in self._proportions().values():
            own, other = reference(self.model, joint), reference(self.model, master)
            mimics[joint] = Mimic(self._joint(master), ratio, offset + own - ratio * other)
        return mimics

    def pins(self, origins: Mapping[int, Placement]) -> list[Pin]:
        """`connect` equalities between bodies or sites; `origins` are of bodies in their links."""
        model, pins = self.model, []
        for index in self._active(mujoco.mjtEq.mjEQ_CONNECT):
            ends = self._ends(index)
            points = np.reshape(model.eq_data[index][:6], (2, 3))
            if mujoco.mjtObj(int(model.eq_objtype[index])) == mujoco.mjtObj.mjOBJ_SITE:
                points = model.site_pos[list(self._objects(index))]
            placed = [
                origins[body].position + origins[body].rotation @ point
                for body, point in zip(ends, points, strict=True)
            ]
            links = (self._link(ends[0]), self._link(ends[1]))
            pins.append(Pin(self._name(index), links, np.array(placed), self._where(index)))
        return pins

    def couplings(self) -> tuple[list[Coupling], list[str]]:
        """All other equalities with the joints that they tie, and notes on those left out.

        A weld to a mocap body is a controller, and one at a free body holds that where it is: both
        are left out.
        """
        kinds, couplings, notes = mujoco.mjtEq, list[Coupling](), list[str]()
        proportional, single = self._proportions(), single_joints(self.model)
        for index in self._active():
            kind = kinds(int(self.model.eq_type[index]))
            if kind == kinds.mjEQ_CONNECT or index in proportional:
                continue
            if kind == kinds.mjEQ_WELD:
                ends = self._ends(index)
                joints = self._between(ends)
                what = "a weld"
                free = [
                    list(self.model.jnt_type[joints_of(self.model, b)]) == [_FREE] for b in ends
                ]
                if any(free) or any(self.model.body_mocapid[b] >= 0 for b in ends):
                    both = " and ".join(f"'{self._link(body)}'" for body in ends)
                    notes.append(f"the weld of {both} is left out")
                    continue
            elif kind == kinds.mjEQ_JOINT:
                joints = [k for k in self._objects(index) if k >= 0]
                flaw = "one too many" if self._proportional(index) else "not proportional"
                what = f"a joint equality that is {flaw}"
            elif kind == kinds.mjEQ_TENDON:
                joints, what = self._of_tendons(index), "a tendon equality"
            else:
                (flex, _), what = self._objects(index), "a flex equality"
                first = int(self.model.flex_vertadr[flex])
                last = first + int(self.model.flex_vertnum[flex])
                bodies = self.model.flex_vertbodyid[first:last]
                joints = self._between([int(body) for body in bodies])
            named = tuple(dict.fromkeys(self._joint(k) for k in joints if k in single))
            if named:
                couplings.append(Coupling(self._name(index), what, named, self._where(index)))
        return couplings, notes

    def offsets(self) -> dict[str, float]:
        """Joints that an equality holds off their reference while the other is at its own."""
        model = self.model
        found = {
            self._joint(self._objects(index)[0]): float(model.eq_data[index][0])
            for index in self._active(mujoco.mjtEq.mjEQ_JOINT)
        }
        ties = self._proportions().values()
        return found | {self._joint(joint): offset for joint, _, offset, _ in ties}

    def _active(self, kind: Any = None) -> list[int]:
        model = self.model
        wanted = range(model.neq) if kind is None else np.flatnonzero(model.eq_type == int(kind))
        return [int(k) for k in wanted if model.eq_active0[k]]

    def _proportions(self) -> dict[int, tuple[int, int, float, float]]:
        r"""Equalities that are one joint following another in proportion, by their numbers.

        Joint, master, $c_0$ and $c_1$ of $q - r = c_0 + c_1 (q_m - r_m)$.
        """
        model, found = self.model, dict[int, tuple[int, int, float, float]]()
        masters = dict[int, int]()
        for index in self._active(mujoco.mjtEq.mjEQ_JOINT):
            joint, master = self._objects(index)
            if self._proportional(index) and joint not in masters:
                offset, ratio = (float(term) for term in model.eq_data[index][:2])
                found[index] = joint, master, offset, ratio
                masters[joint] = master
        for index in self._active(mujoco.mjtEq.mjEQ_TENDON):
            tendon, other = self._objects(index)
            wraps = wraps_of(model, tendon)
            pair = {k: x for kind, k, x in wraps if kind == mujoco.mjtWrap.mjWRAP_JOINT and x}
            if other >= 0 or not len(wraps) == len(pair) == 2:
                continue
            (first, a), (second, b) = pair.items()
            if second in masters:
                first, a, second, b = second, b, first, a
            end = first
            while end != second and end in masters:
                end = masters[end]
            if second not in masters and end != second:
                offset = float(model.eq_data[index][0]) / b
                found[index] = second, first, offset, -a / b
                masters[second] = first
        return found

    def _proportional(self, index: int) -> bool:
        return bool(self.model.eq_obj2id[index] >= 0 and not self.model.eq_data[index][2:5].any())

    def _name(self, index: int) -> str:
        return name_of(self.model, "eq", index)

    def _joint(self, index: int) -> str:
        return name_of(self.model, "joint", index)

    def _link(self, body: int) -> str:
        return name_of(self.model, "body", body) if body else WORLD

    def _where(self, index: int) -> str:
        return f"{self.path}, equality '{self._name(index)}'"

    def _objects(self, index: int) -> tuple[int, int]:
        return int(self.model.eq_obj1id[index]), int(self.model.eq_obj2id[index])

    def _ends(self, index: int) -> tuple[int, int]:
        first, second = self._objects(index)
        if mujoco.mjtObj(int(self.model.eq_objtype[index])) == mujoco.mjtObj.mjOBJ_SITE:
            return int(self.model.site_bodyid[first]), int(self.model.site_bodyid[second])
        return first, second

    def _between(self, bodies: Sequence[int]) -> list[int]:
        """Joints that move some of the bodies against the others."""
        lines = [joints_to(self.model, body) for body in bodies]
        moving = {joint for line in lines for joint in line}
        return sorted(k for k in moving if not all(k in line for line in lines))

    def _of_tendons(self, index: int) -> list[int]:
        """Joints that change the length of an equality's tendons."""
        model, joints = self.model, list[int]()
        for tendon in self._objects(index):
            wraps = wraps_of(model, tendon) if tendon >= 0 else []
            joints += [k for kind, k, _ in wraps if kind == mujoco.mjtWrap.mjWRAP_JOINT]
            sites = [k for kind, k, _ in wraps if kind == mujoco.mjtWrap.mjWRAP_SITE]
            joints += self._between([int(model.site_bodyid[k]) for k in sites])
        return joints
