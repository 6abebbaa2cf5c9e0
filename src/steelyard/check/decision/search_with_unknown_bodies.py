"""Combinations of readings of a log, searched by their evidence where bodies are not known.

One change after another, from the declared reading and from the best combinations of orders and
signs: all single changes are screened, the best few are compared by their evidence, and what is
best is changed again. Each change costs what its choice among its kind and its numbers take.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import EffortPredictor
from steelyard.check.hypotheses.evidence_with_unknown_bodies import (
    Evidence,
    EvidenceOfLog,
    body_map,
    payload_map,
)
from steelyard.check.hypotheses.floating_base_readings import BaseReading
from steelyard.check.hypotheses.gravity_payload_and_delay import (
    COMPENSATED,
    NEAR_AXIS_ANGLE,
    gravity_directions,
    gravity_hypotheses,
    held_hypothesis,
)
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    AS_DECLARED,
    FITTED_NUMBER_COST,
    LIKELY,
    SURE,
    Hypothesis,
    choice_cost,
    scored,
)
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    OtherEfforts,
    best_combinations,
    effort_hypotheses,
    holds_factors,
    position_changes,
    ratio_hypotheses,
)
from steelyard.check.hypotheses.readings_and_likelihood import Key, Likelihood, Reading
from steelyard.check.hypotheses.sensors_contacts_and_limbs import (
    CONTACTS,
    OF_BASE,
    OTHER_FACTOR,
    SENSOR_DELAY,
    SENSOR_MOUNTING,
    base_hypotheses,
    sensor_late,
)
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.prior.body_priors import model_prior

COMPARED = 6  # changes of a reading that are compared by their evidence after screening
ROUNDS = 4  # changes at most, one after another
TRIED_DELAYS = (-0.08, -0.04, 0.04, 0.08, 0.14, 0.22, 0.3)  # delays of efforts that are tried [s]
DELAY_STEPS = (0.02, 0.01, 0.005)  # steps to either side by which the best of them is refined [s]
POOR = 0.1  # misfit of a joint from which combinations are searched too
COMPARED_ANYWAY = ("effort unit", "effort kind")  # screening does not tell sizes of all efforts
LARGEST_FACTOR = 1000.0  # on one joint's effort: friction fits what is off by more
HELD_SHARES = (1.0, 0.8, 0.6)  # of the nominal weight that efforts may lack beside a mounting
SAME_FACTOR = 1.25  # factors on efforts up to which they are one
SAME_TURN = np.cos(np.deg2rad(2.5))  # of the sensor of a floating base
SAME_UNIT = 10.0  # typical factors up to which they are of one unit
LEAST_MASS, LEAST_SHARE = 0.3, 0.02  # least payload [kg], and relative to the arm's mass


@dataclass(frozen=True, eq=False)
class Explanation:
    """A reading of a log, as changes of the declared one."""

    reading: Reading
    changes: tuple[Hypothesis, ...]
    evidence: Evidence

    @property
    def cost(self) -> float:
        """What its changes cost."""
        return sum(change.cost for change in self.changes)

    @property
    def log(self) -> float:
        """Log evidence with what its changes cost."""
        return self.evidence.log - self.cost

    @property
    def poor(self) -> bool:
        """Whether a joint disagrees, whatever bodies weigh."""
        return bool(np.any(self.evidence.misfits[self.evidence.counts > 0.0] > POOR))

    @property
    def carried(self) -> Array:
        """Ten numbers by which the last link differs from the model file's, payload included."""
        return _carried(self.reading, self.evidence)

    def as_hypothesis(self, **named: object) -> Hypothesis:
        """The same as one hypothesis."""
        says = ", and ".join(change.says for change in self.changes if change.says) or AS_DECLARED
        cause = self.changes[-1].cause if self.changes else ""
        joints = self.changes[-1].joints if self.changes else ()
        score, log = self.evidence.score, self.evidence.log
        one = Hypothesis(cause, says, self.reading, self.cost, joints, score, evidence=log)
        return replace(one, **named)  # type: ignore[arg-type]


def least_mass(knowledge: EffortPredictor) -> float:
    """Payload from which on one matters [kg]."""
    arm = sum(body.inertia.mass for body in knowledge.robot.bodies)
    return max(LEAST_MASS, LEAST_SHARE * arm)


def _carried(reading: Reading, evidence: Evidence) -> Array:
    robot = reading.knowledge.robot
    part = slice(10 * (last := carrier(robot).body), 10 * last + 10)
    arm, load = np.split(evidence.bodies, [10 * len(robot.bodies)])
    found = (body_map(robot) @ arm)[part] - evidence.size * model_prior(robot, last).inertia.ten
    return np.asarray(found + payload_map(robot) @ load if len(load) else found)


Tried = tuple[Reading, tuple[Hypothesis, ...]]


class Search:
    """Explanations of a log that were compared."""

    def __init__(
        self, likelihood: Likelihood, others: OtherEfforts, unknown: NDArray[np.bool_]
    ) -> None:
        self.of = EvidenceOfLog(likelihood, unknown)
        self._others = others
        self.found: dict[Key, Explanation] = {}
        self._alternatives: dict[Key, list[Hypothesis]] = {}
        self.compare([(likelihood.declared, ())])
        for number in range(ROUNDS if self.found else 0):
            best = self.best
            most = 1 + best.poor * (number > 0)
            near = [x for x in self.ordered() if x.log > best.log - 2.0 * SURE][:most]
            starts = [x for x in near if x.reading.key not in self._alternatives]
            for start in starts:
                self._expand(start)
            if number == 0 and self.best.poor:
                self._compare_best([(h.reading, (h,)) for h in best_combinations(likelihood)])
            if not starts:
                break
        if self.found:
            self._refine_delay()

    @property
    def declared(self) -> Explanation:
        """The declared reading."""
        return next(iter(self.found.values()))

    @property
    def best(self) -> Explanation:
        """The likeliest one; of those that hardly differ from it, that with the fewest changes."""
        least = max(x.log for x in self.found.values()) - LIKELY
        near = [x for x in self.found.values() if x.log > least]
        return min(near, key=lambda x: (len(x.changes), x.reading.held > 0.0, -x.log))

    def ordered(self) -> list[Explanation]:
        """The best first."""
        return sorted(self.found.values(), key=lambda x: -x.log)

    def alternatives(self, cause: str) -> Iterator[tuple[Hypothesis, float]]:
        """Single changes of the best explanation with one cause, each with its log odds."""
        if self.best.reading.key not in self._alternatives:
            self._expand(self.best)
        best = self.best
        own = self._rough(best.reading)
        for one in self._alternatives.get(best.reading.key, ()):
            key = one.reading.key
            if one.cause != cause or alike(cause, one.reading, best.reading):
                continue
            if cause in FACTOR_CAUSES and one.cost >= FITTED_NUMBER_COST:
                continue  # `odds_of_factors` tell more than the factor that fits best
            rough = self.of.screened([one.reading])[0]
            least = least_mass(best.reading.knowledge)
            if cause == "payload" and rough and _carried(one.reading, rough)[0] < least:
                continue
            if key in self.found:
                yield one, self.found[key].log - best.log
            else:
                yield one, self._rough(one.reading) - one.cost - own

    def without(self, cause: str) -> float:
        """Log odds of all that say of a cause what the best does, by their best, to the others."""
        best, declared = self.best, self.declared.reading
        if cause == "mounting" or best.reading.kind == COMPENSATED:
            self._compare_best(list(self._held()))
            best = self.best
        alone = undone(best.reading, declared, cause)
        self.compare([(alone, tuple(c for c in best.changes if c.cause != cause))])
        late = best.reading.delay - declared.delay
        half = (
            0.5 * abs(late) if cause == "effort delay" else np.inf
        )  # from which on one is as late
        others = [
            x
            for x in self.found.values()
            if not says_the_same(cause, x.reading, best.reading)
            and (x.reading.delay - declared.delay) * np.sign(late) <= half
        ]
        most = max(x.log for x in self.found.values() if x not in others)
        return most - max((x.log for x in others), default=-np.inf)

    def _held(self) -> Iterator[Tried]:
        """Efforts that lack nominal weight, any mounting; also without factors, which fit that."""
        best, declared = self.best, self.declared.reading
        same = best.reading.kind != COMPENSATED
        kept = tuple(c for c in best.changes if same or c.cause != "effort kind")
        plain = tuple(c for c in best.changes if c.cause not in FACTOR_CAUSES)
        bases = (best.reading, kept), (undone(best.reading, declared, "gain"), plain)
        for base, changes in {base.key: (base, changes) for base, changes in bases}.values():
            rest = tuple(c for c in changes if c.cause != "mounting")
            own = undone(base, declared, "mounting")
            axes = gravity_directions(own, search=False) if own.base is None else ()
            turned = ((h.reading, (*rest, h)) for h in axes)
            for (reading, before), share in product([(own, rest), *turned], HELD_SHARES):
                held = held_hypothesis(reading, share)
                yield held.reading, (*before, held)

    def loss(self, reading: Reading) -> float:
        """Log evidence of a reading below that of the best explanation."""
        found = self.of.of([reading])[0]
        return np.inf if found is None else self.best.evidence.log - found.log

    def odds_of_factors(self, factors: Sequence[Array]) -> list[float]:
        """Log odds to the best explanation of factors on efforts beside it, each `(n,)`."""
        best = self.best
        cost = FITTED_NUMBER_COST + choice_cost(len(best.reading.effort))
        readings = [best.reading.with_factors(one) for one in factors]
        if len(readings) > self.of.most:  # of many joints
            return [self._rough(one) - self._rough(best.reading) - cost for one in readings]
        found = self.of.of(readings)
        return [-np.inf if x is None else x.log - best.evidence.log - cost for x in found]

    def compare(self, tried: Iterable[Tried]) -> None:
        """Compare readings by their evidence."""
        pairs = [pair for pair in tried if pair[0].key not in self.found]
        for (reading, changes), one in zip(pairs, self.of.of([r for r, _ in pairs]), strict=True):
            if one is not None:
                self.found[reading.key] = Explanation(reading, changes, one)

    def _expand(self, start: Explanation) -> None:
        single = list(_changes(start, self._others))
        if len(single) > self.of.most:  # of robots with many joints, those likely by nominal bodies
            single = sorted(scored(single), key=lambda h: -h.log_likelihood)[: self.of.most]
        self._alternatives[start.reading.key] = single
        forced = [h for h in single if h.cause in COMPARED_ANYWAY]
        self._compare_best([(h.reading, (*start.changes, h)) for h in single if h not in forced])
        self.compare([(h.reading, (*start.changes, h)) for h in forced])

    def _rough(self, reading: Reading) -> float:
        found = self.of.screened([reading])[0]
        return -np.inf if found is None else found.log

    def _compare_best(self, tried: Sequence[Tried]) -> None:
        self.of.screened([reading for reading, _ in tried])

        def likely(one: Tried) -> float:
            return self._rough(one[0]) - sum(h.cost for h in one[1])

        self.compare(sorted(tried, key=likely, reverse=True)[:COMPARED])

    def _refine_delay(self) -> None:
        for step in DELAY_STEPS:
            best = self.best
            causes = ("effort delay", SENSOR_DELAY)
            last = next((c for c in best.changes if c.cause in causes), None)
            if last is None:
                return
            rest = tuple(c for c in best.changes if c is not last)
            for more in (-step, step):
                if last.cause == SENSOR_DELAY and best.reading.base is not None:
                    one = sensor_late(best.reading, best.reading.base.delay + more)
                else:
                    one = _late(best.reading, best.reading.delay + more)
                self.compare([(one.reading, (*rest, one))])


def _changes(start: Explanation, others: OtherEfforts) -> Iterator[Hypothesis]:
    reading, declared = start.reading, start.reading.likelihood.declared
    for h in effort_hypotheses(reading, others):
        factors = h.reading.effort_scale / reading.effort_scale
        # a fitted factor on all efforts is no other reading than bodies of another size
        known = h.cause in ("effort unit", "effort kind") and h.cost < FITTED_NUMBER_COST
        if known and np.any(factors != 1.0):
            if holds_factors(reading, np.abs(factors)):
                yield h
            continue
        sizes = np.abs(np.log(np.abs(factors)))
        if h.cause != "gain" or (np.ptp(factors) > 0.0 and sizes.max() < np.log(LARGEST_FACTOR)):
            yield h
    if reading.base is None:
        yield from gravity_hypotheses(reading)
        yield from gravity_directions(reading, search=start.poor)
    yield from base_hypotheses(reading)
    for h in position_changes(reading):
        # units of positions and time are found by other checks, without a model
        if h.cause in ("position sign", "joint order") and h.reading.keeps_evidence:
            yield h
    yield from ratio_hypotheses(reading)
    if reading.payload is None and reading.base is None:  # more than one limb may carry
        loaded = reading.changed(payload=np.zeros(10))
        says = "the last link carries something"
        yield Hypothesis("payload", says, loaded, FITTED_NUMBER_COST, ())
    if reading.delay == declared.delay:
        for delay in TRIED_DELAYS:
            yield _late(reading, reading.delay + delay)


def _late(reading: Reading, delay: float) -> Hypothesis:
    more = delay - reading.likelihood.declared.delay
    says = f"efforts are {1e3 * abs(more):.3g} ms {'late' if more > 0 else 'early'}"
    return Hypothesis("effort delay", says, reading.changed(delay=delay), FITTED_NUMBER_COST, ())


FACTOR_CAUSES = ("gain", "effort kind", "effort unit")
COPIED: dict[str, Callable[[Reading, Reading], Reading]] = {
    "joint order": lambda a, b: a.changed(position=b.position, effort=b.effort),
    "position sign": lambda a, b: a.changed(
        position_scale=np.copysign(a.position_scale, b.position_scale)
    ),
    "effort sign": lambda a, b: a.changed(effort_scale=np.copysign(a.effort_scale, b.effort_scale)),
    "mounting": lambda a, b: a.changed(gravity=b.gravity),
    "effort delay": lambda a, b: a.changed(delay=b.delay),
    "payload": lambda a, b: a.changed(payload=b.payload),
    SENSOR_MOUNTING: lambda a, b: _base(a, b, "turn"),
    SENSOR_DELAY: lambda a, b: _base(a, b, "delay"),
    CONTACTS: lambda a, b: _base(a, b, "contacts", "factors", "in_world"),
} | dict.fromkeys(
    FACTOR_CAUSES,
    lambda a, b: a.changed(
        effort_scale=np.copysign(b.effort_scale, a.effort_scale),
        ratios=b.ratios,
        kind=b.kind,
        gravity=a.gravity if a.gravity.any() and b.gravity.any() else b.gravity,
        held=b.held,
    ),
)
"""What a reading becomes if what it says of a cause is replaced by what another one says."""


def _base(a: Reading, b: Reading, *names: str) -> Reading:
    """A reading with what another one says of its base."""
    if a.base is None or b.base is None:
        return a
    return a.changed(base=a.base.changed(**{name: getattr(b.base, name) for name in names}))


def undone(reading: Reading, declared: Reading, cause: str) -> Reading:
    """A reading that says of a cause what is declared."""
    return COPIED[cause](reading, declared) if cause in COPIED else declared


def alike(cause: str, a: Reading, b: Reading) -> bool:
    """Whether two readings say the same of a cause."""
    if cause == "joint order":
        return (a.position, a.effort) == (b.position, b.effort)
    if cause == "position sign":
        return np.array_equal(np.sign(a.position_scale), np.sign(b.position_scale))
    if cause == "effort sign":
        # by column, as an order moves them
        return np.array_equal(_signs_of_columns(a), _signs_of_columns(b))
    if cause == "mounting":
        size = float(np.linalg.norm(a.gravity) * np.linalg.norm(b.gravity))
        along = a.gravity @ b.gravity > np.cos(NEAR_AXIS_ANGLE) * size
        return bool(along) if size > 0.0 else not (a.gravity.any() or b.gravity.any())
    if cause == "effort delay":
        return abs(a.delay - b.delay) < DELAY_STEPS[0]
    if cause == "payload":
        return (a.payload is None) == (b.payload is None)
    if cause in OF_BASE:
        return a.base is None or b.base is None or _alike_base(cause, a.base, b.base)
    if cause == "effort kind" and COMPENSATED in (a.kind, b.kind):
        return a.kind == b.kind
    if cause in FACTOR_CAUSES:
        far = np.log(np.abs(a.effort_scale * a.ratios / b.effort_scale / b.ratios))
        typical = float(np.median(far))
        if cause == "effort unit":
            return bool(abs(typical) < np.log(SAME_UNIT))
        same = cause == "gain" or a.kind == b.kind
        return bool(same and np.all(np.abs(far - typical) < np.log(SAME_FACTOR)))
    return a.key == b.key


def _alike_base(cause: str, a: BaseReading, b: BaseReading) -> bool:
    if cause == SENSOR_DELAY:
        return abs(a.delay - b.delay) < DELAY_STEPS[-1]
    if cause == SENSOR_MOUNTING:
        return bool(np.trace(a.turn.T @ b.turn) > 1.0 + 2.0 * SAME_TURN)
    same = (a.contacts, a.in_world) == (b.contacts, b.in_world)
    return bool(same and np.isclose(a.factors, b.factors, rtol=OTHER_FACTOR - 1.0).all())


def mirror(reading: Reading) -> Reading:
    """All positions and all efforts of the other sign: mirrored bodies have the same effect."""
    return reading.changed(
        position_scale=-reading.position_scale, effort_scale=-reading.effort_scale
    )


def says_the_same(cause: str, a: Reading, b: Reading) -> bool:
    """Whether two readings say the same of a cause, or one and the mirror of the other do."""
    other = mirror(a)
    return alike(cause, a, b) or all(
        alike(x, other, b) for x in (cause, "position sign", "effort sign")
    )


def _signs_of_columns(reading: Reading) -> Array:
    signs = np.zeros(len(reading.effort))
    signs[list(reading.effort)] = np.sign(reading.effort_scale)
    return signs
