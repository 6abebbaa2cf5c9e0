"""Rotor inertias that a fit puts to zero: the torques may be of sensors on the link side."""

from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.diagnosis.gear_side import INSTEAD, SEPARABLE, rotors_of
from steelyard.estimation.estimate import Estimate

FEW = 0.5
"""Share of rotor inertias at zero from which on the side of the gears is doubtful."""

LEAST = 2
"""Rotor inertias at zero from which on it is."""


class RotorsAtZero:
    """A remark where most rotor inertias of joint torques are zero."""

    name: ClassVar[str] = "gear side"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One remark, with what to change, after a fit."""
        identified = case.identified
        zero, every = rotors_at_zero(identified.estimate, identified.signals.effort_kind)
        if not case.fitted or not zero:
            return ()
        says = (
            f"{len(zero)} of {every} {SEPARABLE} are zero: torques may be those of sensors "
            "on the link side, which do not contain the rotors'"
        )
        joints = tuple(name.partition(".")[2] for name in zero)
        fix = Fix(f"If so, use {INSTEAD} in [model] terms")
        brief = f"{len(zero)} of {every} {SEPARABLE} are zero: are the sensors on the link side?"
        ok = Severity.OK
        return (Finding(self.name, "", ok, says, "", joints, fix, headline=True, brief=brief),)


def rotors_at_zero(estimate: Estimate, effort_kind: str) -> tuple[tuple[str, ...], int]:
    """Rotor inertias at or below zero, and how many there are; none where they are the fewer.

    Args:
        estimate: The estimate.
        effort_kind: Content of the efforts: they are asked of torques at the joints only.
    """
    rotors = rotors_of(estimate)
    values = dict(zip(estimate.parameters.names, estimate.parameters.values, strict=True))
    zero = tuple(name for name in rotors if name in estimate.at_bound or values[name] <= 0.0)
    many = len(zero) >= max(LEAST, FEW * len(rotors))
    at_joints = effort_kind == "joint_torque"
    return (zero if many and at_joints else ()), len(rotors)
