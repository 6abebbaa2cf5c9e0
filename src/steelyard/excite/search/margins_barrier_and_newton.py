r"""Margins at the samples of a motion, their logarithmic barrier, and Newton's method within it.

Limits of joints are linear in the coefficients, $o_{jr} - \totali s_{ri} x_{ji} \ge 0$; their
barrier is $-\sum \log$ of the margins in units of the limit. Other constraints matter only nearer
than their activation distance: with $s$ the margin over the activation distance their barrier is
$-\log s - (1 - s) - \tfrac12 (1 - s)^2$ for $s < 1$ and zero beyond, twice differentiable at 1.

$f(x) + \mu\,b(x)$ is minimised for falling $\mu$ while the criterion $f$ becomes sharper. The
barrier's second derivatives are exact, those of the criterion are learnt from its slopes (damped
BFGS [Nocedal2006]): every step is a small linear system, and every step stays feasible.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Stopped
from steelyard.excite.constraints.constraint_and_limits import Constraint, MotionLimits
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
        return replace(self, t=t, reserves=(), edge=0.0)

    @cached_property
    def coarser(self) -> "InequalityConstraints":
        """The same with every `_SPARSE_STEP`th sample and no reserves, for a first look."""
        return replace(self, t=self.t[::_SPARSE_STEP], reserves=(), edge=0.0)

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
        if total is None or not self.constraints:
            return total
        state = self.state(x)
        for number, constraint in enumerate(self.constraints):
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


ObjectiveFunction = Callable[[Array, float], tuple[float, Array]]
"""Coefficients and sharpness to the value to be minimised and its slope."""

StepWatch = Callable[[Array], None]  # told of feasible coefficients; may raise `Stopped`

STAGES = ((4.0, 1e-1), (4.0, 1e-2), (16.0, 1e-2), (16.0, 1e-3), (64.0, 1e-3), (64.0, 1e-4))
"""Sharpness and weight of the barrier, one after the other."""

BACK_STAGES = ((16.0, 1e-1), (64.0, 1e-2), (64.0, 1e-3), (64.0, 1e-4))
"""From a minimum off the constraints and to them again: then they can keep more than before."""

_FRACTION_TO_BOUNDARY = 0.95
_ENOUGH_GAIN = 1e-4
_STEP_SHRINK = 0.4
_STEP_TRIALS = 12


class Deadline:
    """Ends a search at a time of `time.monotonic`, and keeps the latest coefficients, if any.

    A search that begins in the feasible set gives them where it does so.
    """

    def __init__(self, at: float, *begun: Array) -> None:
        self._at, self.latest = at, list(begun)

    def __call__(self, x: Array) -> None:
        """Keep them; raises `Stopped` past the deadline."""
        self.latest = [x]
        if time.monotonic() > self._at:
            raise Stopped("the time limit is reached")


@dataclass(frozen=True, eq=False)
class _Point:
    x: Array
    value: float
    gradient: Array
    barrier: Barrier


@dataclass(frozen=True, eq=False)
class _Stage:
    """What is minimised at one sharpness of the criterion and one weight of the barrier."""

    objective: ObjectiveFunction
    inequalities: InequalityConstraints
    sharpness: float
    weight: float

    def at(self, x: Array) -> _Point | None:
        """The point, if it is inside and shows something."""
        barrier = self.inequalities.barrier(x)
        if barrier is None:
            return None
        value, gradient = self.objective(x, self.sharpness)
        return _Point(x, value, gradient, barrier) if np.isfinite(value) else None

    def step(self, point: _Point, hessian: Array) -> tuple[_Point | None, float]:
        """A step that lowers criterion and barrier, and the gain that its model foretold."""
        inequalities, weight = self.inequalities, self.weight
        gradient = (point.gradient + weight * point.barrier.gradient).ravel()
        full = hessian + weight * point.barrier.hessian
        try:
            dx = np.asarray(np.linalg.solve(full, -gradient)).reshape(point.x.shape)
        except np.linalg.LinAlgError:  # curvatures too far apart for the digits there are
            dx = np.linalg.lstsq(full, -gradient, rcond=None)[0].reshape(point.x.shape)
        gain = -float(gradient @ dx.ravel())
        now = point.value + weight * point.barrier.value
        margins, change = inequalities.limit_margins(point.x), inequalities.margin_rates(dx)
        towards = change < 0.0
        to_boundary = np.min(margins[towards] / -change[towards], initial=np.inf)
        size = min(1.0, _FRACTION_TO_BOUNDARY * float(to_boundary))
        for _ in range(_STEP_TRIALS):
            tried = self.at(point.x + size * dx)
            if tried is not None:
                then = tried.value + weight * tried.barrier.value
                if then <= now - _ENOUGH_GAIN * size * gain:
                    return tried, gain
            size *= _STEP_SHRINK
        return None, gain


def minimised(
    objective: ObjectiveFunction,
    inequalities: InequalityConstraints,
    x: Array,
    *,
    stages: tuple[tuple[float, float], ...] = STAGES,
    extra: Sequence[Array] = (),
    between: bool = True,
    steps: int = 60,
    tolerance: float = 1e-3,
    watch: StepWatch = lambda x: None,
) -> Array:
    """The nearest minimum of an objective from a motion strictly inside, `(n, m)`.

    Stages are sharpness and weight of the barrier, one after the other, of most `steps` each; one
    ends where the predicted gain of a step is below the tolerance. Each constraint's margins keep
    `extra` on top, `(k,)` each, if given, and with `between` what they dip between samples, see
    `with_reserves`.
    """
    hessian = np.eye(x.size)
    for sharpness, weight in stages:
        inner = inequalities.with_reserves(x, extra) if between else inequalities
        stage = _Stage(objective, inner, sharpness, weight)
        point = stage.at(x)
        if point is None:
            return x
        for _ in range(steps):
            watch(point.x)
            moved, gain = stage.step(point, hessian)
            if moved is None:
                break
            hessian = _learnt(hessian, moved.x - point.x, moved.gradient - point.gradient)
            point = moved
            if gain < tolerance:
                break
        x = point.x
    return x


def minimised_by(
    deadline: float,
    objective: ObjectiveFunction,
    inequalities: InequalityConstraints,
    x: Array,
    **options: Any,
) -> Array:
    """See `minimised`; where that is not reached by the deadline, how far it came."""
    watch = Deadline(deadline, x)
    try:
        return minimised(objective, inequalities, x, watch=watch, **options)
    except Stopped:
        return watch.latest[0]


def _learnt(hessian: Array, dx: Array, change: Array) -> Array:
    """Damped BFGS: stays positive definite whatever the criterion does."""
    step, y = dx.ravel(), change.ravel()
    along = hessian @ step
    bend = float(step @ along)
    if not bend > 0.0:
        return hessian
    agreement = float(step @ y)
    if agreement < 0.2 * bend:
        share = 0.8 * bend / (bend - agreement)
        y = share * y + (1.0 - share) * along
        agreement = float(step @ y)
    return hessian - np.outer(along, along) / bend + np.outer(y, y) / agreement
