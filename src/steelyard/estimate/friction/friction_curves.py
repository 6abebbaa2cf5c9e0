r"""Friction of joints over speed, with its 95 % intervals.

One joint moves at constant speed, all others rest. Friction is linear in its parameters,
$\tau_f = J(\dot q)\,\phi_f$, so that its variance is $J C J^T$ with the covariance $C$ of the
parameters; their errors only, not what the laws lack.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Z95, Array, Parameters
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.model.model import ValuedModel
from steelyard.model.terms.stateful_terms import Presliding

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
    names, covariance = identified.model.friction_names, _friction_covariance(identified)
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


def _friction_covariance(identified: IdentifiedModel) -> Array:
    """Covariance of the parameters of friction, `(p, p)`; zero of those not identified."""
    estimate, names = identified.estimate, identified.model.friction_names
    known, full = estimate.parameters.names, estimate.covariance
    if estimate.standard is not None:
        known, full = estimate.standard.parameters.names, estimate.standard.covariance
    places = [known.index(name) if name in known else -1 for name in names]
    return np.asarray(np.pad(full, ((0, 1), (0, 1)))[np.ix_(places, places)])


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
