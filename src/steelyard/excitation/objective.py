"""What is minimised over the coefficients of a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.bases.basis import Basis
from steelyard.excitation.criteria.criteria import Criterion, worst
from steelyard.excitation.criteria.measure import Measure
from steelyard.regression.information_gradient import InformationEvaluator, SampledInformation


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
