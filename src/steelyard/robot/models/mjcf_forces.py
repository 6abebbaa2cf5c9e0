r"""Forces in a compiled MJCF: efforts of actuators, springs and other passive forces.

MuJoCo clamps the force of every actuator, maps it to the joints by the moments of its transmission
and clamps the joint's sum once more: `actuatorfrcrange` of the joint, `forcerange` of its
actuators and `ctrlrange` of plain motors all count. A sum within $[a, b]$ is a limit of
$\min(-a, b)$: limits are the same both ways here.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.robot.mechanism import JointSpring, ModelNote

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
            touched = [k for k in single_joints(self.model) if self._dof(k) in dofs]
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

    def _dof(self, joint: int) -> int:
        return int(self.model.jnt_dofadr[joint])

    def _joint_range(self, joint: int) -> tuple[float, float]:
        """Least and greatest `qfrc_actuator` of a joint; unbounded if nothing bounds it."""
        model, moments = self.model, self.moments[:, self._dof(joint)]
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
