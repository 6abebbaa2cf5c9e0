"""Hypotheses about a floating base: its sensor, its contacts, limbs that are exchanged."""

from collections.abc import Iterable, Iterator
from itertools import combinations

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.floating_base_readings import BaseReading, right_angles
from steelyard.check.hypotheses.gravity_payload_and_delay import held_hypothesis
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    FITTED_NUMBER_COST,
    Hypothesis,
    choice_cost,
    likeliest,
)
from steelyard.check.hypotheses.position_and_effort_hypotheses import COARSE_SAMPLES
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.robot.robot import Robot

SENSOR_MOUNTING, SENSOR_DELAY, CONTACTS = "sensor mounting", "sensor delay", "contacts"
OF_BASE = (SENSOR_MOUNTING, SENSOR_DELAY, CONTACTS)
"""Causes of hypotheses about a floating base."""
TRIED_SENSOR_DELAYS = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2)  # that are tried [s]
FACTORS = np.array([0.0, 0.1, 0.22, 0.5, 0.75, 1.0, 1.33, 2.0, 4.45, 9.81, 30.0, 100.0, 1000.0])
"""Factors on wrenches that are tried, of either sign: pounds, kilograms, kilonewtons are near."""
OTHER_FACTOR = 1.15  # factor on a wrench from which on it is another one
TURN_STEP = 0.3  # first step of that [rad]
UPRIGHT = 1.0 - 1e-9  # sine of a pitch from which on it is a right angle


def base_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """All single changes of how a floating base, its contacts and limbs are read; not scored."""
    if reading.base is None:
        return
    yield from _mountings(reading, reading.base)
    yield fitted_mounting(reading, reading.base)
    yield from _delays(reading, reading.base)
    yield from _contacts(reading, reading.base)
    yield from exchanged_limbs(reading)
    if not reading.held:
        yield held_hypothesis(reading, 1.0)


def _with(reading: Reading, cause: str, says: str, base: BaseReading, cost: float) -> Hypothesis:
    return Hypothesis(cause, says, reading.changed(base=base), cost, ())


def _mountings(reading: Reading, base: BaseReading) -> Iterator[Hypothesis]:
    """The sensor turned by right angles, in its own axes or the base link's, or not at all."""
    log = reading.likelihood
    assert log.base is not None
    axes, tried = np.reshape(log.base.signals.axes, (3, 3)), list[Array]()
    every = [x for turn in right_angles() for x in (turn, axes @ turn @ axes.T)]
    for turn in [axes.T, *every]:
        if all(np.abs(turn - other).max() > 1e-3 for other in (np.eye(3), *tried)):
            tried.append(turn)
    for turn in tried:
        says = f"the inertial sensor is turned by {mounting_words(turn @ base.turn @ axes)}"
        changed = base.changed(turn=turn @ base.turn)
        yield _with(reading, SENSOR_MOUNTING, says, changed, choice_cost(len(tried)))


def fitted_mounting(reading: Reading, base: BaseReading) -> Hypothesis:
    """The turn of the sensor that agrees best near that of a reading, by the known bodies."""
    from scipy.optimize import minimize
    from scipy.spatial.transform import Rotation

    log = reading.likelihood
    assert log.base is not None
    coarse = reading.on(log.thinned(COARSE_SAMPLES))

    def turned(x: Array) -> BaseReading:
        return base.changed(turn=Rotation.from_rotvec(x).as_matrix() @ base.turn)

    def cost(x: Array) -> float:
        return -coarse.changed(base=turned(x)).log_likelihood

    start = np.vstack((np.zeros(3), TURN_STEP * np.eye(3)))
    options = {"initial_simplex": start, "xatol": 1e-3, "fatol": 0.05, "maxfev": 200}
    found = minimize(cost, np.zeros(3), method="Nelder-Mead", options=options)
    after = turned(found.x)
    axes = np.reshape(log.base.signals.axes, (3, 3))
    says = f"the inertial sensor is turned by {mounting_words(after.turn @ axes)}"
    return _with(reading, SENSOR_MOUNTING, says, after, 3.0 * FITTED_NUMBER_COST)


def roll_pitch_yaw(axes: Array) -> Array:
    """Roll, pitch and yaw of a rotation [deg], as a robot file states a mounting."""
    from scipy.spatial.transform import Rotation

    if abs(axes[2, 0]) > UPRIGHT:  # of roll and yaw only a combination counts
        yaw = np.arctan2(-axes[0, 1], axes[1, 1])
        return np.rad2deg([0.0, -np.arcsin(np.clip(axes[2, 0], -1.0, 1.0)), yaw])
    return np.asarray(Rotation.from_matrix(axes).as_euler("xyz", degrees=True))


def mounting_words(axes: Array) -> str:
    """A mounting in words."""
    roll, pitch, yaw = (float(x) + 0.0 for x in np.round(roll_pitch_yaw(axes), 1))
    return f"roll {roll:g}°, pitch {pitch:g}°, yaw {yaw:g}°"


def _delays(reading: Reading, base: BaseReading) -> Iterator[Hypothesis]:
    if reading.likelihood.base is None or base.delay != reading.likelihood.base.signals.delay:
        return
    for delay in TRIED_SENSOR_DELAYS:
        yield sensor_late(reading, base.delay + delay)


def sensor_late(reading: Reading, delay: float) -> Hypothesis:
    """The sensor of the base is late against positions by a delay [s]."""
    base, log = reading.base, reading.likelihood
    assert base is not None and log.base is not None
    more = delay - log.base.signals.delay
    says = (
        f"the sensor of the base is {1e3 * abs(more):.3g} ms {'late' if more > 0 else 'early'} "
        "against joint positions"
    )
    return _with(reading, SENSOR_DELAY, says, base.changed(delay=delay), FITTED_NUMBER_COST)


def _contacts(reading: Reading, base: BaseReading) -> Iterator[Hypothesis]:
    """Wrenches of other size or sign, exchanged, or along other axes."""
    log = reading.likelihood
    assert log.base is not None
    names = [contact.frame for contact in log.base.signals.contacts]
    count, every = len(names), tuple(range(len(names)))
    sets = [every, *((k,) for k in every)] if count > 1 else [every] * bool(count)
    for which in sets:
        factor = _factor(reading, base, which)
        who = "of all contacts" if which == every else f"at '{names[which[0]]}'"
        mine = np.isin(every, which)
        tried = {-1.0: f"forces {who} have the opposite sign"}
        if abs(np.log(max(abs(factor), 1e-3))) > np.log(OTHER_FACTOR):
            tried[factor] = f"forces {who} are off by a factor of {factor:.3g}"
        for x, says in tried.items():
            factors = base.factors * np.where(mine, x, 1.0)
            cost = choice_cost(len(sets)) + FITTED_NUMBER_COST * (abs(x) != 1.0)
            yield _with(reading, CONTACTS, says, base.changed(factors=factors), cost)
        world = tuple(bool(x != m) for x, m in zip(base.in_world, mine, strict=True))
        samples = log.excerpt.base
        if samples is not None and (samples.axes is not None or not any(world)):
            whose = "their frames" if all(np.array(base.in_world)[mine]) else "the world"
            says = f"forces {who} are along the axes of {whose}"
            yield _with(
                reading, CONTACTS, says, base.changed(in_world=world), choice_cost(len(sets))
            )
    exchanges = _exchanges(combinations(every, 2))
    for swapped in exchanges:
        order = list(base.contacts)
        for a, b in swapped:
            order[a], order[b] = order[b], order[a]
        says = "forces are exchanged: " + " and ".join(
            f"'{names[a]}' with '{names[b]}'" for a, b in swapped
        )
        cost = choice_cost(len(exchanges))
        yield _with(reading, CONTACTS, says, base.changed(contacts=tuple(order)), cost)


def _exchanges(pairs: Iterable[tuple[int, int]]) -> list[tuple[tuple[int, int], ...]]:
    """Pairs that are exchanged, each alone or two at once: left and right, fore and hind."""
    alone = [(pair,) for pair in pairs]
    return [*alone, *(a + b for a, b in combinations(alone, 2) if not {*a[0]} & {*b[0]})]


def _factor(reading: Reading, base: BaseReading, which: tuple[int, ...]) -> float:
    """The factor on some wrenches at which a log agrees best with the known bodies."""
    coarse = reading.on(reading.likelihood.thinned(COARSE_SAMPLES))
    mine = np.isin(range(len(base.factors)), which)

    def likelihoods(factors: Array) -> Array:
        each = (base.changed(factors=base.factors * np.where(mine, x, 1.0)) for x in factors)
        return np.array([coarse.changed(base=one).log_likelihood for one in each])

    return likeliest(likelihoods, np.concatenate((-FACTORS[:0:-1], FACTORS)))[0]


def limbs(robot: Robot) -> list[tuple[tuple[int, ...], str]]:
    """Coordinates of each limb and the name of its first link.

    A limb is what hangs on a link beside others and has no branch of its own.
    """
    children: dict[int, list[int]] = {}
    for k, body in enumerate(robot.bodies):
        children.setdefault(body.parent, []).append(k)
    found = []
    for below in children.values():
        for start in below if len(below) > 1 else ():
            chain, at = [start], start
            while len(children.get(at, ())) == 1:
                at = children[at][0]
                chain.append(at)
            if not children.get(at):
                found.append((tuple(robot.bodies[k].coordinate for k in chain), start))
    return [(joints, robot.bodies[k].name) for joints, k in found]


def exchanged_limbs(reading: Reading) -> Iterator[Hypothesis]:
    """Columns of two limbs exchanged, or of two pairs of limbs: left and right, fore and hind."""
    found = limbs(reading.knowledge.robot)
    pairs = [
        (a, b)
        for a, b in combinations(range(len(found)), 2)
        if len(found[a][0]) == len(found[b][0]) and not set(found[a][0]) & set(found[b][0])
    ]
    exchanges = _exchanges(pairs)
    for swapped in exchanges:
        order = list(range(len(reading.position)))
        for a, b in swapped:
            for j, k in zip(found[a][0], found[b][0], strict=True):
                order[j], order[k] = k, j
        says = "columns are exchanged: joints of " + " and ".join(
            f"'{found[a][1]}' with those of '{found[b][1]}'" for a, b in swapped
        )
        position, effort = (tuple(x[k] for k in order) for x in (reading.position, reading.effort))
        moved = tuple(j for j, k in enumerate(order) if j != k)
        changed = reading.changed(position=position, effort=effort)
        cost = 2.0 * choice_cost(len(exchanges))
        yield Hypothesis("joint order", says, changed, cost, moved)
