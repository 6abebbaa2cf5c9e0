"""Signals of the motors' side of the gears, and ratios that a log or a model file contains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.robot.robot import Coordinate
from steelyard.robot.xml_reader import Element
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.template.guess_efforts import reach

BEYOND, MOTOR_BEYOND = 1.5, 3.0
"""Reach of positions over the joint's limits: from which on they contradict them, and from which on
those of most joints are the motors'."""
MISFIT = 1e-3
"""Residual of motor positions behind gears found by regression, relative to their deviation."""
SMALL = 1e-3
"""Entry of a transmission's row, relative to the largest, below which it is zero."""
LEAST_MOTION = 0.05
"""Standard deviation of a joint from which on its gear is determined [rad; m]."""


@dataclass(frozen=True)
class Gears:
    """Gears between motors and joints.

    Attributes:
        ratios: Turns of each motor per turn of its joint.
        coupling: Motor, joint and ratio of motors that turn with a second joint; both by number.
        source: Where they come from, in words.
    """

    ratios: tuple[float, ...]
    coupling: tuple[tuple[int, int, float], ...]
    source: str


def beyond_limits(
    positions: Sequence[Column],
    joints: Sequence[Coordinate],
    scales: Sequence[float],
    values: Mapping[str, Array],
) -> list[float]:
    """Reach of each position over its joint's limit; zero where there is no limit."""
    limits = [max(abs(j.limits.lower), abs(j.limits.upper)) for j in joints]
    return [
        scale * reach(column.name, values) / limit if np.isfinite(limit) and limit > 0.0 else 0.0
        for column, limit, scale in zip(positions, limits, scales, strict=True)
    ]


def whole_numbers(columns: Sequence[Column], values: Mapping[str, Array]) -> bool:
    """Whether all columns hold whole numbers that change, as counts of encoders do."""
    sampled = [values.get(c.name, np.zeros(0)) for c in columns]
    return all(len(x) > 0 and bool(np.all(x == np.round(x)) and np.ptp(x) > 1.0) for x in sampled)


def regressed(motors: Sequence[Array], joints: Sequence[Array]) -> Gears | None:
    r"""Gears from positions of both sides, $q_m = R\,q + c$; `None` where they do not fit.

    Args:
        motors: Positions of the motors, one array `(N,)` each, NaN where broken.
        joints: Positions of the joints, likewise [rad; m].
    """
    sides = np.array([*motors, *joints], dtype=np.float64)
    rows = sides[:, np.isfinite(sides).all(axis=0)]
    n = len(joints)
    if rows.shape[1] < 10 * n or np.any(rows[n:].std(axis=1) < LEAST_MOTION):
        return None
    centred = rows - rows.mean(axis=1, keepdims=True)
    matrix = np.linalg.lstsq(centred[n:].T, centred[:n].T, rcond=1e-10)[0].T
    left = centred[:n] - matrix @ centred[n:]
    if np.any(left.std(axis=1) > MISFIT * centred[:n].std(axis=1)):
        return None
    largest = np.abs(matrix).max(axis=1, keepdims=True)
    matrix = np.where(np.abs(matrix) > SMALL * largest, matrix, 0.0)
    if not np.diag(matrix).all():
        return None
    ratios = tuple(_rounded(x) for x in np.diag(matrix))
    coupling = tuple(
        (i, j, _rounded(matrix[i, j])) for i, j in np.argwhere(matrix).tolist() if i != j
    )
    return Gears(ratios, coupling, "by regression of the logged motor positions on the joints'")


def reductions(model: Element, joints: Sequence[str]) -> Gears | None:
    """Gears from `<transmission>` of a URDF; `None` unless each joint has one other than 1."""
    found: dict[str, float] = {}
    for element in (e for e in model.walk() if e.tag == "transmission"):
        named = [e.attributes.get("name", "") for e in element.walk() if e.tag == "joint"]
        texts = ["".join(e.texts) for e in element.walk() if e.tag == "mechanicalReduction"]
        values = {value for text in texts if (value := _number(text)) is not None}
        if len(named) == 1 and len(values) == 1:
            found[named[0]] = values.pop()
    ratios = tuple(found.get(name, 0.0) for name in joints)
    if not all(ratios) or all(ratio == 1.0 for ratio in ratios):
        return None
    return Gears(ratios, (), "from <transmission> of the model file")


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _rounded(value: float) -> float:
    """The whole number if the value is within the regression's accuracy of it."""
    whole = round(float(value))
    return float(whole) if abs(value - whole) <= 1e-3 * abs(value) else float(f"{value:.6g}")
