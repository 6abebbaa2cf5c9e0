r"""Friction as a hypothesis: what it explains by itself, and what is late where it gives way.

A gear gives way before it slips: friction that follows Dahl's law over a length $\sigma$,
$\sigma \dot z = \dot q - |\dot q| z$, comes after the sign of the velocity has changed, and looks
like efforts that are late [Dahl1968].
"""

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.hypothesis import one_of
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood, Score, regressors
from steelyard.kernel.native.recurrence import recurrence

LENGTHS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)
"""Lengths over which friction may give way [rad; m]."""


def friction_alone(likelihood: Likelihood, interpretation: Interpretation) -> Score:
    """How well friction, an offset and rotor inertia explain the efforts, without any body."""
    q, dq, ddq = likelihood.motion(interpretation)
    y, moving = _columns(q, likelihood.driven(dq), likelihood.driven(ddq), np.zeros_like(q))
    return _score(likelihood, interpretation, y, moving)


def giving_way(likelihood: Likelihood, interpretation: Interpretation) -> Score:
    """The same with bodies, and friction that gives way by the best length of each joint."""
    q, dq, ddq = likelihood.motion(interpretation)
    u, predicted = likelihood.driven(dq), likelihood.predicted(interpretation, q, dq, ddq)
    y, moving = _columns(q, u, likelihood.driven(ddq), predicted)
    scores = []
    for length in LENGTHS:
        y[:, 0, 0] = _states(likelihood, likelihood.driven(q), u, length) * moving[:, 0]
        scores.append(_score(likelihood, interpretation, y, moving))
    return replace(scores[0], misfits=np.min([score.misfits for score in scores], axis=0))


def _columns(q: Array, u: Array, du: Array, predicted: Array) -> tuple[Array, Array]:
    return regressors(*(x[:, None] for x in (q, u, du, predicted)))


def _score(
    likelihood: Likelihood, interpretation: Interpretation, y: Array, moving: Array
) -> Score:
    sums = likelihood.products(y, moving, likelihood.excerpt.later([interpretation.delay]))
    return one_of(
        likelihood.scored(sums, np.array([interpretation.effort]), interpretation.effort_scale), 0
    )


def _states(likelihood: Likelihood, q: Array, u: Array, length: float) -> Array:
    """Friction over what it is where it slips, shape `(n, B)`; slipping where a stretch begins."""
    steps = np.diff(q, axis=1, prepend=q[:, :1])
    stretch = likelihood.excerpt.stretch
    begins = np.concatenate(([True], stretch[1:] != stretch[:-1]))
    decay = np.where(begins, 0.0, np.exp(-np.abs(steps) / length))
    drive = np.where(begins, np.sign(u), np.sign(steps) * (1.0 - decay))
    return recurrence(decay, drive, np.ones_like(decay), np.zeros(len(q)))[0]
