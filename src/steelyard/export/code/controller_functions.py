r"""What controllers compute of a model, as programs with the model's numbers in them.

What looks the same at every position of a joint may belong to either of the two bodies that the
joint connects [Gautier1991]: of the body behind a revolute joint with axis $a$ its mass at the
joint's frame, a first moment along $a$ and a second moment $a a^T$; behind a prismatic joint all
second moments. They are moved to the parent in closed form, so the torque changes by rounding
alone; from the first body they go to the base, where they make no torque.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.external.wrench_methods_and_observer_step import (
    observed_torque,
    slow_velocities,
)
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, corrected
from steelyard.model.model import Model
from steelyard.model.torque_and_quantities import (
    BIAS,
    FORWARD_DYNAMICS,
    FRICTION,
    GRAVITY,
    MASS_MATRIX,
    MOMENTUM,
    MOMENTUM_RATE,
    TORQUE,
    Equations,
    Quantity,
    frame_quantity,
)
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Body, Robot
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import symbolic

DIAGONAL = tuple(INERTIAL_NAMES.index(name) for name in ("Ixx", "Iyy", "Izz"))


def regrouped(robot: Robot, tens: Array) -> Array:
    """Mass properties that make the same torque with more zeros.

    Args:
        robot: The robot; where chains are closed, its tree.
        tens: Ten numbers per body, shape `(n_bodies, 10)`.

    Returns:
        The same shape; a body on a parent without mass keeps all that it has.
    """
    found = np.array(tens, dtype=np.float64)
    for index in reversed(range(len(robot.bodies))):
        body = robot.bodies[index]
        if body.parent >= 0 and robot.bodies[body.parent].massless:
            continue
        moved, zeros = _movable(body, found[index])
        found[index] -= moved.ten
        found[index][zeros] = 0.0
        if body.parent >= 0:
            found[body.parent] += moved.moved(body.rotation, body.position).ten
    return found


def _movable(body: Body, ten: Array) -> tuple[Inertia, list[int]]:
    """What the parent may have of a body, and which of the ten numbers are then zero."""
    if body.kind == "prismatic":
        return Inertia.from_ten([0.0] * 4 + ten[4:].tolist()), list(range(4, 10))
    axis = body.axis
    along, across = int(np.abs(axis).argmax()), np.abs(axis).argsort(kind="stable")[:2]
    # of the two moments of inertia across the axis one is made zero, the second if none is
    zero = next((k for k in across if ten[DIAGONAL[k]] == 0.0), across[1])
    size = ten[DIAGONAL[zero]] / (1.0 - axis[zero] ** 2)
    about = size * (np.eye(3) - np.outer(axis, axis))
    moment = ten[1 + along] / axis[along] * axis
    return Inertia(ten[0], moment, about), [0, 1 + along, DIAGONAL[zero]]


Outputs = tuple[tuple[str, tuple[int, ...]], ...]


@dataclass(frozen=True)
class FunctionSpec:
    """A function that can be exported."""

    quantity: Quantity | None  # what it computes; `None` for the regressor of base parameters
    arguments: str
    output: str
    meaning: str  # what the result is, with units


FUNCTIONS = {
    "torque": FunctionSpec(TORQUE, "q dq ddq", "tau", "efforts of the whole model [Nm; N]"),
    "gravity": FunctionSpec(GRAVITY, "q", "tau", "efforts that hold the bodies at rest [Nm; N]"),
    "bias": FunctionSpec(BIAS, "q dq", "tau", "Coriolis, centrifugal and gravity efforts [Nm; N]"),
    "friction": FunctionSpec(FRICTION, "q dq", "tau", "efforts of the friction laws [Nm; N]"),
    "mass": FunctionSpec(
        MASS_MATRIX, "q", "matrix", "mass matrix of bodies and rotors [kg m^2; kg m; kg]"
    ),
    "regressor": FunctionSpec(
        None, "q dq ddq", "columns", "efforts per unit of each base parameter"
    ),
    "momentum": FunctionSpec(MOMENTUM, "q dq", "p", "generalised momentum [kg m^2/s; kg m/s]"),
    "momentum_rate": FunctionSpec(
        MOMENTUM_RATE, "q dq", "rate", "rate of the momentum without efforts [Nm; N]"
    ),
    "forward_dynamics": FunctionSpec(
        FORWARD_DYNAMICS,
        "q dq tau",
        "ddq",
        "accelerations under efforts [rad/s^2; m/s^2], then the least pivot of the mass matrix, "
        "which is positive where the matrix is positive definite",
    ),
}
"""By the names that `--function` takes; frames have functions of their own."""

USUAL_FUNCTIONS = ("torque", "gravity", "bias", "friction", "mass", "regressor")
OF_ALL_TERMS = ("torque", "friction", "regressor", "forward_dynamics")
"""Functions that need the memory of friction, if there is some."""


@dataclass(frozen=True, eq=False)
class Function:
    """A function of the joints' state."""

    name: str
    program: Program  # inputs are arrays among `q`, `passive`, `dq`, `ddq`, `tau` and `memory`
    outputs: Outputs  # names and shapes of its results, in the order of the program's outputs
    meaning: str
    public: bool = True  # whether others call it

    @property
    def sizes(self) -> tuple[tuple[str, int], ...]:
        """Names and entries of the results."""
        return tuple((name, int(np.prod(shape))) for name, shape in self.outputs)


OBSERVER = "observer"  # name that `--function` takes for the observer of external efforts


@dataclass(frozen=True, eq=False)
class ObserverNumbers:
    """Usual bandwidth [Hz] of an observer, and thresholds of contact for it."""

    bandwidth: float
    thresholds: ContactThresholds | None


@dataclass(frozen=True, eq=False)
class Controller:
    """A model with its numbers, for controllers."""

    model: Model
    values: Parameters
    names: tuple[str, ...] = USUAL_FUNCTIONS  # functions that are wanted, of `FUNCTIONS`
    frames: tuple[str, ...] = ()  # names of the frames whose poses and Jacobians are wanted
    observer: ObserverNumbers | None = None  # `None` if it is not wanted

    @cached_property
    def equations(self) -> Equations:
        """The robot with its terms."""
        return Equations(self.model.robot, self.model.terms)

    @property
    def n_memory(self) -> int:
        """Entries of the memory of friction; zero without."""
        return self.equations.n_memory

    @cached_property
    def parameters(self) -> Parameters:
        """The base parameters that are not zero: those that the regressor has columns for."""
        base = base_parameters(self.model)
        found = Parameters(base.base_names, base.base_units, base.base_values(self.values.values))
        return found.of(np.flatnonzero(found.values).tolist())

    @cached_property
    def functions(self) -> tuple[Function, ...]:
        """All functions; those of all terms only where friction has no memory."""
        wanted = [name for name in self.names if not (self.n_memory and name in OF_ALL_TERMS)]
        found = [self._function(name) for name in wanted]
        found += [f for frame in self.frames for f in self._of_frame(frame)]
        if self.model.robot.passive:
            found.append(self._newton())
        if self.observer is not None:
            found.append(self._observed())
        return (*found, *((self._begun(), self._stepped()) if self.n_memory else ()))

    @cached_property
    def numbers(self) -> Array:
        """The standard parameters with bodies' as few as possible."""
        numbers, start = self.values.values.copy(), 0
        for term in self.model.terms:
            count = len(term.parameters(self.model.robot))
            if term.role == "body":
                tens = numbers[start : start + count].reshape(-1, 10)
                numbers[start : start + count] = regrouped(self.model.robot, tens).ravel()
            start += count
        return numbers

    def _function(self, name: str) -> Function:
        wanted = FUNCTIONS[name]
        arguments = tuple(wanted.arguments.split())
        n = self.model.robot.n
        if wanted.quantity is None:
            program = self._traced(arguments, self._regressor)
            shape: tuple[int, ...] = (n, len(self.parameters))
        else:
            quantity = replace(wanted.quantity, arguments=arguments)
            program, shape = self._program(quantity), quantity.shape(self.equations)
        return Function(name, program, ((wanted.output, shape),), wanted.meaning)

    def _program(self, quantity: Quantity) -> Program:
        """A quantity with the model's numbers."""
        part = quantity.part(self.equations)
        places = {name: k for k, name in enumerate(self.equations.names)}
        numbers = [float(self.numbers[places[name]]) for name in part.names]

        def build(q: Any, passive: Any, *rest: Any) -> Sequence[Scalar]:
            given = dict(zip(quantity.arguments, (q, *rest), strict=True))
            return quantity.build(part, {**given, "channels": passive, "parameters": numbers})

        return self._traced(quantity.arguments, build)

    def _traced(self, arguments: Sequence[str], build: Callable[..., Sequence[Scalar]]) -> Program:
        """Equations over positions, those of passive joints, and other arguments."""
        robot = self.model.robot
        sizes = {"memory": self.n_memory, "scalars": 3}
        rest = [Input(name, sizes.get(name, robot.n)) for name in arguments[1:]]
        if robot.passive:
            return symbolic(
                build, [Input("q", robot.n), Input("passive", len(robot.passive)), *rest]
            )
        return symbolic(lambda q, *given: build(q, [], *given), [Input("q", robot.n), *rest])

    def _regressor(self, q: Any, passive: Any, dq: Any, ddq: Any) -> list[Scalar]:
        entries = self.equations.columns(JointState(q, dq, ddq, passive))
        columns = [self.equations.names.index(name) for name in self.parameters]
        return [entries.get((row, k), 0.0) for row in range(self.model.robot.n) for k in columns]

    def _of_frame(self, frame: str) -> tuple[Function, Function]:
        program = self._program(frame_quantity(self.model.robot, frame))
        n = self.model.robot.n
        pose, jacobian = (
            Program(program.inputs, program.steps, program.outputs[part]).pruned()
            for part in (slice(12), slice(12, None))
        )
        own = frame if len(self.frames) > 1 else ""
        return (
            Function(
                f"pose {own}".strip(),
                pose,
                (("position", (3,)), ("rotation", (3, 3))),
                f"origin [m] and axes of frame '{frame}' in the base frame; axes are columns",
            ),
            Function(
                f"jacobian {own}".strip(),
                jacobian,
                (("columns", (6, n)),),
                f"joint speeds to the velocity of the origin of frame '{frame}' (3 rows) and its "
                "angular velocity (3 rows), in the base frame's axes",
            ),
        )

    def _newton(self) -> Function:
        """One Newton step of the passive joints."""
        robot = self.model.robot
        program = self._traced(("q",), lambda q, passive: corrected(robot, q, passive))
        outputs = (("nearer", (len(robot.passive),)), ("gaps", (len(robot.loops),)))
        return Function("newton", program, outputs, "a Newton step; squared gaps [m^2]", False)

    def _begun(self) -> Function:
        def build(q: Any, passive: Any, dq: Any) -> list[Scalar]:
            return self.equations.started(JointState(q, dq, [0.0] * len(dq), passive))

        outputs = (("after", (self.n_memory,)),)
        program = self._traced(("q", "dq"), build)
        return Function("begun", program, outputs, "memory where a motion starts", False)

    def _observed(self) -> Function:
        """A step of the observer; its memory after the step, too, where friction has some."""
        numbers, equations = self.numbers.tolist(), self.equations

        def build(
            q: Any, passive: Any, dq: Any, tau: Any, scalars: Any, *rest: Any
        ) -> list[Scalar]:
            old_momentum, old_drive, old_slow, old_torque, *memory = rest
            slow, ddq = slow_velocities(dq, old_slow, scalars)
            state = JointState(q, dq, ddq, passive)
            after, channels = equations.stepped(state, memory[0] if memory else [])
            given = {"q": q, "dq": dq, "ddq": ddq, "channels": channels, "parameters": numbers}
            momentum, drive, torque = observed_torque(
                equations, given, tau, (old_momentum, old_drive, old_torque), scalars
            )
            return [*momentum, *drive, *slow, *torque, *after]

        memory = ("memory",) if self.n_memory else ()
        n, old = self.model.robot.n, ("momentum", "drive", "slow", "torque")
        outputs = (
            *((f"next_{name}", (n,)) for name in old),
            *(("after", (self.n_memory,)) for _ in memory),
        )
        program = self._traced(("q", "dq", "tau", "scalars", *old, *memory), build)
        return Function("observed", program, outputs, "a step of the observer", False)

    def _stepped(self) -> Function:
        numbers = self.numbers.tolist()

        def build(q: Any, passive: Any, dq: Any, ddq: Any, memory: Any) -> list[Scalar]:
            after, channels = self.equations.stepped(JointState(q, dq, ddq, passive), memory)
            return [*self.equations.torque_of(JointState(q, dq, ddq, channels), numbers), *after]

        outputs = (("tau", (self.model.robot.n,)), ("after", (self.n_memory,)))
        program = self._traced(("q", "dq", "ddq", "memory"), build)
        return Function("stepped", program, outputs, "efforts, and memory after a step", False)
