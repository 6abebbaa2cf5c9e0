"""Order, signs and gains of all columns at once, where no single cause explains a log.

Every order of joints and every set of position signs is tried with gains that are free per joint,
against the nominal bodies; the likeliest few are then compared with bodies of the log's own. So a
wrong order is found although the unit is wrong too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.by_position import BATCH, COARSE, DEEPEST
from steelyard.diagnosis.hypotheses.hypothesis import Hypothesis, choice
from steelyard.diagnosis.likelihood.evidence_kept import keeps_evidence
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import LEAST, Likelihood
from steelyard.diagnosis.likelihood.possible import Possible, possible

FEW = 8
"""Interpretations that are compared with bodies of the log's own."""
SMALL = 0.02
"""Misfit below which fits with free gains count as equally good."""
UNLOADED = 0.05
"""Share of an effort that bodies must make for its sign to be judged."""


def combined_hypotheses(likelihood: Likelihood) -> list[tuple[Hypothesis, Possible]]:
    """Interpretations that differ in order and signs at once, the likeliest first.

    Every one comes with its bodies, which its misfits are those of.
    """
    n = likelihood.signals.n
    if not 2 <= n <= DEEPEST:
        return []
    coarse = replace(likelihood, excerpt=likelihood.excerpt.thinned(COARSE))
    orders = [r for r in _orders(likelihood.declared) if keeps_evidence(likelihood, r)]
    best = _best(coarse, orders)
    best = _best(coarse, [r for one in best for r in _signs(one)])
    found = []
    for interpretation in (
        *best,
        *(turned for one in best for turned in _all_turned(likelihood, one)),
    ):
        bodies = possible(likelihood, interpretation)
        if bodies is not None:
            found.append((_rival(likelihood, interpretation, bodies), bodies))
    return sorted(found, key=lambda pair: -pair[0].log_likelihood)


def _rival(likelihood: Likelihood, interpretation: Interpretation, bodies: Possible) -> Hypothesis:
    declared, n = likelihood.declared, likelihood.signals.n
    before, after = declared.effort_scale, interpretation.effort_scale
    turned = np.sign(declared.position_scale) != np.sign(interpretation.position_scale)
    efforts = int(np.sum(np.sign(before) != np.sign(after)))
    signs = int(np.sum(turned)) + (1 if efforts == n else efforts)
    moved = [
        j for j in range(n) if (interpretation.position[j], interpretation.effort[j]) != (j, j)
    ]
    cost = choice(n) * (len(moved) + signs)
    return Hypothesis("", "", interpretation, cost, tuple(moved), bodies.score)


def _all_turned(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Interpretation]:
    """All efforts of the other sign where most of them are: that of an unloaded joint is open."""
    signs = np.sign(interpretation.effort_scale / likelihood.declared.effort_scale)
    if 0.5 * len(signs) < np.sum(signs < 0.0) < len(signs):
        yield interpretation.with_factors(-signs)


def _orders(interpretation: Interpretation) -> Iterator[Interpretation]:
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


def _signs(interpretation: Interpretation) -> Iterator[Interpretation]:
    for signs in product((1.0, -1.0), repeat=len(interpretation.position)):
        yield interpretation.changed(position_scale=np.array(signs) * interpretation.position_scale)


def _best(
    likelihood: Likelihood, interpretations: Sequence[Interpretation]
) -> list[Interpretation]:
    """The likeliest interpretations with gains of their own, efforts turned where that fits."""
    size = max(1, BATCH // len(likelihood.excerpt.t))
    costs: list[float] = []
    turned: list[Interpretation] = []
    for start in range(0, len(interpretations), size):
        part = list(interpretations[start : start + size])
        misfits, signs, counts = _with_gains(likelihood, part)
        logs = 0.5 * counts * np.log(np.square(misfits) + SMALL**2)
        costs += logs.sum(axis=1).tolist()
        turned += [r.with_factors(s) for r, s in zip(part, signs, strict=True)]
    return [turned[k] for k in np.argsort(costs, kind="stable")[:FEW]]


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
    signs = np.where(share < -UNLOADED, -1.0, 1.0)
    counts = np.where(sums.count >= LEAST, sums.count, 0.0)
    return np.sqrt(np.maximum(left, 0.0)), signs, counts
