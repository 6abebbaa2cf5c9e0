r"""Efforts logged beside targets: they give torques their scale, or get their gains from it.

Along a rollout from the targets, whose states have no noise, the law has a torque $\tau$ of every
row, in the scale of the masses of the model file. What a drive logs is this torque over a gain, and
viscous friction that the law counts as damping is not in it,

$$ y = \alpha\, \tau + c_0 + c_1 \dot q, $$

and a sensor at the joint lacks what dry friction and the rotor take, too, $c_2 \operatorname{sign}
\dot q + c_3 \ddot q$. With a gain $g$ that is known, true torques are $g \alpha$ times those of the
law; with a known scale the gain is $1 / \alpha$. Residuals have Student's distribution, and whole
motions are left out one by one for the interval.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from steelyard.actuators.actuator_model import ActuatorModel, EffortGain
from steelyard.actuators.actuator_parameters import BY_NAME, ActuatorValues
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import FREEDOM, LEAST_FREEDOM, SETTLING, motions
from steelyard.actuators.rollout import STEP, Rolled, rollouts
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Z95, Array
from steelyard.robot.file.signals import TargetSignals

FINE_STEP = STEP / 4  # of the rollouts [s]
CREEP = 0.02  # speed above which dry friction has its sign [rad/s; m/s]
SURE = 0.2  # quantile of the torque's size, below which its sign is not sure
NEGATIVE = 0.05  # of the largest effort: smaller negative ones are noise of a size
WIDEST = 0.35  # standard deviation of the logarithm, above which a factor is not known
FOLLOWS, LIKE_ANOTHER = 0.7, 0.9
"""Correlation with the torque of a joint that efforts have at least, and that which tells that
they are another joint's, if it is above that with their own."""
LEAST_SHARE = 1e-3  # of the torque's size, that other causes do not explain
LEAST_STD = 0.003
"""Of the logarithm of a factor: efforts are logged a little before or after targets arrive, which
moved factors of simulated arms by 0.1 to 0.3 %, however long their logs were."""
ROUNDS = 15  # of the weights of Student's distribution
MOST_SPREADS = 2.5  # standard deviations of the prior of masses, that these are off
OFF = 1.2  # factor between a gain and a stiffness that are both stated, above which one is wrong


@dataclass(frozen=True)
class Factor:
    """Logged effort of a joint per torque of the law, and how well it is known.

    `value` is negative where efforts count against the joint; `std` is that of its logarithm;
    `follows` the correlation of the two, without what other causes explain. `unsigned` are efforts
    that are sizes only.
    """

    value: float
    std: float
    follows: float
    unsigned: bool


@dataclass(frozen=True)
class Efforts:
    """Factors of joints whose efforts follow the torque of the law; else whose they follow."""

    factors: Mapping[int, Factor]
    others: Mapping[int, int]


def logged_efforts(
    step: ArmStep,
    windows: Sequence[Window],
    values: ActuatorValues,
    signals: TargetSignals,
    joints: Sequence[int],
    threads: int,
) -> Efforts:
    """What the logs show of the efforts of these joints, which move."""
    if not signals.effort:
        return Efforts({}, {})
    rolled = rollouts(step, values, windows, (), FINE_STEP, threads)
    rows = [_rows(*one, values) for one in zip(windows, rolled, strict=True)]
    torque, speed, acceleration, effort = (np.concatenate(x) for x in zip(*rows, strict=True))
    place = np.repeat(motions(windows), [len(row[0]) for row in rows])
    columns = {}
    for i in joints:
        v = speed[:, i]
        mine = [torque[:, i], np.ones(len(v)), v]
        if signals.effort_at_joint:
            mine += [v / np.sqrt(v**2 + CREEP**2), acceleration[:, i]]
        columns[i] = np.stack(mine, axis=1)
    found, others = dict[int, Factor](), dict[int, int]()
    for j in joints:
        by = {i: _factor(columns[i], effort[:, j], place) for i in joints}
        size = {i: one.follows for i, one in by.items() if one is not None}
        best, own = max(size, key=size.__getitem__, default=j), by[j]
        if best != j and size[best] > LIKE_ANOTHER:
            others[j] = best
        elif own is not None and own.follows > FOLLOWS and own.std < WIDEST:
            found[j] = own
    return Efforts(found, others)


def _rows(
    window: Window, rolled: Rolled, values: ActuatorValues
) -> tuple[Array, Array, Array, Array]:
    """Torques of the law, speeds and accelerations of the joints, and logged efforts, `(N, n)`."""
    counts = window.t - window.t[0] >= SETTLING
    a = np.gradient(rolled.v, window.t, axis=0)[counts]
    t, q, v, held = (x[counts] for x in (window.t, rolled.q, rolled.v, rolled.held))
    u = window.run.target_at(t, values["delay"])
    off = u + values["offset"] - q
    off = off - np.clip(off, -values["dead_band"], values["dead_band"])
    fed = window.run.supplied(t)[:, None]
    wanted = fed * values["stiffness"] * off - values["damping"] * v + held
    torque = np.clip(wanted, -fed * values["torque_limit"], fed * values["torque_limit"])
    s = values.signs
    effort = window.run.effort[window.start : window.stop][counts]
    return s * (torque - values["back_emf"] * v), s * v, s * a, effort


def _factor(columns: Array, effort: Array, place: NDArray[np.int_]) -> Factor | None:
    """The coefficient of efforts by the torque, the first column; `None` if nothing tells it.

    Efforts that are sizes, but for noise, have the sign of the torque, where that explains them
    better.
    """
    given = np.isfinite(effort)
    signed = _signed_factor(columns[given], effort[given], place[given], False)
    largest = np.quantile(np.abs(effort[given]), 0.99) if given.any() else 0.0
    if not largest or (effort[given] < -NEGATIVE * largest).mean() > 0.01:
        return signed
    torque = columns[:, 0]
    given &= np.abs(torque) > np.quantile(np.abs(torque), SURE)
    turned = (effort * np.sign(torque))[given]
    size = _signed_factor(columns[given], turned, place[given], True)
    better = size is not None and (signed is None or size.follows > signed.follows)
    return size if better and np.ptp(np.sign(torque[given])) > 0.0 else signed


def _signed_factor(x: Array, y: Array, place: NDArray[np.int_], unsigned: bool) -> Factor | None:
    blocks = np.unique(place)
    if len(y) < 10 * x.shape[1] or len(blocks) < 2 or np.ptp(y) == 0.0:
        return None
    weight = np.ones(len(y))
    for _ in range(ROUNDS):
        root = np.sqrt(weight)[:, None]
        off = y - x @ np.linalg.lstsq(root * x, root[:, 0] * y, rcond=None)[0]
        scale = max(float(np.sqrt(np.mean(weight * off**2))), 1e-12)
        weight = (FREEDOM + 1.0) / (FREEDOM + (off / scale) ** 2)
    # what other causes leave of the torque and of efforts, behind the weights
    root = np.sqrt(weight)
    basis = np.linalg.qr(root[:, None] * x[:, 1:])[0]
    torque, rest = (root * z - basis @ (basis.T @ (root * z)) for z in (x[:, 0], y))
    size = float(torque @ torque)
    if size < LEAST_SHARE**2 * float(root**2 @ x[:, 0] ** 2):
        return None
    curvature, right = (np.bincount(place, torque * z) for z in (torque, rest))
    value = float(right.sum()) / size
    follows = abs(float(torque @ rest)) / np.sqrt(size * max(float(rest @ rest), 1e-300))
    told, sides = curvature[blocks], right[blocks]
    without = (right.sum() - sides) / np.maximum(size - told, 1e-9 * size)
    telling = size**2 / float(told @ told)
    wider = float(student.ppf(0.975, max(telling - 1.0, LEAST_FREEDOM))) / Z95
    apart = float(np.sqrt((len(blocks) - 1.0) * np.var(without))) / max(abs(value), 1e-300)
    std = float(np.hypot(wider * apart, LEAST_STD))
    return Factor(value, std, float(follows), unsigned)


def masses_differ(by: float) -> bool:
    """Whether torques so many times those of the law ask for links as no model file has them."""
    return abs(float(np.log(by))) > MOST_SPREADS * BY_NAME["mass_factor"].spread


def scales(found: Efforts, signals: TargetSignals) -> dict[int, tuple[float, float]]:
    """True torque over that of the law, and the standard deviation of its logarithm, by joint.

    Of the joints whose gains are known, and whose efforts count as these say.
    """
    return {
        j: (abs(gain * one.value), one.std)
        for j, one in found.factors.items()
        if (gain := signals.effort_gain[j]) is not None and agrees(gain, one)
    }


def agrees(gain: float, one: Factor) -> bool:
    """Whether efforts count as the gain says, as far as they have signs."""
    return gain * one.value > 0.0 or one.unsigned


def effort_gains(
    model: ActuatorModel, found: Efforts, by_masses: Mapping[int, float]
) -> tuple[EffortGain, ...]:
    """Torque of each joint per logged effort: as it is stated, or by the scale of the model.

    `by_masses` are the gains with which torques have the scale of the model file's masses.
    """
    return tuple(
        replace(
            _gain(model, j, found),
            follows=found.factors[j].follows if j in found.factors else None,
            by_masses=by_masses.get(j),
        )
        for j in range(len(model.signals.effort))
    )


def _gain(model: ActuatorModel, j: int, found: Efforts) -> EffortGain:
    stated, joint, one = model.signals.effort_gain[j], model.joints[j], found.factors.get(j)
    coordinate = model.robot.coordinates[j]
    unit = f"{coordinate.effort_unit}/{model.signals.effort_units[j]}"
    if one is None:
        other = found.others.get(j)
        why = "do not follow the torque of its controller"
        if other is not None:
            why = f"follow the torque of {model.joints[other]}, not of its own controller"
        return EffortGain(joint, unit, stated, None, "not shown", f"{why}: not used")
    variance = sum(
        float(model.covariance[k, k])
        for k, free in enumerate(model.free)
        if (free.name, free.joint) == ("stiffness", j)
    )
    half = Z95 * float(np.hypot(one.std, np.sqrt(variance)))
    if stated is None:
        low, high = sorted((np.exp(-half) / one.value, np.exp(half) / one.value))
        words = "have no sign: that of the torque was taken" if one.unsigned else ""
        interval = (float(low), float(high))
        return EffortGain(joint, unit, 1.0 / one.value, interval, "identified", words)
    ratio, why = abs(stated * one.value), ""
    if not agrees(stated, one):
        why = (
            "count against the joint, with the gain that is stated: not used; by the log it is "
            f"{1.0 / one.value:.3g} {unit}"
        )
    elif abs(np.log(ratio)) > max(np.log(OFF), half):  # 1 where they give torques their scale
        why = (
            f"are {ratio:.2g} times the torque of the law, with the gain and the stiffness that "
            "are stated: one of these is wrong, or the unit"
        )
    return EffortGain(joint, unit, stated, None, "contradicted" if why else "stated", why)
