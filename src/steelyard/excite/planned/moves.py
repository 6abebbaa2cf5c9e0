r"""Moves from place to place as fast as limits allow, and what a tour of places requires.

A move is a fixed curve $q(\tau)$ of joint positions over the unit of time, run through in the time
$T$: speeds are $q'/T$, accelerations $q''/T^2$, jerks $q'''/T^3$. So the shortest time that keeps
all limits is known at once from the extremes of the curve's derivatives, without iteration. The
way along the curve is the minimum-jerk one, $s = 10\tau^3 - 15\tau^4 + 6\tau^5$ [Flash1985].
"""

from dataclasses import dataclass
from math import factorial
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint import MotionLimits
from steelyard.excite.constraints.markers import ToolWay
from steelyard.excite.planned.inverse_kinematics import AnyAttitude, Attitude
from steelyard.excite.planned.postures import Followed, unfollowable_error
from steelyard.excite.trajectories.polynomials import PiecewiseMotion
from steelyard.excite.trajectories.trajectory import ORDERS

_MOST_PIECES = 1024
"""Pieces of a line at most."""
_SAMPLES_PER_PIECE = 8
"""Samples of the tool's way per piece."""
_LEAST_WAY_SAMPLES = 64
"""Samples of the tool's way per move at least."""
_SAMPLED_SHARE = 0.5
"""Share of the straightness that samples may use up, before it is proven for all times."""
_PROOF_EXCESS = 0.1
"""Share of the straightness by which the proven deviation may exceed the true one."""
_TIME_TOLERANCE = 0.01
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
class MovePace:
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
    while pieces < _MOST_PIECES:
        pieces *= 2
        tau = np.linspace(0.0, 1.0, pieces + 1)
        postures = followed.postures(tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2))
        if postures is None:
            continue
        postures[0], postures[-1] = followed.q[0], followed.q[-1]
        curve = _spline(tau, postures)
        deviation, turned = _off_line(curve, followed)
        missed = max(deviation, turned)
        if missed > _SAMPLED_SHARE * straightness:
            continue
        rough = (np.inf, np.inf, _PROOF_EXCESS * straightness)
        return Move(curve, way.proven(curve, rough, followed.ends).deviation, turned)
    raise unfollowable_error(
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
) -> MovePace:
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
    if max(tool_times) * (1.0 + _TIME_TOLERANCE) > duration:
        extent = way.proven(
            move.curve, (_TIME_TOLERANCE * speed, 2.0 * _TIME_TOLERANCE * bend, np.inf)
        )
        times.append((extent.speed / (share * tool.speed), "speed of the tool"))
        root = float(np.sqrt(extent.acceleration / (share * tool.acceleration)))
        times.append((root, "acceleration of the tool"))
    return MovePace(*max(times))


def _samples(curve: PiecewiseMotion) -> Array:
    """Times that resolve a move's pieces."""
    between = max(_SAMPLES_PER_PIECE * (len(curve.breaks) - 1), _LEAST_WAY_SAMPLES)
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


@dataclass(frozen=True)
class ToolGuidance:
    """How the tool is led.

    Attributes:
        path: `line`: straight lines of the tool; `joint`: straight in joint space.
        attitude: What is required of the tool's orientation, at all times on lines, else at places.
        tool: Highest speed and acceleration of the tool's origin, beside the joints' limits.
        share: Of all limits but positions that is used.
        straightness: Greatest distance from a line [m], and turn from the attitude [rad].
        dwell: Rest at every place of the task [s].
    """

    path: Literal["line", "joint"] = "line"
    attitude: Attitude = AnyAttitude()
    tool: ToolLimits = ToolLimits()
    share: float = 1.0
    straightness: float = 1e-4
    dwell: float = 0.0

    def __post_init__(self) -> None:
        wrong = {
            "path": self.path not in ("line", "joint"),
            "share": not 0.0 < self.share <= 1.0,
            "straightness": not self.straightness > 0.0,
            "dwell": not 0.0 <= self.dwell < np.inf,
        }
        for name in (name for name, bad in wrong.items() if bad):
            raise DataError(
                f"{name} = {getattr(self, name)!r} cannot be used",
                where="settings of a process motion",
                fix="path is 'line' or 'joint', 0 < share <= 1, straightness > 0 m, dwell >= 0 s",
            )


@dataclass(frozen=True, eq=False)
class Tour:
    """Places of the tool in the order of the visits; after the last one it goes back to the first.

    Attributes:
        places: Shape `(K, 3)` [m], in the base frame.
        names: Of the visits, for messages.
        dwells: Rest after arriving, per visit, `(K,)` [s]; that of the first is at the very end.
        cycles: How often the task is done.
    """

    places: Array
    names: tuple[str, ...]
    dwells: Array
    cycles: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, (len(self.names), 3)))
        object.__setattr__(self, "dwells", frozen(self.dwells, (len(self.names),)))


@dataclass(frozen=True, eq=False)
class ProcessMotion:
    """A process motion, and notes on it.

    Attributes:
        trajectory: From rest to rest, ending in the posture it started in.
        places: Places visited, the first one again at the end, shape `(K + 1, 3)` [m].
        arrivals: Times of arrival there, shape `(K + 1,)` [s].
        postures: Postures there, shape `(K + 1, n)` [rad; m].
        deviation: Greatest distance of the tool from its straight lines [m], proven for all times.
        turned: Greatest turn of the tool from its attitude on lines [rad], at samples.
        cycles: How often the task is done.
        paces: Per move its time and the limit that it meets.
    """

    trajectory: PiecewiseMotion
    places: Array
    arrivals: Array
    postures: Array
    deviation: float
    turned: float
    cycles: int
    paces: tuple[MovePace, ...]

    @property
    def summary(self) -> str:
        """One line that reports it."""
        limits = [pace.limit for pace in self.paces]
        most = max(sorted(set(limits)), key=limits.count)
        straight = f"deviation from straight lines {1e3 * self.deviation:.2g} mm at most; "
        return (
            f"{self.cycles} cycles, {len(self.paces)} moves in {self.trajectory.duration:.2f} s; "
            f"{straight if self.deviation else ''}most moves are limited by the {most}"
        )
