r"""What changed in which robot, and since when: changes of a fleet's robots over their days.

A robot's changes on day $d$ are its level, a slope over temperature that all robots share, what
happened since (steps along the directions of causes), scatter from day to day, and the error of
the day's own estimate:

$$ x_d = \mu + B\,(T_d - \bar T) + \sum_i U_i s_i [d \ge k_i] + \epsilon_d + e_d ,\quad
   \epsilon_d \sim N(0, \Omega),\ e_d \sim N(0, \Lambda_d^{-1}) . $$

$\Omega$ and $B$ are those of the fleet, from differences between days one and two apart, by
medians: what happens to some robots does not move them, and scatter that is alike on neighbouring
days widens $\Omega$ by what that costs a step test. A day weighs with the precision
$W_d = (\Lambda_d^{-1} + \Omega)^{-1}$, whatever directions its motion does not show.

Steps are found one by one by the likelihood ratio over all causes and days, then all are placed
again beside the others. The probability that chance alone raises the likelihood as much counts the
finite number of days behind $\Omega$, and all robots, causes and days tested (Bonferroni).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.changes_from_model import (
    OF_JOINT,
    Cause,
    LocalParameters,
    NormalEquations,
)

HALF_NORMAL = 0.4549  # median of the square of a standard normal number
WARMTH = 0.02  # standard deviation of relative slopes over temperature before any data [1/K]
MOST_CHANGES = 8  # of one robot
PLACED_AGAIN = 4  # rounds in which changes are placed again beside the others
QUANTILES = (0.5, 0.75)  # of pairs of neighbouring days, at which causes are calibrated
QUIET = 0.25  # quantile of robots whose largest rise is compared with that of chance
ENOUGH_ROBOTS = 8  # robots whose median shows what chance does to one
DRAWS = 2000  # of days that scatter alone, for the largest rise by chance
LEAST_LEVEL = -0.8  # least relative change of a robot that a further change is relative to
GONE = 0.2  # share of a step that may be left after it is taken back
MASS = 0.95  # share of the probability that the interval of a day holds
MOST_ALIKE = 0.8  # largest correlation of neighbouring days that is corrected
DAYS_OF_YEAR = 365.0
LEVEL_ALARM = 0.01  # probability of any robot named for its level by chance


@dataclass(frozen=True, eq=False)
class RobotDays:
    """The days of a robot in their order: labels, equations, temperatures `(D, columns)`."""

    robot: str
    days: tuple[str, ...]
    equations: tuple[NormalEquations, ...]
    temperature: Array


@dataclass(frozen=True, eq=False)
class FleetChange:
    """A step of one robot.

    `size` and its standard deviation are relative, or in the cause's unit, shape `(k,)`; the day is
    the first of the new level, and the interval of it holds 95 % of the probability.
    """

    robot: str
    cause: Cause
    day: str
    interval: tuple[str, str]
    size: Array
    std: Array
    p: float  # probability that chance does this anywhere in the fleet
    factor: float = 1.0  # of a size in the cause's directions
    until: str = ""  # first day on which it is gone again; `""` if it lasts


@dataclass(frozen=True, eq=False)
class RobotLevel:
    """Changes of a robot at its last days, `(m,)`; shrunk towards the fleet, with deviations."""

    robot: str
    value: Array
    std: Array
    unusual: tuple[int, ...]  # places of changes that differ from the fleet's
    away: Array  # from the median of robots, `(m,)`, not shrunk
    spread: Array  # standard deviation of that among robots that do not differ, `(m,)`


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


class FleetDays:
    """The days of all robots: scatter, changes and levels."""

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

    def singly(self, number: int, cause: Cause) -> tuple[Array, Array]:
        """A cause's size on every day of a robot alone, at the fleet's temperature, `(D,)`.

        With it come standard deviations, the scatter between days included.
        """
        robot, scatter = self.robots[number], self.scatter
        weighed, u = self._weighed(robot, scatter), cause.directions
        level, _ = self._level(weighed, self._steps[number])
        found = []
        for w, b in zip(*weighed, strict=True):
            inverse = np.linalg.pinv(u.T @ w @ u)
            found.append((inverse @ (u.T @ (b - w @ level)), np.diag(inverse)))
        sizes, variances = (np.array(part)[:, 0] for part in zip(*found, strict=True))
        return sizes, np.sqrt(np.maximum(variances, 0.0))

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

    @property
    def tests(self) -> int:
        """Causes and days of all robots."""
        return sum(len(self._causes[0]) * (len(r.days) - 1) for r in self.robots)

    @property
    def level(self) -> float:
        """Probability of a false change anywhere that is allowed over these days."""
        return 1.0 - float(np.exp(-self.false_alarms * self.n_days / DAYS_OF_YEAR))

    @cached_property
    def changes(self) -> tuple[FleetChange, ...]:
        """All changes, robot by robot, the first ones first."""
        return tuple(x for number in range(len(self.robots)) for x in self._changes(number))

    @cached_property
    def _steps(self) -> Sequence[list[tuple[Cause, int]]]:
        return [self._found_steps(number) for number in range(len(self.robots))]

    def _found_steps(self, number: int) -> list[tuple[Cause, int]]:
        weighed = self._weighed(self.robots[number], self.scatter)
        steps = list[tuple[Cause, int]]()
        for _ in range(MOST_CHANGES):
            best = self._best(weighed, steps, number)
            if best is None:
                break
            steps = [*steps, best]
            for _ in range(PLACED_AGAIN if len(steps) > 1 else 0):
                before = list(steps)
                for step in before:
                    others = [x for x in steps if x is not step]
                    again = self._best(weighed, others, number)
                    steps = [*others, again] if again is not None else others
                if steps == before:
                    break
        return sorted(self._significant(steps, weighed, number), key=lambda step: step[1])

    def _significant(
        self, steps: list[tuple[Cause, int]], weighed: tuple[Array, Array], number: int
    ) -> list[tuple[Cause, int]]:
        """The steps without those that chance explains beside the others, the worst first."""
        causes = self._causes[number]
        while steps:
            chances = []
            for step in steps:
                others = [x for x in steps if x is not step]
                which, size = causes.index(step[0]), step[0].directions.shape[1]
                gain = self._gains(weighed, others, causes)[which][step[1] - 1]
                chances.append(self._chance(float(gain / self.scatter.inflation[which]), size))
            worst = int(np.argmax(chances))
            if chances[worst] < self.level:
                break
            steps = steps[:worst] + steps[worst + 1 :]
        return steps

    def _best(
        self, weighed: tuple[Array, Array], steps: Sequence[tuple[Cause, int]], number: int
    ) -> tuple[Cause, int] | None:
        """The step that explains most for its number of directions, if chance would not."""
        best, score, causes = None, 0.0, self._causes[number]
        for k, gains in enumerate(self._gains(weighed, steps, causes)):
            if not len(gains):
                return None
            day, size = int(np.argmax(gains)), causes[k].directions.shape[1]
            gain = float(gains[day] / self.scatter.inflation[k])
            own = gain - size * np.log(max(len(gains) + 1, 2))
            if own > score and self._chance(gain, size) < self.level:
                best, score = (causes[k], day + 1), own
        return best

    def _chance(self, gain: float, size: int) -> float:
        from scipy.special import fdtrc

        free = max(self.scatter.differences, 1)
        return float(min(1.0, fdtrc(size, free, gain / size) * max(self.tests, 1)))

    def _changes(self, number: int) -> list[FleetChange]:
        robot, steps = self.robots[number], self._steps[number]
        if not steps:
            return []
        weighed, causes = self._weighed(robot, self.scatter), self._causes[number]
        normal, vector, at = self._normal(weighed, steps)
        inverse = np.linalg.inv(normal)
        values, found = inverse @ vector, list[FleetChange]()
        level = values[: self.local.size].copy()
        for i, (cause, k) in enumerate(steps):
            which, mine = causes.index(cause), slice(at[i], at[i + 1])
            inflation = self.scatter.inflation[which]
            others = steps[:i] + steps[i + 1 :]
            gains = self._gains(weighed, others, causes)[which] / inflation
            mass = np.exp(0.5 * (gains - gains.max()))
            order = np.argsort(-mass)
            enough = int(np.searchsorted(np.cumsum(mass[order]) / mass.sum(), MASS)) + 1
            inside = order[:enough] + 1
            factor = 1.0
            if not cause.unit:  # relative to what the robot had before
                first = int(np.flatnonzero(cause.directions[:, 0])[0])
                before = max(1.0 + float(level[first]), 1.0 + LEAST_LEVEL)
                factor = float(cause.directions[first, 0]) / before
            found.append(
                FleetChange(
                    robot.robot,
                    cause,
                    robot.days[k],
                    (robot.days[int(inside.min())], robot.days[int(inside.max())]),
                    factor * values[mine],
                    abs(factor) * np.sqrt(inflation * np.diag(inverse)[mine]),
                    self._chance(float(gains.max()), cause.directions.shape[1]),
                    factor,
                )
            )
            level += cause.directions @ values[mine]
        sizes = [values[at[i] : at[i + 1]] for i in range(len(steps))]
        return _paired(found, sizes, np.asarray(inverse, dtype=np.float64), at)

    def first_change(self, number: int) -> int:
        """Number of the first day after a robot's first step; that of all days without any."""
        steps = self._steps[number]
        return steps[0][1] if steps else len(self.robots[number].days)

    @cached_property
    def levels(self) -> tuple[RobotLevel, ...]:
        """Each robot's changes from the model at its last days, shrunk towards the fleet."""
        from scipy.special import stdtr

        values, variances, first = [], [], []
        for number, robot in enumerate(self.robots):
            steps, m = self._steps[number], self.local.size
            normal, vector, at = self._normal(self._weighed(robot, self.scatter), steps)
            last = np.zeros((m, len(vector)))
            last[:, :m] = np.eye(m)
            for i, (cause, _) in enumerate(steps):
                last[:, at[i] : at[i + 1]] = cause.directions
            inverse = np.linalg.inv(normal)
            values.append(last @ inverse @ vector)
            variances.append(np.diag(last @ inverse @ last.T).copy())
            first.append((inverse @ vector)[:m])
        usual, found, count = np.median(first, axis=0), list[RobotLevel](), len(self.robots)
        # so few robots do not show their variance well: half as much again per square root of them
        between = self.scatter.robot + (2.0 / max(efficient(count), 1.0)) ** 0.5 * (
            self.scatter.robot + np.median(variances, axis=0)
        )
        for number, robot in enumerate(self.robots):
            value, variance = values[number], variances[number]
            away, free = value - usual, efficient(count)
            spread = np.sqrt(self.scatter.robot + variance)
            p = 2.0 * stdtr(free, -np.abs(away) / spread) * count * self.local.size
            odd = np.flatnonzero(p < LEVEL_ALARM).tolist()
            changed = bool(self._steps[number])
            unusual = tuple(odd) if count > 2 and not changed else ()
            if count > 2 and not changed:
                share = between / (between + variance)
                value, variance = usual + share * away, share * variance
            found.append(RobotLevel(robot.robot, value, np.sqrt(variance), unusual, away, spread))
        return tuple(found)


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


def _paired(
    found: Sequence[FleetChange], sizes: Sequence[Array], covariance: Array, at: Sequence[int]
) -> list[FleetChange]:
    """The changes, a step and the one that takes it back as one."""
    from scipy.special import chdtrc

    left, used = list[FleetChange](), set[int]()
    for i, change in enumerate(found):
        if i in used:
            continue
        for j in range(i + 1, len(found)):
            alike = found[j].cause is change.cause and j not in used
            if not alike:
                continue
            sides = [np.arange(at[k], at[k + 1]) for k in (i, j)]
            spread = np.sum([covariance[np.ix_(a, b)] for a in sides for b in sides], axis=0)
            both = sizes[i] + sizes[j]
            rise = float(both @ np.linalg.solve(spread, both))
            opposite = float(sizes[i] @ sizes[j]) < 0.0
            small = np.linalg.norm(both) < GONE * np.linalg.norm(sizes[i])
            if opposite and (small or float(chdtrc(len(both), rise)) > 1.0 - MASS):
                used.add(j)
                change = replace(change, until=found[j].day)
                break
        left.append(change)
    return left


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


def half_width(std: Array) -> Array:
    """Half-width of 95 % intervals."""
    return Z95 * std
