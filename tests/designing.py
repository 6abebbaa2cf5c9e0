"""Small design problems: an arm of three joints, with or without constraints on its tool."""

from collections.abc import Sequence

import numpy as np

from invented import dh_arm
from steelyard.base.arrays import Array, Parameters
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import torque_limit
from steelyard.excite.constraints.constraint_and_limits import Constraint, MotionLimits
from steelyard.excite.constraints.tool_workspace import Marker, tool_box
from steelyard.excite.design_problem_and_information import Case, InformationEvaluator, Problem
from steelyard.excite.optimality_criteria import CRITERIA
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints
from steelyard.excite.trajectories.motion_families import (
    Basis,
    blended_fourier,
    ramped_fourier,
    raw_fourier,
    reaching,
    rest_fourier,
    splines,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model, ValuedModel

ARM = dh_arm()
MODEL = Model(ARM, (RigidBody(), Coulomb(), Viscous()))
START, END = np.array([0.1, -0.05, 0.45]), np.array([-0.3, 0.25, 0.15])
MIDDLE = np.array([-0.1, 0.1, 0.3])
FAMILIES: dict[str, Basis] = {
    "rest": rest_fourier(3, 8.0, 4),
    "rest, from": rest_fourier(3, 8.0, 3, START),
    "rest, from to": rest_fourier(3, 8.0, 4, START, END),
    "raw": raw_fourier(3, 8.0, 3),
    "blended": blended_fourier(3, 6.0, 3, 2, 1.5),
    "blended, from": blended_fourier(3, 6.0, 3, 1, 1.5, START),
    "ramped": ramped_fourier(3, 8.0, 3, 1, 2.0),
    "ramped, from": ramped_fourier(3, 8.0, 3, 1, 4.0, START),
    "cubic": splines(3, 8.0, 10, 3),
    "quintic, from": splines(3, 8.0, 14, 5, START),
    "quintic, from to": splines(3, 8.0, 14, 5, START, END),
    "reaching": reaching(3, 4, 1.6, 0.2),
    "reaching, from": reaching(3, 3, 1.6, 0.2, START),
}


def limits(jerk: bool = False) -> MotionLimits:
    """Not the same for any two joints, nor about zero."""
    return MotionLimits(
        lower=[-1.4, -0.9, -1.0],
        upper=[1.2, 1.1, 1.6],
        velocity=[1.2, 1.5, 2.0],
        acceleration=[4.0, 5.0, 7.0],
        jerk=[20.0, 30.0, 40.0] if jerk else None,
    )


def box(share: float = 1.0) -> Constraint:
    """Walls around the tool's place in the middle posture; shut at a share of zero."""
    still = MIDDLE[None]
    tool = Marker(ARM.bodies[-1].name, (0.3, 0.0, 0.1), 0.02)
    probe = tool_box(ARM, tool, [0.0] * 3, [None] * 3)
    middle = probe.margins(still, still, still).values[0] + 0.02
    reach = 0.02 + share * np.array([0.3, 0.35, 0.25])
    return tool_box(ARM, tool, list(middle - reach), list(middle + reach))


def torques(share: float = 1.0) -> Constraint:
    """Efforts of the bodies as they are, with dry friction."""
    values = [0.2 if p.prior is None else p.prior for p in MODEL.parameters]
    arm = ValuedModel(MODEL, Parameters(MODEL.names, MODEL.units, values))
    return torque_limit({"arm": arm}, share * np.array([2.5, 18.0, 4.5]))


def problem(
    basis: Basis,
    constraints: Sequence[Constraint] = (),
    *,
    kind: str = "condition",
    jerk: bool = False,
) -> Problem:
    """The arm's problem."""
    bounds = limits(jerk)
    shows = InformationEvaluator(MODEL, np.ones(3), 0.01 * bounds.velocity)
    return Problem(ARM, basis, bounds, constraints, (Case(shows, CRITERIA[kind]),))


def random_starts(
    inequalities: InequalityConstraints, random: np.random.Generator, count: int
) -> list[Array]:
    """Motions of all joints at once that keep all margins."""
    return list(each_start(inequalities, random, count))
