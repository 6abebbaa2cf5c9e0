"""From `[excitation.criterion]` of a robot file to what a motion shows and how it is judged."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, refuse_unknown
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap, clear_map
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import payload_numbers
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.design_problem_and_information import Case, Earlier, InformationEvaluator
from steelyard.excite.optimality_criteria import CRITERIA, measure
from steelyard.excite.standing.information_on_feet import InformationOnFeet
from steelyard.excite.standing.standing_robot import tree_of
from steelyard.model.model import Model
from steelyard.robot.file.excitation_sections import (
    CriterionSection,
    ExcitationSection,
    LoadSection,
)
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

JUMP_SOFTNESS = 0.01  # width within which jumping laws turn while optimising, over the top speed


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
    on_feet = section.stance is not None
    weights = weights_of(wanted, tree_of(model.robot) if on_feet else model.robot, earlier)
    kind = InformationEvaluator if not on_feet else InformationOnFeet
    shows = kind(model, weights, JUMP_SOFTNESS * limits.velocity, absent)
    chosen = None if wanted.chosen is None else _chosen(wanted.chosen, model, shows.base)
    prior = None
    if wanted.after_earlier:
        prior = _needed(earlier, "after_earlier").information(shows.base, absent)
    sizes: list[Array | None] = [None]
    if wanted.relative:
        known = _needed(earlier, "relative")
        sizes = [sizes_of(known, model, shows.base, load) for load in (None, *section.loads)]
    return tuple(Case(shows, measure(CRITERIA[wanted.kind], prior, chosen, s)) for s in sizes)


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
        added = payload_numbers(model.robot, load.frame, point)
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
    laws, found = dict[str, set[str]](), set[str]()
    for term in model.terms:
        own = (parameter.name for parameter in term.parameters(model.robot))
        laws.setdefault(term.law, set()).update(own)
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
