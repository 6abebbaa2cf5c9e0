"""Constraints from the `[excitation]` tables."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.excitation.bases.families import per_joint
from steelyard.excitation.collision.collision import self_clearance
from steelyard.excitation.collision.whole_robot import load_balls
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.constraints.torque import EffortLimit, power_limit, torque_limit
from steelyard.excitation.constraints.torque import loaded as loaded_with
from steelyard.excitation.point_load import COUNTED, load_inertias
from steelyard.excitation.previous_model import Earlier
from steelyard.excitation.shapes.shapes import Shape
from steelyard.excitation.uncovered import Declined, Gap
from steelyard.excitation.workspace_tables import (
    ConstraintsAndNotes,
    workspace_of,
    world_of,
    written,
)
from steelyard.kernel.quantities.kinematics import last_frame
from steelyard.model import Model, ValuedModel
from steelyard.parameters import Parameters
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.robot.robot import Robot
from steelyard.robot_file.excitation_sections import ExcitationSection
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.terms.term import StatefulTerm


def constraints_of(
    loaded: LoadedRobot, model: Model, earlier: Earlier | None
) -> tuple[tuple[Constraint, ...], tuple[str, ...]]:
    """All that must hold at all times beside the limits of the joints, and what was assumed.

    Args:
        loaded: The robot and its tables.
        model: Its terms, with memory or without.
        earlier: What an earlier identification of the robot knows.

    Raises:
        ModelError: A frame or a shape is missing, or what must hold cannot be proven.
    """
    section = loaded.excitation
    found, notes = list[Constraint](), list[str]()
    world = world_of(loaded)
    for part, part_notes in (
        workspace_of(loaded, world),
        efforts_of(loaded, model, earlier),
        clearance_of(loaded, world),
    ):
        found += part
        notes += part_notes
    idle = not (section.criterion.relative or _seen(section) or _limited(found))
    if section.loads and idle:
        notes.append(
            "loads have no effect: neither torque nor workspace is limited, no criterion relative"
        )
    if loaded.robot.passive:
        notes.append(Gap("loop closure is checked at samples, not proven between them"))
    return tuple(found), tuple(notes)


def _limited(found: Sequence[Constraint]) -> bool:
    return any(isinstance(constraint, EffortLimit) for constraint in found)


def _seen(section: ExcitationSection) -> bool:
    """Whether workspace limits or the cell apply to loads."""
    limits_links = section.workspace is not None and section.workspace.limits_links
    return limits_links or (section.collision is not None and section.collision.world is not None)


def efforts_of(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> ConstraintsAndNotes:
    """Torque and power of the prior model, without and with every load.

    Raises:
        ModelError: Limits are requested, but torque is not known beforehand.
    """
    section = loaded.excitation
    wanted, robot = section.limits, model.robot
    own = np.array([joint.limits.effort for joint in robot.coordinates])
    given = own if wanted.effort in ("robot", "any") else None
    efforts = per_joint(None if given is not None else wanted.effort, robot, "effort", own)
    efforts = wanted.share * efforts
    powers = per_joint(wanted.power, robot, "power", np.full(robot.n, np.inf))
    requested = given is None or wanted.power is not None or wanted.total_power is not None
    limited = wanted.effort != "any" and bool(np.isfinite(efforts).any())
    free: list[str] = [Declined("torque is not limited, as specified")]
    notes = free if wanted.effort == "any" else _unlimited(robot, efforts)
    if not (limited or requested):
        return [], notes
    why = _unknown_efforts(loaded, model, earlier)
    if why is not None:
        if requested:
            raise ModelError(
                f"torque cannot be limited: {why}",
                where="[excitation.limits]",
                fix='leave out effort and power, or say effort = "any"',
            )
        return [], [Gap(f"torque is not limited: {why}")]
    cases = _cases(loaded, _memoryless(model), earlier)
    found = list[EffortLimit]()
    if limited:
        found.append(torque_limit(cases, efforts))
    if wanted.power is not None or wanted.total_power is not None:
        total = np.inf if wanted.total_power is None else wanted.total_power
        found.append(power_limit(cases, powers, total))
    source = (
        "of the earlier model" if earlier is not None else "of the model file, without friction"
    )
    sprung = not _stiffnesses(loaded).keys().isdisjoint(model.names)
    known = "masses and springs" if sprung else "masses"
    scope = f"{known} of the model file, without friction" if earlier is None else ""
    notes = [f"torques are limited with the values {source}", *notes]
    found = [replace(limit, scope=scope or "of the earlier model") for limit in found]
    return list(found), [*notes, COUNTED] if section.loads else notes


def _unlimited(robot: Robot, efforts: Array) -> list[str]:
    """A note that names the joints without a limit of effort, if there are any."""
    joints = zip(robot.joint_names, efforts, strict=True)
    free = ", ".join(f"'{name}'" for name, most in joints if not np.isfinite(most))
    text = f"torque is not limited for joints without a known effort limit: {free}"
    return [Gap(text)] if free else []


def _memoryless(model: Model) -> Model:
    kept = tuple(term for term in model.terms if not isinstance(term, StatefulTerm))
    return Model(model.robot, kept)


def _unknown_efforts(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> str | None:
    """Why torques are not known beforehand, if they are not.

    Without an earlier model no friction is known, so laws with memory then lack like all others.
    """
    if loaded.signals is not None and loaded.signals.effort_kind == "gravity_compensated_torque":
        return "the robot file's efforts are gravity compensated"
    if earlier is not None:
        for term in model.terms:
            if isinstance(term, StatefulTerm):
                return f"'{term.law}' has internal states"
    if model.robot.passive:
        return "the robot has closed chains"
    if not model.has_bodies:
        return "the model has no rigid bodies"
    if not any(body.known for body in model.robot.bodies):
        return "the model file gives no masses"
    return None


def _stiffnesses(loaded: LoadedRobot) -> dict[str, float]:
    """Values of the parameters of terms for the model file's springs, one per joint."""
    stiff = {f"spring.{name}": spring.stiffness for name, spring in loaded.springs.items()}
    return stiff | {
        f"spring_preload.{name}": spring.stiffness * spring.free
        for name, spring in loaded.springs.items()
    }


def _cases(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> dict[str, ValuedModel]:
    """The prior model, without and with every load; an earlier model replaces it wholly.

    What that one does not hold is zero: its values may be base parameters, which stand for others.
    """
    nominal: Mapping[str, float] = _stiffnesses(loaded) | {
        f"{name}.{body.name}": float(value)
        for body in model.robot.bodies
        for name, value in zip(INERTIAL_NAMES, body.inertia.ten, strict=True)
    }
    known = nominal if earlier is None else earlier.standard
    names = [name for name in model.names if name in known]
    units = [model.units[model.names.index(name)] for name in names]
    arm = model.at(Parameters(names, units, [known[name] for name in names]))
    cases = {"without load": arm}
    for number, load in enumerate(loaded.excitation.loads, start=1):
        frame = load.frame or last_frame(model.robot)
        for what, inertia in load_inertias(load).items():
            with written("loads] frame"):
                case = loaded_with(arm, frame, inertia)
            cases[f"with load {number}, {load.mass:g} kg {what}"] = case
    return cases


def clearance_of(loaded: LoadedRobot, world: tuple[Shape, ...] = ()) -> ConstraintsAndNotes:
    """That bodies do not touch each other or the world, where shapes say what they are.

    Loads whose radius is given are bodies, too.
    """
    section, loads = loaded.excitation.collision, loaded.excitation.loads
    bare = [f"{number}" for number, load in enumerate(loads, start=1) if load.radius is None]
    notes = list[str]()
    if bare and (section is None or section.bodies):
        notes.append(
            Gap(
                "loads without a radius are not checked against the robot's own links: load "
                + ", ".join(bare)
            )
        )
    balls = tuple(ball for ball, load in zip(load_balls(loaded), loads, strict=True) if load.radius)
    if section is None:
        try:
            found = self_clearance(loaded, others=balls)
        except ModelError as error:
            why = error.wrong[:1].lower() + error.wrong[1:]
            return [], [Gap(f"self-collisions are not checked: {why}")]
        return [found], [*found.notes, *notes]
    if not section.bodies:
        text = "self-collisions are not checked, as specified"
        notes.append(Declined(text))
    if not section.bodies and not world:
        return [], notes
    found = self_clearance(
        loaded,
        skip=section.without,
        margin=section.margin,
        others=(*balls, *world),
        ignore=section.ignore,
        bodies=section.bodies,
    )
    return [found], [*found.notes, *notes]
