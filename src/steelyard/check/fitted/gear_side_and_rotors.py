"""Are torques those of motors, which contain what rotors need, or of the link side?

Both kinds of log look alike but for the torque that accelerates rotors and gears: identified rotor
inertias that are significantly positive say that it is contained.
"""

from collections.abc import Iterable

from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, case_check
from steelyard.check.clean_runs_and_customary_model import customary_model, longest_run
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.fitted_case_and_ranked_causes import FittedCase
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.laws.laws_without_friction import RotorInertia
from steelyard.model.laws.register import law_of

SIGNIFICANT_ROTOR = 4.0  # rotor inertia over its standard deviation from which on it is significant
SIGNIFICANT_ROTOR_SHARE = 0.5  # from which on torques contain those of the rotors
LINK_SIDE_INSTEAD = 'kind = "link_torque" without rotor_inertia'
"""How a robot file describes sensors on the link side."""
SEPARABLE_ROTORS = "rotor inertias (those separable from link inertias)"
"""What `rotors_of` are, for people: there may be fewer than joints."""


@case_check("gear side", "Do torques contain those of the rotors?", quick=False)
def gear_side_check(case: Case) -> Iterable[Finding]:
    """Rotor inertias that torques declared as those at joints contain; open if nothing decides."""
    signals = case.loaded.signals
    if signals is None or signals.effort_kind != "joint_torque":
        return ()
    try:
        model, found = customary_model(case), longest_run(case)
        if found is None or not any(isinstance(term, RotorInertia) for term in model.terms):
            return ()
        estimate = WeightedLeastSquares()(gather(base_regressor(model), found[1]))
    except SteelyardError:
        return ()
    rotors = rotors_of(estimate)
    values = zip(estimate.parameters.names, estimate.parameters.values, estimate.std, strict=True)
    sure = sum(value > SIGNIFICANT_ROTOR * std for of, value, std in values if of in rotors)
    figure = f"{sure} of {len(rotors)} {SEPARABLE_ROTORS} are significantly positive"
    if rotors and sure >= SIGNIFICANT_ROTOR_SHARE * len(rotors):
        return (Finding.ok(f"torques contain those of the rotors: {figure}", figure),)
    says = (
        f"undecided: {figure}; if the sensors are on the link side (Franka, KUKA iiwa, Kinova "
        f"Gen3), use {LINK_SIDE_INSTEAD} in [model] terms"
    )
    fix = Fix(f"if sensors are on the link side, use {LINK_SIDE_INSTEAD}")
    return (Finding.ok(says, figure, fix=None if sure or not rotors else fix, answered=False),)


def rotors_of(estimate: Estimate) -> tuple[str, ...]:
    """Rotor inertias that are base parameters of their own and that the data show."""
    return tuple(name for name in estimate.parameters.names if law_of(name) is RotorInertia)


ZERO_ROTOR_SHARE = 0.5  # of rotor inertias at zero, for the side of gears to be doubtful
FEWEST_ZERO_ROTORS = 2  # rotor inertias at zero from which on it is


@case_check("gear side")
def rotors_at_zero_check(case: FittedCase) -> Iterable[Finding]:
    """A remark, with what to change, where most fitted rotor inertias of joint torques are zero."""
    identified = case.identified
    zero, every = rotors_at_zero(identified.estimate, identified.signals.effort_kind)
    if not case.fitted or not zero:
        return ()
    are = f"{len(zero)} of {every} {SEPARABLE_ROTORS} are zero:"
    says = (
        f"{are} torques may be those of sensors on the link side, which do not contain the rotors'"
    )
    joints = tuple(name.partition(".")[2] for name in zero)
    fix = Fix(f"If so, use {LINK_SIDE_INSTEAD} in [model] terms")
    brief = f"{are} are the sensors on the link side?"
    return (Finding.ok(says, "", joints, fix, headline=True, brief=brief),)


def rotors_at_zero(estimate: Estimate, effort_kind: str) -> tuple[tuple[str, ...], int]:
    """Rotor inertias at or below zero, and how many there are; none where they are the fewer."""
    rotors = rotors_of(estimate)
    values = dict(zip(estimate.parameters.names, estimate.parameters.values, strict=True))
    zero = tuple(name for name in rotors if name in estimate.at_bound or values[name] <= 0.0)
    many = len(zero) >= max(FEWEST_ZERO_ROTORS, ZERO_ROTOR_SHARE * len(rotors))
    at_joints = effort_kind == "joint_torque"
    return (zero if many and at_joints else ()), len(rotors)
