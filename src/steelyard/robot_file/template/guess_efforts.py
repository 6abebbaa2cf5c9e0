"""What columns of efforts hold, by their names and values: currents, torques, counts, nothing."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.column_names import CURRENTS, TORQUES, Column

TORQUE = (
    "torque by their names, which do not state the side of the gears: assumed joint torque "
    "including rotor inertia; for sensors on the link side (Franka, KUKA iiwa, Kinova Gen3, Rokae "
    'xMate) set kind = "link_torque" and remove rotor_inertia from [model] terms'
)
BEHIND = (
    "torque of sensors on the link side of the gears, by the names of robot and joints ({}): it "
    "contains no rotor inertia, and little friction of gears. If it is computed from motor "
    "currents, set "
    'kind = "joint_torque" and add "rotor_inertia" to [model] terms'
)
"""Why efforts of a known robot are those of sensors on the link side."""
LINK_SIDE = re.compile(r"(?<![a-z])(panda|fr3|franka|iiwa|lbr|gen3(?!_?lite))(?![a-z])")
"""Names of robots with torque sensors on the link side: Franka, KUKA iiwa, Kinova Gen3."""
BEYOND = 3.0
"""Reach of torques over the joint's limit from which on their unit is another one."""
UNSTATED = (
    "their names state neither torque nor current: assumed joint torque in Nm or N; some drivers "
    "(Universal Robots' for ROS) log A, which `steelyard check` finds out"
)
OF_MOTORS = "torque of motors by their names: joint torque through the gears"
OTHERS = 6
"""Effort-like columns that were not chosen and are listed."""
COUNTS = ("count", "counts", "ticks", "adc", "lsb")
"""Words of columns without a physical unit."""

AMPERES = ("a", "amp", "amps")
"""Words of columns in ampere."""


def effort_units(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[str, list[str]]:
    """Why, and the unit of each effort column."""
    units, unsaid = [], []
    for column, joint in zip(columns, joints, strict=True):
        if _is_current(column) or stated_current(column):
            far = reach(column.name, values) > 200.0
            units.append(stated_current(column) or ("mA" if far else "A"))
        else:
            units.append(joint.effort_unit)
            unsaid.append(column)
    if len(unsaid) == len(columns):
        return _torque_words(columns), units
    return "motor current by their names" + _unsaid(unsaid, units), units


def stated_current(column: Column) -> str:
    """`A` or `mA`, where the column's name says so; else empty."""
    return "mA" if column.has("ma") else "A" if column.has(*AMPERES) else ""


def _torque_words(columns: Sequence[Column]) -> str:
    """What columns without currents hold, in words."""
    if all(column.of_motor for column in columns):
        return OF_MOTORS
    stated = any(column.has(*TORQUES, "moment", "nm", "n", "force", "forces") for column in columns)
    return TORQUE if stated else UNSTATED


def _unsaid(columns: Sequence[Column], units: Sequence[str]) -> str:
    """Columns beside currents whose names speak of none, in words; empty if there are none."""
    if not columns:
        return ""
    names, taken = ", ".join(c.name for c in columns), set(units) - {"A", "mA"}
    return f", but not of {names}: assumed in {' and '.join(sorted(taken))}; check unit and gain"


def _is_current(column: Column) -> bool:
    """Whether a name speaks of amperes: `TorqueCur1` is a torque."""
    if column.has(*AMPERES):
        return True
    return column.has(*CURRENTS) and not column.has(*TORQUES)


def link_side(robot: str, joints: Sequence[str]) -> str:
    """What in the names of a robot and its joints says that torques are those on the link side.

    Empty if nothing does.
    """
    found = (LINK_SIDE.search(name.lower()) for name in (robot, *joints))
    return next((match.group() for match in found if match), "")


def beyond_effort(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[str, ...]:
    """That torques go far beyond the joints' limits, in one sentence: their unit is another one."""
    found = []
    for column, joint in zip(columns, joints, strict=True):
        far, limit = reach(column.name, values), joint.limits.effort
        if np.isfinite(limit) and limit > 0.0 and far > BEYOND * limit:
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


def others(effort: Sequence[Column], every: Sequence[Column]) -> str:
    """Effort-like columns that were not chosen, by pattern; empty if there are none."""
    patterns: dict[str, list[str]] = {}
    for name in (c.name for c in every if c not in effort):
        patterns.setdefault(re.sub(r"\d+(?=\D*$)", "{}", name), []).append(name)
    left = [x for p, names in patterns.items() for x in ([p] if len(names) > 1 else names)]
    if not left:
        return ""
    shown = ", ".join(left[:OTHERS]) + f" and {len(left) - OTHERS} more" * (len(left) > OTHERS)
    return f"; other columns that may be efforts: {shown}: use them instead if they are measured"


def reach(name: str, values: Mapping[str, Array]) -> float:
    """How far from zero a column goes, a few broken values aside; zero if not sampled."""
    sampled = values.get(name)
    if sampled is None or not len(sampled):
        return 0.0
    return float(np.quantile(np.abs(sampled), 0.98))
