r"""Output-error fit: parameters for which rollouts from the targets meet the measured positions.

Levenberg-Marquardt on the negative logarithm of the likelihood of independent residuals with
Student's distribution, one scale $s_j$ a joint, so that stretches in which the arm touches
something count little [Lange1989],

$$ \sum_j N \log s_j + \tfrac{\nu + 1}{2} \sum_k \log\bigl(1 + r_{jk}^2 / (\nu s_j^2)\bigr), $$

and a prior of each parameter with precision $P$. What a law lacks shows differently in each motion,
so that motions are what repeats: with curvature $H_b$ and gradient $g_b$ of each of $B$ logs, or of
parts of long ones, the likelihood is divided by how much larger these gradients are than if
residuals were independent, $\varphi$, that it does not outweigh the prior. With
$A = H / \varphi + P$, the values would move by $d_b = (A - H_b / \varphi)^{-1} g_b / \varphi$
without one motion. The covariance is that of the jackknife [Efron1981; Cameron2015],

$$ \tfrac{B - 1}{B} \sum_b (d_b - \bar d) (d_b - \bar d)^T + A^{-1} P A^{-1}, $$

the first part widened as Student's distribution asks of as many motions as tell the parameter.
Steps of rollouts have an error too: a share of by how much finer ones move the values is added.
So few motions may agree by chance: no standard deviation is less than that of $A^{-1}$.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from steelyard.actuators.actuator_parameters import ActuatorValues, Free, moved
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.rollout import STEP, Rolled, rollouts
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Z95, Array, frozen

FREEDOM = 4.0  # of Student's distribution
LEAST_SCALE = 1e-4  # of residuals [rad]: no encoder is better
CONVERGED = 0.3  # nats of the objective, below which a step is the last one
ROUNDS = 15
TRIES = 6
PARTS = 8  # of equal length, into which all motion is cut for intervals; shorter logs stay whole
STEP_ERROR = 1.0 / 3.0
"""Error of steps a quarter as long, over what these change: 1/3 in first order, 1/15 in second."""
LEAST_FREEDOM = 1.0  # of Student's distribution, where one motion tells all
LARGEST_SLOPE = 100.0
"""Derivative of a position times the standard deviation of the prior [rad; m], above which a
rollout depends on chance: friction that falls faster with speed than damping grows."""
SETTLING = 0.2  # seconds of a window that do not count: its first velocity is uncertain


@dataclass(frozen=True, eq=False)
class Task:
    """What is fitted to what."""

    step: ArmStep
    windows: tuple[Window, ...]
    free: tuple[Free, ...]
    prior: Array
    """Means of the prior, in the coordinates of the search `(p,)`."""
    spread: Array
    """Its standard deviations `(p,)`."""
    h: float = STEP
    threads: int = 2
    finer: int = 1
    """How many times shorter the steps of residuals are than those of their slopes."""

    @classmethod
    def of(
        cls,
        step: ArmStep,
        windows: Sequence[Window],
        free: Sequence[Free],
        centre: ActuatorValues,
        known: Mapping[tuple[str, int], tuple[float, float]] = MappingProxyType({}),
        h: float = STEP,
        threads: int = 2,
    ) -> "Task":
        """With a prior about `centre`, in which joints have actuators that are alike.

        `known` has another mean and spread of some, by name and joint.
        """
        usual = centre.changed(stiffness=usual_stiffness(centre, step.kinds))
        prior = [known.get((one.name, one.joint), (one.at(usual), one.kind.spread)) for one in free]
        mean, spread = np.array(prior).reshape(-1, 2).T
        return cls(step, tuple(windows), tuple(free), frozen(mean), frozen(spread), h, threads)

    @property
    def precision(self) -> Array:
        """Of the prior `(p,)`."""
        return np.asarray(self.spread**-2.0)

    def rolled(self, values: ActuatorValues, slopes: bool = False) -> list[Rolled]:
        """The windows rolled out, with derivatives if wanted."""
        given, h = (self.step, values, self.windows), self.h / self.finer
        coarse = rollouts(*given, self.free, self.h, self.threads) if slopes else []
        if slopes and self.finer == 1:
            return coarse
        found = rollouts(*given, (), h, self.threads)
        pairs = zip(found, coarse, strict=True) if slopes else ()
        return [Rolled(a.q, a.v, a.held, b.slopes, a.q - b.q) for a, b in pairs] or found


@dataclass(frozen=True, eq=False)
class Fitted:
    """The most probable values, scales of the residuals `(n,)` [rad; m], and their covariance."""

    task: Task
    values: ActuatorValues
    scale: Array
    covariance: Array
    """Of the search, `(p, p)`: logarithms where these are searched."""
    scatter: Array
    """The part of it that motions tell: without that of the prior and of the steps."""
    least_std: Array
    """Standard deviations if residuals were noise alone, `(p,)`."""
    repeated: float
    """How many residuals tell what one would, were they independent."""
    chance: float
    """Share of the windows that did not count: their rollouts depend on chance."""

    @property
    def std(self) -> Array:
        """Standard deviations, of logarithms where these are searched `(p,)`."""
        return np.sqrt(np.diag(self.covariance))


def usual_stiffness(values: ActuatorValues, kinds: Sequence[str]) -> Array:
    """Median of the joints of the same kind, revolute or prismatic, `(n,)`."""
    own = np.array(kinds)
    return np.array([np.median(values["stiffness"][own == kind]) for kind in kinds])


def residuals(task: Task, rolled: Sequence[Rolled]) -> list[Array]:
    """Measured less simulated positions of each window, without its first moments."""
    return [
        (w.q - r.q)[w.t - w.t[0] >= SETTLING] for w, r in zip(task.windows, rolled, strict=True)
    ]


def scales(found: Sequence[Array], start: Array | None = None) -> Array:
    """Scale of Student's distribution of each joint's residuals."""
    r = np.concatenate(list(found))
    s = 1.5 * np.median(np.abs(r), axis=0) if start is None else start
    s = np.maximum(s, LEAST_SCALE)
    for _ in range(20):
        weights = (FREEDOM + 1.0) / (FREEDOM + (r / s) ** 2)
        s = np.maximum(np.sqrt(np.mean(weights * r**2, axis=0)), LEAST_SCALE)
    return s


def objective(
    task: Task, values: ActuatorValues, found: Sequence[Array], scale: Array, repeated: float
) -> float:
    """Negative logarithm of likelihood and prior, but for constants.

    `repeated` is how many residuals tell what one would, were they independent.
    """
    r = np.concatenate(list(found)) / scale
    if not np.isfinite(r).all():
        return np.inf
    likelihood = 0.5 * (FREEDOM + 1.0) * np.log1p(r**2 / FREEDOM).sum()
    off = np.array([one.at(values) for one in task.free]) - task.prior
    likelihood += len(r) * np.log(scale).sum()
    return float(likelihood / repeated + 0.5 * off @ (task.precision * off))


def fit(
    task: Task,
    start: ActuatorValues,
    rounds: int = ROUNDS,
    report: Callable[[int, float], None] = lambda round_, value: None,
) -> Fitted:
    """The most probable values near a start."""
    whole, values, damping = task, start, 1e-2
    scale = None
    for round_ in range(rounds):
        every = whole.rolled(values, slopes=True)
        task, rolled = predictable(whole, every)
        if not rolled:
            unknown = frozen(np.diag(whole.spread**2))
            scale = scales(residuals(whole, every), scale)
            return Fitted(whole, values, frozen(scale), unknown, unknown, whole.spread, 1.0, 1.0)
        found = residuals(task, rolled)
        scale = scales(found, scale)
        told = [_quadratic(*one, scale) for one in zip(task.windows, rolled, found, strict=True)]
        information = np.sum([curvature for curvature, _, _ in told], axis=0)
        gradients = np.array([gradient for _, gradient, _ in told])
        repeated = _repeated(information, gradients, motions(task.windows))
        now = objective(task, values, found, scale, repeated)
        report(round_, now)
        off = np.array([one.at(values) for one in task.free]) - task.prior
        curvature = information / repeated + np.diag(task.precision)
        gradient = gradients.sum(axis=0) / repeated - task.precision * off
        better = None
        for _ in range(TRIES):
            scaled = curvature + damping * np.diag(np.diag(curvature))
            trial = moved(values, task.free, np.linalg.solve(scaled, gradient))
            value = objective(task, trial, residuals(task, task.rolled(trial)), scale, repeated)
            if value < now:
                better = trial
                break
            damping *= 8.0
        known = _covariance(task, told, repeated)
        chance = 1.0 - len(task.windows) / len(whole.windows)
        last = Fitted(whole, values, frozen(scale), *known, repeated, chance)
        if better is None:
            break
        values, damping = better, max(damping / 8.0, 1e-8)
        last = replace(last, values=values)
        if now - value < CONVERGED:
            break
    return last


def predictable(task: Task, rolled: Sequence[Rolled]) -> tuple[Task, list[Rolled]]:
    """Windows whose rollouts do not depend on chance: their derivatives are bounded."""
    most = LARGEST_SLOPE / task.spread
    clear = [bool((np.abs(one.slopes) < most).all()) for one in rolled]
    windows = tuple(compress(task.windows, clear))
    return replace(task, windows=windows), list(compress(rolled, clear))


def _quadratic(
    window: Window, rolled: Rolled, r: Array, scale: Array
) -> tuple[Array, Array, Array]:
    """Curvature of the likelihood `(p, p)`, its gradient, and what finer steps add to it `(p,)`."""
    counts = window.t - window.t[0] >= SETTLING
    slopes = rolled.slopes[counts]
    weight = (FREEDOM + 1.0) / (FREEDOM + (r / scale) ** 2) / scale**2
    flat = slopes.reshape(-1, slopes.shape[-1])
    heavy = flat * weight.reshape(-1, 1)
    finer = np.broadcast_to(rolled.finer, rolled.q.shape)[counts].reshape(-1)
    return flat.T @ heavy, r.reshape(-1) @ heavy, finer @ heavy


def _repeated(information: Array, gradients: Array, place: NDArray[np.int_]) -> float:
    """How much larger the motions' gradients are than if residuals were independent."""
    count, told = int(place.max()) + 1, np.diag(information)
    if count == 1:
        return 1.0
    own = np.zeros((count, len(told)))
    np.add.at(own, place, gradients)
    scatter = count * own.var(axis=0, ddof=1)
    seen = told > 1e-9 * told.max()
    return max(1.0, float(np.median(scatter[seen] / told[seen])))


def _covariance(
    task: Task, told: Sequence[tuple[Array, Array, Array]], repeated: float
) -> tuple[Array, Array, Array]:
    """Of the parameters, by what they would be without one motion or another.

    Then this part of it, which one window alone does not tell, and the least standard deviations.
    """
    prior, place = np.diag(task.precision), motions(task.windows)
    count, p = int(place.max()) + 1, len(prior)
    information, gradients = np.zeros((count, p, p)), np.zeros((count, p))
    for k, (curvature, gradient, _) in zip(place, told, strict=True):
        information[k] += curvature / repeated
        gradients[k] += gradient / repeated
    curvature = information.sum(axis=0) + prior
    inverse = np.linalg.inv(curvature)
    moves = np.stack(
        [np.linalg.solve(curvature - own, g) for own, g in zip(information, gradients, strict=True)]
    )
    moves -= moves.mean(axis=0)
    share = np.einsum("ij,bjk,ki->bi", inverse, information, inverse)
    telling = share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300)
    wider = student.ppf(0.975, np.maximum(telling - 1.0, LEAST_FREEDOM)) / Z95
    moves *= wider * np.sqrt((count - 1.0) / count)
    step = STEP_ERROR / repeated * (inverse @ np.sum([finer for _, _, finer in told], axis=0))
    scatter = moves.T @ moves if count > 1 else np.diag(task.spread**2)
    covariance = scatter + inverse @ prior @ inverse + np.outer(step, step)
    least = np.sqrt(np.diag(inverse))
    more = np.maximum(1.0, least / np.sqrt(np.diag(covariance)))
    covariance *= np.outer(more, more)
    return frozen(covariance), frozen(scatter), frozen(least)


def motions(windows: Sequence[Window]) -> NDArray[np.int_]:
    """Which motion each window is of, `(W,)`: its log, or one of the parts of a long one."""
    length = np.array([w.t[-1] - w.t[0] for w in windows])
    names = np.array([w.run.name for w in windows])
    found, count = np.empty(len(windows), dtype=int), 0
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        parts = max(1, round(PARTS * length[mine].sum() / length.sum()))
        ends = np.cumsum(length[mine])
        middle = (ends - 0.5 * length[mine]) / ends[-1]
        found[mine] = count + np.minimum((middle * parts).astype(int), parts - 1)
        count += parts
    return np.asarray(np.unique(found, return_inverse=True)[1])
