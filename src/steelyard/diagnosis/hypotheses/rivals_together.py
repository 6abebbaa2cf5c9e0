"""Order, signs and gains of all columns at once, where no single cause explains a log.

Every order of joints and every set of position signs is tried with gains that are free per joint,
against the nominal bodies; the likeliest few are then held against bodies of the log's own. So a
wrong order is found although the unit is wrong too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.evidence_kept import keeps_evidence
from steelyard.diagnosis.hypotheses.possible import Possible, possible
from steelyard.diagnosis.hypotheses.reading import Reading
from steelyard.diagnosis.hypotheses.rival import Rival, choice
from steelyard.diagnosis.hypotheses.rivals_position import BATCH, COARSE, DEEPEST
from steelyard.diagnosis.hypotheses.trial import LEAST, Trial

FEW = 8
"""Readings that are held against bodies of the log's own."""
SMALL = 0.02
"""Misfit below which fits with free gains count as equally good."""
UNLOADED = 0.05
"""Share of an effort that bodies must make for its sign to be judged."""


def combined_rivals(trial: Trial) -> list[tuple[Rival, Possible]]:
    """Readings that differ in order and signs at once, the likeliest first.

    Every one comes with its bodies, which its misfits are those of.
    """
    n = trial.signals.n
    if not 2 <= n <= DEEPEST:
        return []
    coarse = replace(trial, excerpt=trial.excerpt.thinned(COARSE))
    orders = [r for r in _orders(trial.declared) if keeps_evidence(trial, r)]
    best = _best(coarse, orders)
    best = _best(coarse, [r for one in best for r in _signs(one)])
    found = []
    for reading in (*best, *(turned for one in best for turned in _all_turned(trial, one))):
        bodies = possible(trial, reading)
        if bodies is not None:
            found.append((_rival(trial, reading, bodies), bodies))
    return sorted(found, key=lambda pair: -pair[0].log_likelihood)


def _rival(trial: Trial, reading: Reading, bodies: Possible) -> Rival:
    declared, n = trial.declared, trial.signals.n
    before, after = declared.effort_scale, reading.effort_scale
    turned = np.sign(declared.position_scale) != np.sign(reading.position_scale)
    efforts = int(np.sum(np.sign(before) != np.sign(after)))
    signs = int(np.sum(turned)) + (1 if efforts == n else efforts)
    moved = [j for j in range(n) if (reading.position[j], reading.effort[j]) != (j, j)]
    cost = choice(n) * (len(moved) + signs)
    return Rival("", "", reading, cost, tuple(moved), bodies.score)


def _all_turned(trial: Trial, reading: Reading) -> Iterator[Reading]:
    """All efforts of the other sign where most of them are: that of an unloaded joint is open."""
    signs = np.sign(reading.effort_scale / trial.declared.effort_scale)
    if 0.5 * len(signs) < np.sum(signs < 0.0) < len(signs):
        yield reading.with_factors(-signs)


def _orders(reading: Reading) -> Iterator[Reading]:
    """Joints in every order, efforts with them or as declared; and efforts alone."""
    n = len(reading.position)
    for order in permutations(range(n)):
        position = tuple(reading.position[k] for k in order)
        moved = reading.changed(position=position)
        yield moved
        if position != reading.position:
            effort = tuple(reading.effort[k] for k in order)
            yield moved.changed(effort=effort)
            yield reading.changed(effort=effort)


def _signs(reading: Reading) -> Iterator[Reading]:
    for signs in product((1.0, -1.0), repeat=len(reading.position)):
        yield reading.changed(position_scale=np.array(signs) * reading.position_scale)


def _best(trial: Trial, readings: Sequence[Reading]) -> list[Reading]:
    """The likeliest readings with gains of their own, efforts turned where that fits."""
    size = max(1, BATCH // len(trial.excerpt.t))
    costs: list[float] = []
    turned: list[Reading] = []
    for start in range(0, len(readings), size):
        part = list(readings[start : start + size])
        misfits, signs, counts = _with_gains(trial, part)
        logs = 0.5 * counts * np.log(np.square(misfits) + SMALL**2)
        costs += logs.sum(axis=1).tolist()
        turned += [r.with_factors(s) for r, s in zip(part, signs, strict=True)]
    return [turned[k] for k in np.argsort(costs, kind="stable")[:FEW]]


def _with_gains(trial: Trial, readings: Sequence[Reading]) -> tuple[Array, Array, Array]:
    """Misfits with a gain per joint, its sign where the bodies show it, and counts, `(h, n)`."""
    sums = trial.sums(readings)
    h, j = np.ogrid[: len(readings), : trial.signals.n]
    effort = np.array([r.effort for r in readings])
    ee = np.maximum(sums.ee[h, j, effort], 1e-300)
    ye = sums.ye[h, j, :, effort]
    sizes = np.sqrt(np.maximum(np.diagonal(sums.yy, axis1=-2, axis2=-1), 1e-300))
    normal = sums.yy / sizes[..., None] / sizes[..., None, :] + 1e-9 * np.eye(5)
    right = ye / sizes
    theta = np.linalg.solve(normal, right[..., None])[..., 0]
    left = 1.0 - np.sum(right * theta, axis=-1) / ee
    scale = np.array([r.effort_scale for r in readings])
    share = theta[..., 4] / np.sqrt(ee) * np.sign(scale)
    signs = np.where(share < -UNLOADED, -1.0, 1.0)
    counts = np.where(sums.count >= LEAST, sums.count, 0.0)
    return np.sqrt(np.maximum(left, 0.0)), signs, counts
