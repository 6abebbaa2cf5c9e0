r"""Postures that bring a frame to a place, with the tool oriented as required.

Levenberg-Marquardt, many problems side by side. With the residual $r$ (metres, and radians times a
length) and its Jacobian $J$ of the joints that are free to move, a step is

$$\Delta q = J^T (J J^T + \lambda I)^{-1} r,$$

the shortest that a redundant arm can make [Wampler1986]. Joints at an end of their range that
would leave it stand still, so the method ends at the nearest place within the ranges where the
target itself is out of reach.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.excite.collision.solids_and_shapes import axes_along
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.model.equations.frame_and_point_kinematics import (
    frame_kinematics,
    refuse_fixed,
    refuse_passive,
)
from steelyard.robot.robot import Frame, Robot


@dataclass(frozen=True, eq=False)
class Attitude:
    """What is required of a tool's orientation: z in a `direction` of the base, or nothing.

    The turn about that axis is free; those about the two axes `across`, `(k, 3)`, must be zero.
    """

    direction: Array | None
    across: Array

    def __init__(self, direction: ArrayLike | None = None) -> None:
        set_fields(self, direction=None, across=np.zeros((0, 3)))
        if direction is None:
            return
        vector = frozen(direction, (3,))
        length = float(np.linalg.norm(vector))
        if not 1e-9 < length < np.inf:
            raise ValueError(f"the direction of a tool has no direction: {vector}")
        unit = frozen(vector / length)
        set_fields(self, direction=unit, across=axes_along(unit)[:, :2].T)

    @property
    def rows(self) -> int:
        """Number of turns `k` that must be zero, 0 or 2."""
        return len(self.across)

    def turns(self, rotation: Array) -> Array:
        """Turns that are left to make, shape `(N, k)` [rad], at orientations `(N, 3, 3)`."""
        if self.direction is None:
            return np.zeros((len(rotation), 0))
        axis = rotation[:, :, 2]
        normal = np.cross(axis, self.direction)
        sine = np.linalg.norm(normal, axis=1)
        angle = np.arctan2(sine, axis @ self.direction)
        opposite = (sine < 1e-9) & (angle > 1.0)
        normal[opposite], sine[opposite] = self.across[0], 1.0
        length = np.where(sine < 1e-12, 1.0, angle / np.maximum(sine, 1e-12))
        return np.asarray((normal * length[:, None]) @ self.across.T)

    def slopes(self, angular: Array) -> Array:
        """How the turns made grow with the joints, `(N, k, n)`, from rates `(N, 3, n)`."""
        return np.asarray(self.across @ angular)


REACHED = 1e-8  # a place is reached when it is missed by less than this [m; rad]
_LENGTH = 0.3  # one radian of turn weighs as much as this many metres
_DRAW = 0.1  # spare joints are drawn by this at once at most [rad; m]
_TRUSTED = 1e-6  # damping over the Jacobian's size, where the start is near; else a thousandfold

Kinematics = Callable[[Array], tuple[Array, Array, Array]]
"""At postures `(N, n)` the origin `(N, 3)` [m] and orientation `(N, 3, 3)` of a frame in the base,
and the rates of the origin, then of turning, per joint rate, `(N, 6, n)`."""


@dataclass(frozen=True, eq=False)
class Postures:
    """Postures `(N, n)` for targets, and how far they miss these [m] and the attitude [rad]."""

    q: Array
    missed: Array
    turned: Array

    @property
    def reached(self) -> Array:
        """Whether each target is reached, as booleans `(N,)`."""
        return np.asarray((self.missed < REACHED) & (self.turned < REACHED))


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Solves for postures of one frame within ranges of positions `(n,)` [rad; m]."""

    kinematics: Kinematics
    lower: Array
    upper: Array
    attitude: Attitude

    @classmethod
    def of(
        cls, robot: Robot, frame: Frame, limits: MotionLimits, attitude: Attitude
    ) -> "InverseKinematics":
        """For a frame of a robot, within the position limits.

        Raises:
            ModelError: It does not move, or loops decide where it is.
        """
        refuse_passive(robot, frame.body, frame.name)
        refuse_fixed(robot, frame)
        return cls(frame_kinematics(robot, frame), limits.lower, limits.upper, attitude)

    @property
    def spare(self) -> int:
        """Joints beyond what the place and the attitude need."""
        return len(self.lower) - 3 - self.attitude.rows

    def place(self, q: Array) -> Array:
        """The frame's origin, shape `(N, 3)` [m], at postures `(N, n)`."""
        return self.kinematics(q)[0]

    def solve(
        self, targets: Array, seeds: Array, *, near: bool = False, rounds: int = 100
    ) -> Postures:
        """The postures that come nearest to targets `(N, 3)` [m], from seeds `(N, n)` [rad; m].

        With `near` the seeds are close: hardly any damping to begin with.
        """
        q = np.clip(seeds, self.lower, self.upper)
        rest = self.missing(q, targets)
        damping = np.full(len(q), _TRUSTED if near else 1e3 * _TRUSTED)
        active = np.arange(len(q))
        for _ in range(rounds):
            if not len(active):
                break
            step = self._step(q[active], rest[active], damping[active])
            trial = np.clip(q[active] + step, self.lower, self.upper)
            left = self.missing(trial, targets[active])
            better = np.sum(left**2, axis=1) < np.sum(rest[active] ** 2, axis=1)
            moved = np.abs(trial - q[active]).max(axis=1)
            q[active[better]], rest[active[better]] = trial[better], left[better]
            damping[active] = np.clip(damping[active] * np.where(better, 0.1, 10.0), 1e-14, 1e6)
            small = np.abs(rest[active]).max(axis=1) < 1e-3 * REACHED
            active = active[~small & (moved > 1e-12)]
        left = rest / weights_of(self.attitude)
        return Postures(q, np.linalg.norm(left[:, :3], axis=1), np.linalg.norm(left[:, 3:], axis=1))

    def reach(self, target: Array, seed_posture: Array, seed: int, restarts: int = 24) -> Postures:
        """`nearest` from a seed posture `(n,)` and random starts."""
        rng = np.random.default_rng(seed)
        starts = rng.uniform(self.lower, self.upper, (restarts, len(self.lower)))
        return self.nearest(target, np.vstack([seed_posture, starts]))

    def nearest(self, target: Array, starts: Array) -> Postures:
        """Postures found for one target `(3,)` from starts `(k, n)`, by distance from the first.

        Those that reach it come first; where none does, the one that comes nearest.
        """
        found = self.solve(np.tile(target, (len(starts), 1)), starts)
        far = np.linalg.norm(found.q - starts[0], axis=1)
        if found.reached.any():
            order = np.argsort(np.where(found.reached, far, np.inf), kind="stable")
            order = order[: int(found.reached.sum())]
        else:
            order = np.argsort(np.hypot(found.missed, _LENGTH * found.turned), kind="stable")
        return Postures(found.q[order], found.missed[order], found.turned[order])

    def agile_first(self, q: Array) -> Array:
        """Postures `(N, n)` in another order: first those that can move best.

        By the least singular value of the Jacobian times the room to the nearest end of a range,
        relative to half the range.
        """
        half = 0.5 * (self.upper - self.lower)
        room = np.min(np.minimum(q - self.lower, self.upper - q) / half, axis=1)
        agility = np.linalg.svd(self.rates(q), compute_uv=False)[:, -1]
        return np.asarray(q[np.argsort(-agility * room, kind="stable")])

    def drawn(self, target: Array, q: Array, towards: Array, share: float = 0.2) -> Array:
        """A posture that keeps the target, its spare joints drawn towards another posture.

        They go a share of the way, and at most by `_DRAW`.
        """
        if self.spare <= 0:
            return q
        jacobian = self.rates(q[None])[0]
        drawn = share * (towards - q)
        drawn *= min(1.0, _DRAW / max(float(np.abs(drawn).max()), _DRAW))
        free = drawn - np.linalg.lstsq(jacobian, jacobian @ drawn, rcond=1e-9)[0]
        found = self.solve(target[None], (q + free)[None], near=True)
        return found.q[0] if found.reached[0] else q

    def missing(self, q: Array, targets: Array) -> Array:
        """What is left to go and to turn, shape `(N, 3 + k)`; turns weighed as lengths [m]."""
        place, rotation, _ = self.kinematics(q)
        left = np.hstack([targets - place, self.attitude.turns(rotation)])
        return np.asarray(left * weights_of(self.attitude))

    def rates(self, q: Array) -> Array:
        """How the way made grows with the joints, shape `(N, 3 + k, n)`, weighed alike."""
        rates = self.kinematics(q)[2]
        rows = np.concatenate([rates[:, :3], self.attitude.slopes(rates[:, 3:])], axis=1)
        return np.asarray(rows * weights_of(self.attitude)[:, None])

    def _step(self, q: Array, rest: Array, damping: Array) -> Array:
        """One damped step, shape `(N, n)`; joints that would leave their range stand still."""
        jacobian = self.rates(q)
        downhill = np.einsum("nij,ni->nj", jacobian, rest)
        stuck = ((q >= self.upper) & (downhill > 0.0)) | ((q <= self.lower) & (downhill < 0.0))
        free = np.where(stuck[:, None, :], 0.0, jacobian)
        square = free @ np.swapaxes(free, 1, 2)
        size = np.trace(square, axis1=1, axis2=2) + 1e-12
        square += (damping * size)[:, None, None] * np.eye(square.shape[1])
        step: Array = np.einsum(
            "nij,ni->nj", free, np.linalg.solve(square, rest[:, :, None])[:, :, 0]
        )
        return step


def weights_of(attitude: Attitude) -> Array:
    """Weights of a place's coordinates and of an attitude's turns, shape `(3 + k,)`."""
    return np.array([1.0] * 3 + [_LENGTH] * attitude.rows)


def within(limits: MotionLimits, margin: float = 1e-3) -> MotionLimits:
    """The limits with position ranges narrower at both ends by `margin` [rad; m], 1 % at most."""
    narrow = np.minimum(margin, 0.01 * (limits.upper - limits.lower))
    return replace(limits, lower=limits.lower + narrow, upper=limits.upper - narrow)
