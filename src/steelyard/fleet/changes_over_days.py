r"""What changed in which robot, and since when: steps over the days of a fleet's robots.

Steps are found one by one by the likelihood ratio over all causes and days, then all are placed
again beside the others. The probability that chance alone raises the likelihood as much counts the
finite number of days behind $\Omega$, and all robots, causes and days tested (Bonferroni).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.changes_from_model import Cause
from steelyard.fleet.scatter_of_days import LEAST_LEVEL, FleetScatter, efficient

MOST_CHANGES = 8  # of one robot
PLACED_AGAIN = 4  # rounds in which changes are placed again beside the others
GONE = 0.2  # share of a step that may be left after it is taken back
MASS = 0.95  # share of the probability that the interval of a day holds
DAYS_OF_YEAR = 365.0
LEVEL_ALARM = 0.01  # probability of any robot named for its level by chance


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


class FleetDays(FleetScatter):
    """The days of all robots: changes and levels."""

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


def half_width(std: Array) -> Array:
    """Half-width of 95 % intervals."""
    return Z95 * std
