"""Explanations that read the efforts in another way: sign, unit, gains, kind, order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis, choice, one_of
from steelyard.diagnosis.likelihood.evidence_kept import keeps_evidence
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood, Sums

THOUSAND = {"1000 times larger": 1e3, "1000 times smaller": 1e-3}
OWN = 3.0 * FREE
"""What a gain of a joint's own costs: among many, some fit what friction and the model lack."""
PERCENT = "percent"
"""Efforts in percent of the joints' limits."""
LEAST_GAIN = 5e-4
"""Least factor by which a gain may be wrong."""
LARGEST_GAIN = 2000.0
GRID = 151
FAR = 3.0
"""Factor on a gain from which on it is named."""
OTHER, WORSE = 1.4, 1.3
"""A gain is identifiable if gains off by the first factor have a misfit larger by the second."""


@dataclass(frozen=True, eq=False)
class Other:
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
    likelihood: Likelihood, interpretation: Interpretation, sums: Sums, others: Sequence[Other]
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
    yield from _factors(likelihood, interpretation, sums, _signs(likelihood), "effort sign")
    yield from unit_hypotheses(likelihood, interpretation, sums)
    for other in others:
        changed = interpretation.changed(kind=other.kind)
        found = {other.says: other.factors}
        yield from _factors(
            likelihood, changed, sums, found, "effort kind", choice(4), tuple(range(n))
        )
    best = best_factors(likelihood, sums, effort, interpretation.effort_scale)
    for j, name in enumerate(names):
        factors = np.ones(n)
        factors[j] = best[j]
        says = {f"effort of '{name}' times {best[j]:.3g}": factors}
        yield from _factors(likelihood, interpretation, sums, says, "gain", choice(n) + FREE, (j,))
    seen = sums.count[0] > 0.0
    common = float(np.exp(np.median(np.log(best[seen])))) if seen.any() else 1.0
    units_off = min(abs(np.log(common / unit)) for unit in (*THOUSAND.values(), 1.0))
    if units_off > np.log(OTHER):
        says = {f"all efforts times {common:.3g}": np.full(n, common)}
        yield from _factors(likelihood, interpretation, sums, says, "gain", FREE, tuple(range(n)))
    identifiable = _identifiable(likelihood, sums, effort, interpretation.effort_scale, best)
    blind = ", ".join(
        f"'{name}'" for name, known in zip(names, identifiable[0], strict=True) if not known
    )
    factors = np.where(identifiable[1], best, 1.0)
    far = ", ".join(
        f"'{name}' times {factor:.3g}"
        for name, factor, known in zip(names, factors, identifiable[0], strict=True)
        if known and abs(np.log(factor)) > np.log(FAR)
    )
    own = "every joint has its own gain" + (f": effort of {far}" if far else "")
    own += f"; those of {blind} are poorly identified" if blind else ""
    every = {own: factors}
    kind = "gain" if "A" in likelihood.signals.effort_units else "effort kind"
    changed = interpretation if kind == "gain" else interpretation.changed(kind="motor_current")
    yield from _factors(likelihood, changed, sums, every, kind, n * OWN, tuple(range(n)))
    yield from _orders(likelihood, interpretation, sums)


def unit_hypotheses(
    likelihood: Likelihood, interpretation: Interpretation, sums: Sums
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
    yield from _factors(likelihood, interpretation, sums, units, "effort unit")


def _signs(likelihood: Likelihood) -> dict[str, Array]:
    """The opposite sign of all efforts, and of each; without a reference, of those with a gain."""
    names = likelihood.knowledge.robot.joint_names
    n, unknown = len(names), likelihood.signals.unknown_gains
    stated = [likelihood.knowledge.identified or not unknown or not unknown[j] for j in range(n)]
    found = {"all efforts have the opposite sign": np.where(stated, -1.0, 1.0)}
    for j in np.flatnonzero(stated if n > 1 else [False]):
        turned = np.where(np.arange(n) == j, -1.0, 1.0)
        found[f"effort of '{names[j]}' has the opposite sign"] = turned
    return found if any(stated) else {}


def _factors(
    likelihood: Likelihood,
    interpretation: Interpretation,
    sums: Sums,
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
        price = choice(len(factors)) if cost is None else cost
        yield Hypothesis(cause, says, changed, price, touched, one_of(score, 0))


def best_factors(likelihood: Likelihood, sums: Sums, effort: list[int], scale: Array) -> Array:
    """The factor on each joint's effort at which it agrees best, shape `(n,)`."""
    factors = np.geomspace(LEAST_GAIN, LARGEST_GAIN, GRID)
    for _ in range(3):
        grid = factors.reshape(GRID, -1) * np.ones(len(scale))
        many = Sums(*(np.broadcast_to(x, (GRID, *x.shape[1:])) for x in vars(sums).values()))
        score = likelihood.scored(many, np.tile(effort, (GRID, 1)), grid * scale)
        best = grid[np.argmin(score.misfits, axis=0), np.arange(len(scale))]
        step = (grid[1] / grid[0]) ** 1.5
        factors = best * np.geomspace(1.0 / step, step, GRID)
    return np.where(sums.count[0] > 0.0, best, 1.0)


def _identifiable(
    likelihood: Likelihood, sums: Sums, effort: list[int], scale: Array, factors: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Joints whose effort identifies its gain, and those at which 1 at least is a worse one.

    Others agree as well with quite another gain.
    """
    around = np.stack((factors / OTHER, factors, factors * OTHER, np.ones_like(factors)))
    many = Sums(*(np.broadcast_to(x, (4, *x.shape[1:])) for x in vars(sums).values()))
    less, best, more, one = likelihood.scored(many, np.tile(effort, (4, 1)), around * scale).misfits
    bound = WORSE * best + 0.01
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


def _orders(
    likelihood: Likelihood, interpretation: Interpretation, sums: Sums
) -> Iterator[Hypothesis]:
    """The order of effort columns that agrees best, found as an assignment."""
    from scipy.optimize import linear_sum_assignment

    n = len(interpretation.effort)
    if n < 2:
        return
    columns = np.tile(np.arange(n)[:, None], (1, n))
    many = Sums(*(np.broadcast_to(x, (n, *x.shape[1:])) for x in vars(sums).values()))
    score = likelihood.scored(many, columns, np.tile(interpretation.effort_scale, (n, 1)))
    costs = score.counts * np.log(np.square(score.misfits) + 1e-3)
    order = tuple(int(c) for c in linear_sum_assignment(costs.T)[1])
    if order == interpretation.effort or not keeps_evidence(
        likelihood, interpretation.changed(effort=order)
    ):
        return
    moved = tuple(j for j in range(n) if order[j] != interpretation.effort[j])
    cost = 2.0 * choice(n) if len(moved) == 2 else n * choice(n)
    changed = interpretation.changed(effort=order)
    says = f"efforts in the order {', '.join(str(c + 1) for c in order)}"
    found = likelihood.scored(sums, np.array([order]), interpretation.effort_scale)
    yield Hypothesis("joint order", says, changed, cost, moved, one_of(found, 0))
