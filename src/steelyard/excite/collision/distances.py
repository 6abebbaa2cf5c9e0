r"""Distances of shapes at samples, and their lower bounds at all times of a motion.

At the middle of an interval of half length $h$ a distance is at least the gap $g$ between the
heights of both solids along the direction of their nearest points, whatever the solver's
tolerance was. Within the interval it is at least $g - h \sum_j \kappa_j |\dot q_j|$, with
$\kappa$ from `reach.rates` and $|\dot q_j| \le |\dot q_j(t)| + h \max |\ddot q_j|$. Intervals
whose bound is not good enough are cut up; this is conservative advancement [Mirtich1996] without
an order in time.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.excite.collision.shapes import Poses, Shape, ShapeKinematics, rates
from steelyard.excite.collision.solids import height
from steelyard.excite.constraints.bounding import cut, goals
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.robot import Robot

Indices = NDArray[np.intp]

HEIGHT_ROUNDING = 1e-9  # rounding of a bound that comes from the heights of two solids [m]


class Scene:
    """Shapes on a robot and around it, and the pairs of them that matter.

    The numbers of the two shapes of each pair are its `ways`, `(W, 2)`; a half-space is the second.
    """

    def __init__(
        self, robot: Robot, shapes: Sequence[Shape], ways: Sequence[tuple[int, int]]
    ) -> None:
        from steelyard.excite.collision.mujoco_geometry import Distances

        flat = [shape.flat for shape in shapes]
        ordered = [(j, i) if flat[i] else (i, j) for i, j in ways]
        self.shapes = tuple(shapes)
        self.ways: Indices = np.array(ordered, dtype=np.intp).reshape(-1, 2)
        self.kinematics = ShapeKinematics(robot, shapes)
        self._solver = Distances(tuple(s.solid for s in shapes))
        self._flat = np.array(flat)[self.ways[:, 1]]

    def balls(self, poses: Poses) -> Array:
        """Lower bounds of all ways' distances from balls around the shapes, shape `(N, W)` [m]."""
        radius = np.array([shape.solid.radius for shape in self.shapes])
        first, second = self.ways.T
        apart = poses.centres[:, second] - poses.centres[:, first]
        with np.errstate(invalid="ignore"):
            gaps = np.sqrt(np.einsum("nwi,nwi->nw", apart, apart)) - radius[first] - radius[second]
        flat = self._flat
        normal = poses.rotations[:, second[flat]][..., 2]
        above = poses.centres[:, first[flat]] - poses.origins[:, second[flat]]
        gaps[:, flat] = np.einsum("nwi,nwi->nw", normal, above) - radius[first[flat]]
        return np.asarray(gaps - HEIGHT_ROUNDING)

    def along(self, poses: Poses, ways: Indices, samples: Indices, normals: Array) -> Array:
        """Lower bounds of `H` ways' distances at samples, by heights along a direction, `(H,)` [m].

        Exact if the unit vectors `normals` from the first to the second shape, `(H, 3)`, are those
        of the nearest points; of a half-space its own is taken.
        """
        both = self.ways[ways].T
        own = -poses.rotations[samples, both[1], :, 2]
        normal = np.where(self._flat[ways][:, None], own, normals)
        apart = poses.origins[samples, both[1]] - poses.origins[samples, both[0]]
        bounds = np.einsum("hi,hi->h", normal, apart)
        for numbers, outwards in zip(both, (normal, -normal), strict=True):
            seen = np.einsum("hij,hi->hj", poses.rotations[samples, numbers], outwards)
            for number in np.unique(numbers):
                at = np.flatnonzero(numbers == number)
                bounds[at] -= height(self.shapes[number].solid, seen[at])
        return np.asarray(bounds - HEIGHT_ROUNDING)

    def centre_lines(self, poses: Poses, ways: Indices, samples: Indices) -> Array:
        """Directions from centre to centre, shape `(H, 3)`."""
        first, second = self.ways[ways].T
        return directions(poses.centres[samples, second] - poses.centres[samples, first])

    def exact(self, poses: Poses, ways: Indices, samples: Indices) -> tuple[Array, Array, Array]:
        """Distances, nearest points and their direction of `H` ways, each at a sample, ascending.

        Returns:
            Signed distances, shape `(H,)` [m]; nearest points, shape `(H, 2, 3)`; unit vectors
            in which the distance grows as the second shape moves, shape `(H, 3)`, zero where the
            shapes touch in just a point.
        """
        distances, points = np.empty(len(ways)), np.empty((len(ways), 2, 3))
        flat = self._flat[ways]
        solid = np.flatnonzero(~flat)
        at = (poses.rotations, poses.origins)
        distances[solid], points[solid] = self._solver.between(
            self.ways[ways[solid]], samples[solid], at
        )
        for way in np.unique(ways[flat]):
            k = np.flatnonzero(ways == way)
            distances[k], points[k] = self._over_plane(poses, int(way), samples[k])
        normals = directions(points[:, 1] - points[:, 0])
        return distances, points, normals * np.where(distances < 0.0, -1.0, 1.0)[:, None]

    def _over_plane(self, poses: Poses, way: int, samples: Indices) -> tuple[Array, Array]:
        """Distances `(H,)` and nearest points `(H, 2, 3)` of a solid and a half-space."""
        first, second = self.ways[way]
        turn, normal = poses.rotations[samples, first], poses.rotations[samples, second][:, :, 2]
        solid = self.shapes[first].solid
        low = solid.farthest(-np.einsum("hij,hi->hj", turn, normal))
        low = poses.origins[samples, first] + np.einsum("hij,hj->hi", turn, low)
        above = np.einsum("hi,hi->h", normal, low - poses.origins[samples, second])
        return above, np.stack([low, low - above[:, None] * normal], axis=1)


def directions(vectors: Array) -> Array:
    """Vectors of length one, shape `(H, 3)`; those too short to have a direction become zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), 0.0)


DISTANCE_TOLERANCE = 1e-4  # a bound is at most this far below the least distance found [m]
FIRST_PROOF_PIECES = 200  # pieces of the motion to begin with
MOST_PROOF_INTERVALS = 2_000_000  # intervals after which a proof ends with the bounds that it has

_PIECES = 16
_ROUNDING = 1e-12


def proven_distances(
    robot: Robot,
    scene: Scene,
    trajectory: ExactTrajectory,
    owner: Indices,
    enough: Array,
    kept: Array,
) -> Array:
    """Lower bounds of the distances of pairs at all times, shape `(k,)` [m].

    Each of the scene's ways belongs to a pair, its `owner`, shape `(W,)`. Beyond `enough`, shape
    `(k,)` [m], a bound need not be sharp; near above the distances to be `kept`, `(k,)` [m], it is
    sharper than `DISTANCE_TOLERANCE`.
    """
    bounds = _bounds_of(robot, scene, trajectory)
    least, proven = np.full(len(enough), np.inf), np.full(len(enough), np.inf)
    tolerance = np.full(len(kept), DISTANCE_TOLERANCE)
    even = np.linspace(0.0, trajectory.duration, FIRST_PROOF_PIECES + 1)
    times = np.union1d(even, trajectory.breaks)
    times = times[(times >= 0.0) & (times <= trajectory.duration)]
    ways = np.repeat(np.arange(len(owner)), len(times) - 1)
    start, end = (np.tile(edge, len(owner)) for edge in (times[:-1], times[1:]))
    used = 0
    while len(ways):
        pair = owner[ways]
        bound, gap, slack = bounds(ways, start, end, enough[pair])
        np.minimum.at(least, pair, gap)
        goal = np.minimum(enough, goals(least - kept, tolerance) + kept)[pair]
        used += len(ways)
        good = (bound >= goal) | (used > MOST_PROOF_INTERVALS)
        np.minimum.at(proven, pair[good], bound[good])
        with np.errstate(divide="ignore", over="ignore"):
            wanted = np.ceil(slack / np.maximum(gap - goal, 0.01 * DISTANCE_TOLERANCE))
        pieces = np.clip(wanted, 2, _PIECES).astype(np.intp)
        start, end, of = cut(start[~good], end[~good], pieces[~good])
        ways = ways[~good][of]
    return proven


def _bounds_of(
    robot: Robot, scene: Scene, trajectory: ExactTrajectory
) -> Callable[[Indices, Array, Array, Array], tuple[Array, Array, Array]]:
    """What bounds distances of ways over intervals from start to end, `(I,)` each [s].

    It gives the bound, the distance's bound at the middle, and what lies between, `(I,)` each [m].
    Bounds need not be better than its last argument, shape `(I,)` [m].
    """
    lower, upper = trajectory.extremes(0)
    both = [(scene.shapes[a], scene.shapes[b]) for a, b in scene.ways]
    changes = np.array([rates(robot, a, b, lower, upper) for a, b in both])
    fastest, acceleration = (
        np.maximum(*(np.abs(x) for x in trajectory.extremes(order))) * (1.0 + _ROUNDING)
        for order in (1, 2)
    )

    def bounds(
        ways: Indices, start: Array, end: Array, enough: Array
    ) -> tuple[Array, Array, Array]:
        times, samples = np.unique(0.5 * (start + end), return_inverse=True)
        poses = scene.kinematics(trajectory.derivative(times, 0))
        # a little more than half: the middle is rounded
        half = 0.5 * (end - start) * (1.0 + 1e-9) + 1e-15 * trajectory.duration
        speed = np.abs(trajectory.derivative(times, 1))[samples]
        speed = np.minimum(speed + half[:, None] * acceleration, fastest)
        slack = half * np.einsum("ij,ij->i", speed, changes[ways])
        gap = scene.balls(poses)[samples, ways]
        for normals in (scene.centre_lines, lambda *at: scene.exact(*at)[2]):
            short = np.flatnonzero(gap - slack < enough)
            # the solver moves fastest from sample to sample
            short = short[np.argsort(samples[short], kind="stable")]
            at = (poses, ways[short], samples[short])
            found = scene.along(*at, normals(*at))
            gap[short] = np.maximum(gap[short], found)
        return gap - slack, gap, slack

    return bounds
