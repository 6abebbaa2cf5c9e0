r"""Moves from place to place as fast as limits allow, each by one smooth law of time.

A move is a fixed curve $q(\tau)$ of joint positions over the unit of time, run through in the time
$T$: speeds are $q'/T$, accelerations $q''/T^2$, jerks $q'''/T^3$. So the shortest time that keeps
all limits is known at once from the extremes of the curve's derivatives, without iteration. The
way along the curve is the minimum-jerk one, $s = 10\tau^3 - 15\tau^4 + 6\tau^5$ [Flash1985].
"""

from dataclasses import dataclass
from math import factorial

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.constraints.tool_way import ToolWay
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.planned.follow import Followed, astray
from steelyard.excitation.trajectories.exact import ORDERS
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion

_FINEST = 1024
"""Pieces of a line at most."""
_BETWEEN = 8
"""Samples of the tool's way per piece."""
_LEAST = 64
"""Samples of the tool's way per move at least."""
_SEEN = 0.5
"""Share of the straightness that samples may use up, before it is proven for all times."""
_EXACT = 0.1
"""Share of the straightness by which the proven deviation may exceed the true one."""
_CLOSE = 0.01
"""How far the proven time for the tool's limits may be above the shortest one, relatively."""


@dataclass(frozen=True, eq=False)
class Move:
    """A move over the unit of time.

    Attributes:
        curve: Joint positions over times from 0 to 1.
        deviation: Greatest distance of the tool from its straight line [m]; 0 for joint moves.
        turned: Greatest turn of the tool from its attitude [rad]; 0 for joint moves.
    """

    curve: PiecewiseMotion
    deviation: float = 0.0
    turned: float = 0.0


@dataclass(frozen=True)
class ToolLimits:
    """Highest speed [m/s] and acceleration [m/s²] of the tool's origin."""

    speed: float = np.inf
    acceleration: float = np.inf

    def __post_init__(self) -> None:
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            raise DataError(
                f"a tool speed of {self.speed} m/s and acceleration of {self.acceleration} m/s² "
                "allow no motion",
                where="tool limits of a process motion",
                fix="give a speed and an acceleration above 0, or leave them out",
            )


@dataclass(frozen=True)
class Pace:
    """How long a move takes [s], and the limit that it meets."""

    duration: float
    limit: str


def joint_move(start: Array, end: Array) -> Move:
    """All joints together, straight in joint space."""
    coefficients = np.outer([0.0, 0.0, 0.0, 10.0, -15.0, 6.0], end - start)
    coefficients[0] = start
    return Move(PiecewiseMotion(np.array([0.0, 1.0]), coefficients[None]))


def line_move(followed: Followed, way: ToolWay, straightness: float, where: str) -> Move:
    """Along a straight line of the tool, as a quintic spline through exact postures.

    Args:
        followed: The line.
        way: Of the tool.
        straightness: Greatest distance from the line [m], and turn from the attitude [rad].
        where: The move, for messages.

    Raises:
        Astray: The postures cannot be followed so closely.
    """
    pieces, missed = 8, np.inf
    while pieces < _FINEST:
        pieces *= 2
        tau = np.linspace(0.0, 1.0, pieces + 1)
        postures = followed.postures(tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2))
        if postures is None:
            continue
        postures[0], postures[-1] = followed.q[0], followed.q[-1]
        curve = _spline(tau, postures)
        deviation, turned = _off_line(curve, followed)
        missed = max(deviation, turned)
        if missed > _SEEN * straightness:
            continue
        rough = (np.inf, np.inf, _EXACT * straightness)
        return Move(curve, way.proven(curve, rough, followed.ends).deviation, turned)
    raise astray(
        "the postures along the straight line change so fast that no smooth motion was found that "
        f"keeps to it within {1e3 * straightness:.3g} mm; it is missed by {1e3 * missed:.3g} mm",
        where,
        1.0,
    )


def pace(
    move: Move,
    way: ToolWay,
    limits: MotionLimits,
    tool: ToolLimits,
    share: float,
    names: tuple[str, ...],
) -> Pace:
    """The shortest time that keeps all limits.

    Args:
        move: The move; it goes somewhere.
        way: Of the tool.
        limits: Of the joints.
        tool: Of the tool.
        share: Of every limit that is used, above 0.
        names: Of the joints.
    """
    bounds = [limits.velocity, limits.acceleration]
    bounds += [] if limits.jerk is None else [limits.jerk]
    times: list[tuple[float, str]] = []
    for order, bound in enumerate(bounds, start=1):
        low, high = move.curve.extremes(order)
        needed = (np.maximum(-low, high) / (share * bound)) ** (1.0 / order)
        j = int(np.argmax(needed))
        times.append((float(needed[j]), f"{ORDERS[order]} of '{names[j]}'"))
    duration = max(times)[0]
    speed, bend = way.seen(move.curve, _samples(move.curve))
    tool_times = (speed / (share * tool.speed), np.sqrt(bend / (share * tool.acceleration)))
    if max(tool_times) * (1.0 + _CLOSE) > duration:
        extent = way.proven(move.curve, (_CLOSE * speed, 2.0 * _CLOSE * bend, np.inf))
        times.append((extent.speed / (share * tool.speed), "speed of the tool"))
        root = float(np.sqrt(extent.acceleration / (share * tool.acceleration)))
        times.append((root, "acceleration of the tool"))
    return Pace(*max(times))


def _samples(curve: PiecewiseMotion) -> Array:
    """Times that resolve a move's pieces."""
    between = max(_BETWEEN * (len(curve.breaks) - 1), _LEAST)
    return np.linspace(0.0, 1.0, between + 1)


def _spline(tau: Array, q: Array) -> PiecewiseMotion:
    """The quintic spline through postures that starts and ends at rest, without acceleration."""
    from scipy.interpolate import make_interp_spline

    rest = [(order, np.zeros(q.shape[1])) for order in (1, 2)]
    spline = make_interp_spline(tau, q, k=5, bc_type=(rest, rest))
    widths = np.diff(tau)[:, None]
    powers = [spline(tau[:-1], order) * widths**order / factorial(order) for order in range(6)]
    return PiecewiseMotion(tau, np.stack(powers, axis=1))


def _off_line(curve: PiecewiseMotion, followed: Followed) -> tuple[float, float]:
    """Greatest distance from the line [m] and turn from the attitude [rad] that samples show."""
    place, rotation = followed.solver.kinematics.pose(curve.derivative(_samples(curve), 0))
    start, way = followed.ends[0], followed.ends[1] - followed.ends[0]
    along = np.clip((place - start) @ way / (way @ way), 0.0, 1.0)
    away = place - start - along[:, None] * way
    turns = followed.solver.attitude.turns(rotation)
    return float(np.linalg.norm(away, axis=1).max()), float(np.linalg.norm(turns, axis=1).max())
