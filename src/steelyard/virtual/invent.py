"""Inventing a truth: bodies near the nominal ones, and values for whatever terms there are."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, cast

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.model import Model
from steelyard.parameters import Parameter, Parameters
from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Robot
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.open_fields import Find
from steelyard.terms.register import DEFAULT_TERMS
from steelyard.terms.term import SHARE, StatefulTerm, Term
from steelyard.virtual.mujoco_model import TIMESTEP
from steelyard.virtual.scales import Scales, scales_of
from steelyard.virtual.truth import Truth

_LEAST_SMOOTHING = {"revolute": 0.005, "prismatic": 0.001}


def random_truth(
    robot: Robot, seed: int, spread: float = 0.15, terms: Sequence[Term] = DEFAULT_TERMS
) -> Truth:
    """An invented truth near the robot's nominal model.

    Inertias are the nominal ones seen through a random deformation of the body, so they are
    those of a consistent body; a link whose model file gives no mass properties, or impossible
    ones, becomes a ball of about 1 kg. Rotor inertia is drawn in proportion to the inertia that a
    coordinate moves, all other laws in proportion to its typical torque: at half of the robot's
    limits, a law loads a coordinate with 10 to 25 % of it.

    Args:
        robot: The robot.
        seed: Same seed, same truth.
        spread: Size of the deformation; 0.15 moves masses and inertias by 20–30 %.
        terms: Causes of torque; fields still to be found are drawn within their bounds.
    """
    rng = np.random.default_rng(seed)
    inertial = frozen(
        [
            b.inertia.ten if b.massless else _deformed(_usable(b.inertia, b.known), rng, spread).ten
            for b in robot.bodies
        ]
    )
    scales = scales_of(robot, inertial)
    names = [p.name for p in RigidBody().parameters(robot)]
    bodies = dict(zip(names, inertial.ravel().tolist(), strict=True))
    chosen = tuple(_with_drawn_fields(term, bodies, rng) for term in terms)
    model = Model(robot, chosen)
    values = dict(bodies)
    for term in chosen:
        if term.role != "body":
            values |= _drawn(term, robot, scales, rng)
    known = Parameters(model.names, model.units, [values[name] for name in model.names])
    return Truth(model, known, _smoothing(robot, model, known, scales))


def _with_drawn_fields(term: Term, bodies: dict[str, float], rng: np.random.Generator) -> Term:
    """The term with its open fields drawn; loads are those of the true bodies."""
    drawn: dict[str, Any] = {}
    for field in fields(cast(Any, term)):
        given = getattr(term, field.name)
        if isinstance(given, Find):
            low, high = np.log([given.lower, given.upper])
            drawn[field.name] = float(np.exp(low + rng.uniform(0.4, 0.6) * (high - low)))
    found = cast(Term, replace(cast(Any, term), **drawn)) if drawn else term
    return found.with_reference(bodies)


def _drawn(term: Term, robot: Robot, scales: Scales, rng: np.random.Generator) -> dict[str, float]:
    """Values of a term's parameters."""
    parameters = term.parameters(robot)
    sizes = _sizes(term, robot, scales)
    bounds = [_share(term, parameter) for parameter in parameters]
    low, high = np.array(bounds).reshape(-1, 2).T
    values = rng.uniform(low, high) * sizes
    return dict(zip((p.name for p in parameters), values.tolist(), strict=True))


def _share(term: Term, parameter: Parameter) -> tuple[float, float]:
    """Of what a parameter is measured by, the least and the largest share."""
    usual = SHARE if parameter.lower >= 0.0 else (-SHARE[1], SHARE[1])
    return term.shares.get(parameter.name.split(".")[0], usual)


def _sizes(term: Term, robot: Robot, scales: Scales) -> Array:
    """What the parameters are measured by, shape `(parameters,)`.

    That value at which the parameter alone loads a joint with its typical torque, if the law does
    not say otherwise.
    """
    peaks = scales.peaks(term)
    torque = np.broadcast_to(scales.torque[:, None], peaks.shape)
    loads = np.divide(torque, peaks, out=np.full(peaks.shape, np.inf), where=peaks > 0.0)
    return term.typical_values(robot, np.min(loads, axis=0), scales.inertia_along)


def _usable(nominal: Inertia, known: bool) -> Inertia:
    """The nominal body, or a ball where it is not physically consistent."""
    if nominal.flaw() is None and (known or nominal.mass > 0.0):
        return nominal
    return Inertia.about_com(1.0, [0.0, 0.0, 0.05], np.eye(3) * 1.5e-3)


def _deformed(nominal: Inertia, rng: np.random.Generator, spread: float) -> Inertia:
    r"""The body $J = L\,E E^T L^T$ with $J_0 = L L^T$ and $E$ random around the unit matrix.

    Any such $J$ is positive semidefinite: the body exists.
    """
    values, vectors = np.linalg.eigh(nominal.pseudo)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    deformed = root @ (np.eye(4) + spread * rng.standard_normal((4, 4)))
    return Inertia.from_pseudo(deformed @ deformed.T)


def _smoothing(robot: Robot, model: Model, values: Parameters, scales: Scales) -> Array:
    r"""Smoothing speeds that an explicit step `h` of 0.125 ms follows, shape `(n_joints,)`.

    Near zero speed a law that jumps by $\pm f$ damps with $f / v_s$; the step is well inside its
    range of stability if $h\,(M^{-1})_{jj}\,f / v_s \le 1/2$ at every posture.
    """
    truth = Truth(model, values, np.ones(robot.n_joints))
    rows = (r.inertia * np.outer(r.row, r.row) for r in truth.rotors)
    added = sum(rows, np.zeros((1, 1)))
    mobility = np.diagonal(np.linalg.inv(scales.masses + added), axis1=1, axis2=2).max(axis=0)
    least = np.array([_LEAST_SMOOTHING[joint.kind] for joint in robot.joints])
    known = values.as_dict()
    jump = np.zeros(robot.n_joints)
    for term in truth.laws:
        if not isinstance(term, StatefulTerm):
            own = np.array([known[p.name] for p in term.parameters(robot)])
            jump += scales.jumps(term, least) @ np.abs(own)
    return frozen(np.maximum(least, 2.0 * TIMESTEP * mobility * jump))
