"""Joints that gravity hardly loads: their torques have the scale of the other joints' stiffness.

Positions determine what is over the stiffness; the stiffness itself is that of actuators which are
alike, and as uncertain as those differ from each other.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from steelyard.actuators.actuator_parameters import (
    BY_NAME,
    UNLIMITED,
    ActuatorValues,
    Free,
)
from steelyard.actuators.fit import Fitted
from steelyard.base.arrays import Z95, Array, frozen

SCALED = ("stiffness", "damping", "back_emf", "coulomb", "stribeck", "armature", "torque_limit")
"""Parameters that change with the unit of torque."""


def like_the_others(values: ActuatorValues, loaded: Sequence[int]) -> ActuatorValues:
    """Joints without a scale of their own have the stiffness of those that gravity loads."""
    if not loaded:
        return values
    usual = float(np.median(values["stiffness"][list(loaded)]))
    factor = np.ones(values.n)
    rest = [j for j in range(values.n) if j not in loaded]
    factor[rest] = usual / values["stiffness"][rest]
    found = {name: values[name] * factor for name in SCALED}
    limit = np.minimum(found.pop("torque_limit"), UNLIMITED)
    return values.changed(torque_limit=limit, **found)


def spread_of_stiffness(values: ActuatorValues, loaded: Sequence[int]) -> float:
    """Standard deviation of the logarithm of the stiffness of one more actuator of the kind.

    By that of the joints `loaded`, widened as Student's distribution asks of so few; at most what
    is assumed of an actuator before any log.
    """
    most, count = BY_NAME["stiffness"].spread, len(loaded)
    if count < 2:
        return most
    spread = float(np.std(np.log(values["stiffness"][list(loaded)]), ddof=1))
    wider = float(student.ppf(0.975, count - 1)) / Z95
    return min(most, spread * float(np.sqrt(1.0 + 1.0 / count)) * wider)


def with_assumed_scales(
    found: Fitted, assumed: Sequence[int], loaded: Sequence[int]
) -> tuple[tuple[Free, ...], Array, Array]:
    """What was searched with the stiffness of joints `assumed`, covariance, and share known.

    The uncertainty of a joint's scale is in all that scales with it; ratios do not have it.
    """
    free = (*found.task.free, *(Free("stiffness", j) for j in assumed))
    p, spread = len(found.task.free), spread_of_stiffness(found.values, loaded)
    covariance = np.zeros((len(free), len(free)))
    covariance[:p, :p] = found.covariance
    for j in assumed:
        along = np.array([float(one.joint == j and one.name in SCALED) for one in free])
        covariance += spread**2 * np.outer(along, along)
    prior = np.array([one.kind.spread for one in free])
    prior[:p] = found.task.spread
    known = np.clip(1.0 - np.diag(covariance) / prior**2, 0.0, 1.0)
    return free, frozen(covariance), frozen(known)
