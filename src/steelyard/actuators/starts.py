r"""Where the search for actuators begins: signs and zeros of the log, stiffness and friction.

While a joint moves slowly, the error of its controller is what the spring needs,

$$ u - q = \frac{1}{k_p} \bigl(g(s q + z) s + f \operatorname{sign} \dot q + k_d\, \dot q
   + m\, \ddot q\bigr), $$

linear in all but the zeros $z$, and gravity tells these and the signs $s$. Zeros lie where the
joint's limits contain the motion. Friction, damping and mass are projected out [Golub1973], and
what is left is fitted from several starts for each combination of signs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
from scipy.stats.qmc import Halton

from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.target_runs import TargetRun
from steelyard.base.arrays import Array
from steelyard.model.model import ValuedModel
from steelyard.robot.robot import Robot

SAMPLES = 2000  # that are fitted
SMOOTHED = 0.18  # length of the polynomials that differentiate positions [s]
MOVING = 0.1  # of a joint's largest speed, above which friction has its sign
BEYOND = 0.1  # how far motion may leave the limits of the model file [rad]
COMBINATIONS, PLACES = 16, 6
"""Most combinations of signs, and of starts of the zeros for each beside the model's own."""
MATTERS = 0.02  # change of gravity by a turn of a joint, over its largest, that can be seen
LEAST_STIFFNESS, MOST_STIFFNESS = 0.1, 1e4
"""Bounds of a start [Nm/rad]."""


@dataclass(frozen=True, eq=False)
class Quiet:
    """Samples of all runs, `(N, n)` each, in the log's signs: what slow motion shows."""

    q: Array
    error: Array
    dq: Array
    ddq: Array

    @classmethod
    def of(cls, runs: Sequence[TargetRun]) -> "Quiet":
        """Smoothed, on an even clock, some of all samples."""
        parts = [_smoothed(run) for run in runs]
        every = max(1, sum(len(p[0]) for p in parts) // SAMPLES)
        return cls(*(np.concatenate([p[k][::every] for p in parts]) for k in range(4)))


def _smoothed(run: TargetRun) -> tuple[Array, Array, Array, Array]:
    dt = float(np.median(np.diff(run.t)))
    t = np.arange(run.t[0], run.t[-1], dt)
    q = np.stack([np.interp(t, run.t, x) for x in run.q.T], axis=1)
    u = run.target[np.clip(np.searchsorted(run.t, t, side="right") - 1, 0, None)]
    width = min(max(5, 2 * round(SMOOTHED / dt / 2.0) + 1), 2 * ((len(t) - 1) // 2) - 1)
    dq, ddq = (savgol_filter(q, width, 3, deriv=order, delta=dt, axis=0) for order in (1, 2))
    inner = slice(width, len(t) - width)
    error = (u - q) * run.supplied(t)[:, None]
    return q[inner], error[inner], dq[inner], ddq[inner]


@dataclass(frozen=True, eq=False)
class Start:
    """A start, and how badly slow motion fits it: smaller is better."""

    values: ActuatorValues
    cost: float


class _Slow:
    """The linear problem of each joint, all but gravity projected out."""

    def __init__(self, model: ValuedModel, quiet: Quiet) -> None:
        self.model, self.quiet = model, quiet
        self.n = model.model.robot.n
        fastest = np.quantile(np.abs(quiet.dq), 0.99, axis=0)
        self.moving = np.abs(quiet.dq) > np.maximum(MOVING * fastest, 1e-4)
        self.usable = [j for j in range(self.n) if self.moving[:, j].sum() > 50]
        self.basis, self.error, self.sides = {}, {}, {}
        for j in self.usable:
            rows = self.moving[:, j]
            v, a = quiet.dq[rows, j], quiet.ddq[rows, j]
            columns = np.stack([np.sign(v), v, a], axis=1)
            self.basis[j] = np.linalg.qr(columns)[0]
            self.sides[j] = columns
            self.error[j] = self._without(j, quiet.error[rows, j])
        usual = [1.5 * np.median(np.abs(e)) for e in self.error.values()]
        self.scale = {j: max(x, 1e-4) for j, x in zip(self.usable, usual, strict=True)}

    def _without(self, j: int, x: Array) -> Array:
        return np.asarray(x - self.basis[j] @ (self.basis[j].T @ x))

    def gravity(self, signs: Array, zeros: Array) -> Array:
        """In the log's signs, `(N, n)`."""
        return np.asarray(self.model.gravity(signs * self.quiet.q + zeros) * signs)

    def compliance(self, j: int, gravity: Array) -> float:
        """One over the stiffness of a joint, for its gravity along moving samples."""
        own = self._without(j, gravity)
        size = float(own @ own)
        value = float(own @ self.error[j]) / size if size > 0.0 else 0.0
        return float(np.clip(value, 1.0 / MOST_STIFFNESS, 1.0 / LEAST_STIFFNESS))

    def residuals(self, signs: Array, zeros: Array) -> Array:
        """Of all joints, in their scales."""
        gravity, found = self.gravity(signs, zeros), []
        for j in self.usable:
            mine = gravity[self.moving[:, j], j]
            left = self.error[j] - self.compliance(j, mine) * self._without(j, mine)
            found.append(left / self.scale[j])
        return np.concatenate(found) if found else np.zeros(1)

    def values(self, signs: Array, zeros: Array, late: float) -> ActuatorValues:
        """Parameters that slow motion gives; of joints without gravity like those of the others."""
        gravity = self.gravity(signs, zeros)
        weight = gravity.std(axis=0)
        told = {j: 1.0 / self.compliance(j, gravity[self.moving[:, j], j]) for j in self.usable}
        clear = [told[j] for j in self.usable if weight[j] > MATTERS * weight.max(initial=0.0)]
        clear = [k for k in clear if LEAST_STIFFNESS < k < 0.5 * MOST_STIFFNESS]
        usual = float(np.median(clear)) if clear else 10.0
        kp, kd, f = (
            np.full(self.n, usual),
            np.full(self.n, 0.03 * usual),
            np.full(self.n, 0.01 * usual),
        )
        for j in self.usable:
            rows = self.moving[:, j]
            kp[j] = told[j] if told[j] in clear else usual
            wanted = self.quiet.error[rows, j] - gravity[rows, j] / kp[j]
            friction, damping, *_ = np.linalg.lstsq(self.sides[j], wanted, rcond=None)[0]
            f[j] = kp[j] * max(float(friction), 1e-3 * float(np.std(wanted)) + 1e-6)
            kd[j] = kp[j] * max(float(damping), 2e-3)
        own = self.model.mass_matrix(signs * self.quiet.q[0] + zeros)
        return ActuatorValues.of(
            signs.tolist(),
            stiffness=kp,
            damping=kd,
            coulomb=f,
            armature=np.maximum(0.3 * np.diag(own), 1e-4),
            zero=zeros,
            delay=late,
        )


def gravity_joints(model: ValuedModel, quiet: Quiet) -> list[int]:
    """Joints whose zero changes what gravity needs."""
    q = quiet.q[:: max(1, len(quiet.q) // 50)]
    before = model.gravity(q)
    largest = float(np.abs(before).max(initial=0.0))
    found = []
    for j in range(q.shape[1]):
        turned = q.copy()
        turned[:, j] += 0.5
        if np.abs(model.gravity(turned) - before).max() > MATTERS * largest > 0.0:
            found.append(j)
    return found


def starts(
    model: ValuedModel,
    runs: Sequence[TargetRun],
    signs: Sequence[float | None],
    zeros: Sequence[float | None],
) -> list[Start]:
    """Starts, the best first: one for each combination of signs that is possible.

    Signs and zeros that are `None` are found where gravity depends on them, else they are 1 and 0.
    """
    quiet = Quiet.of(runs)
    slow, robot = _Slow(model, quiet), model.model.robot
    seen = gravity_joints(model, quiet)
    late = 0.5 * float(np.median(np.diff(runs[0].t)))
    turned = [j for j in seen if signs[j] is None]
    moved = [j for j in seen if zeros[j] is None]
    base_signs = np.array([1.0 if s is None else s for s in signs])
    base_zeros = np.array([0.0 if z is None else z for z in zeros])
    found = []
    for some in islice(_sign_combinations(len(turned)), COMBINATIONS):
        s = base_signs.copy()
        s[turned] = some
        best, cost = _best_zeros(slow, robot, s, base_zeros, moved)
        values = slow.values(s, best, late)
        unlike = np.log(values["stiffness"][seen] / np.median(values["stiffness"]))
        found.append(Start(values, cost + 0.5 * float(unlike @ unlike)))
    return sorted(found, key=lambda one: one.cost)


def _sign_combinations(count: int) -> Iterator[tuple[float, ...]]:
    """All of them, few reversed joints first."""
    every = list(product((1.0, -1.0), repeat=count))
    yield from sorted(every, key=lambda some: sum(x < 0.0 for x in some))


def _best_zeros(
    slow: _Slow, robot: Robot, signs: Array, zeros: Array, moved: Sequence[int]
) -> tuple[Array, float]:
    """Zeros that fit slow motion best within the limits of the joints, and their cost."""
    if not moved:
        return zeros, float(np.log1p(slow.residuals(signs, zeros) ** 2).sum())
    low, high = np.array([bounds_of_zero(robot, slow.quiet.q, signs, j) for j in moved]).T

    def of(x: Array) -> Array:
        full = zeros.copy()
        full[list(moved)] = x
        return full

    found = []
    places = low + Halton(len(moved), seed=0).random(PLACES) * (high - low)
    for first in (np.clip(np.zeros(len(moved)), low + 1e-6, high - 1e-6), *places):
        solved = least_squares(
            lambda x: slow.residuals(signs, of(x)),
            first,
            bounds=(low, high),
            loss="cauchy",
            max_nfev=25,
        )
        found.append((float(2.0 * solved.cost), solved.x))
    cost, best = min(found, key=lambda one: one[0])
    return of(best), cost


def zero_prior(robot: Robot, q: Array, signs: Array, j: int) -> tuple[float, float]:
    """Mean and standard deviation of a joint's zero: the model's own if limits allow it."""
    low, high = bounds_of_zero(robot, q, signs, j)
    return float(np.clip(0.0, low, high)), 0.25 * (high - low)


def bounds_of_zero(robot: Robot, q: Array, signs: Array, j: int) -> tuple[float, float]:
    """Where a joint's zero may lie: its motion is within its limits; half a turn if it has none."""
    limits = robot.coordinates[j].limits
    q = signs[j] * q[:, j]
    low, high = limits.lower - q.min() - BEYOND, limits.upper - q.max() + BEYOND
    if not (np.isfinite(low) and np.isfinite(high)) or high - low > 2.0 * np.pi or low >= high:
        return -np.pi, np.pi
    return float(low), float(high)
