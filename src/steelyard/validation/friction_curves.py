r"""The friction of each joint over its speed, as identified, with its 95 % interval.

One joint moves at constant speed, all others rest. Friction is linear in its parameters,
$\tau_f = J(\dot q)\,\phi_f$, so that its variance is $J C J^T$ with the covariance $C$ of the
parameters; their errors only, not what the laws lack.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.estimate import Z95
from steelyard.estimation.identified import IdentifiedModel
from steelyard.model import ValuedModel
from steelyard.parameters import Parameters
from steelyard.terms.memory import Presliding

GRID = 60
"""Speeds on each side of zero."""

DENSITY = 2.5
"""Power by which the speeds are denser near zero."""

TRAVEL = 2.0 * np.pi
"""Travel between two speeds where friction has memory, which has then settled [rad; m]: a whole
turn, after which the posture of a revolute joint is the same."""


@dataclass(frozen=True, eq=False)
class FrictionCurve:
    """Friction of one joint over speed.

    Attributes:
        joint: The joint.
        speed: Rising, shape `(G,)` [rad/s; m/s].
        effort: Friction of the model, shape `(G,)` [Nm; N].
        half_width: Of its 95 % interval, shape `(G,)` [Nm; N].
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
    memory needs, have no curve.

    Args:
        identified: The model.
        postures: Positions of all independent joints, one row for each joint's curve, on which
            only friction that depends on load depends, shape `(n, n)` [rad; m].
        fastest: Largest speed of each curve, shape `(n,)` [rad/s; m/s].
    """
    names, covariance = _friction(identified)
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


def _friction(identified: IdentifiedModel) -> tuple[list[str], Array]:
    """Names of the parameters of friction, `p` of them, and their covariance, `(p, p)`.

    Those that the data do not identify have no variance, like their value.
    """
    model, estimate = identified.model, identified.estimate
    names = [
        parameter.name
        for term in model.terms
        if term.cause == "friction"
        for parameter in term.parameters(model.robot)
    ]
    known, full = estimate.parameters.names, estimate.covariance
    if estimate.standard is not None:
        known, full = estimate.standard.parameters.names, estimate.standard.covariance
    places = [known.index(name) if name in known else -1 for name in names]
    padded = np.pad(full, ((0, 1), (0, 1)))
    return names, padded[np.ix_(places, places)]


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
