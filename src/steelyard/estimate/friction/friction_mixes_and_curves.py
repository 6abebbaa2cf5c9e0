r"""Mixes of friction laws, whether logs contain enough motion for them; friction over speed.

Friction laws are compared by leaving out a fifth of the motion (or one run) in turn. Every part
should have motion of every joint at several speeds, over a distance at which laws with internal
states become usable (three of their lengths), and all parts together motion in both directions.
With fewer data no laws can be distinguished; with these, the comparison itself keeps Coulomb
friction unless another law is significantly better.

For a curve over speed, one joint moves at constant speed, all others rest. Friction is linear in
its parameters, $\tau_f = J(\dot q)\,\phi_f$, so that its variance is $J C J^T$ with the covariance
$C$ of the parameters; their errors only, not what the laws lack.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import groupby
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array, Parameters
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.cross_validation import FOLDS
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Cubic,
    DirectionalCoulomb,
    DirectionalStribeck,
    DirectionalViscous,
    Quadratic,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent, LuGre, MaxwellSlip
from steelyard.model.laws.laws_without_friction import Offset, Spring
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.stateful_terms import Presliding
from steelyard.model.terms.term import Term
from steelyard.robot.file.sections import EffortKind
from steelyard.robot.robot import Coordinate, Robot

Mix = tuple[Term, ...]  # friction laws that act together
Stage = tuple[Mix, ...]  # candidates, the simplest first

FINE = (3e-4, 1e-3, 3e-3, 1e-2)
WIDE = (1e-3, 4e-3, 2e-2, 1e-1)

DIRECTION: Stage = (
    (Coulomb(),),
    *((Coulomb(smoothing=speed),) for speed in (0.005, 0.02, 0.05)),
    *((Dahl(length=length),) for length in (3e-4, 1e-3, 3e-3, 1e-2)),
    *(
        (LuGre(length=length, breakaway=1.15, speed=speed),)
        for length in (3e-4, 1e-3)
        for speed in (0.1, 0.3)
    ),
    (MaxwellSlip(lengths=FINE),),
    (MaxwellSlip(lengths=WIDE, relaxing=True),),
    (Coulomb(), MaxwellSlip(lengths=FINE)),
)
"""How friction turns round with the direction of motion, the simplest first."""

SPEED: Stage = (
    (Viscous(),),
    (Viscous(), Root()),
    (Viscous(), Quadratic()),
    (Viscous(), Cubic()),
    *((Viscous(), Stribeck(speed=speed)) for speed in (0.02, 0.1)),
    (DirectionalViscous(),),
    *((Viscous(), DirectionalStribeck(speed=speed)) for speed in (0.02, 0.1)),
)
"""How friction grows with speed; with an offset, Coulomb friction is directional as it is."""

PLAIN: Mix = (*DIRECTION[0], *SPEED[0])  # with which others are compared
LOADED = ("motor_current", "motor_torque")  # efforts behind gears: friction grows with load

LOAD: Stage = ((), (LoadDependent(length=1e-3),))  # whether friction grows with the load

LEVER = 0.1  # arm at which a prismatic joint's speeds and lengths are those of a revolute one [m]

SPRINGS: Stage = ((), (Spring(),))  # whether cables or springs pull the joints


def stages_of(
    model: Model, kind: EffortKind, left_out: Literal["run", "segment"]
) -> tuple[Stage, ...]:
    """The candidates for a model without friction, stage by stage.

    Laws of speed act along further coordinates as well, where the model has viscous friction along
    them. A spring that the model has is no candidate; nor are springs where stretches are left out
    in turn, which share the postures of one motion and cannot tell them from what else depends on
    posture.
    """
    aside = [x for x in model.terms if isinstance(x, Viscous) and (x.along or x.motors)]

    def everywhere(laws: Mix) -> Mix:
        return laws + tuple(
            replace(cast(Any, law), joints=x.joints, motors=x.motors, along=x.along)
            for law in laws[1:]
            for x in aside
        )

    offset = any(isinstance(term, Offset) for term in model.terms)
    direction = DIRECTION if offset else (*DIRECTION, (DirectionalCoulomb(),))
    stages = [_sized(direction, model.robot), _sized([*map(everywhere, SPEED)], model.robot)]
    if kind in LOADED:
        stages.append(_sized(LOAD, model.robot))
    if left_out == "run" and not any(isinstance(term, Spring) for term in model.terms):
        stages.append(SPRINGS if offset else ((), (Spring(free="unknown"),)))
    return tuple(stages)


ANY_SPEED: Mix = (Quadratic(), Cubic(), Stribeck(speed=0.1))
"""Beside Coulomb and viscous friction: about any friction that depends on speed."""


def with_any_speed(model: Model) -> Model:
    """The model with friction as about any function of speed, where it has Coulomb friction.

    For what is estimated beside friction: what a law lacks would move it.
    """
    laws = {term.law for term in model.terms}
    if Coulomb.law not in laws:
        return model
    more = [law for law in _sized([ANY_SPEED], model.robot)[0] if law.law not in laws]
    return replace(model, terms=(*model.terms, *more))


def _sized(stage: Sequence[Mix], robot: Robot) -> Stage:
    """The candidates with speeds and lengths of prismatic joints as at a lever."""
    sizes = [LEVER if c.kind == "prismatic" else 1.0 for c in robot.coordinates[robot.n_base :]]
    if LEVER not in sizes:
        return tuple(stage)

    def sized(term: Term) -> Term:
        if any(getattr(term, name, None) for name in ("joints", "motors", "along")):
            return term
        given = {name: getattr(term, name) for name in term.bounds}
        wanted = {name: tuple(value * x for x in sizes) for name, value in given.items() if value}
        return cast(Term, replace(cast(Any, term), **wanted)) if wanted else term

    return tuple(tuple(map(sized, mix)) for mix in stage)


def mix_name(terms: Sequence[Term]) -> str:
    """A mix for people to read: laws with their speeds and lengths, and what else is not usual."""
    names = []
    for term in terms:
        values = {f: getattr(term, f.name) for f in fields(term)}  # type: ignore[arg-type]
        given = [
            f.name if value is True else f"{f.name} {_short(value)}"
            for f, value in values.items()
            if f.name not in term.unnamed and value
            if f.name in term.bounds or value != f.default
        ]
        names.append(f"{term.law} ({', '.join(given)})" if given else term.law)
    return " + ".join(names)


def _short(value: object) -> str:
    if isinstance(value, tuple) and value and isinstance(value[0], tuple):
        return ", ".join(str(name) for name, _ in value)
    if isinstance(value, tuple):
        alike = [(x, len(list(same))) for x, same in groupby(value)]
        return ", ".join(_short(x) + (f" x {n}" if n > 1 else "") for x, n in alike)
    return f"{value:g}" if isinstance(value, float) else str(value)


LENGTHS = 3.0  # lengths of a law's state that a joint travels until its samples are used
SPEEDS = 2.0  # fast over slow motion (quantiles 0.9 and 0.1) from which on speeds differ
SLOWEST = 0.03  # speed up to which a joint rests, relative to its fastest


@dataclass(frozen=True)
class JointMotion:
    """Motion of one joint over all logs."""

    reversals: int
    travel: float  # distance travelled [rad; m]
    speeds: float  # fast over slow motion, quantiles 0.9 and 0.1 of the speed in motion


def joint_motions(logs: Sequence[tuple[Array, NDArray[np.intp], float]]) -> tuple[JointMotion, ...]:
    """Motion of each joint.

    A log is velocities `(n, B)` [rad/s; m/s], the number of the stretch that each sample lies in
    `(B,)`, and the time between samples [s].
    """
    n = len(logs[0][0])
    fastest = [max(float(np.quantile(np.abs(dq[j]), 0.98)) for dq, _, _ in logs) for j in range(n)]
    found = []
    for joint in range(n):
        reversals, travel, speeds = 0, 0.0, [np.zeros(0)]
        for dq, stretch, step in logs:
            moving = np.abs(dq[joint]) > SLOWEST * fastest[joint]
            for number in np.unique(stretch[moving]):
                signs = np.sign(dq[joint][moving & (stretch == number)])
                reversals += int(np.count_nonzero(np.diff(signs)))
            travel += float(np.abs(dq[joint]).sum()) * step
            speeds.append(np.abs(dq[joint])[moving])
        every = np.concatenate(speeds)
        slow, fast = np.quantile(every, (0.1, 0.9)) if len(every) else (1.0, 0.0)
        found.append(JointMotion(reversals, travel, float(fast / slow)))
    return tuple(found)


def lacking(motions: Sequence[JointMotion], coordinates: Sequence[Coordinate]) -> tuple[str, ...]:
    """What is missing for `friction = "auto"`, one sentence per joint; none if nothing is."""
    found = []
    for motion, coordinate in zip(motions, coordinates, strict=True):
        size = LEVER if coordinate.kind == "prismatic" else 1.0
        least = FOLDS * LENGTHS * max(WIDE) * size
        if motion.reversals == 0:
            found.append(f"{coordinate.name} moves in one direction only")
        elif motion.travel < least:
            found.append(
                f"{coordinate.name} travels {motion.travel:.2g} {coordinate.unit} "
                f"({least:.2g} needed)"
            )
        elif motion.speeds < SPEEDS:
            found.append(f"{coordinate.name} moves at one speed only")
    return tuple(found)


GRID = 60  # speeds on each side of zero
DENSITY = 2.5  # power by which the speeds are denser near zero

TRAVEL = 2.0 * np.pi
"""Travel between two speeds where friction has memory, which has then settled [rad; m]: a whole
turn, after which the posture of a revolute joint is the same."""


@dataclass(frozen=True, eq=False)
class FrictionCurve:
    """Friction of one joint over rising speeds, shape `(G,)` [rad/s; m/s].

    Efforts of the model and half-widths of their 95 % intervals are of the same shape [Nm; N].
    """

    joint: str
    speed: Array
    effort: Array
    half_width: Array


def friction_curves(
    identified: IdentifiedModel, postures: Array, fastest: Array
) -> tuple[FrictionCurve, ...]:
    """The friction of every joint whose friction was identified.

    Joints of closed loops that do not close at their posture, or on the travel that friction with
    memory needs, have no curve. Of the postures `(n, n)` [rad; m], one row for each joint's curve,
    only friction that depends on load depends; `fastest` is the largest speed of each curve, `(n,)`
    [rad/s; m/s].
    """
    names, estimate = identified.model.friction_names, identified.estimate
    covariance = (estimate.standard or estimate).covariance_of(names)
    curves = []
    for j, joint in enumerate(identified.joints):
        speed = fastest[j] * np.linspace(1.0, 0.5 / GRID, GRID) ** DENSITY
        falling, rising = (
            _side(identified.valued, j, names, postures[j], side) for side in (-speed, speed)
        )
        if falling is None or rising is None:
            continue
        jacobian = np.concatenate([falling, rising[::-1]])
        if fastest[j] > 0.0 and np.any(jacobian @ covariance):
            values = np.array([identified.valued.values[name] for name in names])
            variance = np.einsum("gp,pq,gq->g", jacobian, covariance, jacobian)
            half = Z95 * np.sqrt(np.maximum(variance, 0.0))
            both = np.concatenate([-speed, speed[::-1]])
            curves.append(FrictionCurve(joint, both, jacobian @ values, half))
    return tuple(curves)


def _side(
    valued: ValuedModel, j: int, names: Sequence[str], posture: Array, speed: Array
) -> Array | None:
    """Friction of joint `j` per unit of each parameter, shape `(G, p)`.

    The first speed is held once before, so that memory has settled there too. `None` if the
    robot's loops do not close on the way.
    """
    model, speed = valued.model, np.append(speed[:1], speed)
    q, dq = np.repeat(posture[:, None], len(speed), axis=1), np.zeros((len(posture), len(speed)))
    dq[j] = speed
    if any(isinstance(term, Presliding) for term in model.terms):
        q[j] += np.sign(speed) * TRAVEL * np.arange(len(speed))
    ddq = np.zeros_like(q)
    scan = model.scan(drop=True)
    channels = scan(q, dq, ddq)
    if not scan.closed.all():
        return None

    def response(name: str) -> Array:
        unit = [float(own == name) for own in model.names]
        of_one = ValuedModel(model, Parameters(model.names, model.units, unit))
        return of_one.block(q, dq, ddq, channels)[j, 1:]

    return np.array([response(name) for name in names]).reshape(len(names), len(speed) - 1).T
