r"""The walls that a motion may not touch while it is optimised: a logarithmic barrier.

Limits of joints are linear in the coefficients, $o_{jr} - \sum_i s_{ri} x_{ji} \ge 0$; their
barrier is $-\sum \log$ of the margins in units of the limit. Other constraints matter only nearer
than their room: with $s$ the margin over the room their barrier is
$-\log s - (1 - s) - \tfrac12 (1 - s)^2$ for $s < 1$ and zero beyond, twice differentiable at 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.basis import Basis
from steelyard.excitation.constraint import Constraint
from steelyard.excitation.limits import MotionLimits


@dataclass(frozen=True, eq=False)
class Barrier:
    """The barrier at one motion, with the derivatives that Newton's method takes.

    Attributes:
        value: Mean over the samples.
        slope: Shape `(n, m)`.
        curvature: Shape `(n m, n m)`; of constraints that are not linear the part without their
            second derivatives.
    """

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Walls:
    """Margins of a motion at sample times.

    Attributes:
        basis: The family of motions.
        limits: Of the joints.
        constraints: All else that must hold.
        t: Sample times, shape `(N,)` [s].
    """

    basis: Basis
    limits: MotionLimits
    constraints: Sequence[Constraint]
    t: Array

    @cached_property
    def shapes(self) -> list[Array]:
        """The basis' functions and their derivatives at the samples, four of shape `(N, m)`."""
        return [self.basis.shapes(self.t, order) for order in range(self._orders)]

    @cached_property
    def offsets(self) -> list[Array]:
        """What the basis has without coefficients, four of shape `(N, n)`."""
        return [self.basis.offset(self.t, order) for order in range(self._orders)]

    @property
    def _orders(self) -> int:
        return 3 if self.limits.jerk is None else 4

    @cached_property
    def _rows(self) -> Array:
        """Slopes of the linear margins, taken off, shape `(R, m)`."""
        return np.vstack([sign * shape for shape in self.shapes for sign in (1.0, -1.0)])

    @cached_property
    def _products(self) -> Array:
        """Outer products of each row with itself, shape `(R, m * m)`."""
        rows = self._rows
        return (rows[:, :, None] * rows[:, None, :]).reshape(len(rows), -1)

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Linear margins at zero coefficients, and what they are counted in, `(n, R)` each."""
        sides = bounds(self.limits)[: self._orders]
        at_zero, units = [], []
        for (lower, upper), offset in zip(sides, self.offsets, strict=True):
            half = np.repeat(0.5 * (upper - lower)[:, None], len(self.t), axis=1)
            at_zero += [upper[:, None] - offset.T, offset.T - lower[:, None]]
            units += [half, half]
        return np.hstack(at_zero), np.hstack(units)

    def linear(self, x: Array) -> Array:
        """Margins of the limits in units of half their range, shape `(n, R)`."""
        at_zero, units = self._bounds
        return (at_zero - x @ self._rows.T) / units

    def away(self, dx: Array) -> Array:
        """How fast those margins change along `dx`."""
        return -(dx @ self._rows.T) / self._bounds[1]

    def state(self, x: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration at the samples, each `(N, n)`."""
        q, dq, ddq = (s @ x.T + o for s, o in zip(self.shapes[:3], self.offsets[:3], strict=True))
        return q, dq, ddq

    def worst(self, x: Array) -> float:
        """The smallest margin of all, in units of limits and rooms; positive inside."""
        least = float(self.linear(x).min())
        for constraint in self.constraints if least > 0.0 else ():
            values = constraint.margins(*self.state(x)).values
            least = float(np.minimum(least, (values / constraint.room).min()))
        return -np.inf if np.isnan(least) else least

    def barrier(self, x: Array) -> Barrier | None:
        """The barrier at `x`, or `None` where a margin is not positive."""
        margins = self.linear(x)
        if not margins.min() > 0.0:
            return None
        n, m = x.shape
        inverse = 1.0 / margins
        weight = inverse / self._bounds[1]
        value = -float(np.log(margins).sum())
        slope = weight @ self._rows
        blocks = (weight**2 @ self._products).reshape(n, m, m)
        curvature = np.zeros((n * m, n * m))
        for joint, block in enumerate(blocks):
            own = slice(joint * m, (joint + 1) * m)
            curvature[own, own] = block
        state = self.state(x) if self.constraints else None
        for constraint in self.constraints:
            assert state is not None
            part = self._curved(constraint, state, x.shape)
            if part is None:
                return None
            value += part[0]
            slope = slope + part[1]
            curvature += part[2]
        count = len(self.t)
        return Barrier(value / count, slope / count, curvature / count)

    def _curved(
        self, constraint: Constraint, state: tuple[Array, Array, Array], shape: tuple[int, ...]
    ) -> tuple[float, Array, Array] | None:
        """Value, slope and curvature of one constraint's barrier."""
        margins = constraint.margins(*state)
        s = margins.values / constraint.room
        if not s.min() > 0.0:
            return None
        times, which = np.nonzero(s < 1.0)
        near, unit = s[times, which], constraint.room[which]
        lack = 1.0 - near
        value = float((-np.log(near) - lack - 0.5 * lack**2).sum())
        rows = np.zeros((len(times), *shape))
        for by, functions in zip(
            (margins.by_q, margins.by_dq, margins.by_ddq), self.shapes[:3], strict=True
        ):
            if by is not None:
                change = by[times, which] / unit[:, None]
                rows += change[:, :, None] * functions[times][:, None, :]
        flat = rows.reshape(len(times), shape[0] * shape[1])
        first = -1.0 / near + 1.0 + lack
        second = 1.0 / near**2 - 1.0
        return value, (first @ flat).reshape(shape), (flat * second[:, None]).T @ flat


def bounds(limits: MotionLimits) -> list[tuple[Array, Array]]:
    """Lower and upper bound of position, speed, acceleration and, where limited, jerk."""
    sides = [(limits.lower, limits.upper)]
    symmetric = [limits.velocity, limits.acceleration]
    symmetric += [] if limits.jerk is None else [limits.jerk]
    return sides + [(-most, most) for most in symmetric]
