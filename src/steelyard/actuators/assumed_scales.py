"""Joints whose stiffness nothing shows: their torques have the scale of the others' stiffness.

Positions determine what is over the stiffness; the stiffness itself is that of actuators which are
alike, and as uncertain as those differ from each other.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

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

SCALED = (
    "stiffness",
    "integral",
    "damping",
    "back_emf",
    "coulomb",
    "stribeck",
    "armature",
    "torque_limit",
)
"""Parameters that change with the unit of torque."""
LEAST_SPREAD = 0.1  # of logarithms of the stiffness of actuators of a type


def like_the_others(
    values: ActuatorValues,
    loaded: Sequence[int],
    kinds: Sequence[str],
    stated: Mapping[str, Array],
) -> ActuatorValues:
    """Joints without a scale of their own have the stiffness of those that have one.

    What is `stated` stays as it is, `(n,)` each, NaN where nothing is.
    """
    factor = np.ones(values.n)
    for j in range(values.n):
        if j not in loaded and (like := _like(j, loaded, kinds)):
            factor[j] = float(np.median(values["stiffness"][like])) / values["stiffness"][j]
    return scaled(values, factor, stated)


def scaled(
    values: ActuatorValues, factor: Array, stated: Mapping[str, Array] = MappingProxyType({})
) -> ActuatorValues:
    """Values with torques in another unit, by joint; what is `stated` stays as it is."""
    free = {name: np.isnan(stated.get(name, np.nan)) for name in SCALED}
    free["torque_limit"] = free["torque_limit"] & (values["torque_limit"] < UNLIMITED)
    return values.changed(
        **{name: values[name] * np.where(free[name], factor, 1.0) for name in SCALED}
    )


def _like(j: int, loaded: Sequence[int], kinds: Sequence[str]) -> list[int]:
    """Joints with a scale that are revolute, or prismatic, as this one is."""
    return [k for k in loaded if kinds[k] == kinds[j]]


def spread_of_stiffness(stiffness: Sequence[float], variance: Sequence[float]) -> float:
    """Standard deviation of the logarithm of the stiffness of one more actuator of a kind.

    By the scatter of some beyond the mean variance of their logarithms, widened as Student's
    distribution asks of so few, and this variance; at most what is assumed before any log.
    """
    most, number = BY_NAME["stiffness"].spread, len(stiffness)
    if number < 2:
        return most
    known = float(np.mean(variance))
    scatter = max(0.0, float(np.var(np.log(stiffness), ddof=1)) - known) * (1.0 + 1.0 / number)
    wider = float(student.ppf(0.975, number - 1)) / Z95
    return float(np.clip(np.sqrt(wider**2 * scatter + known), LEAST_SPREAD, most))


def with_assumed_scales(
    found: Fitted, assumed: Sequence[int], loaded: Sequence[int], kinds: Sequence[str]
) -> tuple[tuple[Free, ...], Array, Array]:
    """What was searched with the stiffness of joints `assumed`, covariance, and share known.

    The uncertainty of a joint's scale is in all that scales with it; ratios do not have it.
    """
    free = (*found.task.free, *(Free("stiffness", j) for j in assumed))
    p, place = len(found.task.free), {(one.name, one.joint): k for k, one in enumerate(free)}
    covariance = np.zeros((len(free), len(free)))
    covariance[:p, :p] = found.covariance
    for j in assumed:
        like = _like(j, loaded, kinds)
        at = [place.get(("stiffness", k), -1) for k in like]
        variance = [0.0 if k < 0 else float(found.covariance[k, k]) for k in at]
        spread = spread_of_stiffness(found.values["stiffness"][like].tolist(), variance)
        along = np.array([float(one.joint == j and one.name in SCALED) for one in free])
        covariance += spread**2 * np.outer(along, along)
    prior = np.array([one.kind.spread for one in free])
    others = [one.name != "stiffness" for one in found.task.free]  # that efforts do not show
    prior[:p] = np.where(others, found.task.spread, prior[:p])
    known = np.clip(1.0 - np.diag(covariance) / prior**2, 0.0, 1.0)
    return free, frozen(covariance), frozen(known)
