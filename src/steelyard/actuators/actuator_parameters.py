r"""What an actuator law contains: its parameters by joint, their units, and how they are searched.

The law is a position controller, `position_pd`: with the target $u$ and the position $q$ of a
joint, both in the joint's coordinate,

$$ \tau = \operatorname{clip}\bigl(k_p\, e + k_i \textstyle\int e - k_d\, \dot q,\ \pm
   \tau_{max}\bigr) - k_e\, \dot q, \qquad e = d_b(u(t - T) + c - q), $$

where the integral is held at the torque limit, $d_b$ is a dead band of half-width $b$, $T$ the
delay, $c$ what the controller's zero differs from the encoder's, and $k_e$ the back-EMF of a motor
whose voltage is limited: its largest torque falls with speed. The rotor's inertia $a$ and dry
friction of size $f + f_s e^{-(\dot q / v_s)^2} + \mu |\tau|$ act beside it. Bodies are those of the
model file, the one behind each joint times a factor on its mass.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen


@dataclass(frozen=True)
class Kind:
    """One parameter of the law.

    Attributes:
        name: Its name.
        unit: Its unit, on a revolute joint.
        positive: Whether its logarithm is searched.
        spread: Standard deviation of the prior: of the logarithm, or in the unit.
        default: Value where the law does not have it.
        of: Part of the law that it belongs to, if that is not its own.
    """

    name: str
    unit: str
    positive: bool
    spread: float
    default: float
    of: str = ""

    @property
    def part(self) -> str:
        """Part of the law that it belongs to."""
        return self.of or self.name


UNLIMITED = 1e9  # torque that no actuator has [Nm]

KINDS = (
    Kind("stiffness", "Nm/rad", True, 1.0, 1.0),
    Kind("integral", "Nm/(rad s)", True, 1.5, 0.0),
    Kind("damping", "Nm s/rad", True, 2.0, 1e-6),
    Kind("back_emf", "Nm s/rad", True, 2.0, 0.0),
    Kind("coulomb", "Nm", True, 2.0, 0.0),
    Kind("stribeck", "Nm", True, 1.5, 0.0),
    Kind("stribeck_speed", "rad/s", True, 1.0, 1.0, of="stribeck"),
    Kind("load_friction", "1", True, 1.5, 0.0),
    Kind("armature", "kg m²", True, 1.5, 1e-6),
    Kind("torque_limit", "Nm", True, 1.0, UNLIMITED),
    Kind("dead_band", "rad", True, 1.5, 0.0),
    Kind("offset", "rad", False, 0.003, 0.0),
    Kind("zero", "rad", False, 0.5, 0.0),
    Kind("mass_factor", "1", True, 0.2, 1.0),
    Kind("delay", "s", False, 0.05, 0.0),
)
BY_NAME = {kind.name: kind for kind in KINDS}
IN_STEP = (
    *("stiffness", "integral", "damping", "back_emf", "coulomb", "stribeck", "stribeck_speed"),
    *("load_friction", "armature", "torque_limit", "dead_band", "mass_factor"),
)
"""Parameters that are inputs of the step."""


@dataclass(frozen=True, eq=False)
class ActuatorValues:
    """Values of all parameters by name, `(n,)` each; `signs` of the log's joints against the model.

    Positions of the model are `signs * logged + zero`.
    """

    values: Mapping[str, Array]
    signs: Array

    @classmethod
    def of(cls, signs: Sequence[float], **given: Any) -> "ActuatorValues":
        """Values of some parameters, the others their defaults."""
        n = len(signs)
        full = {
            kind.name: frozen(np.broadcast_to(given.get(kind.name, kind.default), (n,)))
            for kind in KINDS
        }
        return cls(full, frozen(signs))

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.signs)

    def changed(self, **given: Any) -> "ActuatorValues":
        """The same with other values of some parameters."""
        return ActuatorValues.of(self.signs.tolist(), **{**self.values, **given})


@dataclass(frozen=True)
class Free:
    """A parameter that is searched: its name and its joint; joint -1 for one that all share."""

    name: str
    joint: int

    @property
    def kind(self) -> Kind:
        """What is known of the parameter."""
        return BY_NAME[self.name]

    def at(self, values: ActuatorValues) -> float:
        """Where it is in the search: its logarithm if it is positive."""
        value = float(values[self.name][self.joint])
        return float(np.log(value)) if self.kind.positive else value

    def slope(self, values: ActuatorValues) -> float:
        """Derivative of the parameter by where it is in the search."""
        return float(values[self.name][self.joint]) if self.kind.positive else 1.0


def free_parameters(
    parts: Sequence[str], joints: Mapping[str, Sequence[int]], n: int
) -> tuple[Free, ...]:
    """All that is searched for a law: parameters of its parts at all joints, or at some only.

    The part `delay` is one for all joints, `delays` one for each.
    """
    return tuple(_free(parts, joints, n))


def _free(parts: Sequence[str], joints: Mapping[str, Sequence[int]], n: int) -> Iterator[Free]:
    for part in parts:
        if part == "delay" and joints.get("delay", [-1]):
            yield Free("delay", -1)
        elif part == "delays":
            yield from (Free("delay", j) for j in joints.get("delay", range(n)))
        else:
            for kind in KINDS:
                if kind.part == part != "delay":
                    yield from (Free(kind.name, j) for j in joints.get(kind.name, range(n)))


LARGEST_STEP = 1.0  # of a logarithm, in one step of the search


def moved(values: ActuatorValues, free: Sequence[Free], step: Array) -> ActuatorValues:
    """The values after a step of the search."""
    new = {name: array.copy() for name, array in values.values.items()}
    for one, by in zip(free, step, strict=True):
        joints = slice(None) if one.joint < 0 else one.joint
        if one.kind.positive:
            new[one.name][joints] *= np.exp(np.clip(by, -LARGEST_STEP, LARGEST_STEP))
        else:
            new[one.name][joints] += by
    new["delay"] = np.maximum(new["delay"], 0.0)
    return ActuatorValues({name: frozen(array) for name, array in new.items()}, values.signs)
