"""What a virtual robot really is: a model of any terms, and the values that it should be found by.

Coulomb friction by the plain sign is that of the fitted law: it sticks and slips. Other laws that
jump at zero speed would make an integration with fixed steps chatter; the plant turns them within a
smoothing speed of some thousandths of the working speed.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.model import Model
from steelyard.parameters import Parameters
from steelyard.robot.robot import Robot
from steelyard.terms.acting import ActsOnAxes
from steelyard.terms.axes import Axis
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.register import description_of, term_of
from steelyard.terms.term import Role, Term
from steelyard.virtual.mujoco_model import Brake, Rotor

SCHEMA = "steelyard-truth/2"
_WHERE = "truth of the virtual robot"


@dataclass(frozen=True, eq=False)
class Truth:
    """A virtual robot's model and its values.

    Attributes:
        model: The robot and all causes of its torque; `rigid_body` is one of them.
        values: All standard parameters of the model, in its order.
        smoothing: Speed over which laws that jump at zero speed turn, but for Coulomb friction by
            the plain sign, per joint of `robot.joints`, shape `(n_joints,)` [rad/s; m/s].
    """

    model: Model
    values: Parameters
    smoothing: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", self.model.at(self.values).values)
        joints = (self.model.robot.n_joints,)
        object.__setattr__(self, "smoothing", frozen(self.smoothing, joints))
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
        found = self._along("rotor")
        return tuple(Rotor(axis.row, value) for _, axis, value in found)

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
        """The same truth with the parameters of all friction laws times a factor.

        Raises:
            ModelError: The factor is no finite number from zero on.
        """
        if not (np.isfinite(factor) and factor >= 0.0):
            raise ModelError(
                f"friction cannot become {factor:g} times as large",
                where="drift of friction",
                fix="give a factor such as 1.2",
            )
        friction = {
            p.name
            for term in self.model.terms
            if term.cause == "friction"
            for p in term.parameters(self.robot)
        }
        return self.changed(**{n: factor * self.values[n] for n in friction})

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON, by the names of parameters and joints; the robot by its name."""
        names, units, values = self.values.names, self.values.units, self.values.values.tolist()
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "terms": [description_of(term) for term in self.model.terms],
            "parameters": {
                name: {"value": value, "unit": unit}
                for name, unit, value in zip(names, units, values, strict=True)
            },
            "smoothing": {
                joint.name: speed
                for joint, speed in zip(self.robot.joints, self.smoothing.tolist(), strict=True)
            },
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot) -> "Truth":
        """The truth that `to_dict` wrote, of this robot.

        Raises:
            ModelError: The values are no truth of this robot, or of another version.
        """
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
        values = [given[name]["value"] for name in model.names]
        return cls(
            model,
            Parameters(model.names, model.units, values),
            frozen([speeds[c.name] for c in robot.joints]),
        )


def read_truth(path: Path, robot: Robot) -> tuple[Truth, Array | None]:
    """The truth in a file that a simulation wrote, and its drive gains, shape `(n,)`, if any.

    Raises:
        ModelError: The file cannot be read, or is no truth of this robot.
    """
    fix = "give the truth.json of a simulation of this robot"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        truth = Truth.from_dict(data, robot)
        gains = data.get("drive_gains")
        return truth, None if gains is None else frozen([gains[j] for j in robot.joint_names])
    except OSError as error:
        raise ModelError(
            f"the truth cannot be read ({error.strerror})", where=str(path), fix=fix
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        lacking = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise ModelError(f"the file is no truth: {lacking}", where=str(path), fix=fix) from None


def _unusable(wrong: str, fix: str) -> ModelError:
    return ModelError(wrong, where=_WHERE, fix=fix)
