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
from steelyard.estimate.information.regressor import (
    InformationEvaluator,
    SampledInformation,
)
from steelyard.excite.constraints.constraint import Constraint, MotionLimits
from steelyard.excite.criteria import Criterion, DOptimal, Measure, worst, worst_value
from steelyard.excite.search.newton import InequalityConstraints
from steelyard.excite.trajectories.linear_bases import Basis
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
    """A criterion of the information at sample times, the worst over all loads.

    A sample stands for the time from it to the next: the information is that of the whole motion.

    Attributes:
        basis: The family of motions.
        cases: The loads, one or more.
        t: Sample times, shape `(N,)` [s].
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
        """The smooth criterion and its slope.

        Args:
            x: Coefficients, shape `(n, m)`.
            sharpness: The larger, the nearer to the criterion itself.

        Returns:
            Infinite where the motion shows too little; the slope, shape `(n, m)`, is zero then.
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
        return [case.shows.at(q, dq, ddq, step=self._step) for case in self.cases]

    @property
    def _step(self) -> float:
        return self.basis.duration / len(self.t)


COMPOSING_SHARPNESS = 4.0
"""Of the criterion by which motions are compared before they are improved."""


@dataclass(frozen=True)
class JointGroup:
    """Joints whose efforts share parameters, directly or by way of others.

    Attributes:
        joints: Numbers of the joints, ascending.
        columns: Base parameters that their efforts depend on, ascending.
    """

    joints: tuple[int, ...]
    columns: tuple[int, ...]


def joint_groups_of(shows: InformationEvaluator) -> tuple[JointGroup, ...]:
    """The limbs of a robot, by their first joints; one of all joints where loops close.

    Joints whose efforts depend on no base parameter are limbs by themselves.
    """
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


def composed_motions(
    objective: Objective,
    inequalities: InequalityConstraints,
    limbs: Sequence[JointGroup],
    motions: Iterable[Array],
) -> Iterator[Array]:
    """The best of motions in the feasible set so far, after each of them, mixed limb by limb.

    What a limb shows does not depend on the others: where another motion shows its parameters
    better, by D-optimality, the limb takes it over as far as constraints and criterion permit.

    Args:
        objective: What is minimised.
        inequalities: Inequality constraints of the motion.
        limbs: The limbs.
        motions: Coefficients, each of shape `(n, m)`.

    Yields:
        Coefficients in the feasible set, shape `(n, m)`; as many as there are motions.
    """
    best: _Mixed | None = None
    for x in motions:
        one = _Mixed.of(objective, limbs, x)
        if best is None:
            best = one
        else:
            first, second = (best, one) if best.value <= one.value else (one, best)
            best = first.with_limbs_of(second, objective, inequalities, limbs)
        yield best.x


@dataclass(frozen=True, eq=False)
class _Mixed:
    """A motion, its criterion, and that of every limb."""

    x: Array
    value: float
    each: tuple[float, ...]

    @classmethod
    def of(cls, objective: Objective, limbs: Sequence[JointGroup], x: Array) -> "_Mixed":
        value = objective.value(x, COMPOSING_SHARPNESS)
        if len(limbs) < 2:
            return cls(x, value, ())
        grams = [seen.gram for seen in objective.seen(x)]
        parts = [np.ix_(limb.columns, limb.columns) for limb in limbs]
        return cls(x, value, tuple(max(_group_criterion(g[part]) for g in grams) for part in parts))

    def with_limbs_of(
        self,
        other: "_Mixed",
        objective: Objective,
        inequalities: InequalityConstraints,
        limbs: Sequence[JointGroup],
    ) -> "_Mixed":
        """The motion with those of the other's limbs that show more, if they fit to it."""
        best = self
        for number, (limb, new) in enumerate(zip(limbs, other.each, strict=False)):
            if not new < best.each[number]:
                continue
            x = best.x.copy()
            x[list(limb.joints)] = other.x[list(limb.joints)]
            value = (
                objective.value(x, COMPOSING_SHARPNESS)
                if inequalities.smallest_margin(x) > 0.0
                else np.nan
            )
            if value <= best.value:
                each = (*best.each[:number], new, *best.each[number + 1 :])
                best = _Mixed(x, value, each)
        return best


def _group_criterion(gram: Array) -> float:
    """D-optimality; what is not definite is infinite, of no parameters zero."""
    return DOptimal().smooth(gram, 1.0)[0] if len(gram) else 0.0


SHOWN_PER_WAVE = 20
"""Samples of the criterion per wave of the highest frequency."""

KEPT_PER_WAVE = 40
"""Samples of the constraints; between two of them an extreme is at most 0.3 % higher."""

JUMP_WIDTH = 1e-9
"""Width of speed [rad/s; m/s] below any that a sample has: the jumping laws themselves."""


def jumping(cases: Sequence[Case]) -> tuple[Case, ...]:
    """The cases with the laws as they are, not softened."""
    return tuple(
        replace(case, shows=replace(case.shows, widths=np.full_like(case.shows.widths, JUMP_WIDTH)))
        for case in cases
    )


@dataclass(frozen=True, eq=False)
class Problem:
    """What is designed.

    Attributes:
        robot: The robot.
        basis: The family of motions.
        limits: Of the joints.
        constraints: All else that must hold at all times.
        cases: What the motion shows and how that is judged, one per load of the robot.
        samples: Samples of the criterion that people read.
        notes: What was assumed, one sentence each, for the user.
    """

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
