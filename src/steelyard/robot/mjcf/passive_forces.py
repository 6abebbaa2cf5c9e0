"""Forces in a compiled MJCF that are neither of rigid bodies nor of motors."""

from typing import Any

import mujoco
import numpy as np

from steelyard.robot.mjcf.efforts import posed, single_joints
from steelyard.robot.model_notes import JointSpring, ModelNote, Naming


def springs_of(model: Any, name: Naming) -> dict[str, JointSpring]:
    """Springs of the joints, by joint, unless the file switches springs off.

    Args:
        model: A compiled model (`mujoco.MjModel`).
        name: Names of its objects.
    """
    if _off(model, mujoco.mjtDisableBit.mjDSBL_SPRING):
        return {}
    springs = {}
    for joint in single_joints(model):
        free = float(model.qpos_spring[model.jnt_qposadr[joint]])
        stiffness = float(model.jnt_stiffness[joint])
        linear = not np.any(model.jnt_stiffnesspoly[joint])
        if stiffness or not linear:
            springs[name("joint", joint)] = JointSpring(stiffness, free, linear)
    return springs


def passive_notes(model: Any, name: Naming) -> list[ModelNote]:
    """What the file says of gravity, tendons and fluids that the robot is without."""
    return [
        *_gravity_notes(model),
        *_compensation_notes(model, name),
        *_tendon_notes(model, name),
        *_fluid_notes(model),
    ]


def _off(model: Any, bit: Any) -> bool:
    """Whether a part of the simulation is switched off."""
    return bool(int(model.opt.disableflags) & bit.value)


def _weightless(model: Any) -> bool:
    return not np.any(model.opt.gravity)


def _gravity_notes(model: Any) -> list[ModelNote]:
    shown = "[" + ", ".join(f"{g:g}" for g in model.opt.gravity) + "] m/s²"
    if _weightless(model):
        what = "the MJCF has no gravity, so the robot has none: state it as gravity under [robot]"
    elif _off(model, mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        what = (
            f"the MJCF disables gravity; the robot has {shown} anyway: state gravity "
            "under [robot], [0.0, 0.0, 0.0] for none"
        )
    else:
        return []
    return [ModelNote(what, answer="gravity")]


def _compensation_notes(model: Any, name: Naming) -> list[ModelNote]:
    """Joints that do not carry in simulation what they carry here.

    Where a joint's actuators compensate (`actuatorgravcomp`), its efforts hold the weight.
    """
    off = _weightless(model) or _off(model, mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    relieved = set[int]()
    for compensated in [] if off else np.flatnonzero(model.body_gravcomp):
        body = int(compensated)
        while body:
            first = int(model.body_jntadr[body])
            relieved |= set(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_parentid[body])
    what = (
        "gravity compensation of bodies in the MJCF (gravcomp) is not in the robot; efforts logged "
        'without weight have kind = "gravity_compensated_torque": '
    )
    return [
        ModelNote(what, name("joint", joint), (name("joint", joint),), "weight")
        for joint in single_joints(model)
        if joint in relieved and not model.jnt_actgravcomp[joint]
    ]


def _tendon_notes(model: Any, name: Naming) -> list[ModelNote]:
    """Tendons that pull, brake or carry inertia."""
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
        joints = [name("joint", k) for k in single_joints(model) if model.jnt_dofadr[k] in dofs]
        if acting and joints:
            what = (
                "forces of tendons in the MJCF are not in the model unless a term represents them "
            )
            item = f"'{name('tendon', tendon)}' on {', '.join(joints)} ({', '.join(acting)})"
            notes.append(ModelNote(what + "(along = {...}): ", item, tuple(joints)))
    return notes


def _fluid_notes(model: Any) -> list[ModelNote]:
    density, viscosity = float(model.opt.density), float(model.opt.viscosity)
    if density == 0.0 and viscosity == 0.0:
        return []
    return [
        ModelNote(
            f"forces of a fluid in the MJCF (density {density:g} kg/m³, viscosity {viscosity:g} "
            "Pa s) are not in the model"
        )
    ]
