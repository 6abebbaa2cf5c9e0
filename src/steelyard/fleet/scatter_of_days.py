r"""How a fleet's robots scatter over their days, and what one step of them would gain.

A robot's changes on day $d$ are its level, a slope over temperature that all robots share, what
happened since (steps along the directions of causes), scatter from day to day, and the error of
the day's own estimate:

$$ x_d = \mu + B\,(T_d - \bar T) + \sum_i U_i s_i [d \ge k_i] + \epsilon_d + e_d ,\quad
   \epsilon_d \sim N(0, \Omega),\ e_d \sim N(0, \Lambda_d^{-1}) . $$

$\Omega$ and $B$ are those of the fleet, from differences between days one and two apart, by
medians: what happens to some robots does not move them, and scatter that is alike on neighbouring
days widens $\Omega$ by what that costs a step test. A day weighs with the precision
$W_d = (\Lambda_d^{-1} + \Omega)^{-1}$, whatever directions its motion does not show.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.changes_from_model import (
    OF_JOINT,
    Cause,
    LocalParameters,
    NormalEquations,
)

HALF_NORMAL = 0.4549  # median of the square of a standard normal number
WARMTH = 0.02  # standard deviation of relative slopes over temperature before any data [1/K]
QUANTILES = (0.5, 0.75)  # of pairs of neighbouring days, at which causes are calibrated
QUIET = 0.25  # quantile of robots whose largest rise is compared with that of chance
ENOUGH_ROBOTS = 8  # robots whose median shows what chance does to one
DRAWS = 2000  # of days that scatter alone, for the largest rise by chance
LEAST_LEVEL = -0.8  # least relative change of a robot that a further change is relative to
MOST_ALIKE = 0.8  # largest correlation of neighbouring days that is corrected


@dataclass(frozen=True, eq=False)
class RobotDays:
    """The days of a robot in their order: labels, equations, temperatures `(D, columns)`."""

    robot: str
    days: tuple[str, ...]
    equations: tuple[NormalEquations, ...]
    temperature: Array


@dataclass(frozen=True, eq=False)
class Scatter:
    """What the fleet's days share: variances `(m,)` of days and robots, slopes `(m,)` [1/K]."""

    day: Array
    robot: Array
    slope: Array
    slope_std: Array
    middle: Array  # mean temperature of each change, `(m,)`; zero where it is not known
    differences: int  # between days, behind `day`
    # by how much twice the log-likelihood of each cause rises more from one day to the next than
    # chance lets it, `(causes,)`
    inflation: Array


class FleetScatter:
    """The days of all robots, and how they scatter."""

    def __init__(
        self, robots: Sequence[RobotDays], local: LocalParameters, false_alarms: float
    ) -> None:
        self.robots, self.local = tuple(robots), local
        self.false_alarms = false_alarms
        every = [one for robot in robots for one in robot.equations]
        self.friction = local.friction(every)
        self._prior = np.diag(local.expected(self.friction) ** -2.0)

    @property
    def n_days(self) -> int:
        """Number of different days."""
        return len({day for robot in self.robots for day in robot.days})

    @cached_property
    def _singly(self) -> list[tuple[Array, Array]]:
        """Estimates of every robot's days alone, `(D, m)`, and their variances."""
        found = []
        for robot in self.robots:
            inverse = [np.linalg.inv(e.matrix + self._prior) for e in robot.equations]
            values = [c @ e.vector for c, e in zip(inverse, robot.equations, strict=True)]
            found.append((np.array(values), np.array([np.diag(c) for c in inverse])))
        return found

    def _warmth(self, robot: RobotDays) -> Array:
        """Temperature that each change of a robot depends on, `(D, m)`; NaN without."""
        n, m, given = len(self.local.joints), self.local.size, robot.temperature
        found = np.full((len(robot.days), m), np.nan)
        if given.shape[1] == n:
            found[:, : OF_JOINT * n] = np.repeat(given, OF_JOINT, axis=1)
        elif given.shape[1] == 1:
            found[:, : OF_JOINT * n] = given
        return found

    @cached_property
    def scatter(self) -> Scatter:
        """Variances of days and robots, and slopes over temperature, by robust differences."""
        lags = [self._differences(lag) for lag in (1, 2)]
        (change, variance, warmer), second = lags
        m = self.local.size
        expected = self.local.expected(self.friction)
        if not len(change):
            none = np.zeros(m)
            return Scatter(none, none, none, none, self._middle, 0, np.ones(len(self._causes[0])))
        slope, slope_std = np.zeros(m), np.zeros(m)
        for k in range(m):
            known = np.isfinite(warmer[:, k])
            if known.any():
                given = change[known, k], warmer[known, k], variance[known, k]
                slope[k], slope_std[k] = _slope(*given, WARMTH * expected[k])
        one, two = (
            np.median((x - slope * np.nan_to_num(w)) ** 2 / v, axis=0) / HALF_NORMAL
            if len(x)
            else np.ones(m)
            for x, v, w in (lags[0], second)
        )
        single = np.median(variance, axis=0)
        double = np.median(second[1], axis=0) if len(second[0]) else single
        near, far = np.maximum(one, 1.0) * single, np.maximum(two, 1.0) * double
        alike = np.clip(far / near - 1.0, 0.0, MOST_ALIKE)
        total = 0.5 * near * (1.0 + alike) / (1.0 - alike) ** 2
        day = np.maximum(total - 0.5 * single, 0.0)
        one_each = np.ones(len(self._causes[0]))
        found = Scatter(day, np.zeros(m), slope, slope_std, self._middle, len(change), one_each)
        return self._calibrated(self._with_robots(found))

    @cached_property
    def _middle(self) -> Array:
        every = np.concatenate([self._warmth(robot) for robot in self.robots])
        known = np.isfinite(every).any(axis=0)
        middle = np.zeros(self.local.size)
        middle[known] = np.nanmean(every[:, known], axis=0)
        return middle

    def _differences(self, lag: int) -> tuple[Array, Array, Array]:
        """Of estimates so many days apart: differences, their variances, of temperatures."""
        found: list[tuple[Array, Array, Array]] = []
        for robot, (x, v) in zip(self.robots, self._singly, strict=True):
            if len(x) > lag:
                w = self._warmth(robot)
                found.append((x[lag:] - x[:-lag], v[lag:] + v[:-lag], w[lag:] - w[:-lag]))
        if not found:
            return (np.zeros((0, self.local.size)),) * 3
        change, variance, warmer = (np.concatenate(part) for part in zip(*found, strict=True))
        return change, variance, warmer

    def _with_robots(self, scatter: Scatter) -> Scatter:
        """The scatter with that of levels between robots, by medians over them."""
        robot = np.zeros(self.local.size)
        if len(self.robots) > 2:
            levels = [self._level(self._weighed(r, scatter), ()) for r in self.robots]
            value, variance = (np.array(part) for part in zip(*levels, strict=True))
            away = np.median((value - np.median(value, axis=0)) ** 2, axis=0) / HALF_NORMAL
            robot = np.maximum(away - np.median(variance, axis=0), 0.0)
        return replace(scatter, robot=robot)

    def _calibrated(self, scatter: Scatter) -> Scatter:
        """The scatter with the inflation of every cause.

        Changes of days are correlated in ways that their variances do not say, motions differ, and
        what the model lacks differs with them. So the test's own numbers are compared with those
        of chance: the rise from one day to the next, over all pairs, and the largest rise of each
        robot over its days, by the quarter of robots in which it is least.
        """
        from scipy.special import chdtri

        pairs, largest = list[Array](), list[list[float]]()
        for number, robot in enumerate(self.robots):
            weighed, causes = self._weighed(robot, scatter), self._causes[number]
            pairs.append(self._from_day_to_day(weighed, causes))
            if len(robot.days) > 1:
                largest.append([
                    float(x.max()) / _usual_largest(len(robot.days), cause.directions.shape[1])
                    for x, cause in zip(self._gains(weighed, (), causes), causes, strict=True)
                ])  # fmt: skip
        sizes = [cause.directions.shape[1] for cause in self._causes[0]]
        ratios = [
            np.quantile(np.concatenate(pairs), q, axis=0)
            / np.array([chdtri(size, 1.0 - q) for size in sizes])
            for q in QUANTILES
        ]
        if len(largest) >= ENOUGH_ROBOTS:
            ratios.append(np.quantile(largest, QUIET, axis=0))
        return replace(scatter, inflation=np.maximum(1.0, np.max(ratios, axis=0)))

    def _from_day_to_day(self, weighed: tuple[Array, Array], causes: Sequence[Cause]) -> Array:
        """Rise of twice the log-likelihood by a step between neighbours, `(D - 1, causes)`."""
        w, b = weighed
        inverse = np.linalg.inv(w[:-1] + w[1:] + self._prior)
        left = w[1:] - w[1:] @ inverse @ w[1:]
        rest = b[1:] - np.einsum("kij,kj->ki", w[1:] @ inverse, b[:-1] + b[1:])
        return np.array(_rises(left, rest, w[1:], causes)).T

    @cached_property
    def _causes(self) -> tuple[tuple[Cause, ...], ...]:
        """What may happen to each robot."""
        usual = [np.median(x, axis=0) for x, _ in self._singly]
        return tuple(self.local.causes(np.maximum(x, LEAST_LEVEL)) for x in usual)

    def at_middle(self, robot: RobotDays, scatter: Scatter) -> Array:
        """Changes of a robot's days by their temperature, `(D, m)`."""
        return np.nan_to_num(self._warmth(robot) - scatter.middle) * scatter.slope

    def _weighed(self, robot: RobotDays, scatter: Scatter) -> tuple[Array, Array]:
        """Precision of each day's changes, `(D, m, m)`, and it times their values, `(D, m)`."""
        warm = self.at_middle(robot, scatter)
        root = np.sqrt(scatter.day)
        precisions, products = [], []
        for one, moved in zip(robot.equations, warm, strict=True):
            # (Λ⁻¹ + Ω)⁻¹ = Λ - Λ R (1 + R Λ R)⁻¹ R Λ with R² = Ω: also where Λ is singular
            inner = np.eye(len(root)) + root[:, None] * one.matrix * root
            part = one.matrix * root
            share = np.linalg.solve(inner, part.T)
            precisions.append(one.matrix - part @ share)
            h = one.vector - one.matrix @ moved
            products.append(h - part @ np.linalg.solve(inner, root * h))
        return np.array(precisions), np.array(products)

    def _level(
        self, weighed: tuple[Array, Array], steps: Sequence[tuple[Cause, int]]
    ) -> tuple[Array, Array]:
        """Level of a robot before its steps, and its variances, `(m,)` each."""
        normal, vector, _ = self._normal(weighed, steps)
        inverse, m = np.linalg.inv(normal), self.local.size
        return (inverse @ vector)[:m], np.diag(inverse)[:m].copy()

    def _normal(
        self, weighed: tuple[Array, Array], steps: Sequence[tuple[Cause, int]]
    ) -> tuple[Array, Array, list[int]]:
        """Normal equations of a level and the sizes of steps, and where each step begins."""
        m, (w, b) = self.local.size, weighed
        later = [np.cumsum(x[::-1], axis=0)[::-1] for x in (w, b)]
        at = np.cumsum([m, *(cause.directions.shape[1] for cause, _ in steps)]).tolist()
        normal, vector = np.zeros((at[-1], at[-1])), np.zeros(at[-1])
        normal[:m, :m], vector[:m] = w.sum(axis=0) + self._prior, b.sum(axis=0)
        for i, (cause, k) in enumerate(steps):
            u, mine = cause.directions, slice(at[i], at[i + 1])
            vector[mine] = u.T @ later[1][k]
            normal[mine, :m] = u.T @ later[0][k]
            normal[:m, mine] = normal[mine, :m].T
            for j, (other, start) in enumerate(steps[: i + 1]):
                its = slice(at[j], at[j + 1])
                normal[mine, its] = u.T @ later[0][max(k, start)] @ other.directions
                normal[its, mine] = normal[mine, its].T
            normal[mine, mine] += u.T @ self._prior @ u
        return normal, vector, at

    def _gains(
        self,
        weighed: tuple[Array, Array],
        steps: Sequence[tuple[Cause, int]],
        causes: Sequence[Cause],
    ) -> list[Array]:
        """Rise of twice the log-likelihood by one more step, `(D - 1,)` from day 1 on, by cause."""
        normal, vector, at = self._normal(weighed, steps)
        m, (w, b) = self.local.size, weighed
        later = [np.cumsum(x[::-1], axis=0)[::-1] for x in (w, b)]
        inverse = np.linalg.inv(normal)
        solved, days = inverse @ vector, range(1, len(w))
        cross = np.zeros((len(w), len(vector), m))
        for k in days:
            cross[k, :m] = later[0][k]
            for i, (cause, start) in enumerate(steps):
                cross[k, at[i] : at[i + 1]] = cause.directions.T @ later[0][max(k, start)]
        left = np.array([later[0][k] - cross[k].T @ inverse @ cross[k] for k in days])
        rest = np.array([later[1][k] - cross[k].T @ solved for k in days])
        return _rises(left.reshape(-1, m, m), rest.reshape(-1, m), later[0][1:], causes)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """What may happen to a robot."""
        return self._causes[0]


def efficient(count: int) -> float:
    """Degrees of freedom of a variance by medians over robots (efficiency 0.37)."""
    return max(0.37 * (count - 1), 1.0)


@lru_cache(maxsize=256)
def _usual_largest(days: int, size: int) -> float:
    """A low quantile of the largest rise over days that scatter alone, by simulation."""
    x = np.random.default_rng(0).normal(size=(DRAWS, days, size))
    k = np.arange(1, days)
    sums = np.cumsum(x, axis=1)
    later = (sums[:, -1:] - sums)[:, :-1] - (1.0 - k / days)[:, None] * sums[:, -1:]
    rises = np.sum(later**2, axis=2) / (k * (days - k) / days)
    return float(np.quantile(rises.max(axis=1), QUIET))


def _slope(change: Array, warmer: Array, variance: Array, expected: float) -> tuple[float, float]:
    """Slope of changes over temperature through zero, large residuals weighed down (Huber)."""
    weights, slope = 1.0 / variance, 0.0
    scale = 1.0
    for _ in range(20):
        normal = float(weights @ warmer**2) / scale + expected**-2.0
        slope = float((weights * warmer) @ change) / scale / normal
        left = np.abs(change - slope * warmer) / np.sqrt(variance)
        scale = max(float(np.median(left**2)) / HALF_NORMAL, 1.0)
        weights = np.minimum(1.0, 1.345 * np.sqrt(scale) / np.maximum(left, 1e-12)) / variance
    return slope, float(np.sqrt(1.0 / normal))


SEEN = 1e-9  # share of a direction's information beside all others that is more than rounding


def _rises(left: Array, rest: Array, alone: Array, causes: Sequence[Cause]) -> list[Array]:
    """Rise of twice the log-likelihood by steps of each cause, `(K,)`.

    Normal equations of a step in any change are `left` `(K, m, m)` and `rest` `(K, m)` beside all
    else, and `alone` `(K, m, m)` without. Directions of which nothing is seen count for nothing.
    """
    found = []
    for cause in causes:
        u = cause.directions
        vectors, matrices = rest @ u, u.T @ left @ u
        size = np.sqrt(np.maximum(np.einsum("kii->ki", u.T @ alone @ u), 0.0))
        scale = np.where(size > 0.0, size, np.inf)
        values, directions = np.linalg.eigh(matrices / scale[:, :, None] / scale[:, None, :])
        along = np.einsum("kij,ki->kj", directions, vectors / scale)
        seen = values > SEEN
        found.append(np.sum(np.where(seen, along**2 / np.where(seen, values, 1.0), 0.0), axis=1))
    return found
