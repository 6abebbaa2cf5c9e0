"""A model: a robot and the causes of its torque, linear in parameters; that of a robot file."""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, Parameters
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError
from steelyard.model.compiled_quantity import CompiledQuantity, Stepper
from steelyard.model.dynamics import Dynamics
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RotorInertia
from steelyard.model.laws.register import DEFAULT_TERMS, refuse_unfit, term_of
from steelyard.model.terms.term import Term
from steelyard.model.torque_and_quantities import Equations, Quantity
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot, robot_from_dict


@dataclass(frozen=True, eq=False, repr=False)
class Model(Equations):
    """A robot and its terms; values of the parameters are not part of it.

    Attributes:
        robot: The robot.
        terms: Causes of torque; their columns stand side by side in this order.

    Example:
        >>> arm = load_robot("arm.toml").robot
        >>> Model(arm, (terms.RigidBody(), terms.Viscous()))
        Model(Robot('arm', 2 joints), rigid_body, viscous: 22 parameters)
    """

    robot: Robot
    terms: tuple[Term, ...] = DEFAULT_TERMS

    def __repr__(self) -> str:
        laws = ", ".join(term.law for term in self.terms)
        return f"Model({self.robot!r}, {laws}: {len(self.parameters)} parameters)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        strange = [term for term in self.terms if not isinstance(term, Term)]
        if strange or not isinstance(self.robot, Robot):
            wrong, kind = (strange[0], "term") if strange else (self.robot, "robot")
            raise ModelError(
                f"{wrong!r} is no {kind}",
                where="robot and terms of a model",
                fix="give a Robot, such as load_robot(FILE).robot, and terms such as "
                "terms.Viscous()",
            )
        names = [parameter.name for parameter in self.parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ModelError(
                f"two terms have the same parameter '{twice[0]}'",
                where=f"list of terms of robot '{self.robot.name}'",
                fix="give each joint each law once (see the terms' `joints`)",
            )

    @property
    def has_bodies(self) -> bool:
        """Whether rigid bodies are among the terms."""
        return any(term.role == "body" for term in self.terms)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Model":
        """The model that `to_dict` wrote."""
        terms = tuple(term_of(t, "list of terms of a saved model") for t in data["terms"])
        return cls(robot_from_dict(data["robot"]), terms)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything the model's columns depend on."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()

    def compiled(self, quantity: Quantity) -> CompiledQuantity:
        """A quantity's machine code, kept."""
        found = self._compiled.get(quantity)
        if found is None:
            part, place = quantity.part(self), {name: k for k, name in enumerate(self.names)}
            columns = [place[name] for name in part.names]
            found = CompiledQuantity(quantity, part, columns, quantity.code(part))
            self._compiled[quantity] = found
        return found

    @cached_property
    def _compiled(self) -> dict[Quantity, CompiledQuantity]:
        return {}

    def at(self, values: Parameters) -> "ValuedModel":
        """The model with values; standard parameters that are not named are zero.

        It is a `DataError` if a value belongs to no parameter of the model.
        """
        known = values.as_dict()
        strange = [name for name in known if name not in self.names]
        if strange:
            raise DataError(
                f"the model of '{self.robot.name}' has no parameter '{strange[0]}'",
                where="values of the parameters",
                fix=f"its parameters are {', '.join(self.names[:12])}, ...",
            )
        full = [known.get(name, 0.0) for name in self.names]
        return ValuedModel(self, Parameters(self.names, self.units, full))

    @property
    def prior(self) -> "ValuedModel | None":
        """The nominal model of the robot's file: its bodies, no friction; `None` if unknown."""
        if not all(body.known for body in self.robot.bodies):
            return None
        values = [p.prior if p.prior is not None else 0.0 for p in self.parameters]
        return ValuedModel(self, Parameters(self.names, self.units, values))


@dataclass(frozen=True, eq=False, repr=False)
class ValuedModel(Dynamics):
    """A model with values of its standard parameters; base ones are standard ones, others zero."""

    model: Model
    values: Parameters

    def __repr__(self) -> str:
        return f"ValuedModel({self.model!r})"

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.model.robot

    def evaluate(self, quantity: Quantity, *arguments: ArrayLike, t: Array | None = None) -> Array:
        """A quantity at one configuration or along samples; see `Dynamics.evaluate`."""
        return self.model.compiled(quantity).along(self.values.values, arguments, t)

    def block(self, q: Array, dq: Array, ddq: Array, channels: Array | None = None) -> Array:
        """Efforts of one block, joint-major; `q`, `dq`, `ddq` `(n, B)`, `channels` `(_, B)`."""
        channels = np.empty((0, q.shape[1])) if channels is None else channels
        return self.model.torque_code([q, dq, ddq, channels, self.values.values])

    def start(self) -> Stepper:
        """Begin to evaluate sample by sample, for controllers and streams."""
        return Stepper(self.model.robot, self.model.compiled, self.values.values)


def model_with_open_friction(loaded: LoadedRobot) -> Model:
    """The model of a robot file, with the customary terms where it names none.

    Where friction is to be chosen, it is left out; on the link side no rotor is felt.
    """
    behind = loaded.signals is not None and loaded.signals.effort_kind == "link_torque"
    if loaded.terms is None:
        left: tuple[type[Any], ...] = (RotorInertia,) if behind else ()
        left += (Coulomb, Viscous) if loaded.friction else ()
        return Model(loaded.robot, tuple(t for t in DEFAULT_TERMS if not isinstance(t, left)))
    terms = tuple(term_of(t.description, t.where) for t in loaded.terms)
    gears = loaded.robot.transmission
    motors = set(gears.motors if gears else ()) - set(loaded.robot.joint_names)
    for term, spec in zip(terms, loaded.terms, strict=True):
        refuse_unfit(term, loaded.robot, spec.where)
        named = {name for pair in getattr(term, "pairs", ()) for _, name in pair}
        if behind and (term.on_motors or named & motors):
            raise ModelError(
                f"term '{term.law}' acts on the motors' side, but efforts are link torques, "
                "on the link side",
                where=spec.where,
                fix='leave it out, or use kind = "joint_torque" if efforts are computed from '
                "motor currents",
            )
    return Model(loaded.robot, terms)


def with_friction(model: Model, loaded: LoadedRobot) -> Model:
    """The model with Coulomb and viscous friction where a robot file leaves friction open."""
    return replace(model, terms=(*model.terms, Coulomb(), Viscous())) if loaded.friction else model


@checked()
def model_of(robot: str | Path | LoadedRobot) -> Model:
    """The model that a robot file describes.

    Its terms are those of the file, or rigid bodies, rotors, Coulomb and viscous friction and
    offsets where it names none.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.

    Raises:
        SteelyardError: The file cannot be used.

    Example:
        >>> model_of("arm.toml").robot.n
        2
    """
    loaded = load_robot(robot)
    return with_friction(model_with_open_friction(loaded), loaded)
