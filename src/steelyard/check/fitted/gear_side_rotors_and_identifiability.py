"""Are torques those of motors or of the link side, and which parameters do logs identify?

Logs of motors and of sensors on the link side look alike but for the torque that accelerates rotors
and gears: identified rotor inertias that are significantly positive say that it is contained.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add

from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, case_check
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.estimate.estimate import Estimate, Unidentifiable
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
        model, found = case.model, case.longest_run()
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


SHOWN_PARAMETERS = 6
HELPFUL_MOTION = {"m": "other configurations of the joints before"} | dict.fromkeys(
    ("mx", "my", "mz"), "other configurations of the joints up to"
)
"""What shows mass and first moments of a body; other parameters, what their laws say."""


@case_check("identifiability", "What can be identified from these logs?", quick=False)
def identifiability_check(case: Case) -> Iterable[Finding]:
    """Parameters that no log shows; nothing where no run can be made of the logs."""
    if not case.runs:
        return
    try:
        regressor = base_regressor(case.model)
        estimate = WeightedLeastSquares()(reduce(add, [gather(regressor, r) for r in case.runs]))
    except SteelyardError as error:
        yield Finding.doubtful(f"undecided: {error.wrong}", "none", fix=Fix(error.fix))
        return
    left_open = case.loaded.friction and case.reference is None
    of = " (of the model with Coulomb and viscous friction)" if left_open else ""
    seen, blind = len(estimate.parameters.names), estimate.blind
    whole = seen + len(blind)
    says = f"the motion makes {seen} of {whole} base parameters{of} identifiable"
    figure = f"{seen} of {whole}, condition number {estimate.condition_normalised:.3g} (normalised)"
    if blind:
        listed = ", ".join(b.name for b in blind[:SHOWN_PARAMETERS])
        says += f"; not {listed}" + (" and more" if len(blind) > SHOWN_PARAMETERS else "")
        yield Finding.doubtful(says, figure, fix=Fix(_advice(blind)))
    else:
        says += "; how accurately they are identified depends on the noise"
        yield Finding.ok(says, figure)


def _advice(blind: Sequence[Unidentifiable]) -> str:
    wanted: dict[str, list[str]] = {}
    for parameter in blind:
        kind, _, of = parameter.name.partition(".")
        wanted.setdefault(HELPFUL_MOTION.get(kind, law_of(parameter.name).shown_by), []).append(of)
    parts = [f"{help_} {', '.join(dict.fromkeys(names))}" for help_, names in wanted.items()]
    return f"additional motion:  {'; '.join(parts)}"
