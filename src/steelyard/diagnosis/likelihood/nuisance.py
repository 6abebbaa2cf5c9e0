"""What differs from day to day: friction and offsets within bounds, fitted from products alone."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import Scalar
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program

DRIFT = (0.5, 1.8)
"""Range of a log's friction relative to the reference's."""
REST = 0.03
"""Speed up to which a joint rests, relative to its fastest."""
NUISANCES = 4
"""tanh, speed, one, acceleration."""
SWEEPS = 40


def unknown_friction(n: int, kind: str) -> tuple[Array, Array]:
    """Bounds without a reference, shapes `(n, 4)`.

    Friction dissipates; rotors are felt unless sensors sit on the link side.
    """
    lower, upper = np.zeros((n, NUISANCES)), np.full((n, NUISANCES), np.inf)
    lower[:, 2] = -np.inf
    if kind == "link_torque":
        upper[:, 3] = 0.0
    return lower, upper


def least_squares(
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
        from steelyard.kernel.program.trace import symbolic

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
