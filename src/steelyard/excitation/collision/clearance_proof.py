r"""Lower bounds of distances that hold at all times of a motion.

At the middle of an interval of half length $h$ a distance is at least the gap $g$ between the
heights of both solids along the direction of their nearest points, whatever the solver's
tolerance was. Within the interval it is at least $g - h \sum_j \kappa_j |\dot q_j|$, with
$\kappa$ from `reach.rates` and $|\dot q_j| \le |\dot q_j(t)| + h \max |\ddot q_j|$. Intervals
whose bound is not good enough are cut up; this is conservative advancement [Mirtich1996] without
an order in time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.excitation.collision.scene import Indices, Scene
from steelyard.excitation.constraints.bounding import goals
from steelyard.excitation.shapes.poses import Poses
from steelyard.excitation.shapes.reach import rates
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.progress import Progress, report_progress, silent
from steelyard.robot.robot import Robot

TOLERANCE = 1e-4
"""A bound is at most this far below the least distance found [m]."""

PIECES = 200
"""Pieces of the motion to begin with."""

MOST = 2_000_000
"""Intervals after which a proof ends with the bounds that it has."""

_PIECES = 16
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class _Intervals:
    """Pairs of shapes, each over an interval of time.

    Attributes:
        ways: Numbers of the pairs, shape `(I,)`.
        middle: Shape `(I,)` [s].
        half: Half lengths, shape `(I,)` [s].
    """

    ways: Indices
    middle: Array
    half: Array

    def at(self, chosen: NDArray[np.bool_]) -> "_Intervals":
        """Some of them."""
        return _Intervals(self.ways[chosen], self.middle[chosen], self.half[chosen])

    def cut(self, pieces: Indices) -> "_Intervals":
        """Each of them in a number of equal pieces."""
        which = np.repeat(np.arange(len(pieces)), pieces)
        number = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        half = self.half[which] / pieces[which]
        start = self.middle[which] - self.half[which]
        return _Intervals(self.ways[which], start + (2 * number + 1) * half, half)


def proven_distances(
    robot: Robot,
    scene: Scene,
    trajectory: ExactTrajectory,
    owner: Indices,
    enough: Array,
    kept: Array,
    *,
    tolerance: float = TOLERANCE,
    progress: Progress = silent,
) -> Array:
    """Lower bounds of the distances of pairs at all times, shape `(k,)` [m].

    Args:
        robot: The robot.
        scene: Its shapes, and `W` ways in which they may touch.
        trajectory: The motion.
        owner: The pair that each way belongs to, shape `(W,)`.
        enough: Distances beyond which a bound need not be sharp, shape `(k,)` [m].
        kept: Distances that must be kept: near above them, bounds are sharper, shape `(k,)` [m].
        tolerance: How far below the least distance a bound may be otherwise [m].
        progress: Told of the share of the time that is done.

    Raises:
        Stopped: `progress` requested a stop.
    """
    search = _Search(robot, scene, trajectory)
    least, proven = np.full(len(enough), np.inf), np.full(len(enough), np.inf)
    work = _start(trajectory, len(owner))
    total, used = float(work.half.sum()), 0
    while len(work.ways):
        pair = owner[work.ways]
        bound, gap, slack = search.bounds(work, enough[pair])
        np.minimum.at(least, pair, gap)
        goal = np.minimum(enough, goals(least - kept, np.full(len(kept), tolerance)) + kept)[pair]
        used += len(work.ways)
        good = (bound >= goal) | (used > MOST)
        np.minimum.at(proven, pair[good], bound[good])
        with np.errstate(divide="ignore", over="ignore"):
            wanted = np.ceil(slack / np.maximum(gap - goal, 0.01 * tolerance))
        pieces = np.clip(wanted, 2, _PIECES).astype(np.intp)
        work = work.at(~good).cut(pieces[~good])
        report_progress(progress, "proving clearances", total - float(work.half.sum()), total)
    return proven


def _start(trajectory: ExactTrajectory, ways: int) -> _Intervals:
    """All ways over pieces that no break of the motion lies in."""
    even = np.linspace(0.0, trajectory.duration, PIECES + 1)
    times = np.union1d(even, trajectory.breaks)
    times = times[(times >= 0.0) & (times <= trajectory.duration)]
    middle, half = 0.5 * (times[1:] + times[:-1]), 0.5 * np.diff(times)
    which = np.repeat(np.arange(ways), len(middle))
    return _Intervals(which, np.tile(middle, ways), np.tile(half, ways))


class _Search:
    """What bounds an interval.

    Attributes:
        scene: The shapes.
        trajectory: The motion.
        rates: Change of distance per speed of each joint, shape `(W, n)`.
        speed: Greatest speeds, shape `(n,)`.
        acceleration: Greatest accelerations, shape `(n,)`.
    """

    def __init__(self, robot: Robot, scene: Scene, trajectory: ExactTrajectory) -> None:
        self.scene, self.trajectory = scene, trajectory
        lower, upper = trajectory.extremes(0)
        shapes = scene.shapes
        both = [(shapes[a], shapes[b]) for a, b in scene.ways]
        self.rates = np.array([rates(robot, a, b, lower, upper) for a, b in both])
        self.speed, self.acceleration = (
            np.maximum(*(np.abs(x) for x in trajectory.extremes(order))) * (1.0 + _ROUNDING)
            for order in (1, 2)
        )

    def bounds(self, work: _Intervals, enough: Array) -> tuple[Array, Array, Array]:
        """Per interval the bound, the distance's bound at its middle, and what lies between.

        Args:
            work: `I` intervals.
            enough: Bounds that need not be better, shape `(I,)` [m].
        """
        times, samples = np.unique(work.middle, return_inverse=True)
        poses = self.scene.kinematics(self.trajectory.derivative(times, 0))
        # a little more than half: the middle is rounded
        half = work.half * (1.0 + 1e-9) + 1e-15 * self.trajectory.duration
        speed = np.abs(self.trajectory.derivative(times, 1))[samples]
        speed = np.minimum(speed + half[:, None] * self.acceleration, self.speed)
        slack = half * np.einsum("ij,ij->i", speed, self.rates[work.ways])
        gap = self._balls(poses, work.ways, samples)
        for better in (self._centre_lines, self._nearest):
            short = np.flatnonzero(gap - slack < enough)
            # the solver moves fastest from sample to sample
            short = short[np.argsort(samples[short], kind="stable")]
            found = better(poses, work.ways[short], samples[short])
            gap[short] = np.maximum(gap[short], found)
        return gap - slack, gap, slack

    def _balls(self, poses: Poses, ways: Indices, samples: Indices) -> Array:
        return self.scene.balls(poses)[samples, ways]

    def _centre_lines(self, poses: Poses, ways: Indices, samples: Indices) -> Array:
        lines = self.scene.centre_lines(poses, ways, samples)
        return self.scene.along(poses, ways, samples, lines)

    def _nearest(self, poses: Poses, ways: Indices, samples: Indices) -> Array:
        normals = self.scene.exact(poses, ways, samples)[2]
        return self.scene.along(poses, ways, samples, normals)
