"""From a robot file's `[excitation]` tables to the problem that they describe."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, refuse_unknown
from steelyard.estimate.information.base_parameters_and_regressor import (
    FAINT,
    BaseMap,
    base_parameters,
    clear_map,
)
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import payload_numbers
from steelyard.excite.constraints.constraint import Declined
from steelyard.excite.constraints.constraints_from_tables import constraints_of, without_memory
from steelyard.excite.constraints.motion_limits import (
    ACCELERATIONS_ASSUMED,
    MotionLimits,
    motion_limits,
)
from steelyard.excite.design_problem_and_information import Case, InformationEvaluator, Problem
from steelyard.excite.earlier_model import Earlier
from steelyard.excite.optimality_criteria import CRITERIA, Measure
from steelyard.excite.trajectories.motion_families import basis_of, per_joint
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import Model
from steelyard.model.terms.term import StatefulTerm
from steelyard.robot.file.excitation_sections import (
    CriterionSection,
    ExcitationSection,
    LoadSection,
    MotionLimitsSection,
)
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

JUMP_SOFTNESS = 0.01  # width within which jumping laws turn while optimising, over the top speed
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
    limits = limits_of(loaded.robot, section.limits)
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
    share = RANGE_MARGIN * span
    margin = share if section.position_margin is None else np.full(robot.n, section.position_margin)
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


def cases_of(
    section: ExcitationSection, model: Model, limits: MotionLimits, earlier: Earlier | None
) -> tuple[Case, ...]:
    """What the motion shows and how it is judged, once per load.

    What torque shows does not depend on the load, but sizes of parameters do: loads count where
    the criterion is relative to them.
    """
    wanted = section.criterion
    wrong, where = f"there is no criterion '{wanted.kind}'", "[excitation.criterion] kind"
    refuse_unknown(wanted.kind, CRITERIA, wrong, where, "criteria", DataError)
    absent = absent_of(wanted, model, earlier)
    weights = weights_of(wanted, model.robot, earlier)
    shows = InformationEvaluator(model, weights, JUMP_SOFTNESS * limits.velocity, absent)
    chosen = None if wanted.chosen is None else _chosen(wanted.chosen, model, shows.base)
    prior = None
    if wanted.after_earlier:
        prior = _needed(earlier, "after_earlier").information(shows.base, absent)
    if not wanted.relative:
        return (Case(shows, Measure(CRITERIA[wanted.kind], prior, chosen)),)
    known = _needed(earlier, "relative")
    sizes = [sizes_of(known, model, shows.base, load) for load in (None, *section.loads)]
    return tuple(Case(shows, Measure(CRITERIA[wanted.kind], prior, chosen, s)) for s in sizes)


def weights_of(wanted: CriterionSection, robot: Robot, earlier: Earlier | None) -> Array:
    """Weights of the joints, shape `(n,)`: given, all the same, or one over the noise."""
    where = "[excitation.criterion] weights"
    if isinstance(wanted.weights, tuple):
        if len(wanted.weights) != robot.n or min(wanted.weights) < 0.0 or not any(wanted.weights):
            raise DataError(
                f"the weights {list(wanted.weights)} do not fit {robot.n} joints",
                where=where,
                fix="give one number per joint, none of them negative, some above zero",
            )
        if wanted.after_earlier:
            raise DataError(
                "weights of the joints are given, but earlier runs are weighted by their noise",
                where=where,
                fix="leave out the weights, or after_earlier",
            )
        return frozen(wanted.weights)
    if wanted.weights == "noise":
        return _needed(earlier, "weights").weights
    if wanted.after_earlier:
        return _needed(earlier, "after_earlier").weights
    return np.ones(robot.n)


def absent_of(wanted: CriterionSection, model: Model, earlier: Earlier | None) -> tuple[str, ...]:
    """Base parameters that the model does without."""
    base = clear_map(model)
    if wanted.without is None:
        removed = () if earlier is None else earlier.removed
        return tuple(name for name in base.base_names if name in removed)
    found = _named(wanted.without, model, base, "without")
    if found >= set(base.base_names):
        raise DataError(
            "the model would do without all of its parameters",
            where="[excitation.criterion] without",
            fix="name fewer laws or parameters",
        )
    return tuple(name for name in base.base_names if name in found)


def sizes_of(earlier: Earlier, model: Model, base: BaseMap, load: LoadSection | None) -> Array:
    """Sizes of the base parameters with a load, no smaller than twice their uncertainty, `(b,)`."""
    standard = np.array([earlier.standard.get(name, 0.0) for name in model.names])
    if load is not None:
        point = Inertia.about_com(load.mass, load.com, np.zeros((3, 3)))
        added = payload_numbers(model.robot, load.frame or last_frame(model.robot), point)
        for name, value in added.items():
            if name in model.names:
                standard[model.names.index(name)] += value
    values = np.abs(base.base_values(standard))
    std = dict(zip(earlier.names, np.sqrt(np.diag(earlier.covariance)), strict=True))
    least = np.array([2.0 * std.get(name, 0.0) for name in base.base_names])
    sizes = np.maximum(values, least)
    for name, size in zip(base.base_names, sizes, strict=True):
        if not size > 0.0:
            raise DataError(
                f"the earlier model has no value of '{name}'",
                where="[excitation.criterion] relative",
                fix="give an earlier model with the same terms, or leave 'relative' out",
            )
    return np.asarray(sizes)


def _needed(earlier: Earlier | None, key: str) -> Earlier:
    if earlier is None:
        raise DataError(
            f"'{key}' needs an earlier model, and none is given",
            where=f"[excitation.criterion] {key}",
            fix="add --earlier MODEL.json, which `steelyard identify` wrote",
        )
    return earlier


def _named(wanted: Sequence[str], model: Model, base: BaseMap, key: str) -> set[str]:
    """Names of base parameters that are named, or belong to a law that is."""
    first, laws = 0, dict[str, set[str]]()
    for term in model.terms:
        count = len(term.parameters(model.robot))
        laws.setdefault(term.law, set()).update(model.names[first : first + count])
        first += count
    found = set[str]()
    for name in wanted:
        wrong = f"'{name}' is neither a law nor a base parameter of the model"
        known, where = [*laws, *base.base_names], f"[excitation.criterion] {key}"
        refuse_unknown(name, known, wrong, where, "laws and parameters", DataError)
        found |= laws.get(name, {name})
    return found


def _chosen(wanted: Sequence[str], model: Model, base: BaseMap) -> tuple[int, ...]:
    found = _named(wanted, model, base, "chosen")
    if not found & set(base.base_names):
        laws = [term.law for term in model.terms]
        raise DataError(
            f"none of the chosen parameters is identifiable from torque: {list(wanted)}",
            where="[excitation.criterion] chosen",
            fix="choose laws or parameters among "
            + ", ".join(dict.fromkeys([*laws, *base.base_names])),
        )
    return tuple(k for k, name in enumerate(base.base_names) if name in found)
