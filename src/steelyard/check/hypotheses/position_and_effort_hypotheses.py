r"""Hypotheses that read positions or efforts otherwise: sign, order, unit, zero, ratio, gain, kind.

The reference predicts the efforts at $q_j + \delta$, with friction as every hypothesis may have it;
the likeliest $\delta$ is sought.

Every order of joints and every set of position signs is tried with gains that are free per joint,
against the nominal bodies, and the likeliest few are proposed. So a wrong order is found although
the unit is wrong too.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, permutations, product
from math import pi

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    SAMPLE_BATCH,
    ZOOMED_POINTS,
    Hypothesis,
    choice_cost,
    likeliest,
    scored,
)
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    LEAST_SAMPLE_COUNT,
    MISFIT_FLOOR,
    EffortProducts,
)
from steelyard.check.hypotheses.readings_and_likelihood import Likelihood, Reading
from steelyard.estimate.nonlinear.nonlinear_parameters import LOOSEST
from steelyard.robot.robot import Robot

OTHER_POSITION_UNITS = {"revolute": {"degrees": pi / 180.0}, "prismatic": {"millimetres": 1e-3}}
OTHER_TIME_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
MOST_PERMUTED_JOINTS = 7  # most joints of which all orders and all signs are tried
COARSE_SAMPLES = 200  # samples for a first look
REFINED_HYPOTHESES = 12  # how many of the best of them are looked at again


def position_changes(reading: Reading) -> Iterator[Hypothesis]:
    """One change each, not scored: a sign, two joints exchanged, a unit of positions or of time."""
    names, joints = reading.likelihood.names, reading.likelihood.joints
    n = len(joints)
    for j in joints:
        yield _turned(reading, (j,), f"'{names[j]}' has the opposite sign", choice_cost(n))
    if n > 1:
        says = "all positions have the opposite sign"
        # efforts of the other sign, which may fit as well, are likelier
        yield _turned(reading, tuple(joints), says, choice_cost(n) + 2.0 * CLOSE_HYPOTHESES)
    for a, b in combinations(joints, 2):
        order = list(range(len(names)))
        order[a], order[b] = b, a
        pair = f"'{names[a]}' and '{names[b]}'"
        for both, whose in ((False, f"positions of {pair}"), (True, pair)):
            yield _ordered(reading, order, both, f"{whose} exchanged", 2.0 * choice_cost(n))
    yield from _units(reading)


def deep_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """The best of all signs and of all orders."""
    n = len(reading.position)
    if reading.base is not None or not 2 < n <= MOST_PERMUTED_JOINTS:
        return
    coarse = reading.on(reading.likelihood.thinned(COARSE_SAMPLES))
    signs, orders = [], []
    for joints in chain.from_iterable(combinations(range(n), k) for k in range(2, n)):
        says = f"joints {', '.join(str(j + 1) for j in joints)} have the opposite sign"
        cost = choice_cost(n) * min(len(joints), n - len(joints))
        signs.append(_turned(coarse, joints, says, cost))
    for order in permutations(range(n)):
        if sum(j != k for j, k in enumerate(order)) > 2:
            numbers = ", ".join(str(coarse.position[k] + 1) for k in order)
            for both, whose in ((False, "positions"), (True, "joints")):
                says = f"{whose} in the order {numbers}"
                orders.append(_ordered(coarse, order, both, says, n * choice_cost(n)))
    for family in (signs, orders):
        best = sorted(scored(family), key=lambda r: -r.log_likelihood)[:REFINED_HYPOTHESES]
        yield from scored([replace(h, reading=h.reading.on(reading.likelihood)) for h in best])


def _turned(reading: Reading, joints: tuple[int, ...], says: str, cost: float) -> Hypothesis:
    signs = np.where(np.isin(np.arange(len(reading.position)), joints), -1.0, 1.0)
    turned = reading.changed(position_scale=signs * reading.position_scale)
    return Hypothesis("position sign", says, turned, cost, joints)


def _ordered(
    reading: Reading, order: Sequence[int], both: bool, says: str, cost: float
) -> Hypothesis:
    position, effort = (tuple(x[k] for k in order) for x in (reading.position, reading.effort))
    changed = reading.changed(position=position, effort=effort if both else reading.effort)
    moved = tuple(j for j, k in enumerate(order) if j != k)
    return Hypothesis("joint order", says, changed, cost, moved)


def _units(reading: Reading) -> Iterator[Hypothesis]:
    """Positions in other units, all or those of one joint; time in another unit."""
    coordinates = reading.knowledge.robot.coordinates
    n = len(coordinates)
    for kind, units in OTHER_POSITION_UNITS.items():
        mine = [j for j in reading.likelihood.joints if coordinates[j].kind == kind]
        sets = [tuple(mine), *((j,) for j in mine)] if len(mine) > 1 else [tuple(mine)]
        for joints, (unit, scale) in product(filter(None, sets), units.items()):
            who = "positions" if len(joints) > 1 else f"'{coordinates[joints[0]].name}'"
            for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
                factors = np.where(np.isin(np.arange(n), joints), factor, 1.0)
                changed = reading.changed(position_scale=factors * reading.position_scale)
                text = f"{who} {says} {unit}"
                yield Hypothesis("position unit", text, changed, choice_cost(2 * n), joints)
    for unit, scale in OTHER_TIME_UNITS.items():
        for factor, says in ((scale, "in"), (1.0 / scale, "not in")):
            changed = reading.changed(time=factor * reading.time)
            yield Hypothesis("clock", f"time {says} {unit}", changed, choice_cost(6), ())


ZERO_CAUSE = "joint zeros"  # the check that an explanation by a zero belongs to
ZERO_GRID = np.array(
    [-3.5, -2.8, -2.2, -1.6, -1.2, -0.8, -0.4, -0.2, -0.1, 0.0]
    + [0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.2, 2.8, 3.5]
)
"""Offsets that are tried first [rad; m]."""
NEAR_ZERO = 0.4  # how far from a reading's own zero the likeliest is looked for [rad; m]


@dataclass(frozen=True)
class JointZero:
    """The zero offset of a joint: its position is the logged one plus it."""

    joint: int  # index of the joint
    name: str  # the joint's name
    unit: str  # `rad` or `m`
    value: float  # the likeliest offset; 0 where it is not identifiable
    std: float  # its standard deviation; infinite where it is not identifiable

    @property
    def identifiable(self) -> bool:
        """Whether the log identifies it."""
        return bool(np.isfinite(self.std))

    @property
    def words(self) -> str:
        """Like `elbow -0.0931 ± 0.0102 rad`."""
        return f"{self.name} {self.value:.3f} ± {Z95 * self.std:.3f} {self.unit}"


def zero_hypotheses(reading: Reading) -> list[Hypothesis]:
    """The best zero of each joint whose zero the log identifies; the likeliest names its like."""
    zeros = [zero for zero in zero_offsets(reading) if zero.identifiable]
    cost = FITTED_NUMBER_COST + choice_cost(len(reading.position))
    found = scored(
        [
            Hypothesis(
                ZERO_CAUSE,
                f"zero offset of {zero.words}",
                reading.with_zero(zero.joint, zero.value),
                cost,
                (zero.joint,),
                spread=zero.std,
            )
            for zero in zeros
        ]
    )
    if not found:
        return []
    best = max(range(len(found)), key=lambda k: found[k].log_likelihood)
    least = found[best].log_likelihood - CLOSE_HYPOTHESES
    alike = [zeros[k].words for k, h in enumerate(found) if k != best and h.log_likelihood > least]
    if alike:
        says = f"{found[best].says} (or of {', '.join(alike)})"
        found[best] = replace(found[best], says=says)
    return found


def zero_offsets(reading: Reading) -> tuple[JointZero, ...]:
    """Offsets of all joints, each by itself; of an open chain with declared zeros, else none."""
    robot, log = reading.knowledge.robot, reading.likelihood
    if robot.passive or any(log.signals.unknown_offsets):
        return ()
    coarse = reading.on(log.thinned(COARSE_SAMPLES))
    found = []
    for joint, coordinate in enumerate(robot.coordinates):
        values = _zero_likelihoods(coarse, joint, ZERO_GRID)
        k = int(np.clip(np.argmax(values), 1, len(ZERO_GRID) - 2))
        grid = np.linspace(ZERO_GRID[k - 1], ZERO_GRID[k + 1], ZOOMED_POINTS)
        value, std = likeliest(partial(_zero_likelihoods, reading, joint), grid)
        if std > LOOSEST[coordinate.unit]:
            value, std = 0.0, np.inf
        found.append(JointZero(joint, coordinate.name, coordinate.unit, value, std))
    return tuple(found)


def zero_near(reading: Reading, joint: int) -> tuple[float, float]:
    """The likeliest zero near a reading's own [rad; m], and its standard deviation, or infinity."""
    grid = np.linspace(-NEAR_ZERO, NEAR_ZERO, ZOOMED_POINTS)
    return likeliest(partial(_zero_likelihoods, reading, joint), grid)


def _zero_likelihoods(reading: Reading, joint: int, offsets: Array) -> Array:
    moved = [
        Hypothesis(ZERO_CAUSE, "", reading.with_zero(joint, x), 0.0, (joint,)) for x in offsets
    ]
    return np.array([found.log_likelihood for found in scored(moved)])


UPRIGHT_AXIS = 0.05
"""Part of gravity across a first axis up to which it is taken to be along it [m/s²]."""


def zeros_without_effect(robot: Robot) -> tuple[bool, ...]:
    """Joints whose zeros no motion identifies, for parameters express them, or none has an effect.

    A first joint that turns about the direction of gravity or slides, and joints of last bodies.
    """
    parents = {body.parent for body in robot.bodies}
    found = [False] * robot.n
    for k, body in enumerate(robot.bodies):
        along = np.linalg.norm(np.cross(body.rotation @ body.axis, robot.gravity))
        first = body.parent < 0 and (body.kind == "prismatic" or along <= UPRIGHT_AXIS)
        if body.coordinate < robot.n and (first or k not in parents):
            found[body.coordinate] = True
    return tuple(found)


LARGEST_RATIO_FACTOR = 4.0  # largest factor by which a ratio is looked for to be off, either way
RATIO_GRID = 25


def ratio_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """One motor's ratio off, the factor that agrees best for each of them."""
    log = reading.likelihood
    if log.signals.position_map is None:
        return
    cost = choice_cost(log.signals.n) + FITTED_NUMBER_COST
    far = np.log(LARGEST_RATIO_FACTOR)
    grid = np.linspace(-far, far, RATIO_GRID)
    for joint in log.joints:
        best, _ = likeliest(partial(_ratio_likelihoods, reading, joint), grid)
        winner = _with_ratio(reading, joint, best)
        says = f"gear ratio of '{log.names[joint]}' times {np.exp(best):.4g}"
        yield Hypothesis("gain", says, winner, cost, (joint,), winner.score)


def _with_ratio(reading: Reading, joint: int, log_factor: float) -> Reading:
    factors = np.where(np.arange(len(reading.ratios)) == joint, np.exp(log_factor), 1.0)
    return reading.changed(ratios=reading.ratios * factors)


def _ratio_likelihoods(reading: Reading, joint: int, log_factors: Array) -> Array:
    return np.array([_with_ratio(reading, joint, x).log_likelihood for x in log_factors])


THOUSAND = {"1000 times larger": 1e3, "1000 times smaller": 1e-3}
OWN_GAIN_COST = 3.0 * FITTED_NUMBER_COST
"""What a gain of a joint's own costs: among many, some fit what friction and the model lack."""
PERCENT = "percent"  # efforts in percent of the joints' limits
LEAST_GAIN = 5e-4  # least factor by which a gain may be wrong
LARGEST_GAIN = 2000.0
GAIN_GRID = 151
FACTOR_REACH = 10.0  # how far from the best factor others are tried, either way
FAR_GAIN = 3.0  # factor on a gain from which on it is named
OTHER_GAIN_FACTOR, WORSE_MISFIT_FACTOR = 1.4, 1.3
"""A gain is identifiable if gains off by the first factor have a misfit larger by the second."""
MODEL_FILE_FACTOR = 2.5
"""Factor by which effort of links may differ from that of a model file's, and with it a factor on
measured efforts that is estimated by these."""


OtherEfforts = Mapping[str, tuple[str, Array]]
"""What efforts may be instead, in words: the kind, and factors `(n,)` on them as declared."""


def effort_hypotheses(reading: Reading, others: OtherEfforts) -> Iterator[Hypothesis]:
    """All of them, for the positions of a reading."""
    names, units = reading.likelihood.names, reading.likelihood.signals.effort_units
    n = len(names)
    joints = reading.likelihood.joints
    every = tuple(joints)
    yield from _effort_factors(reading, _effort_signs(reading.likelihood), "effort sign")
    amperes = "A" in units and np.max(np.abs(reading.effort_scale)) >= 1.0
    thousands = {  # nobody logs kiloamperes
        f"efforts are logged in a unit {says}": reading.likelihood.among_joints(np.full(n, f))
        for says, f in THOUSAND.items()
        if f < 1.0 or not amperes
    }
    yield from _effort_factors(reading, thousands, "effort unit")
    for says, (kind, factors) in others.items():
        cost = choice_cost(4)
        yield from _effort_factors(reading, {says: factors}, "effort kind", cost, every, kind)
    best, seen = best_factors(reading), reading.sums.count[0] > 0.0
    for j in joints:
        says = f"effort of '{names[j]}' times {best[j]:.3g}"
        own = {says: np.where(np.arange(n) == j, best, 1.0)}
        yield from _effort_factors(reading, own, "gain", choice_cost(n) + FITTED_NUMBER_COST, (j,))
    seen[: every[0]] = False
    common = float(np.exp(np.median(np.log(best[seen])))) if seen.any() else 1.0
    units_off = min(abs(np.log(common / unit)) for unit in (*THOUSAND.values(), 1.0))
    if units_off > np.log(OTHER_GAIN_FACTOR):
        of_all = reading.likelihood.among_joints(np.full(n, common))
        every_one = {f"all efforts times {common:.3g}": of_all}
        yield from _effort_factors(reading, every_one, "gain", FITTED_NUMBER_COST, every)
    known, other_than_one = _identifiable(reading, best)
    factors = np.where(other_than_one, best, 1.0)
    blind = ", ".join(f"'{names[j]}'" for j in joints if not known[j])
    far = ", ".join(
        f"'{names[j]}' times {factors[j]:.3g}"
        for j in np.flatnonzero(known & (np.abs(np.log(factors)) > np.log(FAR_GAIN)))
    )
    says = "every joint has its own gain" + (f": effort of {far}" if far else "")
    says += f"; those of {blind} are poorly identified" if blind else ""
    cause, kind = ("gain", "") if "A" in units else ("effort kind", "motor_current")
    yield from _effort_factors(reading, {says: factors}, cause, n * OWN_GAIN_COST, every, kind)
    yield from _effort_orders(reading)


def _effort_signs(likelihood: Likelihood) -> dict[str, Array]:
    """The opposite sign of all efforts, and of each; without a reference, of those with a gain."""
    names, joints = likelihood.names, likelihood.joints
    n, unknown, known = (
        len(names),
        likelihood.signals.unknown_gains,
        likelihood.knowledge.identified,
    )
    stated = [j in joints and (known or not unknown or not unknown[j]) for j in range(n)]
    found = {"all efforts have the opposite sign": np.where(stated, -1.0, 1.0)}
    for j in np.flatnonzero(stated if len(joints) > 1 else [False]):
        turned = np.where(np.arange(n) == j, -1.0, 1.0)
        found[f"effort of '{names[j]}' has the opposite sign"] = turned
    return found if any(stated) else {}


def _effort_factors(
    reading: Reading,
    factors: Mapping[str, Array],
    cause: str,
    cost: float | None = None,
    joints: tuple[int, ...] | None = None,
    kind: str = "",
) -> Iterator[Hypothesis]:
    for says, f in factors.items():
        changed = reading.with_factors(f).changed(kind=kind or reading.kind)
        touched = tuple(int(j) for j in np.flatnonzero(f != 1.0)) if joints is None else joints
        price = choice_cost(len(factors)) if cost is None else cost
        score = reading.with_efforts(f[None]).one(0)
        yield Hypothesis(cause, says, changed, price, touched, score)


def best_factors(reading: Reading) -> Array:
    """The factor on each joint's effort at which it agrees best, shape `(n,)`."""
    n = len(reading.effort)
    factors = np.geomspace(LEAST_GAIN, LARGEST_GAIN, GAIN_GRID)
    for _ in range(3):
        grid = factors.reshape(GAIN_GRID, -1) * np.ones(n)
        best = grid[np.argmin(reading.with_efforts(grid).misfits, axis=0), np.arange(n)]
        step = (grid[1] / grid[0]) ** 1.5
        factors = best * np.geomspace(1.0 / step, step, GAIN_GRID)
    found: Array = np.where(reading.sums.count[0] > 0.0, best, 1.0)
    return reading.likelihood.among_joints(found)


def _identifiable(reading: Reading, factors: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Joints whose effort identifies its gain, and those at which 1 at least is a worse one.

    Others agree as well with quite another gain.
    """
    around = np.stack(
        (factors / OTHER_GAIN_FACTOR, factors, factors * OTHER_GAIN_FACTOR, np.ones_like(factors))
    )
    less, best, more, one = reading.with_efforts(around).misfits
    bound = WORSE_MISFIT_FACTOR * best + 0.01
    inside = (factors > 2.0 * LEAST_GAIN) & (factors < 0.5 * LARGEST_GAIN)
    return (np.minimum(less, more) > bound) & inside, (one > bound) & inside


def factor_intervals(reading: Reading) -> tuple[Array, Array, Array]:
    """The best, the least and the largest factor on each joint's effort, shape `(n,)` each.

    Zero and infinity where friction explains efforts that are as small, or as large. With a model
    file's masses, which may be wrong by `MODEL_FILE_FACTOR`, they are as much wider.
    """
    best, steps = best_factors(reading), np.geomspace(1.0 / FACTOR_REACH, FACTOR_REACH, GAIN_GRID)
    misfits = reading.with_efforts(steps[:, None] * best).misfits
    near = misfits <= WORSE_MISFIT_FACTOR * misfits.min(axis=0) + 0.01
    near[:, reading.sums.count[0] <= 0.0] = True
    near[:, : reading.likelihood.joints.start] = True
    wide = 1.0 if reading.knowledge.identified else MODEL_FILE_FACTOR
    low, high = steps[near.argmax(axis=0)] / wide, steps[::-1][near[::-1].argmax(axis=0)] * wide
    return best, np.where(near[0], 0.0, best * low), np.where(near[-1], np.inf, best * high)


def holds_factors(reading: Reading, factors: Array) -> bool:
    """Whether factors `(n,)` on the efforts are those that a log shows, of one joint at least."""
    _, low, high = factor_intervals(reading)
    within = (low <= factors) & (factors <= high)
    return bool(within.all() and np.any((low > 0.0) & np.isfinite(high)))


def _effort_orders(reading: Reading) -> Iterator[Hypothesis]:
    """The order of effort columns that agrees best, found as an assignment."""
    from scipy.optimize import linear_sum_assignment

    n, joints = len(reading.effort), reading.likelihood.joints
    if len(joints) < 2:
        return
    score = reading.with_efforts(np.ones((n, n)), np.tile(np.arange(n)[:, None], (1, n)))
    costs = (score.counts * np.log(np.square(score.misfits) + 1e-3))[joints.start :, joints.start :]
    order = tuple(joints.start + int(c) for c in linear_sum_assignment(costs.T)[1])
    order = (*range(joints.start), *order)
    changed = reading.changed(effort=order)
    if order == reading.effort or not changed.keeps_evidence:
        return
    moved = tuple(j for j in range(n) if order[j] != reading.effort[j])
    cost = 2.0 * choice_cost(n) if len(moved) == 2 else n * choice_cost(n)
    says = f"efforts in the order {', '.join(str(c + 1) for c in order)}"
    found = reading.with_efforts(np.ones((1, n)), np.array([order]))
    yield Hypothesis("joint order", says, changed, cost, moved, found.one(0))


FEW_COMBINATIONS = 8  # readings that are proposed
UNLOADED_SHARE = 0.05  # share of an effort that bodies must make for its sign to be judged


def best_combinations(likelihood: Likelihood) -> list[Hypothesis]:
    """Readings that differ in order and signs at once, by nominal bodies with free gains.

    Joints in every order, efforts with them or as declared, and efforts alone; then every set of
    signs of positions for the likeliest of these.
    """
    declared, n = likelihood.thinned(COARSE_SAMPLES).declared, likelihood.signals.n
    if declared.base is not None or not 2 <= n <= MOST_PERMUTED_JOINTS:
        return []
    own, *others = permutations(range(n))
    orders = [(own, effort) for effort in (own, *others)]
    orders += [(position, effort) for position in others for effort in (own, position)]
    best = _likeliest_with_gains([declared.changed(position=p, effort=e) for p, e in orders])
    signs = [np.array(one) for one in product((1.0, -1.0), repeat=n)]
    best = _likeliest_with_gains(
        [r.changed(position_scale=r.position_scale * one) for r in best for one in signs]
    )
    return [_combined_of(reading.on(likelihood)) for reading in best]


def _combined_of(reading: Reading) -> Hypothesis:
    declared, n = reading.likelihood.declared, len(reading.effort)
    turned = np.sign(declared.position_scale) != np.sign(reading.position_scale)
    efforts = int(np.sum(np.sign(declared.effort_scale) != np.sign(reading.effort_scale)))
    signs = int(np.sum(turned)) + (1 if efforts == n else efforts)
    moved = [j for j in range(n) if (reading.position[j], reading.effort[j]) != (j, j)]
    return Hypothesis("", "", reading, choice_cost(n) * (len(moved) + signs), tuple(moved))


def _likeliest_with_gains(readings: Sequence[Reading]) -> list[Reading]:
    """The likeliest of readings with gains of their own, efforts turned where that fits."""
    likelihood = readings[0].likelihood
    size = max(1, SAMPLE_BATCH // len(likelihood.excerpt.t))
    motions = {r.of_motion: r for r in readings}
    each, places = list(motions.values()), {motion: k for k, motion in enumerate(motions)}
    parts = [_with_gains(likelihood.sums(each[k : k + size])) for k in range(0, len(each), size)]
    costs, shares = (np.concatenate(x) for x in zip(*parts, strict=True))
    motion = np.array([places[r.of_motion] for r in readings])[:, None]
    at = motion, np.arange(likelihood.signals.n), np.array([r.effort for r in readings])
    best: list[Reading] = []
    for k in np.argsort(costs[at].sum(axis=1), kind="stable"):
        if readings[k].keeps_evidence:
            scale = readings[k].effort_scale
            share = shares[at][k] * np.sign(scale)
            turned = np.where(share < -UNLOADED_SHARE, -1.0, 1.0)
            best.append(readings[k].changed(effort_scale=scale * turned))
        if len(best) == FEW_COMBINATIONS:
            break
    return best


def _with_gains(sums: EffortProducts) -> tuple[Array, Array]:
    """Costs of every joint's misfit to every effort column with a gain per joint, `(h, n, n)`.

    And the share of the effort that the bodies make, negative where they show another sign.
    """
    sizes = np.sqrt(np.maximum(np.diagonal(sums.yy, axis1=-2, axis2=-1), 1e-300))
    normal = sums.yy / sizes[..., None] / sizes[..., None, :] + 1e-9 * np.eye(5)
    right, ee = sums.ye / sizes[..., None], np.maximum(sums.ee, 1e-300)
    theta = np.linalg.solve(normal, right)
    left = np.maximum(1.0 - np.sum(right * theta, axis=-2) / ee, 0.0)
    counts = np.where(sums.count >= LEAST_SAMPLE_COUNT, sums.count, 0.0)[..., None]
    costs = 0.5 * counts * np.log(left + MISFIT_FLOOR**2)
    return costs, theta[..., 4, :] / np.sqrt(ee)
