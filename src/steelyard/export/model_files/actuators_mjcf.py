"""Identified actuators as MJCF: position actuators with delay, armature and dry friction."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from steelyard.actuators.actuator_model import ActuatorModel, ActuatorParameter, EffortGain
from steelyard.actuators.actuator_parameters import BY_NAME, UNLIMITED, ActuatorValues
from steelyard.actuators.actuator_words_and_tables import scale_source
from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import ModelError
from steelyard.export.model_files.representable_content import Content
from steelyard.export.model_files.urdf_and_mjcf import (
    comment,
    document,
    mjcf_of,
    number,
    numbers,
)
from steelyard.model.terms.term import AxisPartKind
from steelyard.report.words import significant

TIMESTEP = 2.5e-4  # of the file [s]: its springs are explicit in MuJoCo's integration
STIFF = {"solreffriction": "0.002 1", "solimpfriction": "0.999 0.9999 0.001 0.5 2"}
"""Dry friction that hardly creeps."""


DELAYED = (
    "Delays start with ctrl = 0: before the first step, mj_initCtrlHistory sets what was commanded "
    "before.",
)


@dataclass(frozen=True)
class ActuatorFile:
    """The text of a model file with actuators, and what it cannot represent, a sentence each."""

    text: str
    unsupported: tuple[str, ...]


def actuators_mjcf(model: ActuatorModel, units: Sequence[str] = ()) -> ActuatorFile:
    """An MJCF of the arm, whose `ctrl` are targets in the model's joints [rad; m].

    `units` are lines about other robots of the kind, for the head.

    Raises:
        ModelError: The fitted motion is outside the limits of the joints, which MuJoCo enforces.
    """
    refuse_beyond_limits(model)
    robot, values = model.identified_robot, model.values
    effects: list[dict[AxisPartKind, float]] = [
        {"rotor": float(a), "dry": float(f)} if f > 0.0 else {"rotor": float(a)}
        for a, f in zip(values["armature"], at_standstill(values), strict=True)
    ]
    lacks = unsupported(model, ("integral", "stribeck", "load_friction", "dead_band"))
    inertias = tuple(body.inertia for body in robot.bodies)
    root = mjcf_of(Content(robot, inertias, tuple(effects), (), (), lacks))
    for option in root.iter("option"):
        option.set("timestep", number(TIMESTEP))
    emfs = dict(zip(model.joints, values["back_emf"], strict=True))
    for joint in root.iter("joint"):
        joint.attrib.update(STIFF if joint.get("frictionloss") else {})
        joint.attrib.pop("actuatorfrcrange", None)  # a limit is what was identified, or stated
        if (emf := float(emfs.get(joint.get("name", ""), 0.0))) > 0.0:
            joint.set("damping", number(emf))
    motors = root.find("actuator")
    assert motors is not None
    for motor in list(motors):
        motors.remove(motor)
    for j, coordinate in enumerate(robot.coordinates):
        motors.append(_actuator(model, j, coordinate.name))
    more = (
        "Bodies have no shapes here: no meshes, no contacts.",
        f"The step is {TIMESTEP:g} s. With longer ones MuJoCo's explicit springs take half a step",
        "times kp from the damping.",
        *(DELAYED if np.any(values["delay"] >= TIMESTEP) else ("No delay was identified.",)),
    )
    head = head_lines(model, lacks, units, "MJCF", *more, target="ctrl", position="qpos")
    return ActuatorFile(document(root, comment("\n".join(head))), lacks)


def _actuator(model: ActuatorModel, j: int, name: str) -> ET.Element:
    values = model.values
    kp, kv = (number(float(values[key][j])) for key in ("stiffness", "damping"))
    found = ET.Element("position", name=name, joint=name, kp=kp, kv=kv)
    if (limit := float(values["torque_limit"][j])) < UNLIMITED:
        found.set("forcerange", numbers([-limit, limit]))
    if (delay := float(values["delay"][j])) >= TIMESTEP:
        found.set("delay", number(delay))
        found.set("nsample", str(ceil(delay / TIMESTEP) + 1))
    return found


def refuse_beyond_limits(model: ActuatorModel) -> None:
    """A `ModelError` where motion of the logs is outside of the joints' limits."""
    if model.beyond_limits:
        raise ModelError(
            f"sign or zero of {', '.join(model.beyond_limits)} cannot be right: motion of the logs "
            "is far beyond the limits of the model file",
            where=f"model of '{model.robot.name}'",
            fix="leave position_sign and position_offset out of the robot file, or correct them "
            "(`check` says which), and identify again",
        )


def at_standstill(values: ActuatorValues) -> Array:
    """Dry friction of each joint at rest `(n,)`, for simulators that have one size of it.

    On an SO-101, errors in MuJoCo are nearly half of those with the friction of fast motion.
    """
    return np.asarray(values["coulomb"] + values["stribeck"])


def unsupported(
    model: ActuatorModel, names: Sequence[str], friction: str = "frictionloss"
) -> tuple[str, ...]:
    """Parameters of the model that a format lacks, in words with their sizes.

    `friction` is what the format calls dry friction.
    """
    what = {
        "stribeck": f"dry friction that falls with speed: {friction} is that at standstill, in "
        "motion it is less by up to",
        "load_friction": "dry friction that grows with the motor's torque",
        "dead_band": "the controller's dead band",
        "integral": "the controller's integral gain",
        "mass_factor": "masses of the links behind the joints, over those of the model file",
        "back_emf": "a torque limit that falls with speed",
        "stribeck_speed": "the speed over which dry friction falls",
    }
    found = []
    if model.signals.supply:
        found.append("stiffness and torque limits that follow the supply voltage")
    for name in names:
        sizes = model.values[name]
        kind = BY_NAME[BY_NAME[name].part]
        if np.any(model.values[kind.name] != kind.default):
            listed = ", ".join(
                f"{joint} {significant(x)}" for joint, x in zip(model.joints, sizes, strict=True)
            )
            found.append(f"{what[name]} ({listed})")
    return tuple(found)


def head_lines(
    model: ActuatorModel,
    lacks: Sequence[str],
    units: Sequence[str],
    form: str,
    *more: str,
    target: str = "target of the actuator",
    position: str = "joint position",
) -> list[str]:
    """Where the numbers come from, how targets of the log become those of a file, and ranges.

    `form` names the format, `more` are lines about it.
    """
    origin = model.provenance
    return [
        f"{model.robot.name}: actuators identified with steelyard {origin.version} from targets "
        "and positions.",
        f"Runs: {', '.join(origin.runs) or 'unknown'}.",
        "Inputs, SHA-256:",
        *(f"  {role}: {value}" for role, value in origin.inputs.items()),
        "Masses and inertias are those of the model file, times the factors below where they are "
        "listed.",
        f"Scale: {scale_source(model)}.",
        *_target_lines(model, target, position),
        *more,
        "Parameters, with 95 % intervals. For domain randomisation draw one scale for all values",
        "of a joint, and the ratios to its stiffness: these are much sharper than the values.",
        *(_range(one) for one in model.parameters if one.status != "not in the law"),
        *(_gain(one) for one in model.efforts if one.value is not None),
        "Ratios to the stiffness, with 95 % intervals:",
        *_ratios(model),
        *units,
        f"{form} cannot represent these parts of the identified actuators:",
        *(f"  - {sentence}" for sentence in lacks or ("nothing",)),
    ]


def _target_lines(model: ActuatorModel, target: str, position: str) -> list[str]:
    """How targets and positions of the log become those of the model's joints, by their names."""
    values = model.values
    units = ["" if scale == 1.0 else f"{scale:.9g} * " for scale in model.signals.scale]
    return [
        "Targets and positions as the log has them, in the joints of this file [rad; m]; a target",
        "is held from row to row:",
        *(
            f"  {joint}: {target} = {values.signs[j]:+g} * ({units[j]}target "
            f"{values['offset'][j]:+.6g}) {values['zero'][j]:+.6g}, {position} = "
            f"{values.signs[j]:+g} * {units[j]}logged {values['zero'][j]:+.6g}"
            for j, joint in enumerate(model.joints)
        ),
    ]


def _range(one: ActuatorParameter) -> str:
    """A parameter with its interval, or where else it is from."""
    unit = f" {one.unit}" if one.unit != "1" else ""
    value = f"  {one.name} of {one.joint}: {significant(one.value)}{unit}"
    if one.interval is None:
        return f"{value}, {one.status}"
    low, high = (significant(x) for x in one.interval)
    said = {"not identifiable": ", wide: the logs do not show it", "assumed": ", assumed"}
    return f"{value} [{low}, {high}]{said.get(one.status, '')}"


def _gain(one: EffortGain) -> str:
    """Torque per logged effort, by which simulated torques become efforts."""
    low, high = (significant(x) for x in one.interval or (0.0, 0.0))
    within = f" [{low}, {high}]" if one.interval else f", {one.status}"
    return f"  torque per logged effort of {one.joint}: {significant(one.value)} {one.unit}{within}"


def _ratios(model: ActuatorModel) -> list[str]:
    found = []
    for j, joint in enumerate(model.joints):
        for name in ("damping", "back_emf", "coulomb", "stribeck", "armature"):
            if (ratio := model.ratio(name, j)) is not None:
                value, std = ratio
                low, high = (significant(value * np.exp(s * Z95 * std)) for s in (-1.0, 1.0))
                found.append(f"  {name} of {joint}: {significant(value)} [{low}, {high}]")
    return found
