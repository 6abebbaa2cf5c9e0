r"""Torques of a model along a desired motion, and whether they can be commanded.

Friction is that of the *desired* velocity. Laws that jump at zero velocity turn within a speed $w$,
$\tanh(\dot q_d / w)$ in the place of the sign [Volkmann], because a desired velocity is rarely
exactly zero at rest; laws with a smoothing of their own keep that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, ModelError, advice
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.effort_errors import known_efforts
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import FRICTION, TORQUE, Equations, Quantity
from steelyard.robot.robot import Robot
from steelyard.symbolic.program_and_softening import Program, softened

SIGN_SMOOTHING = 1e-3  # speed within which friction by the plain sign turns [rad/s; m/s]


@dataclass(frozen=True, eq=False)
class SmoothedQuantity(Quantity):
    """A quantity whose jumps at zero velocity are spread over a speed `width` [rad/s; m/s]."""

    width: float = SIGN_SMOOTHING

    def program(self, part: Equations) -> Program:
        """The program of the quantity, softened."""
        return softened(super().program(part), self.arguments.index("dq"), self.width)


@lru_cache(maxsize=64)
def smoothed(quantity: Quantity, width: float) -> Quantity:
    """A quantity with its jumps at zero velocity spread over a speed; zero leaves it as it is."""
    if width == 0.0:
        return quantity
    return SmoothedQuantity(
        f"{quantity.name}, smoothed",
        quantity.arguments,
        quantity.enters,
        quantity.build,
        quantity.shape,
        (*quantity.key, width),
        width=width,
    )


def feedforward_torque(
    valued: ValuedModel,
    motion: Motion,
    smoothing: float = SIGN_SMOOTHING,
    quantity: Quantity = TORQUE,
) -> Array:
    """Joint torques of a model, or those of a quantity, along a motion, shape `(N, n)` [Nm; N].

    Friction with memory begins at rest. Laws that jump at zero velocity turn within the speed
    `smoothing` [rad/s; m/s]; zero for the plain sign.
    """
    chosen = smoothed(quantity, smoothing)
    return valued.evaluate(chosen, motion.q, motion.dq, motion.ddq, t=motion.t)


def friction_torque(
    valued: ValuedModel, motion: Motion, smoothing: float = SIGN_SMOOTHING
) -> Array:
    """Torques of the friction laws along a desired motion, as `feedforward_torque`."""
    return feedforward_torque(valued, motion, smoothing, FRICTION)


def in_joint_order(
    motion: Motion, joints: Sequence[str] | None, robot: Robot, where: str
) -> Motion:
    """The motion of a robot's joints, in their order, which is that of columns without names."""
    if joints is None:
        if motion.n_joints == robot.n:
            return motion
        raise DataError(
            f"the motion has {motion.n_joints} joints without names, the model {robot.n}",
            where=where,
            fix=f"name its joints; the model has {', '.join(robot.joint_names)}",
        )
    if len(joints) != motion.n_joints or len(set(joints)) != len(joints):
        raise DataError(
            f"{len(joints)} names are given for the {motion.n_joints} joints of the motion, or one "
            "twice",
            where=where,
            fix="give one name per column, each once",
        )
    for wanted, known, lacks, has in (
        (robot.joint_names, joints, "motion", "the model has"),
        (joints, robot.joint_names, "model", "the motion moves"),
    ):
        for name in wanted:
            if name not in known:
                raise DataError(
                    f"the {lacks} has no joint '{name}', which {has}",
                    where=where,
                    fix=advice(name, known, f"joints of the {lacks}"),
                )
    order = np.array([list(joints).index(name) for name in robot.joint_names])
    parts = (x[:, order] for x in (motion.q, motion.dq, motion.ddq))
    return Motion(motion.t, *parts)


def refuse_unknown_gains(identified: IdentifiedModel) -> None:
    """Efforts of the model are torques."""
    signals = identified.signals
    unknown = list(signals.unknown_gains)
    if not any(unknown):
        unknown = [not known for known in known_efforts(identified)]
    if any(unknown):
        joint = identified.joints[unknown.index(True)]
        raise ModelError(
            f"the drive gain of joint '{joint}' is unknown: the model's efforts are no torques",
            where=f"model of '{identified.model.robot.name}', gains of its effort columns",
            fix="identify the gains with a payload (steelyard identify ROBOT LOG --loaded LOG "
            "--payload-mass KG), or give them in [signals.effort] gain",
        )


def refuse_other_robot(identified: IdentifiedModel, robot: Robot) -> None:
    """The model is one of a robot that is controlled by joint torques."""
    model = identified.model.robot
    where = f"model of '{model.name}', robot '{robot.name}'"
    if model.joint_names != robot.joint_names:
        raise ModelError(
            f"the model has the joints {', '.join(model.joint_names)}, the robot "
            f"{', '.join(robot.joint_names)}",
            where=where,
            fix="give a model of this robot, with the joints in the same order",
        )
    if not np.allclose(model.gravity, robot.gravity, atol=1e-6):
        compensated = identified.signals.effort_kind == "gravity_compensated_torque"
        raise ModelError(
            "the model was identified from gravity-compensated efforts: it has no gravity, but "
            "the joint torques of the robot need it"
            if compensated
            else "the model and the robot are mounted differently: their gravity differs",
            where=where,
            fix="identify from joint torques, or give the robot file that the model was "
            "identified with",
        )


def remarks_on_torques(identified: IdentifiedModel) -> tuple[str, ...]:
    """What the torques of the model leave out, a sentence each."""
    kind, scales = identified.signals.effort_kind, identified.effort_scales
    found = []
    if kind == "gravity_compensated_torque":
        found.append(
            "torques are without gravity: they are for a controller that adds gravity itself"
        )
    if kind == "link_torque":
        found.append(
            "torques are those on the link side: inertia and friction of the motors are not in them"
        )
    if identified.model.n_channels > len(identified.model.robot.passive):
        found.append(
            "friction with memory is zero at first from rest; a motion that begins moving is "
            "taken to have moved at that speed before"
        )
    if scales is not None:
        found.append(
            f"torques are those of the model: logged efforts are {scales.words} times as large "
            "(estimated effort scales)"
        )
    return tuple(found)
