"""Whether the torques of an identified model can be commanded."""

import numpy as np

from steelyard.errors import ModelError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.robot.robot import Robot
from steelyard.validation.headline import known_efforts


def refuse_unknown_gains(identified: IdentifiedModel) -> None:
    """Efforts of the model are torques.

    Raises:
        ModelError: A drive gain is unknown or relative, so that they are torques up to a factor
            only.
    """
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
    """The model is one of a robot that is controlled by joint torques.

    Raises:
        ModelError: It has other joints, or another gravity.
    """
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


def remarks(identified: IdentifiedModel) -> tuple[str, ...]:
    """What the torques of the model leave out, a sentence each."""
    found = []
    if identified.signals.effort_kind == "gravity_compensated_torque":
        found.append(
            "torques are without gravity: they are for a controller that adds gravity itself"
        )
    if identified.signals.effort_kind == "link_torque":
        found.append(
            "torques are those on the link side: inertia and friction of the motors are not in them"
        )
    if identified.model.n_channels > len(identified.model.robot.passive):
        found.append(
            "friction with memory is zero at first from rest; a motion that begins moving is "
            "taken to have moved at that speed before"
        )
    if identified.effort_scales is not None:
        factors = identified.effort_scales.words
        found.append(
            f"torques are those of the model: logged efforts are {factors} times as large "
            "(estimated effort scales)"
        )
    return tuple(found)
