"""Do joint torques contain the rotors', or are they of sensors on the link side?

Both kinds of log look alike but for the torque that accelerates rotors and gears: identified rotor
inertias that are significantly positive say that it is contained.
"""

from typing import ClassVar

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.identifiability import customary_model, longest_run
from steelyard.errors import SteelyardError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor
from steelyard.terms.laws.rotor_inertia import RotorInertia
from steelyard.terms.register import law_of

SURE = 4.0
"""Rotor inertia over its standard deviation from which on it is significant."""

ENOUGH = 0.5
"""Share of significant rotor inertias from which on torques contain those of the rotors."""

INSTEAD = 'kind = "link_torque" without rotor_inertia'
"""How a robot file describes sensors on the link side."""


class GearSide:
    """Rotor inertias that the torques of the longest log contain."""

    name: ClassVar[str] = "gear side"
    question: ClassVar[str] = "Do torques contain those of the rotors?"
    quick: ClassVar[bool] = False

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding if torques are declared as those at the joints, open if nothing decides."""
        signals = case.loaded.signals
        if signals is None or signals.effort_kind != "joint_torque":
            return ()
        try:
            model, run = customary_model(case), longest_run(case)
            if run is None or not any(isinstance(term, RotorInertia) for term in model.terms):
                return ()
            estimate = WeightedLeastSquares()(gather(base_regressor(model), run))
        except SteelyardError:
            return ()
        return (_finding(self.name, estimate),)


SEPARABLE = "rotor inertias (those separable from link inertias)"
"""What `rotors_of` are, for people: there may be fewer than joints."""


def rotors_of(estimate: Estimate) -> tuple[str, ...]:
    """Rotor inertias that are base parameters of their own and that the data show."""
    return tuple(name for name in estimate.parameters.names if law_of(name) is RotorInertia)


def _finding(name: str, estimate: Estimate) -> Finding:
    rotors = rotors_of(estimate)
    values = zip(estimate.parameters.names, estimate.parameters.values, estimate.std, strict=True)
    sure = sum(value > SURE * std for of, value, std in values if of in rotors)
    figure = f"{sure} of {len(rotors)} {SEPARABLE} are significantly positive"
    if rotors and sure >= ENOUGH * len(rotors):
        says = f"torques contain those of the rotors: {figure}"
        return Finding(name, "", Severity.OK, says, figure)
    says = (
        f"undecided: {figure}; if the sensors are on the link side (Franka, KUKA iiwa, Kinova "
        f"Gen3), use {INSTEAD} in [model] terms"
    )
    fix = None if sure or not rotors else Fix(f"if sensors are on the link side, use {INSTEAD}")
    return Finding(name, "", Severity.OK, says, figure, fix=fix, answered=False)
