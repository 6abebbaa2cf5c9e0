"""What is fitted beside an interpretation: friction, offsets, and numbers all joints share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import Scalar
from steelyard.symbolic.native.compiled import Code, compiled
from steelyard.symbolic.program import InputArray as Input
from steelyard.symbolic.program import Program

FRICTION_DRIFT = (0.5, 1.8)
"""Range of a log's friction relative to the reference's."""
REST_SPEED = 0.03
"""Speed up to which a joint rests, relative to its fastest."""
NUISANCES = 4
"""tanh, speed, one, acceleration."""
COORDINATE_SWEEPS = 40


def unknown_friction(n: int, kind: str) -> tuple[Array, Array]:
    """Bounds without a reference, shapes `(n, 4)`.

    Friction dissipates; rotors are felt unless sensors sit on the link side.
    """
    lower, upper = np.zeros((n, NUISANCES)), np.full((n, NUISANCES), np.inf)
    lower[:, 2] = -np.inf
    if kind == "link_torque":
        upper[:, 3] = 0.0
    return lower, upper


def fit_nuisances(
    yy: Array, ye: Array, ee: Array, scale: Array, lower: Array, upper: Array, sweeps: int
) -> tuple[Array, Array]:
    r"""Least $\|s\,e - y_5 - Y\theta\|^2$ within bounds, by coordinates.

    Args:
        yy: Products of the four nuisances and the prediction, shape `(..., 5, 5)`.
        ye: Of these with the effort, shape `(..., 5)`.
        ee: Square of the effort, shape `(...)`.
        scale: $s$, shape `(...)`.
        lower: Shape `(..., 4)`.
        upper: Shape `(..., 4)`.
        sweeps: How often the coordinates are gone through.

    Returns:
        Squares that are left, shape `(...)`, and $\theta$, shape `(..., 4)`.
    """
    h = yy[..., :4, :4]
    b = scale[..., None] * ye[..., :4] - yy[..., :4, 4]
    b = np.ascontiguousarray(np.broadcast_to(b, np.broadcast_shapes(b.shape, lower.shape)))
    h = np.ascontiguousarray(np.broadcast_to(h, (*b.shape, 4)))
    theta = _by_coordinates(h, b, lower, upper, sweeps)
    constant = scale**2 * ee - 2.0 * scale * ye[..., 4] + yy[..., 4, 4]
    bent = np.sum((h @ theta[..., None])[..., 0] * theta, axis=-1)
    return np.maximum(constant - 2.0 * np.sum(b * theta, axis=-1) + bent, 0.0), theta


def _by_coordinates(h: Array, b: Array, lower: Array, upper: Array, sweeps: int) -> Array:
    r"""The least $\theta^T H\theta - 2 b^T\theta$ within bounds, shape `(..., 4)`."""
    shape = b.shape
    bounds = (np.broadcast_to(side, shape).reshape(-1, NUISANCES).T for side in (lower, upper))
    rows, wanted = h.reshape(-1, NUISANCES**2).T, b.reshape(-1, NUISANCES).T
    return np.ascontiguousarray(_coordinates(sweeps)([rows, wanted, *bounds]).T).reshape(shape)


@cache
def _coordinates(sweeps: int) -> Code:
    """The coordinates' sweeps as machine code: inputs $H$, $b$ and the bounds, output theta."""

    def build() -> tuple[Program, dict[str, Any]]:
        from steelyard.symbolic.trace import symbolic

        def swept(
            h: Sequence[Scalar],
            b: Sequence[Scalar],
            lower: Sequence[Scalar],
            upper: Sequence[Scalar],
        ) -> Sequence[Scalar]:
            diagonal = [np.maximum(h[(NUISANCES + 1) * k], 1e-300) for k in range(NUISANCES)]
            theta = [np.minimum(np.maximum(0.0, x), y) for x, y in zip(lower, upper, strict=True)]
            for _ in range(sweeps):
                for k in range(NUISANCES):
                    one, *rest = (j for j in range(NUISANCES) if j != k)
                    others = h[NUISANCES * k + one] * theta[one]
                    for j in rest:
                        others = others + h[NUISANCES * k + j] * theta[j]
                    free = (b[k] - others) / diagonal[k]
                    theta[k] = np.minimum(np.maximum(free, lower[k]), upper[k])
            return theta

        sizes = {"h": NUISANCES**2} | dict.fromkeys(("b", "lower", "upper"), NUISANCES)
        return symbolic(swept, [Input(name, size) for name, size in sizes.items()]), {}

    return compiled(["friction within bounds", sweeps], build)


SHARED_FIT_ROUNDS = 4
WIDE_STD = 1e6


@dataclass(frozen=True, eq=False)
class SharedFit:
    """Values `(k,)` and their covariance `(k, k)`."""

    values: Array
    covariance: Array


def shared_fit(
    residual: Array,
    columns: Array,
    nuisances: Array,
    bounds: tuple[Array, Array],
    size: Array,
    worth: float,
    prior: Array,
) -> SharedFit:
    r"""Weighted least squares of $r_j = C_j x + Y_j \theta_j$ over all joints.

    Every joint weighs by its own residuals; bounds are taken as a normal distribution of their
    width.

    Args:
        residual: Efforts less what is predicted without the columns, shape `(n, B)`, zero where a
            joint does not count.
        columns: Shape `(k, n, B)`.
        nuisances: Shape `(n, 4, B)`.
        bounds: Least and largest nuisances, each `(n, 4)`.
        size: Least standard deviation of each joint's residuals, shape `(n,)`.
        worth: Independent samples per sample.
        prior: Standard deviation of the numbers around zero, shape `(k,)`.
    """
    n, k = len(residual), len(columns)
    middle, width = _normal(bounds, size)
    columns = np.asarray(columns * (nuisances[:, 2] != 0.0))
    variance = np.maximum(np.mean(np.square(residual), axis=1), np.square(size))
    values: Array = np.zeros(k)
    covariance: Array = np.eye(k)
    for _ in range(SHARED_FIT_ROUNDS):
        matrix, vector = np.diag(1.0 / np.square(prior)), np.zeros(k)
        eliminated = []
        for j in range(n):
            weight = worth / variance[j]
            c, y, r = columns[:, j], nuisances[j], residual[j]
            inner = weight * y @ y.T + np.diag(1.0 / np.square(width[j]))
            right = weight * y @ r + middle[j] / np.square(width[j])
            cross = weight * c @ y.T
            gain = np.linalg.solve(inner, np.column_stack((cross.T, right)))
            eliminated.append(gain)
            matrix += weight * c @ c.T - cross @ gain[:, :k]
            vector += weight * c @ r - cross @ gain[:, k]
        covariance = np.asarray(np.linalg.inv(matrix))
        values = covariance @ vector
        for j in range(n):
            theta = eliminated[j][:, k] - eliminated[j][:, :k] @ values
            left = residual[j] - values @ columns[:, j] - theta @ nuisances[j]
            count = max(float(np.count_nonzero(nuisances[j, 2])), 1.0)
            variance[j] = max(float(left @ left) / count, float(size[j]) ** 2)
    return SharedFit(values, covariance)


def _normal(bounds: tuple[Array, Array], size: Array) -> tuple[Array, Array]:
    """Middle and half-width of bounds; infinite ones are wide."""
    lower, upper = bounds
    known = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(known, lower, 0.0), np.where(known, upper, 0.0)
    wide = WIDE_STD * np.maximum(size, 1e-12)[:, None]
    tiny = 1e-9 * np.maximum(size, 1e-12)[:, None]
    width = np.where(known, np.maximum(0.5 * (high - low), tiny), wide)
    return 0.5 * (low + high), width
