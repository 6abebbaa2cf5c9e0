"""From a robot file's `[excitation]` tables to the problem that they describe."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError, ModelError
from steelyard.estimate.information.base_parameters_and_regressor import (
    FAINT,
    base_parameters,
    clear_map,
)
from steelyard.excite.collision.clearance import self_clearance
from steelyard.excite.collision.shapes_given_or_assumed import load_balls
from steelyard.excite.collision.solids_and_shapes import Shape
from steelyard.excite.collision.workspace_from_tables import (
    ConstraintsAndNotes,
    workspace_of,
    world_of,
)
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import (
    EffortLimit,
    power_limit,
    torque_limit,
    with_payload,
)
from steelyard.excite.constraints.constraint_and_limits import (
    ACCELERATIONS_ASSUMED,
    Constraint,
    Declined,
    Gap,
    MotionLimits,
    motion_limits,
)
from steelyard.excite.criterion_from_tables import cases_of
from steelyard.excite.design_problem_and_information import (
    KEPT_PER_WAVE,
    Earlier,
    Problem,
)
from steelyard.excite.standing.forces_of_feet import LEAST_FORCES_NOTE, feet_forces
from steelyard.excite.standing.legs_follow_base import (
    RESERVE,
    LegLimits,
    Legs,
    OnAllJoints,
    limits_of_first,
)
from steelyard.excite.standing.standing_robot import tree_of
from steelyard.excite.trajectories.motion_families import basis_of, per_joint
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import StatefulTerm
from steelyard.robot.file.excitation_sections import (
    MotionLimitsSection,
    StanceSection,
)
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.tables_by_kind import at_place
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import BASE_COORDINATES, Robot

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
    if section.stance is not None:
        return _while_standing(loaded, section.stance)
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


def _while_standing(
    loaded: LoadedRobot, stance: StanceSection
) -> tuple[tuple[Constraint, ...], tuple[str, ...]]:
    """The constraints of all joints of a robot that stands, whose legs follow its base."""
    legs, section = Legs(loaded.robot), loaded.excitation
    whole, world, n = replace(loaded, robot=legs.tree), world_of(loaded), loaded.robot.n
    limits = limits_of(legs.tree, section.limits)
    most, left = greatest_efforts(legs.tree, section.limits)
    bending: list[Constraint] = [
        LegLimits(legs.tree, limits, tuple(range(n, legs.tree.n))),
        feet_forces(legs.tree, stance, loaded.robot.assembly, most[len(BASE_COORDINATES) :]),
    ]
    notes = [*limits.notes, LEAST_FORCES_NOTE, *left]
    found = [OnAllJoints(legs, one, RESERVE) for one in bending]
    for part, part_notes in (workspace_of(whole, world), clearance_of(whole, world)):
        found += [OnAllJoints(legs, one) for one in part]
        notes += part_notes
    return tuple(found), tuple(notes)


def greatest_efforts(
    robot: Robot, wanted: MotionLimitsSection
) -> tuple[Array, tuple[Declined, ...]]:
    """The share of effort limits that the motion may use, `(n,)`, and what is not limited."""
    if wanted.effort == "any":
        return np.full(robot.n, np.inf), (Declined("torque is not limited, as specified"),)
    own = np.array([joint.limits.effort for joint in robot.coordinates])
    given = None if wanted.effort == "robot" else wanted.effort
    return wanted.share * per_joint(given, robot, "effort", own), ()


def efforts_of(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> ConstraintsAndNotes:
    """Torque and power of the prior model, without and with every load."""
    section = loaded.excitation
    wanted, robot = section.limits, model.robot
    efforts, left = greatest_efforts(robot, wanted)
    powers = per_joint(wanted.power, robot, "power", np.full(robot.n, np.inf))
    powered = wanted.power is not None or wanted.total_power is not None
    requested = wanted.effort not in ("robot", "any") or powered
    limited = bool(np.isfinite(efforts).any())
    notes: list[str] = [*left]
    if not left and not np.isfinite(efforts).all():
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
    found = [torque_limit(cases, efforts)] if limited else []
    if powered:
        found.append(power_limit(cases, powers, wanted.total_power or np.inf))
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
        # what it is as a mass; between both torques are linear
        shell = SHELL_INERTIA * load.mass * load.ball**2
        for what, about_com in (
            ("as a point", np.zeros((3, 3))),
            (f"as a hollow sphere of {1e3 * load.ball:.3g} mm", shell * np.eye(3)),
        ):
            inertia = Inertia.about_com(load.mass, load.com, about_com)
            with at_place("[excitation.loads] frame"):
                case = with_payload(arm, load.frame, inertia)
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


RANGE_MARGIN = 0.02  # share of a joint's range kept free at each end, if no margin is given

Tables = tuple[LoadedRobot, Model, Earlier | None]
"""What `build` makes a problem of: another process gets it pickled, and builds it anew."""


def build(loaded: LoadedRobot, model: Model, earlier: Earlier | None = None) -> Problem:
    """The problem that a robot file's tables describe, for a kind of motion of `FAMILIES`.

    Raises:
        DataError: The tables do not fit the robot.
        ModelError: A frame or a shape is missing.
    """
    section = loaded.excitation
    basis = basis_of(section.motion, loaded.robot)
    on_feet, per_wave = section.stance is not None, KEPT_PER_WAVE
    limits = limits_of(tree_of(loaded.robot) if on_feet else loaded.robot, section.limits)
    if on_feet:
        per_wave *= 2  # legs bend at twice the frequencies of the base
        limits = limits_of_first(limits, loaded.robot.n)
    constraints, more = constraints_of(loaded, model, earlier)
    model, notes = memoryless(model)
    return Problem(
        loaded.robot,
        basis,
        limits,
        constraints,
        cases_of(section, model, limits, earlier),
        section.samples,
        (*limits.notes, *notes, *more),
        per_wave,
    )


def memoryless(model: Model) -> tuple[Model, tuple[str, ...]]:
    """The model without terms with internal states; notes on what the criterion lacks."""
    bare = without_memory(model)
    left = [term.law for term in model.terms if isinstance(term, StatefulTerm)]
    notes = [f"'{law}' has internal states: it is left out of the criterion" for law in left]
    clear = clear_map(bare).base_names
    if faint := [name for name in base_parameters(bare).base_names if name not in clear]:
        notes.append(
            "left out of the criterion, as at most "
            f"{100.0 * FAINT:g} % of their columns is independent of the others: {', '.join(faint)}"
        )
    return bare, tuple(notes)


def limits_of(robot: Robot, section: MotionLimitsSection) -> MotionLimits:
    """The limits of the robot, as the tables change, share and narrow them."""
    robot_limits = motion_limits(robot)
    notes = robot_limits.notes
    if section.acceleration is None:
        notes += (ACCELERATIONS_ASSUMED,)
    span = robot_limits.upper - robot_limits.lower
    margin = RANGE_MARGIN * span if section.position_margin is None else section.position_margin
    lower, upper = robot_limits.lower + margin, robot_limits.upper - margin
    for joint, low, high, whole in zip(robot.coordinates, lower, upper, span, strict=True):
        if not low < high:
            raise DataError(
                f"joint '{joint.name}' has a range of {whole:.4g} {joint.unit}: nothing remains "
                f"with a margin of {section.position_margin:g} {joint.unit} at each end",
                where="[excitation.limits] position_margin",
                fix=f"give a margin below {0.5 * whole:.4g}, or lock the joint",
            )
    velocity = per_joint(section.velocity, robot, "velocity", robot_limits.velocity)
    if faster := [
        f"{joint.name} {most:.3g} against {joint.limits.velocity:.3g} {joint.unit}/s"
        for joint, most in zip(robot.coordinates, section.share * velocity, strict=True)
        if most > joint.limits.velocity > 0.0
    ]:
        text = "the model file's speed limits are exceeded, as velocity sets higher ones: "
        notes += (Declined(text + ", ".join(faster)),)
    acceleration = per_joint(section.acceleration, robot, "acceleration", robot_limits.acceleration)
    stated = {"velocity": section.velocity, "acceleration": section.acceleration}
    given = {
        (quantity, name)
        for quantity, own in stated.items()
        for name in (own if isinstance(own, dict) else () if own is None else robot.joint_names)
    }
    jerk = None
    if section.jerk is not None:
        jerk = section.share * per_joint(section.jerk, robot, "jerk", np.full(robot.n, 1e6))
    return MotionLimits(
        lower,
        upper,
        section.share * velocity,
        section.share * acceleration,
        notes,
        jerk,
        section.share,
        robot_limits.assumed - given,
    )
