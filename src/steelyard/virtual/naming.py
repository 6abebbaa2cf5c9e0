"""A log as the robot file says that logs look: its columns, their units, sides and drive gains."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.robot_file.signals import ROW, Signals
from steelyard.virtual.sensors import Reading


def as_declared(
    reading: Reading,
    signals: Signals,
    *,
    velocity: bool = True,
    gains: ArrayLike | None = None,
) -> dict[str, Array]:
    """The columns of a log under the names, in the units and on the side that a file declares.

    Args:
        reading: What the sensors say, of the joints.
        signals: What the robot file declares; without velocity columns the log has none.
        velocity: Whether there are velocities at all.
        gains: True drive gains, for those that the file leaves to be identified; 1 if not given.
    """
    named = {} if signals.time == ROW else {signals.time: reading.t / signals.time_scale}
    offset = 0.0 if signals.position_offset is None else signals.position_offset
    q = _before(reading.q - offset, signals.position_map)
    named |= _scaled(signals.position, q, signals.position_scale)
    if signals.velocity is not None and signals.velocity_scale is not None and velocity:
        dq = _before(reading.dq, signals.position_map)
        named |= _scaled(signals.velocity, dq, signals.velocity_scale)
    true = signals.gains
    if any(signals.unknown_gains) and gains is not None:
        true = np.where(signals.unknown_gains, gains, true)
    effort = replace(signals, gains=true).logged_efforts(reading.effort)
    return named | dict(zip(signals.effort, effort.T, strict=True))


def _before(values: Array, mapped: Array | None) -> Array:
    """Values, `(N, n)`, before the map that reading a log applies to them."""
    return values if mapped is None else np.asarray(np.linalg.solve(mapped, values.T).T)


def _scaled(names: Sequence[str], values: Array, scales: Array) -> dict[str, Array]:
    return dict(zip(names, (values / scales).T, strict=True))
