"""What a virtual robot really is: a model and its values, given or invented.

Coulomb friction by the plain sign is that of the fitted law: it sticks and slips. Other laws that
jump at zero speed would make an integration with fixed steps chatter; the plant turns them within a
smoothing speed of some thousandths of the working speed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen, records, set_fields
from steelyard.base.errors import ModelError
from steelyard.base.files import read_json
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS, description_of, term_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Axis, Find
from steelyard.model.terms.term import INVENTED_TORQUE_SHARE, ActsOnAxes, Role, StatefulTerm, Term
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import TIMESTEP, Brake, Rotor
from steelyard.simulate.typical_torques_and_masses import Scales, scales_of

SCHEMA = "steelyard-truth/2"
_WHERE = "truth of the virtual robot"


@dataclass(frozen=True, eq=False)
class Truth:
    """A virtual robot's model and its values."""

    model: Model
    values: Parameters  # all standard parameters of the model, in its order
    # speed over which laws that jump at zero speed turn, but for Coulomb friction by the plain
    # sign, per joint of `robot.joints`, shape `(n_joints,)` [rad/s; m/s]
    smoothing: Array

    def __post_init__(self) -> None:
        smoothing = frozen(self.smoothing, (self.model.robot.n_joints,))
        set_fields(self, values=self.model.at(self.values).values, smoothing=smoothing)
        if not np.all(self.smoothing > 0.0):
            raise _unusable("a smoothing speed is not positive", "give every joint one above zero")
        if not self.model.has_bodies:
            raise _unusable(
                "the true robot has no bodies", "add 'rigid_body' to the terms of its model"
            )
        for parameter, value in zip(self.model.parameters, self.values.values, strict=True):
            if not parameter.lower <= value <= parameter.upper:
                raise _unusable(
                    f"parameter '{parameter.name}' is {value:g}, which is out of its range",
                    f"give it a value between {parameter.lower:g} and {parameter.upper:g}",
                )

    @property
    def robot(self) -> Robot:
        """The robot; its nominal inertias play no part."""
        return self.model.robot

    @cached_property
    def inertial(self) -> Array:
        """Ten numbers per body in Pinocchio's order, shape `(n_bodies, 10)`."""
        names = [p.name for p in RigidBody().parameters(self.robot)]
        return frozen(np.reshape([self.values[name] for name in names], (-1, 10)))

    @cached_property
    def rotors(self) -> tuple[Rotor, ...]:
        """Rotor inertias, and how the rotors turn with the joints."""
        return tuple(Rotor(axis.row, value) for _, axis, value in self._along("rotor"))

    @cached_property
    def brakes(self) -> tuple[Brake, ...]:
        """Friction that sticks and slips: Coulomb friction by the plain sign."""
        found = self._along("brake")
        return tuple(Brake(axis.row, value, term.on_motors) for term, axis, value in found)

    def _along(self, role: Role) -> Iterator[tuple[Term, Axis, float]]:
        """Terms of a role with one parameter per coordinate: each with these and their values."""
        for term in self.model.terms:
            if term.role == role:
                axes = cast(ActsOnAxes, term).axes(self.robot)
                for axis, parameter in zip(axes, term.parameters(self.robot), strict=True):
                    yield term, axis, self.values[parameter.name]

    @cached_property
    def laws(self) -> tuple[Term, ...]:
        """The other terms: neither bodies nor rotor inertia nor what sticks and slips."""
        return tuple(term for term in self.model.terms if term.role == "effort")

    @property
    def law_values(self) -> Array:
        """Parameters of `laws`, one after another."""
        names = [p.name for term in self.laws for p in term.parameters(self.robot)]
        return frozen([self.values[name] for name in names])

    def changed(self, **values: float) -> "Truth":
        """The same truth with some values replaced; names with dots go in as `**{...}`."""
        full = {**self.values.as_dict(), **values}
        units = dict(zip(self.values.names, self.values.units, strict=True))
        parameters = Parameters(list(full), [units.get(n, "") for n in full], list(full.values()))
        return Truth(self.model, parameters, self.smoothing)

    def drifted(self, factor: float) -> "Truth":
        """The same truth with the parameters of all friction laws times a finite factor."""
        if not (np.isfinite(factor) and factor >= 0.0):
            raise ModelError(
                f"friction cannot become {factor:g} times as large",
                where="drift of friction",
                fix="give a factor such as 1.2",
            )
        names = self.model.friction_names
        return self.changed(**{name: factor * self.values[name] for name in names})

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON, by the names of parameters and joints; the robot by its name."""
        own, joints = self.values, [joint.name for joint in self.robot.joints]
        each = records(value=own.values, unit=own.units)
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "terms": [description_of(term) for term in self.model.terms],
            "parameters": dict(zip(own.names, each, strict=True)),
            "smoothing": dict(zip(joints, self.smoothing.tolist(), strict=True)),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot) -> "Truth":
        """The truth that `to_dict` wrote, of this robot."""
        if data.get("schema") != SCHEMA:
            raise _unusable(
                f"schema '{data.get('schema')}' instead of '{SCHEMA}'",
                "give a truth.json that this version of steelyard wrote",
            )
        terms = tuple(term_of(term, _WHERE) for term in data["terms"])
        given, model = data["parameters"], Model(robot, terms)
        speeds = data["smoothing"]
        wanted = {"parameters": set(model.names), "joints": {c.name for c in robot.joints}}
        for what, found in (("parameters", set(given)), ("joints", set(speeds))):
            if strange := sorted(found ^ wanted[what]):
                raise _unusable(
                    f"its {what} are not those of robot '{robot.name}': '{strange[0]}'",
                    "take the truth that was made for this robot",
                )
        return cls(
            model,
            Parameters(model.names, model.units, [given[name]["value"] for name in model.names]),
            frozen([speeds[c.name] for c in robot.joints]),
        )


def read_truth(path: Path, robot: Robot) -> tuple[Truth, Array | None]:
    """The truth in a file that a simulation wrote, and its drive gains, shape `(n,)`, if any."""
    fix = "give the truth.json of a simulation of this robot"

    def parse(data: Any) -> tuple[Truth, Array | None]:
        truth, gains = Truth.from_dict(data, robot), data.get("drive_gains")
        return truth, None if gains is None else frozen([gains[j] for j in robot.joint_names])

    return read_json(path, parse, what="the truth", damaged="the file is no truth", fix=fix)


def _unusable(wrong: str, fix: str) -> ModelError:
    return ModelError(wrong, where=_WHERE, fix=fix)


_LEAST_SMOOTHING = {"revolute": 0.005, "prismatic": 0.001}


def random_truth(
    robot: Robot, seed: int, spread: float = 0.15, terms: Sequence[Term] = DEFAULT_TERMS
) -> Truth:
    """An invented truth near the robot's nominal model.

    Inertias are the nominal ones seen through a random deformation of the body, so they are
    those of a consistent body; a link whose model file gives no mass properties, or impossible
    ones, becomes a ball of about 1 kg. Rotor inertia is drawn in proportion to the inertia that a
    coordinate moves, all other laws in proportion to its typical torque: at half of the robot's
    limits, a law loads a coordinate with 10 to 25 % of it. A `spread` of 0.15 moves masses and
    inertias by 20–30 %; fields of terms still to be found are drawn within their bounds.
    """
    rng = np.random.default_rng(seed)
    deformed = [
        b.inertia if b.massless else _deformed(_usable(b.inertia, b.known), rng, spread)
        for b in robot.bodies
    ]
    inertial = frozen([inertia.ten for inertia in deformed])
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
    """Values of a term's parameters.

    Each is a share of a size: of the value at which the parameter alone loads a joint with its
    typical torque, if the law does not say otherwise.
    """
    peaks = scales.peaks(term)
    torque = np.broadcast_to(scales.torque[:, None], peaks.shape)
    loads = np.divide(torque, peaks, out=np.full(peaks.shape, np.inf), where=peaks > 0.0)
    sizes = term.typical_values(robot, np.min(loads, axis=0), scales.inertia_along)
    least, most = INVENTED_TORQUE_SHARE
    parameters = term.parameters(robot)
    shares = [
        term.shares.get(p.name.split(".")[0], (least if p.lower >= 0.0 else -most, most))
        for p in parameters
    ]
    low, high = np.array(shares).reshape(-1, 2).T
    values = rng.uniform(low, high) * sizes
    return dict(zip((p.name for p in parameters), values.tolist(), strict=True))


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
