"""Solid bodies of simple shapes and given mass: priors for links that nobody has weighed."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.robot.inertia import Inertia

DENSITY = 2000.0
"""Of a stand-in [kg/m³]: castings with motors, gears and air in them."""


def of_spread(mass: float, com: ArrayLike, spread: ArrayLike) -> Inertia:
    r"""The body with the second moments $\Sigma_c = \int (x - c)(x - c)^T\,dm$ about its centre.

    Args:
        mass: [kg].
        com: Centre of mass, shape `(3,)` [m].
        spread: $\Sigma_c$ in link axes, shape `(3, 3)` [kg m²].
    """
    spread = np.asarray(spread, dtype=np.float64)
    return Inertia.about_com(mass, com, np.trace(spread) * np.eye(3) - spread)


def spread_of(inertia: Inertia) -> Array:
    r"""$\Sigma_c = \tfrac12 \mathrm{tr}(I_c)\,1 - I_c$, shape `(3, 3)` [kg m²]."""
    about_com = inertia.inertia_com
    return np.asarray(0.5 * np.trace(about_com) * np.eye(3) - about_com)


def box(mass: float, centre: ArrayLike, size: ArrayLike) -> Inertia:
    r"""A solid box along the link's axes: $\Sigma_c = \tfrac{m}{12}\,\mathrm{diag}(s^2)$.

    Args:
        mass: [kg].
        centre: Shape `(3,)` [m].
        size: $s$, lengths of its edges, shape `(3,)` [m].
    """
    edges = np.asarray(size, dtype=np.float64)
    return of_spread(mass, centre, mass / 12.0 * np.diag(edges**2))


def ball(mass: float, centre: ArrayLike, radius: float | None = None) -> Inertia:
    r"""A solid ball, $\Sigma_c = \tfrac{m}{5} r^2\,1$; of `DENSITY` if no radius is given."""
    radius = _ball_radius(mass, DENSITY) if radius is None else radius
    return of_spread(mass, centre, mass * radius**2 / 5.0 * np.eye(3))


def capsule(mass: float, start: ArrayLike, end: ArrayLike, radius: float | None = None) -> Inertia:
    r"""A solid rod with round ends, between the centres of its end balls.

    With $l$ the distance of the ends, $m_c$ and $m_b$ the masses of the cylinder and of both half
    balls: along the axis
    $m_c l^2/12 + m_b (r^2/5 + l^2/4 + 3 l r/8)$, across it $m_c r^2/4 + m_b r^2/5$.

    Args:
        mass: [kg].
        start: Shape `(3,)` [m].
        end: Shape `(3,)` [m].
        radius: [m]; that of a body of `DENSITY` if `None`.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first))
    if radius is None:
        radius = _capsule_radius(mass, length)
    if length < 1e-9:
        return ball(mass, first, radius)
    volumes = np.array([length, 4.0 / 3.0 * radius])
    cylinder, ends = mass * volumes / volumes.sum()
    along = cylinder * length**2 / 12.0
    along += ends * (radius**2 / 5.0 + length**2 / 4.0 + 0.375 * length * radius)
    across = cylinder * radius**2 / 4.0 + ends * radius**2 / 5.0
    axis = (last - first) / length
    spread = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    return of_spread(mass, (first + last) / 2.0, spread)


def densest(mass: float) -> float:
    """Second moment of a ball of steel [kg m²]: no real body of that mass is closer together."""
    return mass * _ball_radius(mass, 8000.0) ** 2 / 5.0


def _ball_radius(mass: float, density: float) -> float:
    return float(np.cbrt(0.75 * mass / (np.pi * density)))


def _capsule_radius(mass: float, length: float) -> float:
    r"""The root of $\pi r^2 l + \tfrac43 \pi r^3 = m / \rho$."""
    roots = np.roots([4.0 / 3.0, length, 0.0, -mass / (np.pi * DENSITY)])
    return float(roots[np.isreal(roots) & (roots.real > 0.0)].real[0])
