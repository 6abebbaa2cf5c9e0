"""Constraints of a motion from the `[excitation]` tables: efforts with loads, clearance."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.excite.collision.clearance import self_clearance
from steelyard.excite.collision.shape_kinematics import Shape
from steelyard.excite.collision.shapes_given_or_assumed import load_balls
from steelyard.excite.collision.workspace_from_tables import (
    ConstraintsAndNotes,
    workspace_of,
    world_of,
    written,
)
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import (
    EffortLimit,
    power_limit,
    torque_limit,
    with_payload,
)
from steelyard.excite.constraints.constraint import Constraint, Declined, Gap
from steelyard.excite.earlier_model import Earlier
from steelyard.excite.trajectories.motion_families import per_joint
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import StatefulTerm
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia

SHELL_INERTIA = 2.0 / 3.0  # of a hollow ball about its centre, over its mass and its radius squared

LOADS_COUNTED = (
    "torques hold for loads of any inertia from a point mass to a hollow sphere of the load's "
    "radius about its centre of mass, alike about all axes; not for an elongated one"
)


def constraints_of(
    loaded: LoadedRobot, model: Model, earlier: Earlier | None
) -> tuple[tuple[Constraint, ...], tuple[str, ...]]:
    """All that must hold at all times beside the limits of the joints, and what was assumed.

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
    space, collision = section.workspace, section.collision
    used = section.criterion.relative or any(isinstance(c, EffortLimit) for c in found)
    used |= space is not None and space.limits_links
    used |= collision is not None and collision.world is not None
    if section.loads and not used:
        notes.append(
            "loads have no effect: neither torque nor workspace is limited, no criterion relative"
        )
    if loaded.robot.passive:
        notes.append(Gap("loop closure is checked at samples, not proven between them"))
    return tuple(found), tuple(notes)


def efforts_of(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> ConstraintsAndNotes:
    """Torque and power of the prior model, without and with every load."""
    section = loaded.excitation
    wanted, robot = section.limits, model.robot
    own = np.array([joint.limits.effort for joint in robot.coordinates])
    given = own if wanted.effort in ("robot", "any") else None
    efforts = per_joint(None if given is not None else wanted.effort, robot, "effort", own)
    efforts = wanted.share * efforts
    powers = per_joint(wanted.power, robot, "power", np.full(robot.n, np.inf))
    requested = given is None or wanted.power is not None or wanted.total_power is not None
    limited = wanted.effort != "any" and bool(np.isfinite(efforts).any())
    notes = list[str]()
    if wanted.effort == "any":
        notes.append(Declined("torque is not limited, as specified"))
    elif not np.isfinite(efforts).all():
        joints = zip(robot.joint_names, efforts, strict=True)
        free = ", ".join(f"'{name}'" for name, most in joints if not np.isfinite(most))
        notes.append(Gap(f"torque is not limited for joints without a known effort limit: {free}"))
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
    cases = _load_cases(loaded, without_memory(model), earlier)
    found = list[EffortLimit]()
    if limited:
        found.append(torque_limit(cases, efforts))
    if wanted.power is not None or wanted.total_power is not None:
        total = np.inf if wanted.total_power is None else wanted.total_power
        found.append(power_limit(cases, powers, total))
    source = scope = "of the earlier model"
    if earlier is None:
        source = "of the model file, without friction"
        sprung = not _stiffnesses(loaded).keys().isdisjoint(model.names)
        scope = f"{'masses and springs' if sprung else 'masses'} {source}"
    notes = [f"torques are limited with the values {source}", *notes]
    found = [replace(limit, scope=scope) for limit in found]
    return list(found), [*notes, LOADS_COUNTED] if section.loads else notes


def without_memory(model: Model) -> Model:
    """The model without terms with internal states."""
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


def _load_cases(
    loaded: LoadedRobot, model: Model, earlier: Earlier | None
) -> dict[str, ValuedModel]:
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
        # what it is as a mass; between both torques are linear
        shell = SHELL_INERTIA * load.mass * load.ball**2
        for what, about_com in (
            ("as a point", np.zeros((3, 3))),
            (f"as a hollow sphere of {1e3 * load.ball:.3g} mm", shell * np.eye(3)),
        ):
            inertia = Inertia.about_com(load.mass, load.com, about_com)
            with written("loads] frame"):
                case = with_payload(arm, frame, inertia)
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
        text = "loads without a radius are not checked against the robot's own links: load "
        notes.append(Gap(text + ", ".join(bare)))
    balls = tuple(ball for ball, load in zip(load_balls(loaded), loads, strict=True) if load.radius)
    if section is None:
        try:
            found = self_clearance(loaded, others=balls)
        except ModelError as error:
            why = error.wrong[:1].lower() + error.wrong[1:]
            return [], [Gap(f"self-collisions are not checked: {why}")]
        return [found], [*found.notes, *notes]
    if not section.bodies:
        notes.append(Declined("self-collisions are not checked, as specified"))
        if not world:
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
