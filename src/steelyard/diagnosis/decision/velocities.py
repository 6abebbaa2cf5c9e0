"""Logged velocities follow positions that change order or sign, or stay where they are."""

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Evidence
from steelyard.diagnosis.finding import Edit
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood

ALIKE = 0.8
"""Correlation from which on a velocity belongs to a position."""


def velocity_edits(
    evidence: Evidence, likelihood: Likelihood, interpretation: Interpretation
) -> tuple[Edit, ...]:
    """What declared velocities need beside positions of an interpretation; nothing without any."""
    before, s = likelihood.declared, evidence.recording.signals
    moved = interpretation.position != before.position
    turned = not np.array_equal(
        np.sign(interpretation.position_scale), np.sign(before.position_scale)
    )
    logged = evidence.samples.dq
    if not (moved or turned) or s.velocity is None or logged is None or s.velocity_scale is None:
        return ()
    from scipy.optimize import linear_sum_assignment

    table = _correlations(evidence.samples.t, logged, likelihood, interpretation)
    order = [int(c) for c in linear_sum_assignment(-np.abs(table) - 1e-6 * np.eye(len(table)))[1]]
    correlated = np.abs(table[np.arange(len(table)), order]) >= ALIKE
    order = [c if correlated[j] else interpretation.position[j] for j, c in enumerate(order)]
    if sorted(order) != list(range(len(order))):
        return ()
    found = []
    if order != list(range(len(order))):
        found.append(Edit(("signals", "velocity"), [s.velocity[c] for c in order]))
    own = np.sign(s.velocity_scale)
    signs = np.where(correlated, np.sign(table[np.arange(len(table)), order]), 1.0) * own[order]
    if not np.array_equal(signs, own):
        found.append(Edit(("signals", "velocity_sign"), [int(x) for x in signs]))
    return tuple(found)


def _correlations(
    t: Array, dq: Array, likelihood: Likelihood, interpretation: Interpretation
) -> Array:
    """Of every joint's derivative of position with every velocity as declared, `(n, n)`.

    Args:
        t: Time of the log's rows, shape `(N,)` [s].
        dq: Their velocities, shape `(N, n)`.
        likelihood: The log.
        interpretation: How its positions are read.
    """
    x = likelihood.excerpt
    good = np.isfinite(t) & np.isfinite(dq).all(axis=1)
    t, dq = t[good], np.clip(dq[good], -1e3, 1e3)
    order = np.argsort(t, kind="stable")
    logged = np.array([np.interp(x.t + x.origin, t[order], column[order]) for column in dq.T])
    if likelihood.signals.position_map is not None:
        logged = np.asarray(np.linalg.solve(likelihood.signals.position_map, logged))
    derived = interpretation.position_scale[:, None] * x.dz[list(interpretation.position)]
    size = np.outer(np.linalg.norm(derived, axis=1), np.linalg.norm(logged, axis=1))
    return np.asarray(derived @ logged.T / np.maximum(size, 1e-300))
