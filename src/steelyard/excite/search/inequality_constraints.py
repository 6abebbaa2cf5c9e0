"""Limits and constraints at the samples of a motion: margins, and their logarithmic barrier."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.constraints.constraint import Constraint
from steelyard.excite.constraints.motion_limits import MotionLimits
from steelyard.excite.trajectories.motion_families import Basis

_DIP_FACTOR = 1.2
_MOST_OF_MARGIN = 0.9
_SPARSE_STEP = 5

CONSTRAINT_STEP = 2  # constraints are seen at each second sample: slower than accelerations


@dataclass(frozen=True, eq=False)
class Barrier:
    """Mean of the barrier over samples, its gradient `(n, m)`, and its hessian `(n m, n m)`.

    Of constraints that are not linear the hessian lacks their second derivatives.
    """

    value: float
    gradient: Array
    hessian: Array


@dataclass(frozen=True, eq=False)
class InequalityConstraints:
    """Margins of a motion at sample times `(N,)` [s].

    Constraints are looked at in each second one. For the time between samples each constraint's
    margins keep its `reserves`, `(N', k)`, none if empty, and the limits' margins the `edge`, `(n,
    2 R)`.
    """

    basis: Basis
    limits: MotionLimits
    constraints: Sequence[Constraint]
    t: Array
    reserves: Sequence[Array] = ()
    edge: Array | float = 0.0

    def refined(self) -> "InequalityConstraints":
        """The same with twice the samples and no reserves."""
        ends = np.append(self.t, 2.0 * self.t[-1] - self.t[-2])
        t = np.sort(np.concatenate([self.t, 0.5 * (ends[1:] + ends[:-1])]))
        return InequalityConstraints(self.basis, self.limits, self.constraints, t)

    @cached_property
    def coarser(self) -> "InequalityConstraints":
        """The same with every `_SPARSE_STEP`th sample and no reserves, for a first look."""
        return InequalityConstraints(
            self.basis, self.limits, self.constraints, self.t[::_SPARSE_STEP]
        )

    @cached_property
    def shapes(self) -> list[Array]:
        """The basis' functions and their derivatives at the samples, each `(N, m)`."""
        return [self.basis.shapes(self.t, order) for order in range(len(self.limits.bounds))]

    @cached_property
    def offsets(self) -> list[Array]:
        """What the basis has without coefficients, each `(N, n)`."""
        return [self.basis.offset(self.t, order) for order in range(len(self.limits.bounds))]

    @cached_property
    def _rows(self) -> Array:
        """All orders one after another, shape `(R, m)`."""
        return np.vstack(self.shapes)

    @cached_property
    def _middle(self) -> Array:
        """What the limits leave in the middle, less the offset, shape `(n, R)`."""
        sides = zip(self.limits.bounds, self.offsets, strict=True)
        return np.hstack([0.5 * (low + high)[:, None] - offset.T for (low, high), offset in sides])

    @cached_property
    def _halves(self) -> Array:
        """Half of each limit's range, shape `(n, R)`."""
        halves = [0.5 * (high - low) for low, high in self.limits.bounds]
        return np.repeat(np.column_stack(halves), len(self.t), axis=1)

    def limit_margins(self, x: Array) -> Array:
        """Margins of the limits in units of half their range, shape `(n, 2 R)`."""
        place = (x @ self._rows.T - self._middle) / self._halves
        return np.hstack([1.0 - place, 1.0 + place]) - self.edge

    def margin_rates(self, dx: Array) -> Array:
        """How fast those margins change along `dx`."""
        rate = (dx @ self._rows.T) / self._halves
        return np.hstack([-rate, rate])

    def room(self, x: Array, dx: Array) -> Array:
        """How much of a change the limits allow each joint, shape `(n,)`."""
        falls = np.maximum(-self.margin_rates(dx), 1e-12)
        return np.asarray(np.min(self.limit_margins(x) / falls, axis=1))

    def state(self, x: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration at the constraints' samples, each `(N', n)`."""
        q, dq, ddq = (
            s[::CONSTRAINT_STEP] @ x.T + o[::CONSTRAINT_STEP]
            for s, o in zip(self.shapes[:3], self.offsets[:3], strict=True)
        )
        return q, dq, ddq

    def with_reserves(self, x: Array, extra: Sequence[Array] = ()) -> "InequalityConstraints":
        """Constraints that keep what margins dip between the samples of a motion inside.

        Between two samples a margin with second difference $c$ dips by $c/8$ at most, as far as it
        is a parabola; no more than nine tenths of a margin is reserved. On top, each constraint's
        margins keep `extra`, `(k,)` each, if given.
        """
        state = self.state(x)
        found = []
        for number, constraint in enumerate(self.constraints):
            values = constraint.margins(*state).values
            wanted = _dips(values) + (extra[number] if extra else 0.0)
            found.append(np.minimum(wanted, _MOST_OF_MARGIN * np.maximum(values, 0.0)))
        margins = replace(self, edge=0.0).limit_margins(x)
        blocks = margins.reshape(-1, len(self.t))
        edge = np.minimum(_dips(blocks.T).T.reshape(margins.shape), _MOST_OF_MARGIN * margins)
        return replace(self, reserves=tuple(found), edge=np.maximum(edge, 0.0))

    def smallest_margin(self, x: Array) -> float:
        """The smallest margin, in units of limits and activation distances; positive: feasible."""
        least = float(self.limit_margins(x).min())
        for constraint in self.constraints if least > 0.0 else ():
            values = constraint.margins(*self.state(x)).values
            least = float(np.minimum(least, (values / constraint.activation_distance).min()))
        return -np.inf if np.isnan(least) else least

    def barrier(self, x: Array) -> Barrier | None:
        """The barrier at `x`, or `None` where a margin is not positive."""
        total = self._limited(x)
        state = self.state(x) if self.constraints and total is not None else None
        for number, constraint in enumerate(self.constraints):
            if total is None or state is None:
                return None
            reserve = self.reserves[number] if self.reserves else 0.0
            part = self._curved(constraint, state, x.shape, reserve)
            if part is None:
                return None
            total = Barrier(
                total.value + part.value,
                total.gradient + part.gradient,
                total.hessian + part.hessian,
            )
        return total

    def _limited(self, x: Array) -> Barrier | None:
        margins = self.limit_margins(x)
        if not margins.min() > 0.0:
            return None
        n, m = x.shape
        above, below = np.hsplit(1.0 / margins, 2)
        gradient = ((above - below) / self._halves) @ self._rows
        bend = (above**2 + below**2) / self._halves**2
        hessian = np.zeros((n * m, n * m))
        for joint, weights in enumerate(bend):
            own = slice(joint * m, (joint + 1) * m)
            hessian[own, own] = (self._rows.T * weights) @ self._rows
        count = len(self.t)
        return Barrier(-float(np.log(margins).sum()) / count, gradient / count, hessian / count)

    def _curved(
        self,
        constraint: Constraint,
        state: tuple[Array, Array, Array],
        shape: tuple[int, ...],
        reserve: Array | float,
    ) -> Barrier | None:
        margins = constraint.margins(*state)
        s = (margins.values - reserve) / constraint.activation_distance
        if not s.min() > 0.0:
            return None
        times, which = np.nonzero(s < 1.0)
        near, unit = s[times, which], constraint.activation_distance[which]
        lack = 1.0 - near
        value = float((-np.log(near) - lack - 0.5 * lack**2).sum())
        rows = np.zeros((len(times), *shape))
        for by, functions in zip(
            (margins.by_q, margins.by_dq, margins.by_ddq), self.shapes[:3], strict=True
        ):
            if by is not None:
                change = by[times, which] / unit[:, None]
                rows += change[:, :, None] * functions[CONSTRAINT_STEP * times][:, None, :]
        flat = rows.reshape(len(times), shape[0] * shape[1])
        gradient = ((-1.0 / near + 1.0 + lack) @ flat).reshape(shape)
        hessian = (flat * (1.0 / near**2 - 1.0)[:, None]).T @ flat
        count = len(state[0])
        return Barrier(value / count, gradient / count, hessian / count)


def _dips(margins: Array) -> Array:
    """How far margins at samples `(N, k)` may dip beside them, as far as they are parabolas."""
    bend = np.zeros_like(margins)
    bend[1:-1] = np.maximum(margins[:-2] - 2.0 * margins[1:-1] + margins[2:], 0.0)
    beside = np.vstack([bend[:1], bend, bend[-1:]])
    return _DIP_FACTOR / 8.0 * np.maximum(np.maximum(beside[:-2], beside[2:]), bend)
