"""Hypotheses that read the efforts in another way: sign, unit, gains, kind, order.

Every order of joints and every set of position signs is tried with gains that are free per joint,
against the nominal bodies; the likeliest few are then compared with bodies of the log's own. So a
wrong order is found although the unit is wrong too.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.bodies import ConsistentBodies, consistent_bodies
from steelyard.check.hypotheses.excerpt import Interpretation
from steelyard.check.hypotheses.likelihood import (
    FITTED_NUMBER_COST,
    LEAST_SAMPLE_COUNT,
    EffortProducts,
    Hypothesis,
    Likelihood,
    choice_cost,
    keeps_evidence,
    one_of,
)
from steelyard.check.hypotheses.position_columns import (
    COARSE_SAMPLES,
    MOST_PERMUTED_JOINTS,
    SAMPLE_BATCH,
)

THOUSAND = {"1000 times larger": 1e3, "1000 times smaller": 1e-3}
OWN_GAIN_COST = 3.0 * FITTED_NUMBER_COST
"""What a gain of a joint's own costs: among many, some fit what friction and the model lack."""
PERCENT = "percent"
"""Efforts in percent of the joints' limits."""
LEAST_GAIN = 5e-4
"""Least factor by which a gain may be wrong."""
LARGEST_GAIN = 2000.0
GAIN_GRID = 151
FAR_GAIN = 3.0
"""Factor on a gain from which on it is named."""
OTHER_GAIN_FACTOR, WORSE_MISFIT_FACTOR = 1.4, 1.3
"""A gain is identifiable if gains off by the first factor have a misfit larger by the second."""


@dataclass(frozen=True, eq=False)
class OtherEffort:
    """What efforts may be instead of what is declared.

    Attributes:
        says: In a few words.
        kind: The kind of effort.
        factors: On the efforts as declared, shape `(n,)`.
    """

    says: str
    kind: str
    factors: Array


def effort_hypotheses(
    likelihood: Likelihood,
    interpretation: Interpretation,
    sums: EffortProducts,
    others: Sequence[OtherEffort],
) -> Iterator[Hypothesis]:
    """All of them, for the positions of an interpretation.

    Args:
        likelihood: The log.
        interpretation: What they start from.
        sums: Its products.
        others: What the efforts may be instead, such as currents of a reference's gains.
    """
    names = likelihood.knowledge.robot.joint_names
    n = len(names)
    effort = list(interpretation.effort)
    yield from _effort_factors(
        likelihood, interpretation, sums, _effort_signs(likelihood), "effort sign"
    )
    yield from unit_hypotheses(likelihood, interpretation, sums)
    for other in others:
        changed = interpretation.changed(kind=other.kind)
        found = {other.says: other.factors}
        yield from _effort_factors(
            likelihood, changed, sums, found, "effort kind", choice_cost(4), tuple(range(n))
        )
    best = best_factors(likelihood, sums, effort, interpretation.effort_scale)
    for j, name in enumerate(names):
        factors = np.ones(n)
        factors[j] = best[j]
        says = {f"effort of '{name}' times {best[j]:.3g}": factors}
        yield from _effort_factors(
            likelihood,
            interpretation,
            sums,
            says,
            "gain",
            choice_cost(n) + FITTED_NUMBER_COST,
            (j,),
        )
    seen = sums.count[0] > 0.0
    common = float(np.exp(np.median(np.log(best[seen])))) if seen.any() else 1.0
    units_off = min(abs(np.log(common / unit)) for unit in (*THOUSAND.values(), 1.0))
    if units_off > np.log(OTHER_GAIN_FACTOR):
        says = {f"all efforts times {common:.3g}": np.full(n, common)}
        yield from _effort_factors(
            likelihood, interpretation, sums, says, "gain", FITTED_NUMBER_COST, tuple(range(n))
        )
    identifiable = _identifiable(likelihood, sums, effort, interpretation.effort_scale, best)
    blind = ", ".join(
        f"'{name}'" for name, known in zip(names, identifiable[0], strict=True) if not known
    )
    factors = np.where(identifiable[1], best, 1.0)
    far = ", ".join(
        f"'{name}' times {factor:.3g}"
        for name, factor, known in zip(names, factors, identifiable[0], strict=True)
        if known and abs(np.log(factor)) > np.log(FAR_GAIN)
    )
    own = "every joint has its own gain" + (f": effort of {far}" if far else "")
    own += f"; those of {blind} are poorly identified" if blind else ""
    every = {own: factors}
    kind = "gain" if "A" in likelihood.signals.effort_units else "effort kind"
    changed = interpretation if kind == "gain" else interpretation.changed(kind="motor_current")
    yield from _effort_factors(
        likelihood, changed, sums, every, kind, n * OWN_GAIN_COST, tuple(range(n))
    )
    yield from _effort_orders(likelihood, interpretation, sums)


def unit_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation, sums: EffortProducts
) -> Iterator[Hypothesis]:
    """Efforts in a thousandth or a thousand times the declared unit; nobody logs kiloamperes."""
    n = likelihood.signals.n
    amperes = (
        "A" in likelihood.signals.effort_units
        and np.max(np.abs(interpretation.effort_scale)) >= 1.0
    )
    units = {
        f"efforts are logged in a unit {says}": np.full(n, f)
        for says, f in THOUSAND.items()
        if f < 1.0 or not amperes
    }
    yield from _effort_factors(likelihood, interpretation, sums, units, "effort unit")


def _effort_signs(likelihood: Likelihood) -> dict[str, Array]:
    """The opposite sign of all efforts, and of each; without a reference, of those with a gain."""
    names = likelihood.knowledge.robot.joint_names
    n, unknown = len(names), likelihood.signals.unknown_gains
    stated = [likelihood.knowledge.identified or not unknown or not unknown[j] for j in range(n)]
    found = {"all efforts have the opposite sign": np.where(stated, -1.0, 1.0)}
    for j in np.flatnonzero(stated if n > 1 else [False]):
        turned = np.where(np.arange(n) == j, -1.0, 1.0)
        found[f"effort of '{names[j]}' has the opposite sign"] = turned
    return found if any(stated) else {}


def _effort_factors(
    likelihood: Likelihood,
    interpretation: Interpretation,
    sums: EffortProducts,
    factors: Mapping[str, Array],
    cause: str,
    cost: float | None = None,
    joints: tuple[int, ...] | None = None,
) -> Iterator[Hypothesis]:
    """Interpretations that differ by factors on the efforts alone."""
    for says, f in factors.items():
        changed = interpretation.with_factors(f)
        score = likelihood.scored(sums, np.array([interpretation.effort]), changed.effort_scale)
        touched = tuple(int(j) for j in np.flatnonzero(f != 1.0)) if joints is None else joints
        price = choice_cost(len(factors)) if cost is None else cost
        yield Hypothesis(cause, says, changed, price, touched, one_of(score, 0))


def best_factors(
    likelihood: Likelihood, sums: EffortProducts, effort: list[int], scale: Array
) -> Array:
    """The factor on each joint's effort at which it agrees best, shape `(n,)`."""
    factors = np.geomspace(LEAST_GAIN, LARGEST_GAIN, GAIN_GRID)
    for _ in range(3):
        grid = factors.reshape(GAIN_GRID, -1) * np.ones(len(scale))
        many = EffortProducts(
            *(np.broadcast_to(x, (GAIN_GRID, *x.shape[1:])) for x in vars(sums).values())
        )
        score = likelihood.scored(many, np.tile(effort, (GAIN_GRID, 1)), grid * scale)
        best = grid[np.argmin(score.misfits, axis=0), np.arange(len(scale))]
        step = (grid[1] / grid[0]) ** 1.5
        factors = best * np.geomspace(1.0 / step, step, GAIN_GRID)
    return np.where(sums.count[0] > 0.0, best, 1.0)


def _identifiable(
    likelihood: Likelihood, sums: EffortProducts, effort: list[int], scale: Array, factors: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Joints whose effort identifies its gain, and those at which 1 at least is a worse one.

    Others agree as well with quite another gain.
    """
    around = np.stack(
        (factors / OTHER_GAIN_FACTOR, factors, factors * OTHER_GAIN_FACTOR, np.ones_like(factors))
    )
    many = EffortProducts(*(np.broadcast_to(x, (4, *x.shape[1:])) for x in vars(sums).values()))
    less, best, more, one = likelihood.scored(many, np.tile(effort, (4, 1)), around * scale).misfits
    bound = WORSE_MISFIT_FACTOR * best + 0.01
    inside = (factors > 2.0 * LEAST_GAIN) & (factors < 0.5 * LARGEST_GAIN)
    return (np.minimum(less, more) > bound) & inside, (one > bound) & inside


def poorly_identified(likelihood: Likelihood, interpretation: Interpretation) -> tuple[str, ...]:
    """Joints whose effort agrees about as well with quite another gain than the declared one."""
    sums, names = likelihood.sums([interpretation]), likelihood.knowledge.robot.joint_names
    ones = np.ones(len(names))
    shown = _identifiable(
        likelihood, sums, list(interpretation.effort), interpretation.effort_scale, ones
    )[0]
    seen = sums.count[0] > 0.0
    return tuple(n for n, well, moves in zip(names, shown, seen, strict=True) if moves and not well)


def _effort_orders(
    likelihood: Likelihood, interpretation: Interpretation, sums: EffortProducts
) -> Iterator[Hypothesis]:
    """The order of effort columns that agrees best, found as an assignment."""
    from scipy.optimize import linear_sum_assignment

    n = len(interpretation.effort)
    if n < 2:
        return
    columns = np.tile(np.arange(n)[:, None], (1, n))
    many = EffortProducts(*(np.broadcast_to(x, (n, *x.shape[1:])) for x in vars(sums).values()))
    score = likelihood.scored(many, columns, np.tile(interpretation.effort_scale, (n, 1)))
    costs = score.counts * np.log(np.square(score.misfits) + 1e-3)
    order = tuple(int(c) for c in linear_sum_assignment(costs.T)[1])
    if order == interpretation.effort or not keeps_evidence(
        likelihood, interpretation.changed(effort=order)
    ):
        return
    moved = tuple(j for j in range(n) if order[j] != interpretation.effort[j])
    cost = 2.0 * choice_cost(n) if len(moved) == 2 else n * choice_cost(n)
    changed = interpretation.changed(effort=order)
    says = f"efforts in the order {', '.join(str(c + 1) for c in order)}"
    found = likelihood.scored(sums, np.array([order]), interpretation.effort_scale)
    yield Hypothesis("joint order", says, changed, cost, moved, one_of(found, 0))


FEW_COMBINATIONS = 8
"""Interpretations that are compared with bodies of the log's own."""
SMALL_FREE_MISFIT = 0.02
"""Misfit below which fits with free gains count as equally good."""
UNLOADED_SHARE = 0.05
"""Share of an effort that bodies must make for its sign to be judged."""


def combined_hypotheses(likelihood: Likelihood) -> list[tuple[Hypothesis, ConsistentBodies]]:
    """Interpretations that differ in order and signs at once, the likeliest first.

    Every one comes with its bodies, which its misfits are those of.
    """
    n = likelihood.signals.n
    if not 2 <= n <= MOST_PERMUTED_JOINTS:
        return []
    coarse = replace(likelihood, excerpt=likelihood.excerpt.thinned(COARSE_SAMPLES))
    orders = [r for r in _combined_orders(likelihood.declared) if keeps_evidence(likelihood, r)]
    best = _best_combinations(coarse, orders)
    best = _best_combinations(coarse, [r for one in best for r in _combined_signs(one)])
    found = []
    for interpretation in (
        *best,
        *(turned for one in best for turned in _all_turned(likelihood, one)),
    ):
        bodies = consistent_bodies(likelihood, interpretation)
        if bodies is not None:
            found.append((_combined_rival(likelihood, interpretation, bodies), bodies))
    return sorted(found, key=lambda pair: -pair[0].log_likelihood)


def _combined_rival(
    likelihood: Likelihood, interpretation: Interpretation, bodies: ConsistentBodies
) -> Hypothesis:
    declared, n = likelihood.declared, likelihood.signals.n
    before, after = declared.effort_scale, interpretation.effort_scale
    turned = np.sign(declared.position_scale) != np.sign(interpretation.position_scale)
    efforts = int(np.sum(np.sign(before) != np.sign(after)))
    signs = int(np.sum(turned)) + (1 if efforts == n else efforts)
    moved = [
        j for j in range(n) if (interpretation.position[j], interpretation.effort[j]) != (j, j)
    ]
    cost = choice_cost(n) * (len(moved) + signs)
    return Hypothesis("", "", interpretation, cost, tuple(moved), bodies.score)


def _all_turned(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Interpretation]:
    """All efforts of the other sign where most of them are: that of an unloaded joint is open."""
    signs = np.sign(interpretation.effort_scale / likelihood.declared.effort_scale)
    if 0.5 * len(signs) < np.sum(signs < 0.0) < len(signs):
        yield interpretation.with_factors(-signs)


def _combined_orders(interpretation: Interpretation) -> Iterator[Interpretation]:
    """Joints in every order, efforts with them or as declared; and efforts alone."""
    n = len(interpretation.position)
    for order in permutations(range(n)):
        position = tuple(interpretation.position[k] for k in order)
        moved = interpretation.changed(position=position)
        yield moved
        if position != interpretation.position:
            effort = tuple(interpretation.effort[k] for k in order)
            yield moved.changed(effort=effort)
            yield interpretation.changed(effort=effort)


def _combined_signs(interpretation: Interpretation) -> Iterator[Interpretation]:
    for signs in product((1.0, -1.0), repeat=len(interpretation.position)):
        yield interpretation.changed(position_scale=np.array(signs) * interpretation.position_scale)


def _best_combinations(
    likelihood: Likelihood, interpretations: Sequence[Interpretation]
) -> list[Interpretation]:
    """The likeliest interpretations with gains of their own, efforts turned where that fits."""
    size = max(1, SAMPLE_BATCH // len(likelihood.excerpt.t))
    costs: list[float] = []
    turned: list[Interpretation] = []
    for start in range(0, len(interpretations), size):
        part = list(interpretations[start : start + size])
        misfits, signs, counts = _with_gains(likelihood, part)
        logs = 0.5 * counts * np.log(np.square(misfits) + SMALL_FREE_MISFIT**2)
        costs += logs.sum(axis=1).tolist()
        turned += [r.with_factors(s) for r, s in zip(part, signs, strict=True)]
    return [turned[k] for k in np.argsort(costs, kind="stable")[:FEW_COMBINATIONS]]


def _with_gains(
    likelihood: Likelihood, interpretations: Sequence[Interpretation]
) -> tuple[Array, Array, Array]:
    """Misfits with a gain per joint, its sign where the bodies show it, and counts, `(h, n)`."""
    sums = likelihood.sums(interpretations)
    h, j = np.ogrid[: len(interpretations), : likelihood.signals.n]
    effort = np.array([r.effort for r in interpretations])
    ee = np.maximum(sums.ee[h, j, effort], 1e-300)
    ye = sums.ye[h, j, :, effort]
    sizes = np.sqrt(np.maximum(np.diagonal(sums.yy, axis1=-2, axis2=-1), 1e-300))
    normal = sums.yy / sizes[..., None] / sizes[..., None, :] + 1e-9 * np.eye(5)
    right = ye / sizes
    theta = np.linalg.solve(normal, right[..., None])[..., 0]
    left = 1.0 - np.sum(right * theta, axis=-1) / ee
    scale = np.array([r.effort_scale for r in interpretations])
    share = theta[..., 4] / np.sqrt(ee) * np.sign(scale)
    signs = np.where(share < -UNLOADED_SHARE, -1.0, 1.0)
    counts = np.where(sums.count >= LEAST_SAMPLE_COUNT, sums.count, 0.0)
    return np.sqrt(np.maximum(left, 0.0)), signs, counts
