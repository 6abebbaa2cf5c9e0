r"""Contacts whose force is unknown: what they are known by, and rows of the equations without it.

With unknown contact forces $F$ the equations of a sample are $Y \pi - \tau = J^T F + \epsilon$,
with errors of standard deviations $\Sigma = \operatorname{diag}(\sigma_j)$. Behind

$$ M = \Sigma P \Sigma^{-1}, \qquad
   P = 1 - J_w^T (J_w J_w^T)^+ J_w, \qquad J_w = J \Sigma^{-1}, $$

the forces are gone: $M J^T = 0$. $P$ is the projection on the null space of the contacts'
whitened Jacobian, so that
$\sum_j (M Y)_j^T (M Y)_j / \sigma_j^2 = Y^T \Sigma^{-1} P\, \Sigma^{-1} Y$
are the normal equations of the best estimate. Row $j$ of $M \epsilon$ has the variance
$\sigma_j^2 P_{jj}$: it is worth $P_{jj}$ of a row, and $\operatorname{tr} P$ rows are left.

Whether a foot touches is uncertain near the time at which it begins or ends. Its force is taken out
there as well, which is right whether it touches or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.robot import BASE_COORDINATES
from steelyard.runs.frames_of_contacts import kinematics_of

SURE = 0.02  # how far an interpolated flag may be from 0 where nothing touches
DEPENDENT = 1e-10  # eigenvalue over the largest below which directions of forces are the same


def channels_of_touches(base: BaseSignals) -> int:
    """Channels that say where contacts are: a flag each, and where up is if one is round."""
    return len(base.touches) + (3 if base.rolls else 0)


def touch_channels(base: BaseSignals, logged: Array, axes: Array | None) -> Array:
    """These channels `(N, c)` from logged columns, and the base's axes in the world `(N, 3, 3)`."""
    limits = np.array([touch.threshold for touch in base.touches])
    with np.errstate(invalid="ignore"):
        touching = np.where(np.isnan(logged), np.nan, (logged > limits).astype(np.float64))
    if not base.rolls:
        return touching
    assert axes is not None
    return np.hstack([touching, axes[:, 2, :]])


def margin_samples(base: BaseSignals | None, rate: float) -> int:
    """Samples around a change of contacts that the longest margin has."""
    touches = () if base is None else base.touches
    return max((ceil(touch.margin * rate) for touch in touches), default=0)


def with_margins(base: BaseSignals, channels: Array, rate: float) -> Array:
    """Flags that hold a margin earlier and later; of channels with `margin_samples` of context."""
    from scipy.ndimage import maximum_filter1d

    halo = margin_samples(base, rate)
    found = channels.copy()
    for row, touch in zip(found, base.touches, strict=False):
        reach = 2 * ceil(touch.margin * rate) + 1
        row[:] = maximum_filter1d(np.where(np.abs(row) > SURE, 1.0, 0.0), reach)
    return found[:, halo : found.shape[1] - halo]


@dataclass(frozen=True, eq=False)
class Touching:
    """Which contacts touch at some samples, and the rows of the equations without their forces.

    `gains` are joint torque per logged effort, shape `(n,)`; `flags` `(c, B)`; `up` is along the
    base's axes, `(3, B)`, without rows if no contact is round.
    """

    base: BaseSignals
    gains: Array
    flags: NDArray[np.bool_]
    up: Array

    @classmethod
    def of(cls, base: BaseSignals, gains: Array, channels: Array) -> "Touching":
        """From channels `(c, B)` behind `with_margins`."""
        count = len(base.touches)
        return cls(base, gains, channels[:count] > 0.5, channels[count:])

    @classmethod
    def joined(cls, parts: Sequence["Touching"]) -> "Touching":
        """Of consecutive samples."""
        flags, up = (
            np.concatenate([getattr(p, x) for p in parts], axis=1) for x in ("flags", "up")
        )
        return replace(parts[0], flags=flags, up=up)

    def part(self, start: int, stop: int) -> "Touching":
        """The samples from `start` to `stop`."""
        return replace(self, flags=self.flags[:, start:stop], up=self.up[:, start:stop])

    def projection(self, q: Array, counted: NDArray[np.bool_] | None = None) -> Array:
        """The matrix $M$ at positions `(n, B)`, shape `(B, n, n)`, for efforts in joints' units.

        Rows that are not `counted`, `(n, B)`, are zero, and nothing of them is in other rows.
        """
        n, count = q.shape
        spread = np.array(self.base.spread) if self.base.spread else np.ones(n)
        known = np.ones((count, n)) if counted is None else counted.T.astype(np.float64)
        jacobian = self.jacobian(q) / spread * known[:, None, :]
        lengths = np.linalg.norm(jacobian, axis=2, keepdims=True)
        jacobian = np.divide(jacobian, lengths, out=np.zeros_like(jacobian), where=lengths > 0.0)
        values, vectors = np.linalg.eigh(jacobian @ jacobian.transpose(0, 2, 1))
        least = DEPENDENT * np.maximum(values[:, -1:], 1e-300)
        roots = np.where(values > least, 1.0 / np.sqrt(np.maximum(values, least)), 0.0)
        directions = (vectors * roots[:, None, :]).transpose(0, 2, 1) @ jacobian
        projection = -directions.transpose(0, 2, 1) @ directions
        projection[:, range(n), range(n)] += known
        return np.asarray(spread[:, None] * projection / spread)

    def with_forces(self, q: Array, measured: Array, predicted: Array) -> Array:
        """Predicted efforts with the contact forces that fit best; all logged ones, `(n, B)`.

        Rows of a base on which any wrench may act say nothing of them.
        """
        rest = (measured - predicted) * self.gains[:, None]
        counted = np.ones(q.shape, dtype=bool)
        counted[: len(BASE_COORDINATES)] = self.base.wrench_known
        unexplained = np.einsum("bij,jb->ib", self.projection(q, counted), rest)
        return np.asarray(measured - unexplained / self.gains[:, None])

    def jacobian(self, q: Array) -> Array:
        """Jacobians of all contacts `(B, m, n)`, zero where one does not touch."""
        rows = []
        names = tuple(touch.frame for touch in self.base.touches)
        for touch, flags, kinematics in zip(
            self.base.touches, self.flags, kinematics_of(self.base, names), strict=True
        ):
            if not flags.any():
                continue
            _, axes, jacobian = kinematics(q.T)
            arm = axes @ np.array(touch.place)
            if touch.radius > 0.0:
                arm = arm - touch.radius * self.up.T
            turned = np.cross(jacobian[:, 3:], arm[:, :, None], axis=1)
            found = jacobian if touch.sole else jacobian[:, :3] + turned
            rows.append(found * flags[:, None, None])
        return np.concatenate(rows or [np.zeros((q.shape[1], 1, len(q)))], axis=1)

    def levers(self, q: Array, efforts: Array, counted: NDArray[np.bool_] | None = None) -> Array:
        r"""Efforts of contact forces per metre by which their points are elsewhere, `(n, B, 3 c)`.

        Each contact is moved along the axes of its frame. The forces $F$ are those that fit efforts
        `(n, B)` in joints' units best: $M\, \Delta J^T F$ of the rows that are `counted`.
        """
        known = np.ones(q.T.shape) if counted is None else counted.T.astype(np.float64)
        matrix, jacobian = self.projection(q, counted), self.jacobian(q) * known[:, None]
        inverse = np.linalg.pinv(jacobian @ jacobian.transpose(0, 2, 1), hermitian=True)
        lost = known * efforts.T - np.einsum("bij,jb->bi", matrix, efforts)
        forces = np.einsum("bij,bjk,bk->bi", inverse, jacobian, lost)
        names, at = tuple(touch.frame for touch in self.base.touches), 0
        found = np.zeros((*q.shape, 3 * len(names)))
        for number, kinematics in enumerate(kinematics_of(self.base, names)):
            flags = self.flags[number]
            if not flags.any():
                continue
            _, axes, own = kinematics(q.T)
            moments = np.cross(axes, forces[:, at : at + 3, None], axis=1) * flags[:, None, None]
            found[..., 3 * number : 3 * number + 3] = np.einsum("bin,bik->nbk", own[:, 3:], moments)
            at += 6 if self.base.touches[number].sole else 3
        return np.asarray(np.einsum("bij,jbk->ibk", matrix, found))
