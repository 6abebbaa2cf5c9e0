"""Clearances between links, tools and the cell, while optimising and proven for all times."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.excite.collision.distances import Indices, Scene, proven_distances
from steelyard.excite.collision.model_shapes import robot_shapes
from steelyard.excite.collision.pairs import (
    Pair,
    candidate_pairs,
    disabled_pairs,
    find_srdf,
    random_postures,
    separable,
)
from steelyard.excite.collision.robot_shapes import reach
from steelyard.excite.collision.shapes import Poses, Shape, rates, sides
from steelyard.excite.constraints.constraint import PROOF_BY_BOUNDS, Constraint, Margins
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.robot.robot import Robot

CLEARANCE_MARGIN = 0.01  # distance that is kept by default [m]
CLEARANCE_ROOM = 0.05  # beyond the margin by this much distances are not looked at closely [m]

ROOM_REACH_SHARE = 0.1  # the same over the reach, for small ones: fingers are nowhere 50 mm apart


@dataclass(frozen=True, eq=False)
class Clearance(Constraint):
    """Every pair stays apart by its margin.

    A margin is the signed distance $s$ less the distance to keep, `wanted`, `(k,)` [m]. With the
    nearest points $p_a, p_b$ and the unit vector $n$ from $a$ to $b$, its gradient is $n^T
    (J_b(p_b) - J_a(p_a))$. Where a margin is given as `activation_distance` or more it may be only
    a lower bound of it, and its gradient zero. From `walls`, by name, no distance is kept.
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
        for name, value in (
            ("wanted", frozen(self.wanted, count)),
            ("activation_distance", frozen(self.activation_distance, count)),
            ("labels", labels),
            ("scene", scene),
            ("_owner", np.array(owner, dtype=np.intp)),
            ("_sides", signs),
        ):
            object.__setattr__(self, name, value)

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
        by_way = self.scene.exact(poses, ways, samples)[0].reshape(shape)
        return self._by_pair(by_way)

    def _by_pair(self, by_way: Array) -> Array:
        """The least of every pair's ways, shape `(N, k)`; these are side by side."""
        first = np.searchsorted(self._owner, np.arange(len(self.pairs)))
        return np.asarray(np.minimum.reduceat(by_way, first, axis=1))

    def nearest(self, q: Array) -> str:
        """Such as `'panda_link5' and 'panda_hand' overlap by 12 mm`, at a posture `(n,)`.

        It is the pair that is nearest to its margin, or farthest below it.
        """
        distances = self.distances(np.asarray(q, dtype=np.float64)[None])[0]
        k = int(np.argmin(distances - self.wanted))
        how = "overlap by" if distances[k] < 0.0 else "are apart by"
        first, second = self.pairs[k].first, self.pairs[k].second
        return f"'{first}' and '{second}' {how} {abs(distances[k]) * 1e3:.3g} mm"

    def proven(self, trajectory: ExactTrajectory) -> Array:
        """Bounds are at most 0.1 mm below the least margin or `activation_distance`."""
        enough = self.wanted + self.activation_distance
        found = proven_distances(
            self.robot, self.scene, trajectory, self._owner, enough, self.wanted
        )
        return found - self.wanted

    def reaches(self, lower: Array, upper: Array) -> Array:
        """See `Constraint`."""
        shapes, most = self.scene.shapes, np.zeros((len(self.pairs), self.robot.n))
        for k, (a, b) in zip(self._owner, self.scene.ways, strict=True):
            most[k] = np.maximum(most[k], rates(self.robot, shapes[a], shapes[b], lower, upper))
        return most


def self_clearance(
    loaded: LoadedRobot,
    *,
    skip: Collection[str] = (),
    margin: float = CLEARANCE_MARGIN,
    activation_distance: float | None = None,
    others: Sequence[Shape] = (),
    ignore: Sequence[tuple[str, str]] = (),
    bodies: bool = True,
) -> Clearance:
    """The constraint that a robot keeps clear of itself and of its cell.

    Its shapes are those of its model file but for the links `skip`, with the SRDF beside it, and
    `others`: tools, payloads and what stands in the cell. The robot's own pairs that overlap at all
    random postures tried are left out, as they cannot be kept apart; those that are never as far
    apart as their margin [m] are kept from touching. Both are noted. Pairs with the cell must be
    able to keep the margin; what is fixed to the base has none. From `activation_distance` [m]
    beyond the margin on a pair does not matter: `CLEARANCE_ROOM`, or `ROOM_REACH_SHARE` of how far
    the robot reaches, whichever is less, if `None`. Pairs of names to `ignore` may touch; without
    `bodies` the robot and its tools keep clear of the cell only.

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
    if activation_distance is None:
        activation_distance = min(CLEARANCE_ROOM, ROOM_REACH_SHARE * reach(robot))
    far = np.full(len(pairs), activation_distance)
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
