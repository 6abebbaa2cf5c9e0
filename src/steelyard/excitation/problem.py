"""The design problem: a criterion, a family of motions and inequality constraints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.barrier import InequalityConstraints
from steelyard.excitation.bases.basis import Basis
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.criteria.criteria import worst_value
from steelyard.excitation.limbs import Limb, limbs_of
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.objective import Case, Objective
from steelyard.robot.robot import Robot

SHOWN_PER_WAVE = 20
"""Samples of the criterion per wave of the highest frequency."""

KEPT_PER_WAVE = 40
"""Samples of the constraints; between two of them an extreme is at most 0.3 % higher."""

JUMP = 1e-9
"""Width of speed [rad/s; m/s] below any that a sample has: the jumping laws themselves."""


def jumping(cases: Sequence[Case]) -> tuple[Case, ...]:
    """The cases with the laws as they are, not softened."""
    return tuple(
        replace(case, shows=replace(case.shows, widths=np.full_like(case.shows.widths, JUMP)))
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
    def limbs(self) -> tuple[Limb, ...]:
        """Joints that share no parameter with others."""
        return limbs_of(self.cases[0].shows)

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
