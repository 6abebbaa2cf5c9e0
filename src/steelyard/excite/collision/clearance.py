r"""Clearances between links, tools and the cell, while optimising and proven for all times.

At the middle of an interval of half length $h$ a distance is at least the gap $g$ between the
heights of both solids along the direction of their nearest points, whatever the solver's tolerance
was. Within the interval it is at least $g - h \sum_j \kappa_j |\dot q_j|$, with $\kappa$ from
`rates` and $|\dot q_j| \le |\dot q_j(t)| + h \max |\ddot q_j|$. Intervals whose bound is
not good enough are cut up; this is conservative advancement [Mirtich1996] without an order in time.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import ModelError
from steelyard.excite.collision.pairs_to_keep_apart import (
    Pair,
    candidate_pairs,
    disabled_pairs,
    find_srdf,
    random_postures,
    separable,
)
from steelyard.excite.collision.robot_and_cell_shapes_from_files import robot_shapes
from steelyard.excite.collision.shapes_given_or_assumed import reach
from steelyard.excite.collision.solids_and_shapes import (
    Poses,
    Shape,
    ShapeKinematics,
    height,
    rates,
    sides,
)
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import cut, goals
from steelyard.excite.constraints.constraint_and_limits import PROOF_BY_BOUNDS, Constraint, Margins
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import Robot

CLEARANCE_MARGIN = 0.01  # distance that is kept by default [m]
CLEARANCE_ROOM = 0.05  # beyond the margin by this much distances are not looked at closely [m]
ROOM_REACH_SHARE = 0.1  # the same over the reach, for small ones: fingers are nowhere 50 mm apart
HEIGHT_ROUNDING = 1e-9  # rounding of a bound that comes from the heights of two solids [m]
DISTANCE_TOLERANCE = 1e-4  # a bound is at most this far below the least distance found [m]
FIRST_PROOF_PIECES = 200  # pieces of the motion to begin with
MOST_PROOF_INTERVALS = 2_000_000  # intervals after which a proof ends with the bounds that it has

_PIECES = 16
_ROUNDING = 1e-12

Indices = NDArray[np.intp]


class Scene:
    """Shapes on a robot and around it, and the pairs of them that matter.

    The numbers of the two shapes of each pair are its `ways`, `(W, 2)`; a half-space is the second.
    """

    def __init__(
        self, robot: Robot, shapes: Sequence[Shape], ways: Sequence[tuple[int, int]]
    ) -> None:
        from steelyard.excite.collision.mjcf_geoms_and_solid_distances import Distances

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
        distances[solid], points[solid] = self._solver.between(
            self.ways[ways[solid]], samples[solid], (poses.rotations, poses.origins)
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


@dataclass(frozen=True, eq=False)
class Clearance(Constraint):
    """Every pair stays apart by its margin.

    A margin is the signed distance $s$ less the distance to keep, `wanted`, `(k,)` [m]. With the
    nearest points $p_a, p_b$ and the unit vector $n$ from $a$ to $b$, its gradient is
    $n^T (J_b(p_b) - J_a(p_a))$. Given as `activation_distance` or more it may be only a lower bound
    of the margin, and its gradient zero. From `walls`, by name, no distance is kept.
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    pairs: tuple[Pair, ...]
    wanted: Array
    activation_distance: Array
    notes: tuple[str, ...] = ()
    name: str = "clearance"
    scope: str = ""
    walls: frozenset[str] = frozenset()
    how: str = PROOF_BY_BOUNDS
    unit: str = "m"
    labels: tuple[str, ...] = field(init=False)
    scene: Scene = field(init=False)
    _owner: Indices = field(init=False)
    _sides: Array = field(init=False)

    def __post_init__(self) -> None:
        scene = Scene(self.robot, self.shapes, [way for pair in self.pairs for way in pair.shapes])
        owner = [k for k, pair in enumerate(self.pairs) for _ in pair.shapes]
        bodies = [[self.shapes[s].body for s in way] for way in scene.ways]
        signs = np.array([sides(self.robot, a, b) for a, b in bodies], dtype=np.float64)
        count = (len(self.pairs),)
        labels = tuple(
            f"'{pair.first}' clear of '{pair.second}'"
            if pair.second in self.walls
            else f"distance of '{pair.first}' and '{pair.second}' above {wanted:g} m"
            for pair, wanted in zip(self.pairs, self.wanted, strict=True)
        )
        set_fields(
            self,
            wanted=frozen(self.wanted, count),
            activation_distance=frozen(self.activation_distance, count),
            labels=labels,
            scene=scene,
            _owner=np.array(owner, dtype=np.intp),
            _sides=signs,
        )

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Margins at positions `q`, shape `(N, n)`; velocities and accelerations do not matter."""
        poses = self.scene.kinematics(np.asarray(q, dtype=np.float64))
        by_way = self.scene.balls(poses)
        limit = (self.wanted + self.activation_distance)[self._owner]
        samples, ways = np.nonzero(by_way < limit)
        lines = self.scene.centre_lines(poses, ways, samples)
        bounds = self.scene.along(poses, ways, samples, lines)
        by_way[samples, ways] = np.maximum(by_way[samples, ways], bounds)
        samples, ways = np.nonzero(by_way < limit)
        exact, points, normals = self.scene.exact(poses, ways, samples)
        by_way[samples, ways] = exact
        values = self._by_pair(by_way)
        slopes = np.zeros((len(q), len(self.pairs), self.robot.n))
        least = exact == values[samples, self._owner[ways]]
        samples, ways = samples[least], ways[least]
        slope = self._slopes(poses, ways, samples, points[least], normals[least])
        slopes[samples, self._owner[ways]] = slope
        return Margins(values - self.wanted, slopes)

    def _slopes(
        self, poses: Poses, ways: Indices, samples: Indices, points: Array, normals: Array
    ) -> Array:
        """Gradients of distances, shape `(H, n)`."""
        signs = self._sides[ways]
        chosen = np.where(signs[:, :, None] > 0.0, points[:, 1:], points[:, :1])
        axes, arms = poses.axes[samples], chosen - poses.anchors[samples]
        turning = np.array([body.kind == "revolute" for body in self.robot.bodies])
        towards = normals[:, None]
        levers = np.where(turning[:, None], np.cross(arms, towards), towards)
        speeds = signs * np.einsum("hbi,hbi->hb", axes, levers)
        slopes = np.zeros((len(ways), self.robot.n))
        for k, body in enumerate(self.robot.bodies):
            slopes[:, body.coordinate] += body.ratio * speeds[:, k]
        return slopes

    def distances(self, q: Array) -> Array:
        """Signed distances of all pairs at positions `(N, n)`, shape `(N, k)` [m]."""
        q = np.asarray(q, dtype=np.float64)
        poses = self.scene.kinematics(q)
        shape = (len(q), len(self._owner))
        samples, ways = (index.ravel() for index in np.indices(shape))
        return self._by_pair(self.scene.exact(poses, ways, samples)[0].reshape(shape))

    def _by_pair(self, by_way: Array) -> Array:
        """The least of every pair's ways, shape `(N, k)`; these are side by side."""
        first = np.searchsorted(self._owner, np.arange(len(self.pairs)))
        return np.asarray(np.minimum.reduceat(by_way, first, axis=1))

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """Bounds are at most 0.1 mm below the least margin or `activation_distance`."""
        owner, kept, enough = self._owner, self.wanted, self.wanted + self.activation_distance
        least, proven = np.full(len(enough), np.inf), np.full(len(enough), np.inf)
        tolerance = np.full(len(kept), DISTANCE_TOLERANCE)
        bounds = self._bounds(trajectory)
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
        return proven - kept

    def _bounds(
        self, trajectory: ExactTrajectory
    ) -> Callable[[Indices, Array, Array, Array], tuple[Array, Array, Array]]:
        """What bounds distances of ways over intervals from start to end, `(I,)` each [s].

        It gives the bound, the distance's bound at the middle, and what lies between, `(I,)` each
        [m]. Bounds need not be better than its last argument, shape `(I,)` [m].
        """
        scene = self.scene
        changes = self._changes(*trajectory.extremes(0))
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
                gap[short] = np.maximum(gap[short], scene.along(*at, normals(*at)))
            return gap - slack, gap, slack

        return bounds

    def _changes(self, lower: Array, upper: Array) -> Array:
        """Change of every way's distance per change of each joint within bounds, `(W, n)`."""
        shapes = self.shapes
        pairs = [(shapes[a], shapes[b]) for a, b in self.scene.ways]
        return np.array([rates(self.robot, a, b, lower, upper) for a, b in pairs])

    def reaches(self, lower: Array, upper: Array) -> Array:
        """See `Constraint`."""
        most = np.zeros((len(self.pairs), self.robot.n))
        np.maximum.at(most, self._owner, self._changes(lower, upper))
        return most


def self_clearance(
    loaded: LoadedRobot,
    *,
    skip: Collection[str] = (),
    margin: float = CLEARANCE_MARGIN,
    others: Sequence[Shape] = (),
    ignore: Sequence[tuple[str, str]] = (),
    bodies: bool = True,
) -> Clearance:
    """The constraint that a robot keeps clear of itself and of its cell.

    Its shapes are those of its model file but for the links `skip`, with the SRDF beside it, and
    `others`: tools, payloads and what stands in the cell. The robot's own pairs that overlap at all
    random postures tried are left out, as they cannot be kept apart; those that are never as far
    apart as their margin [m] are kept from touching. Both are noted. Pairs with the cell must be
    able to keep the margin; what is fixed to the base has none. From `CLEARANCE_ROOM` beyond the
    margin on, or `ROOM_REACH_SHARE` of the robot's reach, whichever is less, a pair does not
    matter. Pairs of names to `ignore` may touch; without `bodies` the robot and its tools keep
    clear of the cell only.

    Raises:
        ModelError: No pair is left, a name in `ignore` does not exist, two things have one, or the
            cell overlaps a link at all postures tried or is never `margin` away from it.
    """
    robot, model = loaded.robot, loaded.sources[-1].path
    if model.suffix.lower() == ".toml":
        raise ModelError(
            "a table of Denavit-Hartenberg parameters has no shapes that could collide",
            where=str(model),
            fix="name a URDF or an MJCF with collision shapes, or leave collision out",
        )
    geometry = robot_shapes(robot, model, skip)
    srdf = find_srdf(model, loaded.model_given)
    if srdf is not None:
        never = geometry.never | disabled_pairs(srdf)
        notes = (*geometry.notes, f"pairs of links that may touch are taken from '{srdf}'")
        geometry = replace(geometry, never=never, notes=notes)
    shapes = (*geometry.shapes, *others)
    pairs, notes, left = candidate_pairs(robot, geometry, shapes, ignore, bodies)
    _check_pairs(robot, pairs)
    far = np.full(len(pairs), min(CLEARANCE_ROOM, ROOM_REACH_SHARE * reach(robot)))
    whole = Clearance(robot, shapes, pairs, np.full(len(pairs), margin), far)
    farthest = whole.distances(random_postures(robot)).max(axis=0)
    kept, wanted, more = separable(shapes, pairs, farthest, margin)
    _check_pairs(robot, kept)
    left += len(pairs) - len(kept)
    scope = f"{len(kept)} pair{'s' * (len(kept) != 1)}" + (f", {left} left out" if left else "")
    notes = (*geometry.notes, *notes, *more)
    return Clearance(robot, shapes, kept, wanted, far[: len(kept)], notes, scope=scope)


def _check_pairs(robot: Robot, pairs: tuple[Pair, ...]) -> None:
    if not pairs:
        raise ModelError(
            "no pair of bodies is left that could collide",
            where=f"robot '{robot.name}'",
            fix="give obstacles or a tool, ignore fewer pairs, or leave collision out",
        )
