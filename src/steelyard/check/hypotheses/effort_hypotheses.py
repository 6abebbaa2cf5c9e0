"""Hypotheses that read the efforts in another way: sign, unit, gains, kind, order.

Every order of joints and every set of position signs is tried with gains that are free per joint,
against the nominal bodies, and the likeliest few are proposed. So a wrong order is found although
the unit is wrong too.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.nuisance_fit_and_score import LEAST_SAMPLE_COUNT, EffortProducts
from steelyard.check.hypotheses.position_hypotheses import COARSE_SAMPLES, MOST_PERMUTED_JOINTS
from steelyard.check.hypotheses.readings_and_likelihood import (
    FITTED_NUMBER_COST,
    SAMPLE_BATCH,
    Hypothesis,
    Likelihood,
    Reading,
    choice_cost,
)

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
    every = tuple(range(n))
    yield from _effort_factors(reading, _effort_signs(reading.likelihood), "effort sign")
    amperes = "A" in units and np.max(np.abs(reading.effort_scale)) >= 1.0
    thousands = {  # nobody logs kiloamperes
        f"efforts are logged in a unit {says}": np.full(n, f)
        for says, f in THOUSAND.items()
        if f < 1.0 or not amperes
    }
    yield from _effort_factors(reading, thousands, "effort unit")
    for says, (kind, factors) in others.items():
        cost = choice_cost(4)
        yield from _effort_factors(reading, {says: factors}, "effort kind", cost, every, kind)
    best, seen = best_factors(reading), reading.sums.count[0] > 0.0
    for j, name in enumerate(names):
        own = {f"effort of '{name}' times {best[j]:.3g}": np.where(np.arange(n) == j, best, 1.0)}
        yield from _effort_factors(reading, own, "gain", choice_cost(n) + FITTED_NUMBER_COST, (j,))
    common = float(np.exp(np.median(np.log(best[seen])))) if seen.any() else 1.0
    units_off = min(abs(np.log(common / unit)) for unit in (*THOUSAND.values(), 1.0))
    if units_off > np.log(OTHER_GAIN_FACTOR):
        every_one = {f"all efforts times {common:.3g}": np.full(n, common)}
        yield from _effort_factors(reading, every_one, "gain", FITTED_NUMBER_COST, every)
    known, other_than_one = _identifiable(reading, best)
    factors = np.where(other_than_one, best, 1.0)
    blind = ", ".join(f"'{names[j]}'" for j in np.flatnonzero(~known))
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
    names = likelihood.names
    n, unknown = len(names), likelihood.signals.unknown_gains
    stated = [likelihood.knowledge.identified or not unknown or not unknown[j] for j in range(n)]
    found = {"all efforts have the opposite sign": np.where(stated, -1.0, 1.0)}
    for j in np.flatnonzero(stated if n > 1 else [False]):
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
    return np.where(reading.sums.count[0] > 0.0, best, 1.0)


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

    n = len(reading.effort)
    if n < 2:
        return
    score = reading.with_efforts(np.ones((n, n)), np.tile(np.arange(n)[:, None], (1, n)))
    costs = score.counts * np.log(np.square(score.misfits) + 1e-3)
    order = tuple(int(c) for c in linear_sum_assignment(costs.T)[1])
    changed = reading.changed(effort=order)
    if order == reading.effort or not changed.keeps_evidence:
        return
    moved = tuple(j for j in range(n) if order[j] != reading.effort[j])
    cost = 2.0 * choice_cost(n) if len(moved) == 2 else n * choice_cost(n)
    says = f"efforts in the order {', '.join(str(c + 1) for c in order)}"
    found = reading.with_efforts(np.ones((1, n)), np.array([order]))
    yield Hypothesis("joint order", says, changed, cost, moved, found.one(0))


FEW_COMBINATIONS = 8  # readings that are proposed
SMALL_FREE_MISFIT = 0.02  # misfit below which fits with free gains count as equally good
UNLOADED_SHARE = 0.05  # share of an effort that bodies must make for its sign to be judged


def best_combinations(likelihood: Likelihood) -> list[Hypothesis]:
    """Readings that differ in order and signs at once, by nominal bodies with free gains.

    Joints in every order, efforts with them or as declared, and efforts alone; then every set of
    signs of positions for the likeliest of these.
    """
    declared, n = likelihood.thinned(COARSE_SAMPLES).declared, likelihood.signals.n
    if not 2 <= n <= MOST_PERMUTED_JOINTS:
        return []
    own, *others = permutations(range(n))
    orders = [(own, effort) for effort in (own, *others)]
    orders += [(position, effort) for position in others for effort in (own, position)]
    best = _likeliest_with_gains([declared.changed(position=p, effort=e) for p, e in orders])
    signs = [np.array(one) for one in product((1.0, -1.0), repeat=n)]
    best = _likeliest_with_gains(
        [r.changed(position_scale=r.position_scale * one) for r in best for one in signs]
    )
    return [
        _combined_of(reading.on(likelihood))
        for reading in (*best, *filter(None, map(_all_turned, best)))
    ]


def _combined_of(reading: Reading) -> Hypothesis:
    declared, n = reading.likelihood.declared, len(reading.effort)
    turned = np.sign(declared.position_scale) != np.sign(reading.position_scale)
    efforts = int(np.sum(np.sign(declared.effort_scale) != np.sign(reading.effort_scale)))
    signs = int(np.sum(turned)) + (1 if efforts == n else efforts)
    moved = [j for j in range(n) if (reading.position[j], reading.effort[j]) != (j, j)]
    return Hypothesis("", "", reading, choice_cost(n) * (len(moved) + signs), tuple(moved))


def _all_turned(reading: Reading) -> Reading | None:
    """All efforts of the other sign where most of them are: that of an unloaded joint is open."""
    signs = np.sign(reading.effort_scale / reading.likelihood.declared.effort_scale)
    most = 0.5 * len(signs) < np.sum(signs < 0.0) < len(signs)
    return reading.with_factors(-signs) if most else None


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
    costs = 0.5 * counts * np.log(left + SMALL_FREE_MISFIT**2)
    return costs, theta[..., 4, :] / np.sqrt(ee)
