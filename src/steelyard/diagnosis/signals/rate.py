"""The rate of a log without time, from the ratio of its velocities to d(q)/dt."""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.signal_overview import SignalOverview
from steelyard.diagnosis.signals.agreement import agreement
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.signals import ROW, VELOCITY_UNITS, Signals

OFF, UNEVEN, MOST_OFF = 0.02, 0.005, 0.13
"""Distance of velocities over d(q)/dt from 1 that is a clock's, if joints differ by no more; from
the last on it is a wrong unit. Real robots' are off by 1 %, or differ by 1.5 % and more."""
LOST_ROWS = 0.05
"""The same difference between joints where a rate is farther off: rows that are lost cause it."""
FEWEST = 2
"""Joints that must move."""
_SCALES = [*VELOCITY_UNITS["revolute"].values()]
RATIOS = tuple(a / b for a in _SCALES for b in _SCALES if a != b)
"""Ratios of velocities in one unit to those in another."""


def rate_by_velocities(
    signals: Signals, overview: SignalOverview, logged: tuple[Sequence[str], Array] | None
) -> float | None:
    """The rate at which velocities are the derivative of the positions [Hz].

    Velocities that are a multiple of the derivative, the same in all joints, show the rate, unless
    the multiple is the ratio of two units.

    Args:
        signals: As declared.
        overview: The log's good rows.
        logged: Columns of velocities and their values `(N, n)`; `None` if there are none.

    Returns:
        The rate; `None` if there is a column of time, the declared rate is right, or nothing moves.
    """
    agreed = None if logged is None or signals.time != ROW else agreement(overview, logged[1])
    if agreed is None or logged is None:
        return None
    scales = agreed.scale[agreed.reliable_joints]
    if len(scales) < FEWEST or not (scales > 0.0).all():
        return None
    scale = float(np.median(scales))
    spread, off = float(np.ptp(scales)) / scale, abs(scale - 1.0)
    if off < OFF or spread > (LOST_ROWS if off > MOST_OFF else UNEVEN):
        return None
    stated = all(Column(name).unit_words for name in logged[0])
    near = 0.5 * OFF if stated else max(OFF, spread)
    if any(abs(scale / ratio - 1.0) < near for ratio in RATIOS):
        return None
    return _round(scale / signals.time_scale)


def _round(rate: float) -> float:
    """The rate with the fewest digits that is as near as velocities determine it."""
    rates = [float(f"{rate:.{digits}g}") for digits in (1, 2, 3, 4)]
    return next(x for x in rates if abs(x / rate - 1.0) < 0.5 * OFF)
