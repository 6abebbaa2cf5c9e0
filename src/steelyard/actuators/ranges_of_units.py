r"""Ranges of actuators over several robots of a kind, such as domain randomisation draws from.

With values $y_i$ of $k$ robots, their mean $\bar y$ and standard deviation $s$, the value that
one more robot's log would show is, in 95 % of the cases, within

$$ \bar y \pm t_{k-1}\, s \sqrt{1 + 1/k}. $$

The scatter contains errors of the values, and is no smaller than these say, so that the range of
the values themselves is smaller, if anything. Robots differ where values scatter more than their
own intervals explain (chi-squared, 95 %). Positive values are taken by their logarithms.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from steelyard.actuators.actuator_model import ActuatorModel, load_actuators
from steelyard.actuators.actuator_parameters import BY_NAME
from steelyard.actuators.choice import WIDE
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.report.words import significant

OF_A_LOG = ("zero", "offset")
"""Parameters that are of one robot's encoder and log, and say nothing of another one."""
FEW = 4  # robots, below which ranges say little
OVER_STIFFNESS = ("damping", "back_emf", "coulomb", "stribeck", "armature")
"""Parameters whose ratios to the stiffness need no masses."""


@dataclass(frozen=True)
class UnitRange:
    """Where 95 % of robots of a kind have a value.

    Attributes:
        name: The parameter, or `NAME / stiffness`.
        joint: Its joint, or `all`.
        unit: Its unit.
        middle: Of the robots' values.
        low: Lower end.
        high: Upper end.
        differ: Whether robots differ by more than their intervals explain.
        units: Number of robots whose logs show it.
    """

    name: str
    joint: str
    unit: str
    middle: float
    low: float
    high: float
    differ: bool
    units: int


def ranges_of_units(models: Sequence[str | Path | ActuatorModel]) -> tuple[UnitRange, ...]:
    """Of all values, and ratios to the stiffness, that logs of two robots show, or more.

    Args:
        models: Identified actuators of robots of one kind, each from its own logs.

    Raises:
        ModelError: There is one model only, joints differ, or two are of the same log.

    Example:
        >>> found = ranges_of_units(["servo-model", "other-servo-model"])
        >>> found[0].name, found[0].low < found[0].middle < found[0].high
        ('stiffness', True)
    """
    known = [load_actuators(one) for one in models]
    _refuse(known)
    return tuple(_ranges(known))


def words_of_ranges(ranges: Sequence[UnitRange], models: Sequence[ActuatorModel]) -> list[str]:
    """The ranges, a line each, and what they rest on."""
    return [
        f"Over {len(models)} robots: middle and the range that holds 95 % of robots of this kind,",
        "if they scatter as the values of these do:",
        *(
            f"  {one.name} of {one.joint}: {significant(one.middle)} [{significant(one.low)}, "
            f"{significant(one.high)}] {one.unit}, {one.units} robots"
            + ", which differ"
            * one.differ
            for one in ranges
        ),
        *qualified(models),
    ]


def qualified(models: Sequence[ActuatorModel]) -> list[str]:
    """What keeps values of these models from being compared, a sentence each."""
    laws = [
        {(p.name, p.joint) for p in one.parameters if p.interval or p.status == "stated"}
        for one in models
    ]
    named = {x for law in laws for x in law if x[0] not in OF_A_LOG}
    several = sorted({x[0] for x in named if not all(x in law for law in laws)})
    bodies = [np.array([b.inertia.ten for b in one.robot.bodies]) for one in models]
    found = []
    if several:
        found.append(
            f"Laws of these robots differ ({', '.join(several)}), and values of one law are not "
            "those of another: state the same parts of [actuator] for all to compare them."
        )
    if any(x.shape != bodies[0].shape or not np.allclose(x, bodies[0]) for x in bodies):
        found.append("Their model files have other masses, which give torques their scale.")
    if len(models) < FEW:
        found.append(f"Below {FEW} robots ranges are wide: little is known of one more.")
    return found


def _refuse(models: Sequence[ActuatorModel]) -> None:
    first = models[0]
    where = ", ".join(f"model of '{one.robot.name}'" for one in models)
    if len(models) < 2:
        raise ModelError(
            "one robot shows no spread between robots", where=where, fix="give two models or more"
        )
    for one in models[1:]:
        if one.joints != first.joints:
            raise ModelError(
                f"their joints are {', '.join(one.joints)}, and not {', '.join(first.joints)}",
                where=where,
                fix="give models of robots of one kind, with the joints in one order",
            )
    logs = [_logs(one) for one in models]
    if any(a & b for k, a in enumerate(logs) for b in logs[:k]):
        raise ModelError(
            "two of them are identified from the same log",
            where=where,
            fix="give one model of each robot, from its own logs",
        )


def _logs(model: ActuatorModel) -> set[str]:
    """Hashes of the logs that were fitted."""
    return {
        value
        for role, value in model.provenance.inputs.items()
        if role.startswith("identification ")
    }


def _ranges(models: Sequence[ActuatorModel]) -> Iterator[UnitRange]:
    every = [
        {(p.name, p.joint): p for p in one.parameters if p.status in ("identified", "stated")}
        for one in models
    ]
    for name, joint in dict.fromkeys(key for found in every for key in found):
        if name in OF_A_LOG:
            continue
        values = [
            (p.value, _std(model, name, joint))
            for found, model in zip(every, models, strict=True)
            if (p := found.get((name, joint))) and (p.value > 0.0 or not BY_NAME[name].positive)
        ]
        unit = next(found[name, joint].unit for found in every if (name, joint) in found)
        if len(values) > 1:
            yield _range(name, joint, unit, values, BY_NAME[name].positive)
    for joint in models[0].joints:
        for name in OVER_STIFFNESS:
            j = models[0].joints.index(joint)
            ratios = [
                found
                for model in models
                if (found := model.ratio(name, j)) and found[0] > 0.0 and found[1] < WIDE
            ]
            if len(ratios) > 1:
                unit = f"{BY_NAME[name].unit} per {BY_NAME['stiffness'].unit}"
                yield _range(f"{name} / stiffness", joint, unit, ratios, True)


def _std(model: ActuatorModel, name: str, joint: str) -> float:
    """In the coordinate of the search; 0 of what is stated."""
    number = -1 if joint == "all" else model.joints.index(joint)
    place = {(one.name, one.joint): k for k, one in enumerate(model.free)}
    at = place.get((name, number))
    return 0.0 if at is None else float(np.sqrt(model.covariance[at, at]))


def _range(
    name: str, joint: str, unit: str, values: Sequence[tuple[float, float]], positive: bool
) -> UnitRange:
    y, std = np.array(values, dtype=float).T
    if positive:
        y = np.log(np.maximum(y, 1e-12))
    middle, half, differ = range_of(y, std)
    low, high = middle - half, middle + half
    if positive:
        middle, low, high = (float(np.exp(x)) for x in (middle, low, high))
    if name == "delay":
        low = max(low, 0.0)
    return UnitRange(name, joint, unit, middle, low, high, differ, len(y))


def range_of(y: Array, std: Array) -> tuple[float, float, bool]:
    """Middle and half range of values `(k,)`, and whether they differ beyond their `std`."""
    k = len(y)
    spread = max(float(y.std(ddof=1)), float(np.sqrt(np.mean(std**2))))
    half = student.ppf(0.975, k - 1) * spread * np.sqrt(1.0 + 1.0 / k)
    weight = np.maximum(std, 1e-9) ** -2.0
    apart = weight @ (y - weight @ y / weight.sum()) ** 2
    return float(y.mean()), float(half), bool(apart > chi2.ppf(0.95, k - 1))
