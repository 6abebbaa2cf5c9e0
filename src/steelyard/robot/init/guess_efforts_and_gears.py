"""A guess of what effort columns hold, and of the gears between motors and joints."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.robot.file.signals import POSITION_UNITS
from steelyard.robot.init.column_names import CURRENTS, TORQUES, Column
from steelyard.robot.models.xml_and_urdf import Element
from steelyard.robot.robot import Coordinate

TORQUE = (
    "torque by their names, which do not state the side of the gears: assumed joint torque "
    "including rotor inertia; for sensors on the link side (Franka, KUKA iiwa, Kinova Gen3, Rokae "
    'xMate) set kind = "link_torque" and remove rotor_inertia from [model] terms'
)
LINK_SIDE_TORQUE = (
    "torque of sensors on the link side of the gears, by the names of robot and joints ({}): it "
    "contains no rotor inertia, and little friction of gears. If it is computed from motor "
    "currents, set "
    'kind = "joint_torque" and add "rotor_inertia" to [model] terms'
)
"""Why efforts of a known robot are those of sensors on the link side."""
LINK_SIDE = re.compile(r"(?<![a-z])(panda|fr3|franka|iiwa|lbr|gen3(?!_?lite))(?![a-z])")
"""Names of robots with torque sensors on the link side: Franka, KUKA iiwa, Kinova Gen3."""
LEAST_EFFORT_BEYOND_LIMIT = 3.0
"""Reach of torques over the joint's limit from which on their unit is another one."""
UNSTATED = (
    "their names state neither torque nor current: assumed joint torque in Nm or N; some drivers "
    "(Universal Robots' for ROS) log A, which `steelyard check` finds out"
)
OF_MOTORS = "torque of motors by their names: joint torque through the gears"
MOST_OTHER_COLUMNS = 6  # effort-like columns that were not chosen and are listed
COUNTS = ("count", "counts", "ticks", "adc", "lsb")  # words of columns without a physical unit

MOST_AMPERES = 200.0  # currents of one robot that go farther are all in mA

AMPERES = ("a", "amp", "amps")  # words of columns in ampere


def effort_units(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[str, list[str]]:
    """Why, and the unit of each effort column."""
    units, unsaid = [], []
    # `TorqueCur1` is a torque
    amperes = [c for c in columns if c.has(*CURRENTS) and not c.has(*TORQUES)]
    bare = [c for c in amperes if not stated_current(c)]
    counts = [c for c in bare if changes(c.name, values)]
    whole = bool(counts) and whole_numbers(counts, values)
    small = whole or any(reach(c.name, values) > MOST_AMPERES for c in bare)
    for column, joint in zip(columns, joints, strict=True):
        if column in amperes or stated_current(column):
            units.append(stated_current(column) or ("mA" if small else "A"))
        else:
            units.append(joint.effort_unit)
            unsaid.append(column)
    if len(unsaid) == len(columns):
        words = (*TORQUES, "moment", "nm", "n", "force", "forces")
        stated = TORQUE if any(column.has(*words) for column in columns) else UNSTATED
        return OF_MOTORS if all(column.of_motor for column in columns) else stated, units
    why = "motor current by their names"
    if whole:
        why += (
            ", which state no unit; whole numbers may be mA or counts of the drive: the unit is "
            "not known, mA is written in its place, and errors are in it (data sheet of the drive: "
            "mA per count)"
        )
    if unsaid:
        names, taken = ", ".join(c.name for c in unsaid), sorted(set(units) - {"A", "mA"})
        why += f", but not of {names}: assumed in {' and '.join(taken)}; check unit and gain"
    return why, units


def stated_current(column: Column) -> str:
    """`A` or `mA`, where the column's name says so; else empty."""
    return "mA" if column.has("ma") else "A" if column.has(*AMPERES) else ""


def link_side(robot: str, joints: Sequence[str]) -> str:
    """What in the names of a robot and its joints says that torques are those on the link side."""
    found = (LINK_SIDE.search(name.lower()) for name in (robot, *joints))
    return next((match.group() for match in found if match), "")


def beyond_effort(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[str, ...]:
    """That torques go far beyond the joints' limits, in one sentence: their unit is another one."""
    found = []
    for column, joint in zip(columns, joints, strict=True):
        far, limit = reach(column.name, values), joint.limits.effort
        if np.isfinite(limit) and limit > 0.0 and far > LEAST_EFFORT_BEYOND_LIMIT * limit:
            line = f"{far:.0f} for {joint.name} ({column.name}) with {limit:g} {joint.effort_unit}"
            found.append((far / limit, line))
    if not found:
        return ()
    more = f" (and {len(found) - 1} more joints)" * (len(found) > 1)
    return (
        f"efforts go beyond the limits of the model, up to {max(found)[1]}{more}: they are in "
        "another unit (gain = 0.001 for mNm, a current, counts), or other columns",
    )


def changes(name: str, values: Mapping[str, Array]) -> bool:
    """Whether a column changes in the sample, as measured efforts do; without one nobody knows."""
    sampled = values.get(name)
    return sampled is None or len(sampled) == 0 or bool(np.ptp(sampled) > 0.0)


def unactuated(
    position: Sequence[Column], effort: Sequence[Column], values: Mapping[str, Array]
) -> tuple[int, ...]:
    """Joints that move in the sample while their effort is always zero; not if all do."""
    found = []
    for j, (q, tau) in enumerate(zip(position, effort, strict=True)):
        x, y = (values.get(column.name, np.zeros(0)) for column in (q, tau))
        if len(x) and len(y) and np.ptp(x) > LEAST_MOTION and not y.any():
            found.append(j)
    return tuple(found) if len(found) < len(position) else ()


def others(effort: Sequence[Column], every: Sequence[Column]) -> str:
    """Effort-like columns that were not chosen, by pattern; empty if there are none."""
    names = [c.name for c in every if c not in effort]
    patterns = by_key((re.sub(r"\d+(?=\D*$)", "{}", name), name) for name in names)
    left = [x for p, names in patterns.items() for x in ([p] if len(names) > 1 else names)]
    if not left:
        return ""
    shown = ", ".join(left[:MOST_OTHER_COLUMNS]) + f" and {len(left) - MOST_OTHER_COLUMNS} more" * (
        len(left) > MOST_OTHER_COLUMNS
    )
    return f"; other columns that may be efforts: {shown}: use them instead if they are measured"


def reach(name: str, values: Mapping[str, Array]) -> float:
    """How far from zero a column goes, a few broken values aside; zero if not sampled."""
    sampled = values.get(name)
    if sampled is None or not len(sampled):
        return 0.0
    return float(np.quantile(np.abs(sampled), 0.98))


LEAST_POSITION_BEYOND_LIMIT, LEAST_MOTOR_BEYOND_LIMIT = 1.5, 3.0
"""Reach of positions over the joint's limits: from which on they contradict them, and from which on
those of most joints are the motors'."""
MISFIT = 1e-3
"""Residual of motor positions behind gears found by regression, relative to their deviation."""
SMALL = 1e-3  # entry of a transmission's row, relative to the largest, below which it is zero
LEAST_MOTION = 0.05  # standard deviation of a joint from which on its gear is determined [rad; m]


@dataclass(frozen=True)
class Gears:
    """Gears between motors and joints: turns of each motor per turn of its joint.

    `coupling` are motor, joint and ratio of motors that turn with a second joint, by number;
    `source` says where the numbers come from.
    """

    ratios: tuple[float, ...]
    coupling: tuple[tuple[int, int, float], ...]
    source: str


def beyond_limits(
    positions: Sequence[Column],
    joints: Sequence[Coordinate],
    units: Sequence[str],
    values: Mapping[str, Array],
) -> list[float]:
    """Reach of each position from the middle of its joint's range, over half of it; or zero."""
    found = []
    for column, joint, unit in zip(positions, joints, units, strict=True):
        x = POSITION_UNITS[joint.kind][unit] * values.get(column.name, np.zeros(0))
        ends = [float(end) for end in np.quantile(x, (0.01, 0.99))] if len(x) else []
        found.append(beyond_range(joint, *ends) if ends else 0.0)
    return found


def beyond_range(coordinate: Coordinate, low: float, high: float) -> float:
    """Farthest position from the middle of a joint's range, over half the range; 0 without one."""
    lower, upper = coordinate.limits.lower, coordinate.limits.upper
    if not (isfinite(lower) and isfinite(upper) and upper > lower):
        return 0.0
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return max(abs(low - middle), abs(high - middle)) / half


def whole_numbers(columns: Sequence[Column], values: Mapping[str, Array]) -> bool:
    """Whether all columns hold whole numbers that change, as counts of encoders do."""
    sampled = [values.get(c.name, np.zeros(0)) for c in columns]
    return all(len(x) > 0 and bool(np.all(x == np.round(x)) and np.ptp(x) > 1.0) for x in sampled)


def regressed(motors: Sequence[Array], joints: Sequence[Array]) -> Gears | None:
    r"""Gears from positions of both sides, $q_m = R\,q + c$; `None` where they do not fit.

    One array `(N,)` per motor and per joint [rad; m], NaN where broken.
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
        values = set[float]()
        for text in texts:
            with suppress(ValueError):
                values |= {x for x in [float(text)] if np.isfinite(x)}
        if len(named) == 1 and len(values) == 1:
            found[named[0]] = values.pop()
    ratios = tuple(found.get(name, 0.0) for name in joints)
    if not all(ratios) or all(ratio == 1.0 for ratio in ratios):
        return None
    return Gears(ratios, (), "from <transmission> of the model file")


def _rounded(value: float) -> float:
    """The whole number if the value is within the regression's accuracy of it."""
    whole = round(float(value))
    return float(whole) if abs(value - whole) <= 1e-3 * abs(value) else float(f"{value:.6g}")
