"""A guess of the column of time and its unit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.template.give_up import IN_FILE, finite, give_up, listed


def guess_time(columns: Sequence[str], sample: Mapping[str, ArrayLike]) -> tuple[str, str] | None:
    """The column of time and its unit; `None` if no column looks like time."""
    values = {name: finite(values) for name, values in sample.items()}
    candidates = [c for c in map(Column, columns) if c.quantity == "time"]
    try:
        time = _time(candidates, columns, values)
    except LogError:
        return None
    return time.name, _time_unit(time, values)[0]


def clock_of(
    candidates: Sequence[Column],
    columns: Sequence[str],
    values: Mapping[str, Array],
    rate: float | None,
) -> tuple[dict[str, Any], str]:
    """What the robot file says of time, and why."""
    if rate is not None:
        reason_given = f"time is the number of the row at the {rate:g} Hz that were given"
        beside = f", not {listed(candidates)}" if candidates else ""
        return {"rate": rate}, reason_given + beside
    time = _time(candidates, columns, values)
    unit, reason = _time_unit(time, values)
    reason_given = f"time is '{time.name}' in {unit}, {reason}"
    return {"time": time.name, "time_unit": unit}, reason_given


def _time(
    candidates: Sequence[Column], columns: Sequence[str], values: Mapping[str, Array]
) -> Column:
    def rises(column: Column) -> bool:
        steps = np.diff(values.get(column.name, np.zeros(0)))
        return bool(len(steps) == 0 or np.mean(steps >= 0.0) > 0.9)

    rising = [c for c in candidates if rises(c)]
    if not rising:
        give_up(
            "no column looks like time",
            columns,
            "give the log's rate: `steelyard init URDF LOG --rate HZ` writes a robot file with "
            f'[signals] rate = HZ instead of time = "..."; or {IN_FILE}',
        )
    return min(rising, key=lambda c: (_topic(c) != _topic(rising[0]), len(c.words)))


def beside(position: Sequence[Column], candidates: Sequence[Column]) -> Sequence[Column]:
    """Times of the topic that positions are of, if the log is of messages."""
    topic = position[0].name.rpartition("/position/")[0]
    return [c for c in candidates if topic and _topic(c) == topic] or candidates


def _topic(time: Column) -> str:
    return time.name.rpartition("/")[0]


def _time_unit(time: Column, values: Mapping[str, Array]) -> tuple[str, str]:
    for unit, words in (
        ("ms", ("ms", "msec", "millis")),
        ("us", ("us", "usec", "micros")),
        ("ns", ("ns", "nsec", "nanos")),
        ("s", ("s", "sec", "seconds")),
    ):
        if time.has(*words):
            return unit, "by its name"
    steps = np.diff(values.get(time.name, np.zeros(0)))
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if step == 0.0:
        return "s", "by default"
    unit = "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"
    return unit, f"as its steps are {step:.4g}"
