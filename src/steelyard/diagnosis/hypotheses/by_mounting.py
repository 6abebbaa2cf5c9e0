r"""Directions of gravity that bodies of a log's own fit, where they fit none that is declared.

Efforts are linear in bodies and in gravity, $e = (Y_0 + \sum_a g_a Y_a) \phi$. With the bodies
eliminated by least squares (variable projection), what is left depends on the direction of $g$
alone, and is minimised from every axis. The likeliest directions are then compared with physically
consistent bodies.
"""

from copy import copy
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.by_surroundings import NEAR, axis_near, gravity_words
from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood
from steelyard.diagnosis.likelihood.possible import SAMPLES, Possible, possible, rows_of

FEW = 3
"""Directions that are compared with physically consistent bodies."""
RIDGE = 1e-4
"""What keeps columns that a motion does not excite at zero, relative to their length."""
FLOOR = 1e-4
"""Least residual of a row, over its effort: logs without noise have none."""
REWEIGHTED = 4
"""How often rows are weighed by the residuals of the last direction."""
LEAST_TILT = np.deg2rad(0.5)
"""Tilt of gravity from a proposed direction from which on it is proposed too [rad]."""
INDEPENDENT, SIGNIFICANT = 100.0, 20.0
"""Independent samples of a joint at most, and the rise of the log-likelihood that a tilt needs."""


def mounting_hypotheses(
    likelihood: Likelihood, now: Interpretation
) -> list[tuple[Hypothesis, Possible]]:
    """Interpretations that differ in gravity alone, the likeliest first, with the bodies of each.

    Args:
        likelihood: The log.
        now: The interpretation that they start from.
    """
    size = float(np.linalg.norm(now.gravity))
    if size == 0.0:
        return []
    found = []
    for direction in _directions(likelihood, now)[:FEW]:
        axis = axis_near(direction)
        gravity = size * (direction if axis is None else axis)
        cost = 2.0 * FREE if axis is None else FREE
        interpretation = now.changed(gravity=gravity)
        bodies = possible(likelihood, interpretation)
        if bodies is not None:
            says = gravity_words(direction)
            found.append(
                (Hypothesis("mounting", says, interpretation, cost, (), bodies.score), bodies)
            )
    return sorted(found, key=lambda pair: -pair[0].log_likelihood)


def _directions(likelihood: Likelihood, now: Interpretation) -> list[Array]:
    """Unit vectors that fit, the best first, none near another or the interpretation's own."""
    from scipy.optimize import least_squares

    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(SAMPLES))
    left = _Left(thin, now)
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    fits = [least_squares(left, start + 0.05, left.slopes, max_nfev=30) for start in axes]
    known = now.gravity / np.linalg.norm(now.gravity)
    found: list[Array] = []
    for fit in sorted(fits, key=lambda fit: float(fit.cost)):
        direction = fit.x / np.linalg.norm(fit.x)
        if all(direction @ other < np.cos(NEAR) for other in (known, *found)):
            found.append(direction)
    return found


def refined_gravity(likelihood: Likelihood, found: Interpretation) -> Array:
    """Gravity as the log fits it best near a direction, or that direction, shape `(3,)` [m/s²].

    Rows weigh by their residuals, which are estimated again with the direction. It stays as it is
    where no tilt of more than `LEAST_TILT` is significant.

    Args:
        likelihood: The log.
        found: Its interpretation, gravity along an axis for example.
    """
    from scipy.optimize import least_squares

    thin = replace(likelihood, excerpt=likelihood.excerpt.thinned(SAMPLES))
    start = found.gravity / max(float(np.linalg.norm(found.gravity)), 1e-12)
    left = _Left(thin, found)
    direction, known = start, left.sigma(start)
    for _ in range(REWEIGHTED):
        weighted = left.weighted(left.sigma(direction))
        fit = least_squares(weighted, direction, weighted.slopes, max_nfev=30)
        direction = fit.x / np.linalg.norm(fit.x)
    gain = INDEPENDENT * float(np.sum(np.log(known / left.sigma(direction))))
    tilt = float(np.arccos(np.clip(start @ direction, -1.0, 1.0)))
    significant = gain > SIGNIFICANT and LEAST_TILT < tilt < NEAR
    return np.asarray(np.linalg.norm(found.gravity) * direction) if significant else found.gravity


class _Left:
    """What is left of the efforts under a direction of gravity, any bodies taken."""

    def __init__(self, likelihood: Likelihood, now: Interpretation) -> None:
        size = float(np.linalg.norm(now.gravity))
        free, efforts, _ = rows_of(likelihood, now.changed(gravity=np.zeros(3)))
        lower, upper = (side.reshape(-1) for side in likelihood.bounds)
        kept = np.ones(free.shape[-1], dtype=np.bool_)
        kept[-len(upper) :] = upper > lower
        free = free[..., kept]
        pulls = [
            rows_of(likelihood, now.changed(gravity=size * axis))[0][..., kept] - free
            for axis in np.eye(3)
        ]
        self._whole = np.sqrt(np.maximum(np.mean(np.square(efforts), axis=1), 1e-30))
        self._k = free.shape[-1]
        self._blocks = np.concatenate((free, *pulls, efforts[..., None]), axis=-1)
        self._weigh(self._whole)

    def _weigh(self, scales: Array) -> None:
        blocks = self._blocks / scales[:, None, None]
        triangle = np.asarray(np.linalg.qr(blocks.reshape(-1, blocks.shape[-1]), mode="r"))
        self._columns, self._efforts = triangle[:, :-1], triangle[:, -1]

    def weighted(self, scales: Array) -> "_Left":
        """The same with rows over `scales`, shape `(n,)`."""
        other = copy(self)
        other._weigh(scales)
        return other

    def __call__(self, v: Array) -> Array:
        """Residuals; the length of `v` is of no account, and kept near 1."""
        length = float(np.linalg.norm(v))
        spanned, right, _ = self._solved(v / length)
        return np.concatenate((right - spanned @ (spanned.T @ right), [length - 1.0]))

    def slopes(self, v: Array) -> Array:
        """Derivatives of the residuals but for what the bodies' change takes [Kaufman1975]."""
        length = float(np.linalg.norm(v))
        direction = v / length
        spanned, _, solution = self._solved(direction)
        pulls = self._columns.reshape(len(self._columns), 4, self._k)[:, 1:] @ solution
        wide = np.concatenate((-pulls, np.zeros((self._k, 3))))
        wide -= spanned @ (spanned.T @ wide)
        turned = (np.eye(3) - np.outer(direction, direction)) / length
        return np.concatenate((wide @ turned, direction[None]))

    def sigma(self, direction: Array) -> Array:
        """Root mean square residual of each row under a direction, shape `(n,)`."""
        solution = self._solved(direction)[2]
        columns = self._under(direction, self._blocks[..., :-1])
        residuals = self._blocks[..., -1] - columns @ solution
        size = np.sqrt(np.mean(np.square(residuals), axis=1))
        return np.asarray(np.maximum(size, FLOOR * self._whole))

    def _under(self, direction: Array, blocks: Array) -> Array:
        """Columns under a direction of gravity, from those without and along the axes."""
        parts = blocks.reshape(*blocks.shape[:-1], 4, self._k)
        columns: Array = parts[..., 0, :] + np.einsum("a,...ak->...k", direction, parts[..., 1:, :])
        return columns

    def _solved(self, direction: Array) -> tuple[Array, Array, Array]:
        """With the ridge: an orthonormal basis of the columns, the efforts, and the solution."""
        columns = self._under(direction, self._columns)
        lengths = np.linalg.norm(columns, axis=0)
        ridge = np.diag(RIDGE * np.maximum(lengths, 1e-6 * lengths.max()))
        wide: Array = np.concatenate((columns, ridge))
        right: Array = np.concatenate((self._efforts, np.zeros(self._k)))
        spanned, triangle = np.linalg.qr(wide)
        return spanned, right, np.linalg.solve(triangle, spanned.T @ right)
