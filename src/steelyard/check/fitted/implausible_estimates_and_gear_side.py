r"""Estimates that no robot can have, the side of the gears, and what logs identify.

Of a link, a solid cylinder of tungsten as long as the link and half as thick is the most it can
weigh; of the arm, ten times what the model file says. A link counts as at least 0.3 of the arm's
reach long, for its geometry is not known. They bound estimates with two standard
deviations to spare.

With $f = \mu\,|\tau|\,s$ the drive gives $(1 + \mu)\,\tau$ to lift a load of $\tau$: the efficiency
is $1 / (1 + \mu)$. At $\mu = 1$ a gear locks itself, as the drive need not hold the load.

Logs of motors and of sensors on the link side look alike but for the torque that accelerates rotors
and gears: identified rotor inertias that are significantly positive say that it is contained.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError, SteelyardError
from steelyard.check.cases_and_checks import Case, case_check
from steelyard.check.finding import MOST_LISTED, SURE_DEVIATIONS, Finding, Fix, Severity
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.estimate.estimate import Estimate, Unidentifiable
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores.effort_errors import known_efforts
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import PLAUSIBLE, LoadDependent
from steelyard.model.laws.laws_without_friction import RotorInertia
from steelyard.model.laws.register import law_of
from steelyard.model.model import Model
from steelyard.model.terms.term import ActsOnAxes
from steelyard.robot.robot import Robot

TUNGSTEN_DENSITY = 19_300.0  # density [kg/m³]
SLENDER_LINK = 0.5  # thickness of a link over its length
SHORTEST, LEAST_LENGTH = 0.3, 0.2  # least length of a link, of the arm's reach and [m]
OTHER_MASS = 10.0  # factor between a mass and what it is compared with, from which on it is said
SURE_BOUND = 2.0  # standard deviations that an estimate must be beyond a bound
DISSIPATIVE_LAWS = (Coulomb.law, Viscous.law)  # friction that would drive if it were negative
CHECK_EFFORTS = (
    "Check the kind, unit, sign and gains of the efforts and the order of the columns "
    "(`steelyard check ROBOT LOG...`)"
)


@case_check("absurd estimates")
def absurd_bodies_check(case: FittedCase) -> Iterable[Finding]:
    """Masses that no link can have, and friction that drives, of a model that was fitted here."""
    found = absurdities(case.identified) if case.fitted else ()
    if not found:
        return ()
    says = "the estimate is physically absurd: " + "; ".join(found)
    return (Finding.wrong(says, fix=Fix(CHECK_EFFORTS)),)


def refuse_absurd(identified: IdentifiedModel, where: str) -> None:
    """Raise `DataError` at an estimate that no robot can have."""
    found = absurdities(identified)
    if found:
        raise DataError(
            f"the estimate is physically absurd: {'; '.join(found)}",
            where=where,
            fix=f"c{CHECK_EFFORTS[1:]}; --no-check writes the model anyway",
        )


def absurdities(identified: IdentifiedModel) -> tuple[str, ...]:
    """What no robot can have, in sentences."""
    return (*_masses(identified), *_driving(identified))


def light_links(identified: IdentifiedModel) -> tuple[str, ...]:
    """Links far lighter than the model file, or both neighbours, say; one sentence each.

    The last link of an arm is compared with the model file only: a flange may be light.
    """
    found = _estimated_masses(identified)
    if found is None:
        return ()
    robot, (masses, covariance) = identified.model.robot, found
    scaled = all(known_efforts(identified))  # else masses are up to a common factor
    half = Z95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sentences = []
    for index, body in enumerate(robot.bodies):
        if body.massless:
            continue
        around = [k for k, other in enumerate(robot.bodies) if other.parent == index]
        beside = min((float(masses[k]) for k in around), default=0.0)
        if body.parent >= 0:
            beside = min(beside, float(masses[body.parent]))
        nominal = body.inertia.mass if body.known and scaled else 0.0
        expected = [(nominal, f"{nominal:.3g} kg in the model file")] if nominal > 0.0 else []
        expected.append((beside, f"its neighbours have {beside:.3g} kg or more"))
        mass = float(masses[index])
        above = [(other, words) for other, words in expected if mass * OTHER_MASS < other]
        if above:
            sure = all(mass + half[index] < other for other, _ in above)
            doubt = "" if sure else "; not sure by its interval"
            interval = f"{mass:.2g} ± {half[index]:.2g} kg"
            sentences.append(
                f"'{body.name}' {interval} ({', '.join(words for _, words in above)}{doubt})"
            )
    return tuple(sentences)


@case_check("light links")
def light_links_check(case: FittedCase) -> Iterable[Finding]:
    """A remark on links of a model that was fitted here, see `light_links`."""
    found = light_links(case.identified) if case.fitted else ()
    if not found:
        return ()
    what = "1 link is" if len(found) == 1 else f"{len(found)} links are"
    says = (
        f"{what} implausibly light: {'; '.join(found)}. Torques follow from sums over links: do "
        "not use the mass of one link, or give what is known of it (`[prior.links]`)"
    )
    return (Finding.ok(says, headline=True),)


def _estimated_masses(identified: IdentifiedModel) -> tuple[Array, Array] | None:
    """Masses of all bodies `(b,)` and their covariance; `None` of a model without."""
    standard, robot = identified.estimate.standard, identified.model.robot
    if standard is None:
        return None
    names = list(standard.parameters.names)
    places = [names.index(f"m.{b.name}") for b in robot.bodies if f"m.{b.name}" in names]
    if len(places) != len(robot.bodies):
        return None
    return standard.parameters.values[places], standard.covariance[np.ix_(places, places)]


def _masses(identified: IdentifiedModel) -> Iterator[str]:
    found, robot = _estimated_masses(identified), identified.model.robot
    if found is None:
        return
    masses, covariance = found
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    for index, (body, mass, std) in enumerate(zip(robot.bodies, masses, stds, strict=True)):
        most = heaviest(robot, index)
        if mass - SURE_BOUND * std > most:
            yield (
                f"link '{body.name}' of {mass:.4g} kg would be denser than tungsten "
                f"(at most {most:.3g} kg for its size)"
            )
    nominal = sum(b.inertia.mass for b in robot.bodies if b.known)
    total, spread = float(masses.sum()), float(np.sqrt(max(covariance.sum(), 0.0)))
    if nominal <= 0.0 or not all(b.known for b in robot.bodies):
        return
    least, most = total - SURE_BOUND * spread, total + SURE_BOUND * spread
    if least > OTHER_MASS * nominal or most < nominal / OTHER_MASS:
        yield f"the total mass of the links is {total:.3g} kg, in the model file {nominal:.3g} kg"


def heaviest(robot: Robot, index: int) -> float:
    """Mass of a solid cylinder of tungsten as long as a link, half as thick [kg]."""
    reach = sum(float(np.linalg.norm(body.position)) for body in robot.bodies)
    ends = [b.position for b in robot.bodies if b.parent == index]
    ends += [f.position for f in robot.frames if f.body == index]
    longest = max((float(np.linalg.norm(end)) for end in ends), default=0.0)
    length = max(longest, SHORTEST * reach, LEAST_LENGTH)
    return TUNGSTEN_DENSITY * np.pi / 4.0 * (SLENDER_LINK * length) ** 2 * length


def _driving(identified: IdentifiedModel) -> Iterator[str]:
    """Joints whose friction least squares finds below zero, both laws for certain, and no more."""
    plain = (*identified.reference, identified.estimate)[0]
    below = plain.parameters.values < -SURE_BOUND * plain.std
    negative = {name for name, is_so in zip(plain.parameters.names, below, strict=True) if is_so}
    joints = identified.model.robot.joint_names
    driving = [
        joint
        for joint in joints
        if negative.issuperset(f"{law}.{joint}" for law in DISSIPATIVE_LAWS)
        and not _others(identified.model, joint)
    ]
    if driving:
        every = len(driving) == len(joints)
        who = "all joints" if every else ", ".join(f"'{joint}'" for joint in driving)
        its = "efforts have" if every else "its effort, or its position, has"
        yield f"estimated friction of {who} is negative: {its} the wrong sign"


def _others(model: Model, joint: str) -> bool:
    """Whether more laws of friction act on a joint: coefficients then mean nothing one by one."""
    return any(
        term.dissipation == "together" and joint in {axis.name for axis in term.axes(model.robot)}
        for term in model.terms
        if isinstance(term, ActsOnAxes)
    )


CAUSES_OF_LOAD_FRICTION = (
    "a gain or gear ratio is wrong, a term is missing, or the motion has too few loads"
)


@case_check("load-dependent friction")
def load_friction_check(case: FittedCase) -> Iterable[Finding]:
    """Coefficients of load-dependent friction of a fit above those of gears.

    Doubtful if an interval lies wholly above `PLAUSIBLE`. Nothing if all that are above have
    intervals down to zero: these are poorly identified, and counted as such.
    """
    estimate = case.identified.estimate
    rows = zip(estimate.parameters.names, estimate.parameters.values, estimate.std, strict=True)
    found = [
        (name.partition(".")[2], float(value), Z95 * float(std))
        for name, value, std in rows
        if name.partition(".")[0] == LoadDependent.law and value > PLAUSIBLE and case.fitted
    ]
    if not any(value > half for _, value, half in found):
        return
    sure = any(value - half > PLAUSIBLE for _, value, half in found)
    listed = ", ".join(
        f"{name} {value:.2f} ± {half:.2g} (efficiency {100.0 / (1.0 + value):.0f} %)"
        for name, value, half in found
    )
    yield Finding.of(
        Severity.DOUBTFUL if sure else Severity.OK,
        f"load-dependent friction of {listed} is more than a gear has (at most about "
        f"{PLAUSIBLE:g} of the load, and a gear locks itself at 1): {CAUSES_OF_LOAD_FRICTION}",
        "",
        tuple(name for name, _, _ in found),
        Fix(
            "Check gains and gear ratios of these joints, and log them moving in both "
            "directions under several loads"
        ),
        headline=True,
        brief=f"load-dependent friction above that of gears ({PLAUSIBLE:g}): {listed}. "
        f"{CAUSES_OF_LOAD_FRICTION[0].upper()}{CAUSES_OF_LOAD_FRICTION[1:]}",
    )


MOST_ROTORS = 0.5  # share of rotor inertias that says what torques contain
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
        found = case.longest_run()
        if found is None or not any(isinstance(term, RotorInertia) for term in case.model.terms):
            return ()
        estimate = WeightedLeastSquares()(case.only(found[0]).information)
    except SteelyardError:
        return ()
    rotors = rotors_of(estimate)
    values = zip(estimate.parameters.names, estimate.parameters.values, estimate.std, strict=True)
    sure = sum(value > SURE_DEVIATIONS * std for of, value, std in values if of in rotors)
    figure = f"{sure} of {len(rotors)} {SEPARABLE_ROTORS} are significantly positive"
    if rotors and sure >= MOST_ROTORS * len(rotors):
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
    many = len(zero) >= max(FEWEST_ZERO_ROTORS, MOST_ROTORS * len(rotors))
    at_joints = effort_kind == "joint_torque"
    return (zero if many and at_joints else ()), len(rotors)


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
        estimate = WeightedLeastSquares()(case.information)
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
        listed = ", ".join(b.name for b in blind[:MOST_LISTED])
        says += f"; not {listed}" + (" and more" if len(blind) > MOST_LISTED else "")
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
