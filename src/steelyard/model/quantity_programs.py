r"""Quantities of a model as programs: what each reads, which terms enter it, how it is traced.

With bodies and rotors $\tau = M(q)\,\ddot q + b(q, \dot q)$, and $\tau$ as a whole has friction,
springs and offsets beside them. All programs read the arrays that `Quantity.arguments` names, the
channels of the terms that enter, and their standard parameters.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.base.errors import DataError, ModelError
from steelyard.model.equations.closed_chains import completed, projected
from steelyard.model.equations.forward_dynamics import accelerations
from steelyard.model.equations.frame_kinematics import frame_of, frame_outputs
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms.friction_memory import Presliding
from steelyard.model.terms.term import StatefulTerm, Term
from steelyard.model.torque_equations import Equations
from steelyard.robot.robot import Frame, Robot
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program

Given = Mapping[str, Scalars]
"""Symbols of the arguments, of `channels` and of `parameters`, by name."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity of a model with values, of arguments among `q`, `dq`, `ddq` and `tau`.

    `build` makes its entries of the terms that enter and of symbols, in C order; the `key` is what
    else its program depends on, as JSON. With a `pivot` the last entry is the least one of a mass
    matrix; it must be positive.
    """

    name: str
    arguments: tuple[str, ...]
    enters: Callable[[Term], bool]
    build: Callable[[Equations, Given], Scalars]
    shape: Callable[[Equations], tuple[int, ...]]
    key: tuple[Any, ...] = ()
    pivot: bool = False

    def part(self, equations: Equations) -> Equations:
        """The equations with the terms only that enter.

        It is a `ModelError` if accelerations are asked for, and a term depends on them beside the
        inertia.
        """
        loaded = [
            t.law
            for t in equations.terms
            if t.needs_reference or isinstance(t, StatefulTerm) and not isinstance(t, Presliding)
        ]
        if loaded and "tau" in self.arguments:
            raise ModelError(
                f"{self.name}: '{loaded[0]}' depends on the acceleration that is looked for",
                where=f"model of '{equations.robot.name}'",
                fix='identify with friction = "auto_memoryless", or with laws such as coulomb and '
                "viscous",
            )
        return Equations(equations.robot, tuple(filter(self.enters, equations.terms)))

    def program(self, part: Equations) -> Program:
        """The arguments, channels and shared parameters of a part to the entries."""
        from steelyard.symbolic.symbols_and_tracing import symbolic

        inputs = (
            *(Input(name, part.robot.n) for name in self.arguments),
            Input("channels", part.n_channels),
            Input("parameters", len(part.parameters), shared=True),
        )
        names = [array.name for array in inputs]
        return symbolic(lambda *x: self.build(part, dict(zip(names, x, strict=True))), inputs)

    def code(self, part: Equations) -> Code:
        """The program as machine code."""
        description = [self.name, *self.key, part.program_key]
        return compiled(description, lambda: (self.program(part), {}))

    def step_program(self, part: Equations) -> Program:
        """As `program`, with friction's memory before a step, and after it behind the entries.

        Inputs are the arguments, passive positions, memory, and shared parameters.
        """
        from steelyard.symbolic.symbols_and_tracing import symbolic

        n, rest = part.robot.n, [0.0] * part.robot.n
        inputs = (
            *(Input(name, n) for name in self.arguments),
            Input("passive", len(part.robot.passive)),
            Input("memory", part.n_memory),
            Input("parameters", len(part.parameters), shared=True),
        )

        def build(*x: Scalars) -> list[Scalar]:
            given = dict(zip([array.name for array in inputs], x, strict=True))
            dq, ddq = given.get("dq", rest), given.get("ddq", rest)
            state = JointState(given["q"], dq, ddq, given["passive"])
            memory, channels = part.stepped(state, given["memory"])
            return [*self.build(part, {**given, "channels": channels}), *memory]

        return symbolic(build, inputs)

    def step_code(self, part: Equations) -> Code:
        """The program of a step as machine code."""
        description = ["step", self.name, *self.key, part.to_dict()]
        return compiled(description, lambda: (self.step_program(part), {}))


def _efforts(part: Equations, given: Given) -> list[Scalar]:
    """Velocities and accelerations that are not given are zero."""
    rest: Scalars = [0.0] * part.robot.n
    dq, ddq = given.get("dq", rest), given.get("ddq", rest)
    state = JointState(given["q"], dq, ddq, given["channels"])
    return part.torque_of(state, given["parameters"])


def _inertial(part: Equations, given: Given, ddq: Scalars) -> list[Scalar]:
    r"""$M(q)\,\ddot q$."""
    weightless = Equations(part.robot.changed(gravity=np.zeros(3)), part.terms)
    kept = {name: given[name] for name in ("q", "channels", "parameters")}
    return _efforts(weightless, {**kept, "ddq": ddq})


def _mass(part: Equations, given: Given) -> list[Scalar]:
    """One triangle is computed, so that the matrix is symmetric to the last bit."""
    from steelyard.symbolic.symbols_and_tracing import affine

    n = part.robot.n
    slopes, _ = affine(lambda ddq: _inertial(part, given, ddq), n)
    return [slopes[max(i, j)][min(i, j)] for i in range(n) for j in range(n)]


def _momentum_rate(part: Equations, given: Given) -> list[Scalar]:
    r"""$\partial_q (\frac12 \dot q^T M \dot q) - g$, passive joints following the others."""
    from steelyard.symbolic.symbols_and_tracing import slopes_of

    momentum = zip(given["dq"], _inertial(part, given, given["dq"]), strict=True)
    twice: Scalar = sum((rate * p for rate, p in momentum), 0.0)
    slopes = slopes_of([0.5 * twice], [*given["q"], *given["channels"]])
    slopes = _followed(part, given, slopes)
    weight = _efforts(part, {name: x for name, x in given.items() if name != "dq"})
    return [slope - g for slope, g in zip(slopes, weight, strict=True)]


def _followed(part: Equations, given: Given, slopes: Scalars) -> list[Scalar]:
    """Derivatives by all joints as derivatives by the independent ones, which the others follow."""
    rest = [0.0] * part.robot.n
    _, torque_map = completed(part.robot, JointState(given["q"], rest, rest, given["channels"]))
    rows = projected(part.robot, {(j, 0): slope for j, slope in enumerate(slopes)}, torque_map)
    return [rows[j, 0] for j in range(part.robot.n)]


def _forward(part: Equations, given: Given) -> list[Scalar]:
    """Accelerations, and the least pivot of the mass matrix."""
    found, pivots = accelerations(lambda ddq: _efforts(part, {**given, "ddq": ddq}), given["tau"])
    least = pivots[0]
    for pivot in pivots[1:]:
        least = np.minimum(least, pivot)
    return [*found, least]


def _regressor(part: Equations, given: Given) -> list[Scalar]:
    state = JointState(given["q"], given["dq"], given["ddq"], given["channels"])
    entries, width = part.columns(state), len(part.parameters)
    return [entries.get((row, k), 0.0) for row in range(part.robot.n) for k in range(width)]


def _every(_: Term) -> bool:
    return True


def _inertias(term: Term) -> bool:
    return term.cause == "inertia"


def _vector(part: Equations) -> tuple[int, ...]:
    return (part.robot.n,)


MOTION = ("q", "dq", "ddq")
TORQUE = Quantity("torque", MOTION, _every, _efforts, _vector)
FRICTION = Quantity("friction", MOTION, lambda t: t.cause == "friction", _efforts, _vector)
REGRESSOR = Quantity(
    "regressor of all terms", MOTION, _every, _regressor, lambda p: (p.robot.n, len(p.parameters))
)
GRAVITY = Quantity("gravity", ("q",), lambda t: t.role == "body", _efforts, _vector)
BIAS = Quantity("bias", ("q", "dq"), _inertias, _efforts, _vector)
MASS_MATRIX = Quantity("mass matrix", ("q",), _inertias, _mass, lambda p: (p.robot.n, p.robot.n))
MOMENTUM = Quantity(
    "momentum", ("q", "dq"), _inertias, lambda p, x: _inertial(p, x, x["dq"]), _vector
)
MOMENTUM_RATE = Quantity("momentum rate", ("q", "dq"), _inertias, _momentum_rate, _vector)
FORWARD_DYNAMICS = Quantity(
    "forward dynamics",
    ("q", "dq", "tau"),
    _every,
    _forward,
    lambda p: (p.robot.n + 1,),
    pivot=True,
)

QUANTITIES = (
    TORQUE, FRICTION, REGRESSOR, GRAVITY, BIAS, MASS_MATRIX, MOMENTUM, MOMENTUM_RATE,
    FORWARD_DYNAMICS,
)  # fmt: skip


@lru_cache(maxsize=256)
def frame_quantity(robot: Robot, frame: str | Frame) -> Quantity:
    """Position, rotation and Jacobian of a frame, row by row; an error if the robot has none."""
    if not isinstance(frame, str | Frame):
        raise DataError(
            f"a frame cannot be of type {type(frame).__name__}",
            where=f"robot '{robot.name}'",
            fix="give its name, or a Frame",
        )
    chosen = frame_of(robot, frame) if isinstance(frame, str) else frame

    def build(part: Equations, given: Given) -> list[Scalar]:
        return frame_outputs(part.robot, chosen, given["q"], given["channels"])

    return Quantity(
        "frame",
        ("q",),
        lambda _: False,
        build,
        lambda part: (12 + 6 * part.robot.n,),
        (chosen.body, chosen.rotation.tolist(), chosen.position.tolist()),
    )
