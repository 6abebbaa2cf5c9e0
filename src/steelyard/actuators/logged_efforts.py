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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from steelyard.actuators.actuator_model import ActuatorModel, EffortGain
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import FREEDOM, LEAST_FREEDOM, SETTLING, motions
from steelyard.actuators.rollout import STEP, Rolled, rollouts
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Z95, Array
from steelyard.robot.file.signals import TargetSignals

SIGHT = 1e-4  # over which a held target is averaged [s]
CREEP = 0.02  # speed above which dry friction has its sign [rad/s; m/s]
SURE = 0.2  # quantile of the torque's size, below which its sign is not sure
WIDEST = 0.35  # standard deviation of the logarithm, above which a factor is not known
ROUNDS = 15  # of the weights of Student's distribution


@dataclass(frozen=True)
class Factor:
    """Logged effort of a joint per torque of the law, and how well it is known.

    `value` is negative where efforts count against the joint; `std` is that of its logarithm.
    `unsigned` are efforts that are sizes only.
    """

    value: float
    std: float
    unsigned: bool


def factors(
    step: ArmStep,
    windows: Sequence[Window],
    values: ActuatorValues,
    signals: TargetSignals,
    threads: int,
) -> dict[int, Factor]:
    """Of the joints whose efforts follow the torque of the law."""
    if not signals.effort:
        return {}
    rolled = rollouts(step, values, windows, (), STEP, threads)
    rows = [_rows(*one, values) for one in zip(windows, rolled, strict=True)]
    torque, speed, acceleration, effort = (np.concatenate(x) for x in zip(*rows, strict=True))
    place = np.repeat(motions(windows), [len(row[0]) for row in rows])
    found = {}
    for j in range(values.n):
        columns = [torque[:, j], np.ones(len(torque)), speed[:, j]]
        if signals.effort_at_joint:
            v = speed[:, j]
            columns += [v / np.sqrt(v**2 + CREEP**2), acceleration[:, j]]
        one = _factor(np.stack(columns, axis=1), effort[:, j], place)
        if one is not None:
            found[j] = one
    return found


def _rows(
    window: Window, rolled: Rolled, values: ActuatorValues
) -> tuple[Array, Array, Array, Array]:
    """Torques of the law, speeds and accelerations of the joints, and logged efforts, `(N, n)`."""
    counts = window.t - window.t[0] >= SETTLING
    a = np.gradient(rolled.v, window.t, axis=0)[counts]
    t, q, v = window.t[counts], rolled.q[counts], rolled.v[counts]
    u, _ = window.run.mean_target(t - SIGHT, SIGHT, values["delay"])
    off = u + values["offset"] - q
    off = off - np.clip(off, -values["dead_band"], values["dead_band"])
    limit = values["torque_limit"]
    fed = window.run.supplied(t)[:, None]
    wanted = fed * values["stiffness"] * off - values["damping"] * v
    torque = np.clip(wanted, -fed * limit, fed * limit)
    s = values.signs
    effort = window.run.effort[window.start : window.stop][counts]
    return s * (torque - values["back_emf"] * v), s * v, s * a, effort


def _factor(columns: Array, effort: Array, place: NDArray[np.int_]) -> Factor | None:
    """The first coefficient of efforts by these columns; `None` if they do not tell it."""
    torque = columns[:, 0]
    given = np.isfinite(effort)
    if given.sum() < 10 * columns.shape[1] or np.ptp(effort[given]) == 0.0:
        return None
    unsigned = bool(effort[given].min() >= 0.0 and (torque < 0.0).mean() > 0.5 * SURE)
    if unsigned:  # sizes have the sign of the torque where that is sure
        given &= np.abs(torque) > np.quantile(np.abs(torque), SURE)
        effort = effort * np.sign(torque)
    x, y, place = columns[given], effort[given], place[given]
    weight = np.ones(len(y))
    for _ in range(ROUNDS):
        heavy = x * weight[:, None]
        off = y - x @ np.linalg.lstsq(heavy.T @ x, heavy.T @ y, rcond=None)[0]
        scale = max(float(np.sqrt(np.mean(weight * off**2))), 1e-12)
        weight = (FREEDOM + 1.0) / (FREEDOM + (off / scale) ** 2)
    blocks = np.unique(place)
    if len(blocks) < 2:
        return None
    heavy = x * weight[:, None]
    curvature = np.stack([heavy[place == b].T @ x[place == b] for b in blocks])
    right = np.stack([heavy[place == b].T @ y[place == b] for b in blocks])
    whole, sides = curvature.sum(axis=0), right.sum(axis=0)
    value = float(np.linalg.lstsq(whole, sides, rcond=None)[0][0])
    without = [
        np.linalg.lstsq(whole - a, sides - b, rcond=None)[0][0]
        for a, b in zip(curvature, right, strict=True)
    ]
    told = curvature[:, 0, 0]
    telling = float(told.sum() ** 2 / (told**2).sum())
    wider = float(student.ppf(0.975, max(telling - 1.0, LEAST_FREEDOM))) / Z95
    std = wider * float(np.sqrt((len(blocks) - 1.0) * np.var(without))) / max(abs(value), 1e-300)
    return Factor(value, std, unsigned) if std < WIDEST else None


def scales(found: Mapping[int, Factor], signals: TargetSignals) -> dict[int, tuple[float, float]]:
    """True torque over that of the law, and the standard deviation of its logarithm, by joint.

    Of the joints whose gains are known, and whose efforts count as these say.
    """
    known = {j: signals.effort_gain[j] for j in found}
    return {
        j: (abs(gain * found[j].value), found[j].std)
        for j, gain in known.items()
        if gain is not None and (gain * found[j].value > 0.0 or found[j].unsigned)
    }


def effort_gains(model: ActuatorModel, found: Mapping[int, Factor]) -> tuple[EffortGain, ...]:
    """Torque of each joint per logged effort: as it is stated, or by the scale of the model."""
    variance = {
        one.joint: float(model.covariance[k, k])
        for k, one in enumerate(model.free)
        if one.name == "stiffness"
    }
    joints = range(len(model.signals.effort))
    return tuple(_gain(model, j, found.get(j), variance.get(j, 0.0)) for j in joints)


def _gain(model: ActuatorModel, j: int, one: Factor | None, variance: float) -> EffortGain:
    """Of joint `j`, whose stiffness has this variance of its logarithm."""
    stated, joint = model.signals.effort_gain[j], model.robot.coordinates[j]
    unit = f"{joint.effort_unit}/{model.signals.effort_units[j]}"
    if one is None:
        return EffortGain(joint.name, unit, stated, None, "not shown")
    if stated is not None:
        against = stated * one.value < 0.0 and not one.unsigned
        return EffortGain(joint.name, unit, stated, None, "contradicted" if against else "stated")
    value, half = 1.0 / one.value, Z95 * float(np.hypot(one.std, np.sqrt(variance)))
    low, high = sorted((value * float(np.exp(-half)), value * float(np.exp(half))))
    return EffortGain(joint.name, unit, value, (low, high), "identified")


def notes_of_efforts(gains: Sequence[EffortGain]) -> tuple[str, ...]:
    """Joints whose efforts are not used."""
    words = {
        "contradicted": "count against the joint, with the gain that is stated: not used. Compare "
        "its sign with the log",
        "not shown": "do not follow the torque of the controller: not used",
    }
    return tuple(f"logged efforts of {one.joint} {words[one.status]}" for one in gains
                 if one.status in words)  # fmt: skip
