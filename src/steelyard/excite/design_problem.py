r"""The design problem: objective, limbs, a family of motions and inequality constraints.

The torque of a joint depends on the bodies that it carries and on its own friction. Branches of a
tree that hang on the fixed base share no parameter, and no torque of one depends on the motion of
another: the information is block-diagonal, $\log\det G = \sum_l \log\det G_l$, exactly. Joints
that carry several branches, like those of a torso, make one limb of them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.information.motion_information import (
    InformationEvaluator,
    SampledInformation,
)
from steelyard.excite.constraints.constraint import Constraint
from steelyard.excite.constraints.motion_limits import MotionLimits
from steelyard.excite.optimality_criteria import Criterion, DOptimal, Measure, worst, worst_value
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints
from steelyard.excite.trajectories.motion_families import Basis
from steelyard.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Case:
    """One load of the robot: what its motions show, and by what that is judged."""

    shows: InformationEvaluator
    criterion: Criterion

    @property
    def chosen(self) -> tuple[int, ...] | None:
        """Columns that matter; all if `None`."""
        return self.criterion.chosen if isinstance(self.criterion, Measure) else None


@dataclass(frozen=True, eq=False)
class Objective:
    """A criterion of the information at sample times `(N,)` [s], the worst over all loads.

    A sample stands for the time from it to the next: the information is that of the whole motion.
    """

    basis: Basis
    cases: Sequence[Case]
    t: Array

    @cached_property
    def _shapes(self) -> list[Array]:
        return [self.basis.shapes(self.t, order) for order in range(3)]

    @cached_property
    def _offsets(self) -> list[Array]:
        return [self.basis.offset(self.t, order).T for order in range(3)]

    def __call__(self, x: Array, sharpness: float) -> tuple[float, Array]:
        """The smooth criterion of coefficients `(n, m)`, and its slope, `(n, m)`.

        Infinite where the motion shows too little; the slope is zero then.
        """
        seen = self.seen(x)
        value, slopes = worst(
            [(case.criterion, s.gram) for case, s in zip(self.cases, seen, strict=True)], sharpness
        )
        result = np.zeros_like(x)
        if not np.isfinite(value):
            return value, result
        for case, samples, slope in zip(self.cases, seen, slopes, strict=True):
            if np.any(slope):
                by = case.shows.pull(samples, slope)
                for part, shape in zip(by, self._shapes, strict=True):
                    result += part @ shape
        return value, result

    def value(self, x: Array, sharpness: float) -> float:
        """The smooth criterion alone, for searches that take no slopes."""
        pairs = [(c.criterion, s.gram) for c, s in zip(self.cases, self.seen(x), strict=True)]
        return worst(pairs, sharpness)[0]

    def seen(self, x: Array) -> list[SampledInformation]:
        """What the samples show, load by load."""
        q, dq, ddq = (
            np.ascontiguousarray((shape @ x.T).T + offset)
            for shape, offset in zip(self._shapes, self._offsets, strict=True)
        )
        step = self.basis.duration / len(self.t)
        return [case.shows.at(q, dq, ddq, step=step) for case in self.cases]


COMPOSING_SHARPNESS = 4.0  # of the criterion by which motions are compared before they are improved


@dataclass(frozen=True)
class JointGroup:
    """Joints whose efforts share parameters, directly or by way of others, ascending.

    The `columns` are the base parameters that their efforts depend on, ascending.
    """

    joints: tuple[int, ...]
    columns: tuple[int, ...]


def joint_groups_of(shows: InformationEvaluator) -> tuple[JointGroup, ...]:
    """The limbs of a robot, by their first joints; one of all joints where loops close."""
    sees = [set(columns) for columns in shows.sees]
    if shows.model.robot.passive:
        return (JointGroup(tuple(range(len(sees))), tuple(sorted(set().union(*sees)))),)
    found: list[tuple[set[int], set[int]]] = []
    for joint, columns in enumerate(sees):
        joints, reached = {joint}, set(columns)
        apart = []
        for others, known in found:
            if known & reached:
                joints |= others
                reached |= known
            else:
                apart.append((others, known))
        found = [*apart, (joints, reached)]
    limbs = [JointGroup(tuple(sorted(joints)), tuple(sorted(reached))) for joints, reached in found]
    return tuple(sorted(limbs, key=lambda limb: limb.joints))


SHOWN_PER_WAVE = 20  # samples of the criterion per wave of the highest frequency

KEPT_PER_WAVE = 40  # of the constraints; between two an extreme is at most 0.3 % higher
JUMP_WIDTH = 1e-9  # width of speed [rad/s; m/s] below any of a sample: the jumping laws themselves


def jumping(cases: Sequence[Case]) -> tuple[Case, ...]:
    """The cases with the laws as they are, not softened."""
    return tuple(
        replace(case, shows=replace(case.shows, widths=np.full_like(case.shows.widths, JUMP_WIDTH)))
        for case in cases
    )


@dataclass(frozen=True, eq=False)
class Problem:
    """What is designed; the criterion that people read is of so many `samples`."""

    robot: Robot
    basis: Basis
    limits: MotionLimits
    constraints: Sequence[Constraint]
    cases: Sequence[Case]
    samples: int = 1000
    notes: tuple[str, ...] = ()

    @cached_property
    def objective(self) -> Objective:
        """The smooth criterion on few samples."""
        return Objective(self.basis, self.cases, self._times(SHOWN_PER_WAVE))

    @cached_property
    def limbs(self) -> tuple[JointGroup, ...]:
        """Joints that share no parameter with others."""
        return joint_groups_of(self.cases[0].shows)

    @cached_property
    def inequalities(self) -> InequalityConstraints:
        """Margins on more samples."""
        return InequalityConstraints(
            self.basis, self.limits, self.constraints, self._times(KEPT_PER_WAVE)
        )

    def criterion_value(self, x: Array) -> float:
        """The criterion itself on `samples` samples, with laws that jump at zero speed."""
        seen = self._unsmoothed.seen(x)
        pairs = [(c.criterion, s.gram) for c, s in zip(self.cases, seen, strict=True)]
        return worst_value(pairs)

    @cached_property
    def _unsmoothed(self) -> Objective:
        return Objective(self.basis, jumping(self.cases), self._spread(self.samples))

    def _times(self, per_wave: int) -> Array:
        waves = self.basis.highest * self.basis.duration
        return self._spread(max(ceil(per_wave * waves), 2 * self.basis.count, 20))

    def _spread(self, count: int) -> Array:
        """Times without the end, which a periodic motion has at its start already."""
        return np.linspace(0.0, self.basis.duration, count, endpoint=False)


def composed_motions(problem: Problem, motions: Iterable[Array]) -> Iterator[Array]:
    """The best of motions in the feasible set so far, after each of them, mixed limb by limb.

    What a limb shows does not depend on the others: where another motion shows its parameters
    better, by D-optimality, the limb takes it over as far as constraints and criterion permit.
    """
    objective, limbs = problem.objective, problem.limbs
    parts = [np.ix_(limb.columns, limb.columns) for limb in limbs]

    def judged(x: Array) -> tuple[Array, float, list[float]]:
        """A motion, its criterion, and that of every limb; of no parameters zero."""
        value = objective.value(x, COMPOSING_SHARPNESS)
        if len(limbs) < 2:
            return x, value, []
        grams = [seen.gram for seen in objective.seen(x)]
        each = [[gram[part] for gram in grams] for part in parts]
        return (
            x,
            value,
            [max(DOptimal().smooth(g, 1.0)[0] if len(g) else 0.0 for g in own) for own in each],
        )

    best: tuple[Array, float, list[float]] | None = None
    for motion in motions:
        one = judged(motion)
        first, second = (one, one) if best is None else (best, one)
        if second[1] < first[1]:
            first, second = second, first
        x, value, each = first
        for k, (limb, better) in enumerate(zip(limbs, second[2], strict=False)):
            if not better < each[k]:
                continue
            tried = x.copy()
            tried[list(limb.joints)] = second[0][list(limb.joints)]
            if not problem.inequalities.smallest_margin(tried) > 0.0:
                continue
            now = objective.value(tried, COMPOSING_SHARPNESS)
            if now <= value:
                x, value, each = tried, now, [*each[:k], better, *each[k + 1 :]]
        best = x, value, each
        yield x
