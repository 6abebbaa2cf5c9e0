"""A found motion on feet as the motion of all joints: what is proven, written and told of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.constraints.constraint_and_limits import Constraint, MotionLimits
from steelyard.excite.standing.forces_of_feet import FeetForces, weight_of, zero_moment_margin
from steelyard.excite.standing.legs_follow_base import LegLimits, OnAllJoints
from steelyard.excite.standing.standing_robot import places_of_feet
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, PiecewiseMotion
from steelyard.robot.file.excitation_sections import StanceSection
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import Robot

_SAMPLES = 2000  # of a motion, at which the zero-moment point is told


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """The tree's robot, its motion, limits, constraints with what is proven of each, and notes."""

    loaded: LoadedRobot
    limits: MotionLimits
    trajectory: PiecewiseMotion
    constraints: tuple[Constraint, ...]
    proven: tuple[Array, ...]
    notes: tuple[str, ...]


def whole_motion(
    loaded: LoadedRobot,
    trajectory: ExactTrajectory,
    constraints: Sequence[Constraint],
    proven: Sequence[Array],
) -> WholeMotion:
    """Of a motion of the independent joints and its constraints, limits and forces first."""
    on_all = [one for one in constraints if isinstance(one, OnAllJoints)]
    legs, limits = on_all[0].legs, on_all[0].inner
    inner = tuple(one.inner for one in on_all[1:])
    forces = inner[0]
    assert isinstance(limits, LegLimits) and isinstance(forces, FeetForces)
    motion = legs.motion(trajectory)
    inside = 1e3 * zero_moment_margin(forces, motion, _SAMPLES)
    note = (
        f"the zero-moment point stays {inside:.0f} mm or more inside the support polygon (samples; "
        "that it stays inside follows from the loads of the feet); polynomials between "
        f"{len(motion.edges)} times move the feet by {1e6 * legs.slip(motion):.2g} µm at most "
        "(middles of the polynomials)"
    )
    whole = replace(loaded, robot=legs.tree)
    return WholeMotion(whole, limits.limits, motion, inner, tuple(proven[1:]), (note,))


def loads_of_base(tree: Robot, stance: StanceSection) -> Array:
    """Sizes of forces and moments on the base, `(6,)` [N, Nm]: the weight, and over the feet."""
    places = places_of_feet(tree, stance, tree.assembly)[:, :2]
    across = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())
    return weight_of(tree) * np.array([1.0, 1.0, 1.0, across, across, across])
