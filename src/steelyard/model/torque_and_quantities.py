r"""Torque of a robot and its terms as equations over symbols, and quantities of it as programs.

With bodies and rotors $\tau = M(q)\,\ddot q + b(q, \dot q)$, and $\tau$ as a whole has friction,
springs and offsets beside them. A `Quantity` says what its program reads, which terms enter it and
how it is traced: all programs read the arrays that `Quantity.arguments` names, the channels of the
terms that enter, and their standard parameters.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.base.errors import DataError, ModelError
from steelyard.model.equations import inverse_dynamics as rigid
from steelyard.model.equations.frame_and_point_kinematics import frame_of, frame_outputs
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.laws.laws_without_friction import RigidBody, body_efforts
from steelyard.model.laws.register import description_of
from steelyard.model.terms.stateful_terms import Presliding, Scan
from steelyard.model.terms.term import Columns, StatefulTerm, Term, has_memory
from steelyard.robot.robot import Frame, Robot, refuse_floating, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import affine, slopes_of, symbolic


@dataclass(frozen=True, eq=False)
class Equations:
    """Efforts and regressor of a robot with its terms, whose columns stand side by side."""

    robot: Robot
    terms: tuple[Term, ...]

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps: compiled code is of one process."""
        return {"robot": self.robot, "terms": self.terms}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All standard parameters, term by term."""
        return tuple(p for term in self.terms for p in term.parameters(self.robot))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the standard parameters."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def friction_names(self) -> tuple[str, ...]:
        """Names of the parameters of friction."""
        return self.names_where(lambda term: term.cause == "friction")

    @cached_property
    def per_run_names(self) -> tuple[str, ...]:
        """Names of the parameters that every run has for itself."""
        return self.names_where(lambda term: term.per_run)

    def names_where(self, chosen: Callable[[Term], bool]) -> tuple[str, ...]:
        """Names of the parameters of some terms."""
        return tuple(p.name for t in self.terms if chosen(t) for p in t.parameters(self.robot))

    @property
    def has_memory(self) -> bool:
        """Whether friction at rest is known: some law has a memory of where the joint came from."""
        return has_memory(self.terms)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the standard parameters."""
        return tuple(p.unit for p in self.parameters)

    @cached_property
    def n_channels(self) -> int:
        """Channels that are computed along a motion, see `Scan`."""
        return len(self.robot.passive) + sum(term.n_channels(self.robot) for term in self.terms)

    @property
    def n_memory(self) -> int:
        """Entries of the memory of friction between two steps."""
        return sum(term.n_memory(self.robot) for term in self._remembering)

    @property
    def steps(self) -> bool:
        """Whether `stepped` gives all channels but passive joints: friction with memory does."""
        channels = [term for term in self.terms if isinstance(term, StatefulTerm)]
        return len(channels) == len(self._remembering)

    @property
    def _remembering(self) -> list[Presliding]:
        return [term for term in self.terms if isinstance(term, Presliding)]

    def started(self, state: JointState) -> list[Scalar]:
        """Memory of friction before the first state; its channels are passive joints."""
        full, _ = rigid.completed(self.robot, state)
        return [x for term in self._remembering for x in term.started(self.robot, full)]

    def stepped(self, state: JointState, memory: Scalars) -> tuple[list[Scalar], list[Scalar]]:
        """Memory of friction after one step, and all channels there, from the state at its end."""
        full, _ = rigid.completed(self.robot, state)
        after: list[Scalar] = []
        channels = list(state.channels)
        for term in self._remembering:
            last = memory[len(after) : len(after) + term.n_memory(self.robot)]
            rows, mine = term.stepped(self.robot, full, last)
            after += rows
            channels += mine
        return after, channels

    def columns(self, state: JointState) -> Columns:
        """Regressor entries `(effort row, standard parameter)` over symbols, with all channels."""
        full, torque_map = rigid.completed(self.robot, state)
        entries: dict[tuple[int, int], Scalar] = {}
        for start, term, seen in self._seen(full):
            for (row, column), value in term.columns(self.robot, seen).items():
                entries[row, start + column] = value
        return rigid.projected(self.robot, entries, torque_map)

    def torque_of(self, state: JointState, values: Scalars) -> list[Scalar]:
        """Efforts over symbols: bodies by inverse dynamics, other terms by their columns."""
        full, torque_map = rigid.completed(self.robot, state)
        efforts: list[Scalar] = [0.0] * self.robot.n_joints
        for start, term, seen in self._seen(full):
            if term.role == "body":
                for row, effort in enumerate(body_efforts(self.robot, seen, values[start:])):
                    efforts[row] += effort
                continue
            for (row, column), value in term.columns(self.robot, seen).items():
                efforts[row] += value * values[start + column]
        entries = {(row, 0): effort for row, effort in enumerate(efforts)}
        rows = rigid.projected(self.robot, entries, torque_map)
        return [rows[row, 0] for row in range(self.robot.n)]

    def _seen(self, state: JointState) -> Iterator[tuple[int, Term, JointState]]:
        """Every term with its first parameter and the state with its own channels only."""
        first = start = 0
        for term in self.terms:
            mine = state.channels[first : first + term.n_channels(self.robot)]
            yield start, term, JointState(state.q, state.dq, state.ddq, mine)
            start, first = start + len(term.parameters(self.robot)), first + len(mine)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "robot": robot_to_dict(self.robot),
            "terms": [description_of(term) for term in self.terms],
        }

    @cached_property
    def program_key(self) -> list[Any]:
        """What programs over the columns depend on: no fields that channels know alone."""
        described = self.to_dict()
        for term, fields in zip(self.terms, described["terms"], strict=True):
            if isinstance(term, StatefulTerm):
                for name in term.state_only_fields:
                    # a list's length is how many channels there are
                    given = fields[name]
                    fields[name] = len(given) or None if isinstance(given, list) else None
        return [described]

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Arrays that every program over the model reads: motion and channels."""
        n = self.robot.n
        return Input("q", n), Input("dq", n), Input("ddq", n), Input("channels", self.n_channels)

    @cached_property
    def columns_program(self) -> tuple[Program, tuple[tuple[int, int], ...]]:
        """All columns as one program, and the place `(row, column)` of each of its outputs."""
        places: list[tuple[int, int]] = []

        def build(*x: Any) -> list[Scalar]:
            columns = self.columns(JointState(*x))
            places.extend(columns)
            return list(columns.values())

        return symbolic(build, self.inputs), tuple(places)

    @cached_property
    def torque_code(self) -> Code:
        """Machine code of the torque; inputs as `inputs`, and the shared parameters."""
        return TORQUE.code(self)

    @cached_property
    def bodies_only(self) -> "Equations":
        """The rigid bodies of the robot as a tree, all joints independent."""
        robot = self.robot
        tree = robot.changed(coordinates=robot.joints, passive=(), loops=(), transmission=None)
        return Equations(tree, (RigidBody(),))

    def scan(self, drop: bool = False) -> Scan:
        """Begin to compute channels along a motion, past loops that cannot close if `drop`."""
        return Scan(self.robot, self.terms, self.rigid_torque, drop)

    def rigid_torque(self, q: Array, dq: Array, ddq: Array, tens: Array) -> Array:
        """Torques of the bodies as a tree, shape `(n_joints, N)`."""
        return self.bodies_only.torque_code([q, dq, ddq, np.empty((0, q.shape[1])), tens])


Given = Mapping[str, Scalars]
"""Symbols of the arguments, of `channels` and of `parameters`, by name."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity of a model with values, of arguments among `q`, `dq`, `ddq` and `tau`.

    `build` makes its entries of the terms that enter and of symbols, in C order; the `key` is what
    else its program depends on, as JSON. With a `pivot` the last entry is the least one of a mass
    matrix; it must be positive. One that is `at_rest` exists only where the base is at rest: with a
    floating one it depends on the direction of gravity.
    """

    name: str
    arguments: tuple[str, ...]
    build: Callable[[Equations, Given], Scalars]
    enters: Callable[[Term], bool] = lambda _: True
    shape: Callable[[Equations], tuple[int, ...]] = lambda part: (part.robot.n,)
    key: tuple[Any, ...] = ()
    pivot: bool = False
    at_rest: bool = False

    def part(self, equations: Equations) -> Equations:
        """The equations with the terms only that enter.

        It is a `ModelError` if accelerations are asked for, and a term depends on them beside the
        inertia; or if the base floats, and must not.
        """
        if self.at_rest:
            refuse_floating(equations.robot, self.name)
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

    def program(self, part: Equations, stepped: bool = False) -> Program:
        """The arguments, channels and shared parameters of a part to the entries.

        Of a step, passive positions and friction's memory before it are inputs instead of the
        channels, and its memory after it stands behind the entries.
        """
        between = [Input("channels", part.n_channels)]
        if stepped:
            between = [Input("passive", len(part.robot.passive)), Input("memory", part.n_memory)]
        inputs = (
            *(Input(name, part.robot.n) for name in self.arguments),
            *between,
            Input("parameters", len(part.parameters), shared=True),
        )

        def build(*x: Scalars) -> Scalars:
            given = dict(zip([array.name for array in inputs], x, strict=True))
            if not stepped:
                return self.build(part, given)
            state = _state(part, given, given["passive"])
            memory, channels = part.stepped(state, given["memory"])
            return [*self.build(part, {**given, "channels": channels}), *memory]

        return symbolic(build, inputs)

    def code(self, part: Equations, stepped: bool = False) -> Code:
        """The program as machine code."""
        known = ["step", part.to_dict()] if stepped else part.program_key
        return compiled([self.name, *self.key, known], lambda: (self.program(part, stepped), {}))


def _state(part: Equations, given: Given, channels: Scalars) -> JointState:
    """Velocities and accelerations that are not given are zero."""
    rest: Scalars = [0.0] * part.robot.n
    return JointState(given["q"], given.get("dq", rest), given.get("ddq", rest), channels)


def _efforts(part: Equations, given: Given) -> list[Scalar]:
    return part.torque_of(_state(part, given, given["channels"]), given["parameters"])


def _inertial(part: Equations, given: Given, ddq: Scalars) -> list[Scalar]:
    r"""$M(q)\,\ddot q$."""
    weightless = Equations(part.robot.changed(gravity=np.zeros(3)), part.terms)
    kept = {name: given[name] for name in ("q", "channels", "parameters")}
    return _efforts(weightless, {**kept, "ddq": ddq})


def _mass(part: Equations, given: Given) -> list[Scalar]:
    """One triangle is computed, so that the matrix is symmetric to the last bit."""
    n = part.robot.n
    slopes, _ = affine(lambda ddq: _inertial(part, given, ddq), n)
    return [slopes[max(i, j)][min(i, j)] for i in range(n) for j in range(n)]


def _momentum_rate(part: Equations, given: Given) -> list[Scalar]:
    r"""$\partial_q (\frac12 \dot q^T M \dot q) - g$, passive joints following the others."""
    momentum = zip(given["dq"], _inertial(part, given, given["dq"]), strict=True)
    twice: Scalar = sum((rate * p for rate, p in momentum), 0.0)
    slopes = slopes_of([0.5 * twice], [*given["q"], *given["channels"]])
    state = _state(part, {"q": given["q"]}, given["channels"])
    entries = {(j, 0): slope for j, slope in enumerate(slopes)}
    rows = rigid.projected(part.robot, entries, rigid.completed(part.robot, state)[1])
    weight = _efforts(part, {name: x for name, x in given.items() if name != "dq"})
    return [rows[j, 0] - g for j, g in enumerate(weight)]


Efforts = Callable[[Scalars], Scalars]  # accelerations to efforts


def accelerations(efforts: Efforts, applied: Scalars) -> tuple[list[Scalar], list[Scalar]]:
    r"""Accelerations under applied efforts, by $M = L D L^T$, and the pivots `D`.

    The `efforts` are $M(q)\,\ddot q + h(q, \dot q)$ of the accelerations, so $M$ is their
    derivative. The pivots are positive if and only if it is positive definite.
    """
    mass, bias = affine(efforts, len(applied))
    sides = [tau - rest for tau, rest in zip(applied, bias, strict=True)]
    (found,), pivots = rigid.solved_by_factors(mass, [sides])
    return found, pivots


def _forward(part: Equations, given: Given) -> list[Scalar]:
    """Accelerations, and the least pivot of the mass matrix."""
    found, pivots = accelerations(lambda ddq: _efforts(part, {**given, "ddq": ddq}), given["tau"])
    return [*found, reduce(np.minimum, pivots)]


def _regressor(part: Equations, given: Given) -> list[Scalar]:
    entries = part.columns(_state(part, given, given["channels"]))
    width = len(part.parameters)
    return [entries.get((row, k), 0.0) for row in range(part.robot.n) for k in range(width)]


def _inertias(term: Term) -> bool:
    return term.cause == "inertia"


MOTION = ("q", "dq", "ddq")
TORQUE = Quantity("torque", MOTION, _efforts)
FRICTION = Quantity("friction", MOTION, _efforts, lambda term: term.cause == "friction")
REGRESSOR = Quantity(
    "regressor of all terms", MOTION, _regressor, shape=lambda p: (p.robot.n, len(p.parameters))
)
GRAVITY = Quantity("gravity", ("q",), _efforts, lambda term: term.role == "body", at_rest=True)
BIAS = Quantity("bias", ("q", "dq"), _efforts, _inertias)
MASS_MATRIX = Quantity("mass matrix", ("q",), _mass, _inertias, lambda p: (p.robot.n, p.robot.n))
MOMENTUM = Quantity("momentum", ("q", "dq"), lambda p, x: _inertial(p, x, x["dq"]), _inertias)
MOMENTUM_RATE = Quantity("momentum rate", ("q", "dq"), _momentum_rate, _inertias, at_rest=True)
FORWARD_DYNAMICS = Quantity(
    "forward dynamics", ("q", "dq", "tau"), _forward, shape=lambda p: (p.robot.n + 1,), pivot=True
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
    chosen = frame_of(robot, frame)

    def build(part: Equations, given: Given) -> list[Scalar]:
        return frame_outputs(part.robot, chosen, given["q"], given["channels"])

    return Quantity(
        "frame",
        ("q",),
        build,
        lambda _: False,
        lambda part: (12 + 6 * part.robot.n,),
        (chosen.body, chosen.rotation.tolist(), chosen.position.tolist()),
    )
