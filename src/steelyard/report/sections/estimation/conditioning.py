"""How well the data distinguish the parameters."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section

if TYPE_CHECKING:
    from steelyard.estimation.estimate import Estimate

PAIRS = 6
"""Most pairs of correlated parameters that are named."""

ALIKE = 0.9
"""Correlation of two estimates from which on they are named."""


class ConditioningSection(Section):
    """Condition numbers, noise per joint, parameters that are hardly distinguished."""

    name: ClassVar[str] = "conditioning"
    title: ClassVar[str] = "Conditioning"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Figures of the estimate and of those beside it."""
        if content.identified is None:
            return None
        estimate = content.identified.estimate
        robot = content.identified.model.robot
        noise = zip(
            robot.joint_names,
            robot.effort_units,
            estimate.sigma.tolist(),
            estimate.n_samples.tolist(),
            strict=True,
        )
        return {
            "estimate": estimate,
            "others": [
                (other, _furthest(estimate, other)) for other in content.identified.reference
            ],
            "noise": list(noise),
            "pairs": _pairs(estimate),
            "alike": ALIKE,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("conditioning.html", numbers)


def _furthest(estimate: Estimate, other: Estimate) -> tuple[str, float] | None:
    """The shared parameter that two estimates differ most in, and how far.

    In standard deviations of both together, the root of the sum of their variances: what a prior
    holds in place may lie many of its own away from what the data alone say of it.
    """
    shared = [name for name in estimate.parameters.names if name in other.parameters.names]
    if not shared:
        return None
    mine, others = (
        dict(zip(one.parameters.names, one.std.tolist(), strict=True)) for one in (estimate, other)
    )
    std = {name: hypot(mine[name], others[name]) for name in shared}
    moved = {
        name: abs(other.parameters[name] - estimate.parameters[name]) / std[name]
        for name in shared
        if std[name] > 0.0
    }
    name = max(moved, key=lambda n: moved[n], default=None)
    return None if name is None else (name, moved[name])


def _pairs(estimate: Estimate) -> list[tuple[str, str, float]]:
    """The most correlated pairs of parameters, strongest first; what a bound holds is in none."""
    std = estimate.std
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.tril(estimate.covariance / std[:, None] / std, -1)
    strength = np.where(np.isfinite(correlation), np.abs(correlation), 0.0)
    names = estimate.parameters.names
    at_bound = [names.index(name) for name in (*estimate.at_bound, *estimate.known)]
    strength[at_bound], strength[:, at_bound] = 0.0, 0.0
    order = np.argsort(strength, axis=None)[::-1][:PAIRS]
    places = [divmod(int(place), len(names)) for place in order]
    return [
        (names[b], names[a], float(correlation[a, b])) for a, b in places if strength[a, b] >= ALIKE
    ]
