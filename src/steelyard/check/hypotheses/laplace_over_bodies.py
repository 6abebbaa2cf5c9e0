r"""Least squares of all joints with bodies and friction that can exist averaged, many at once.

In units of each effort's root mean square, joint j's effort is

$$ \hat e_j = Z_j u + Y_j \theta_j + \varepsilon_j, \qquad \varepsilon_j \sim N(0, \sigma_j^2) $$

with bodies $u$, friction and rotor inertia $\theta_j \ge 0$ and an offset. A body's pseudo-inertia
relative to its nominal one, $X_i$, has the density $\propto |X_i|^\gamma e^{-\gamma
\operatorname{tr} X_i}$ of a Wishart distribution, which is largest at the nominal body, has the
relative width $w = \gamma^{-1/2}$ about it, and is zero where no body can exist; friction has the
same in one dimension. The integral over both is Laplace's, about a maximum that Newton's method
finds, with each joint's own unknowns eliminated. Residuals are not expected below a share of the
effort. What is returned is relative to efforts without any model, $\hat e_j \sim N(0, 1)$.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, multigammaln

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.nuisance_fit_and_score import MISFIT_FLOOR, NUISANCES, ROUNDING
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import BASIS

FRICTION_WIDTH, TYPICAL_FRICTION = 2.0, 0.1
"""Relative width of friction, and its most likely size over the effort."""
OFFSET_WIDTH = 0.3  # std of an offset over the effort, or over that of the nominal bodies if larger
INSIDE = 0.9  # share of the way to where no body exists that one step goes
CONVERGED = 1e-2  # rise of the log-likelihood that a further step promises, at which it is one
FIRST_VARIANCE = 0.1  # of residuals, before any are known
NO_EVIDENCE = -1e300  # log evidence where the Hessian is singular: efforts of no size

Flags = NDArray[np.bool_]
DIAGONAL = np.array([1, 0, 1, 0, 0, 1, 0, 0, 0, 1], dtype=np.bool_)
LENGTHS = np.where(DIAGONAL, 1.0, np.sqrt(0.5))
_ENTRIES = BASIS * LENGTHS[:, None, None]  # of `X` per unknown, shape `(10, 4, 4)`
_IDENTITY = np.where(DIAGONAL, 1.0, 0.0)
_FRICTION_SHAPE = FRICTION_WIDTH**-2
_FRICTION_RATE = _FRICTION_SHAPE / TYPICAL_FRICTION


def nominal_bodies(count: int) -> Array:
    """Unknowns of nominal bodies, shape `(10 count,)`."""
    return np.tile(_IDENTITY, count)


@dataclass(frozen=True, eq=False)
class Averaged:
    """What Laplace's method finds of `h` problems with bodies of `w` widths."""

    logs: Array  # log evidence, shape `(h, w)`
    bodies: Array  # the most likely ones, shape `(h, w, k)`
    misfits: Array  # root mean square of what they leave over the effort's, shape `(h, w, n)`


def averaged(
    yy: Array, ye: Array, ee: Array, counts: Array, positive: Flags, gamma: Array, steps: int
) -> Averaged:
    """Of products of columns `(h, n, k + 4, k + 4)`, and of these with efforts `(h, n, k + 4)`.

    `ee` are mean squares of efforts and `counts` samples `(h, n)`, `positive` says which of a
    joint's unknowns are `(n, 4)`; `gamma`: density of bodies `(h, w, k / 10)`, `steps`: most steps.
    """
    fit = _Fit(yy, ye, ee, counts, positive, gamma)
    for step in range(steps):
        rise = fit.step()
        if step < steps - 1:
            fit.reweigh()
        if rise < CONVERGED:
            break
    return fit.result()


class _Fit:
    """The state of Newton's method: unknowns and variances of all problems and widths."""

    def __init__(
        self, yy: Array, ye: Array, ee: Array, counts: Array, positive: Flags, gamma: Array
    ) -> None:
        h, n, k = *ye.shape[:2], ye.shape[2] - NUISANCES
        w, count = gamma.shape[1:]
        self._shape, self._k = (h, w, n), k
        self._bodies = np.ascontiguousarray(yy[..., :k, :k])
        self._mixed, self._own = (
            np.ascontiguousarray(yy[..., s, k:]) for s in (slice(k), slice(k, None))
        )
        self._ye, self._ee, self._counts = ye, ee[:, None], counts
        self._positive, self._gamma = positive, gamma
        self.u = np.tile(nominal_bodies(count), (h, w, 1))
        self.theta = np.tile(np.where(positive, TYPICAL_FRICTION, 0.0), (h, w, 1, 1))
        self.variance = np.full((h, w, n), FIRST_VARIANCE)
        self._factorise()

    def step(self) -> float:
        """Newton's, as far as bodies and friction can exist; the largest rise that it promised."""
        slope, bend, own_slope, own_bend, coupling = self._expansion()
        own_inverse = np.linalg.inv(own_bend)
        passed = _side_by_side(coupling @ own_inverse)
        bend = bend - passed @ _side_by_side(coupling).swapaxes(-1, -2)
        flat = own_slope.reshape(*own_slope.shape[:2], -1, 1)
        right = slope - (passed @ flat)[..., 0]
        sizes = np.sqrt(np.diagonal(bend, axis1=-2, axis2=-1))
        scaled = bend / sizes[..., :, None] / sizes[..., None, :] + ROUNDING * np.eye(self._k)
        move = -np.linalg.solve(scaled, (right / sizes)[..., None])[..., 0] / sizes
        along = own_slope + self._weight()[..., None] * self._mixed_with(move)
        own = -np.einsum("hwjab,hwjb->hwja", own_inverse, along)
        rise = -0.5 * (np.sum(slope * move, axis=-1) + np.sum(own_slope * own, axis=(-1, -2)))
        change = np.tensordot(move.reshape(*move.shape[:2], -1, 10), _ENTRIES, axes=1)
        lowest = np.linalg.eigvalsh(self._factor.swapaxes(-1, -2) @ change @ self._factor)[..., 0]
        relative = np.where(self._positive, own / self._safe(), 0.0)
        least = np.minimum(lowest.min(axis=-1), relative.min(axis=(-1, -2)))
        length = np.minimum(1.0, INSIDE / np.maximum(-least, 1e-12))
        self.u = self.u + length[..., None] * move
        self.theta = self.theta + length[..., None, None] * own
        self._factorise()
        return float(np.max(np.abs(rise)))

    def reweigh(self) -> None:
        """Variances by what is left; none is worse than no model, so that no joint is given up."""
        self.variance = np.clip(self._squares(), 0.0, 1.0) + MISFIT_FLOOR**2

    def result(self) -> Averaged:
        _, bend, _, own_bend, coupling = self._expansion()
        passed = coupling @ np.linalg.inv(own_bend)
        bend = bend - _side_by_side(passed) @ _side_by_side(coupling).swapaxes(-1, -2)
        bends = np.linalg.slogdet(bend)[1] + np.linalg.slogdet(own_bend)[1].sum(axis=-1)
        whole = self._k + self._positive.size
        counts, squares = self._counts[:, None], self._squares()
        likely = counts * (squares / self.variance + np.log(self.variance) - 1.0)
        logs = self._prior() - 0.5 * np.sum(likely, axis=-1)
        logs += 0.5 * (whole * np.log(2.0 * np.pi) - bends)
        logs = np.where(np.isfinite(logs), logs, NO_EVIDENCE)
        return Averaged(logs, self.u, np.sqrt(np.maximum(squares, 0.0) + MISFIT_FLOOR**2))

    def _expansion(self) -> tuple[Array, Array, Array, Array, Array]:
        """Slopes and bends of minus the log density, by bodies, by a joint's own, and by both."""
        h, w, n = self._shape
        weight = self._weight()
        left, own_left = self._slopes()
        slope = (weight[..., None, :] @ left)[..., 0, :]
        bend = (weight @ self._bodies.reshape(h, n, -1)).reshape(h, w, self._k, self._k)
        turned = self._inverse[..., None, :, :] @ _ENTRIES  # (h, w, bodies, 10, 4, 4)
        traces = np.trace(turned, axis1=-2, axis2=-1)
        slope += (self._gamma[..., None] * (_IDENTITY - traces)).reshape(slope.shape)
        rows = turned.reshape(*turned.shape[:-2], 16)
        bends = rows @ turned.swapaxes(-1, -2).reshape(rows.shape).swapaxes(-1, -2)
        for b in range(self._gamma.shape[2]):
            part = slice(10 * b, 10 * b + 10)
            bend[..., part, part] += self._gamma[..., b, None, None] * bends[..., b, :, :]
        safe, friction = self._safe(), self._positive
        own_slope = weight[..., None] * own_left + np.where(
            friction, _FRICTION_RATE - _FRICTION_SHAPE / safe, self.theta / OFFSET_WIDTH**2
        )
        own_bend = weight[..., None, None] * self._own[:, None]
        curve = np.where(friction, _FRICTION_SHAPE / safe**2, OFFSET_WIDTH**-2)
        own_bend[..., np.arange(NUISANCES), np.arange(NUISANCES)] += curve
        coupling = weight[..., None, None] * self._mixed[:, None]
        return slope, bend, own_slope, own_bend, coupling

    def _slopes(self) -> tuple[Array, Array]:
        """Products of bodies' columns, and of a joint's own, with what is left of its effort."""
        k = self._k
        theta = self.theta.transpose(0, 2, 3, 1)  # (h, n, 4, w)
        bodies = self._bodies @ self.u[:, None].swapaxes(-1, -2) + self._mixed @ theta
        own = (self._own @ theta).transpose(0, 3, 1, 2) + self._mixed_with(self.u)
        ye = self._ye[:, None]
        return bodies.transpose(0, 3, 1, 2) - ye[..., :k], own - ye[..., k:]

    def _mixed_with(self, bodies: Array) -> Array:
        """Products of joints' own columns with the effort of bodies `(h, w, k)`, `(h, w, n, 4)`."""
        found = self._mixed.swapaxes(-1, -2) @ bodies[:, None].swapaxes(-1, -2)
        return np.asarray(found.transpose(0, 3, 1, 2))

    def _weight(self) -> Array:
        return np.asarray(self._counts[:, None] / self.variance)

    def _squares(self) -> Array:
        """Mean squares that are left, `(h, w, n)`."""
        k, (left, own_left), ye = self._k, self._slopes(), self._ye[:, None]
        bodies = ((left - ye[..., :k]) @ self.u[..., None])[..., 0]
        bodies += np.sum((own_left - ye[..., k:]) * self.theta, axis=-1)
        return np.asarray(self._ee + bodies)

    def _factorise(self) -> None:
        """Bodies as matrices; `factor` turns a change into one relative to them."""
        shape = (*self.u.shape[:2], -1, 10)
        self._matrices = np.tensordot(self.u.reshape(shape), _ENTRIES, axes=1)
        values, vectors = np.linalg.eigh(self._matrices)
        self._factor = vectors / np.sqrt(np.maximum(values, ROUNDING))[..., None, :]
        self._inverse = self._factor @ self._factor.swapaxes(-1, -2)

    def _safe(self) -> Array:
        return np.where(self._positive, self.theta, 1.0)

    def _prior(self) -> Array:
        traces = np.trace(self._matrices, axis1=-2, axis2=-1)
        size = np.linalg.slogdet(self._matrices)[1] - traces
        shape = self._gamma + 2.5
        norm = multigammaln(shape, 4) - 4.0 * shape * np.log(self._gamma)
        bodies = np.sum(self._gamma * size - norm - 3.0 * np.log(2.0), axis=-1)
        own_norm = gammaln(_FRICTION_SHAPE + 1.0) - (_FRICTION_SHAPE + 1.0) * np.log(_FRICTION_RATE)
        friction = _FRICTION_SHAPE * np.log(self._safe()) - _FRICTION_RATE * self.theta - own_norm
        offset = -0.5 * (self.theta / OFFSET_WIDTH) ** 2 - np.log(np.sqrt(2 * np.pi) * OFFSET_WIDTH)
        own = np.where(self._positive, friction, offset)
        return np.asarray(bodies + own.sum(axis=(-1, -2)))


def _side_by_side(coupling: Array) -> Array:
    """Columns of all joints, `(h, w, k, 4 n)`, of `(h, w, n, k, 4)`."""
    h, w, n, k, own = coupling.shape
    return coupling.transpose(0, 1, 3, 2, 4).reshape(h, w, k, n * own)
