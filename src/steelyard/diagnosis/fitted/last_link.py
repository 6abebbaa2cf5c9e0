"""Whether the last link comes out much heavier than the model file says: a payload left on, say.

All logs of a loaded robot agree with each other, and their model predicts them all; only what is
known of the links beforehand can show the load. A model file's masses are often wrong, and often
all of them alike: the last link is therefore compared with the others.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.diagnosis.fitted.runs_disagree import RunsDisagree
from steelyard.estimation.estimate import Z95, StandardEstimate
from steelyard.estimation.identified import IdentifiedModel

HEAVIER = 2.0
"""Mass over the model file's, relative to the median of the other links, from which on it is
reported. Links that are invented off by a quarter reach 1.5."""

KNOWN = 0.5
"""Share of a mass's knowledge that must come from the data for it to be compared."""


@dataclass(frozen=True)
class Weight:
    """A link's mass, its standard deviation, the model file's [kg], and the data's share."""

    link: str
    mass: float
    std: float
    nominal: float
    learned: float

    @property
    def ratio(self) -> float:
        """Mass over the model file's."""
        return self.mass / self.nominal


class LastLink:
    """A last link that is much heavier than the model file says."""

    name: ClassVar[str] = "last link"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding for all fitted runs that agree; none of plain least squares: no masses."""
        standard = case.identified.estimate.standard
        if not case.fitted or standard is None:
            return ()
        weights = _weights(case.identified, standard)
        last = case.identified.model.robot.bodies[-1].name
        others = [w.ratio for w in weights if w.link != last]
        mine = [w for w in weights if w.link == last]
        if not mine or not others:
            return ()
        weight, usual = mine[0], float(np.median(others))
        least = weight.mass - Z95 * weight.std
        if weight.ratio < HEAVIER * max(usual, 1.0) or least < max(usual, 1.0) * weight.nominal:
            return ()
        return () if RunsDisagree()(case) else (_finding(weight, usual),)


def _weights(identified: IdentifiedModel, standard: StandardEstimate) -> list[Weight]:
    """Masses that the model file gives and the data identify."""
    place = {name: k for k, name in enumerate(standard.parameters.names)}
    found = []
    for body in identified.model.robot.bodies:
        k = place.get(f"m.{body.name}")
        if k is None or not body.known or body.inertia.mass <= 0.0 or standard.learned[k] < KNOWN:
            continue
        mass, std = float(standard.parameters.values[k]), float(standard.std[k])
        found.append(Weight(body.name, mass, std, body.inertia.mass, float(standard.learned[k])))
    return found


def _finding(weight: Weight, usual: float) -> Finding:
    more = weight.mass - weight.nominal
    return Finding(
        LastLink.name,
        "",
        Severity.DOUBTFUL,
        f"the last link ({weight.link}) is estimated {more:.2g} kg heavier than in the model file: "
        "the robot carries a payload or tool in all logs, or the model file is wrong",
        f"{weight.mass:.3g} ± {Z95 * weight.std:.2g} kg for {weight.nominal:.3g} kg, "
        f"{weight.ratio:.1f} times, the other links {usual:.1f} times",
        fix=Fix("Log without the load, or add the tool to the model file"),
    )
