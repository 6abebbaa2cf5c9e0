"""A log as the robot file says that logs look: its columns, their units and drive gains."""

from collections.abc import Mapping

import numpy as np

from steelyard.arrays import Array
from steelyard.robot.signals import Signals


def as_declared(columns: Mapping[str, Array], signals: Signals) -> dict[str, Array]:
    """The columns of a log under the names, and in the units, that a robot file declares.

    Args:
        columns: Time, positions, velocities if logged, and joint efforts, in SI units, in the
            order of the joints.
        signals: What the robot file declares; without velocity columns the log has none.
    """
    values = list(columns.values())
    n = signals.n
    positions, velocities, efforts = values[1 : 1 + n], values[1 + n : -n], values[-n:]
    named = {signals.time: values[0] / signals.time_scale}
    named |= _scaled(signals.position, positions, signals.position_scale)
    if signals.velocity is not None and signals.velocity_scale is not None and velocities:
        named |= _scaled(signals.velocity, velocities, signals.velocity_scale)
    return named | _scaled(signals.effort, efforts, signals.effort_scale * signals.gains)


def _scaled(names: tuple[str, ...], values: list[Array], scales: Array) -> dict[str, Array]:
    return {
        name: np.asarray(value / scale)
        for name, value, scale in zip(names, values, scales, strict=True)
    }
