"""Torques that MuJoCo does not know, as machine code, and the steps they need for stability.

One call per integration step takes the positions, velocities and last accelerations of MuJoCo's
joints and the applied torques, steps the memory of friction, and gives the forces. Laws that
jump at zero speed are softened, see `symbolic.program_and_softening`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.model import Model
from steelyard.model.terms.stateful_terms import Presliding
from steelyard.model.terms.term import StatefulTerm, Term, TermSamples
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import TIMESTEP, MujocoModel, mass_matrices
from steelyard.simulate.typical_torques_and_masses import postures_of
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, softened

VELOCITY, WIDTHS = 1, 7


@dataclass(frozen=True)
class PlacedTerm:
    """A term with its place in the program's inputs."""

    term: Term
    first: int  # its first parameter
    memory: Presliding | None  # how its memory steps; `None` without
    at: int  # first row of its memory: positions along its axes, then states
    channel: int  # its first channel among those of laws that are stepped by their own scan


@dataclass(frozen=True, eq=False)
class Laws:
    """Terms of a robot, ready to be evaluated at every step."""

    robot: Robot
    terms: tuple[Term, ...]  # the terms; neither bodies nor rotor inertia
    values: Array  # their parameters
    widths: Array  # speeds over which jumps at zero speed are spread, per joint of the robot
    model: MujocoModel

    @cached_property
    def placed(self) -> tuple[PlacedTerm, ...]:
        """The terms with their places."""
        found, first, at, channel = [], 0, 0, 0
        for term in self.terms:
            memory = term if isinstance(term, Presliding) else None
            found.append(PlacedTerm(term, first, memory, at, channel))
            first += len(term.parameters(self.robot))
            if memory is not None:
                at += memory.n_memory(self.robot)
            else:
                channel += term.n_channels(self.robot)
        return tuple(found)

    @property
    def n_memory(self) -> int:
        """Rows of the memory."""
        return sum(p.memory.n_memory(self.robot) for p in self.placed if p.memory is not None)

    @property
    def scanned(self) -> tuple[PlacedTerm, ...]:
        """Terms that are stepped by their own scan."""
        return tuple(p for p in self.placed if p.memory is None and p.term.n_channels(self.robot))

    @property
    def n_channels(self) -> int:
        """Channels of the terms that are stepped by their own scan."""
        return sum(p.term.n_channels(self.robot) for p in self.scanned)

    @cached_property
    def places(self) -> tuple[list[int], list[float], list[float]]:
        """Per joint its number, ratio and zero among MuJoCo's joints."""
        carriers = list(self.model.carriers)
        ratios = [float(self.model.map[c, j]) for j, c in enumerate(carriers)]
        return carriers, ratios, [float(self.model.offset[c]) for c in carriers]

    @cached_property
    def code(self) -> Code:
        """Machine code; `about` names the joints that its rows load and brake.

        Inputs: positions, velocities, accelerations, applied torques, memory, channels, parameters,
        widths. Outputs: forces on the joints `loads`, torque of motor-side terms on the joints
        `brakes`, memory.
        """
        described = Model(self.robot, self.terms).to_dict()

        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import symbolic

            about: dict[str, Any] = {}
            program = symbolic(lambda *given: self._outputs(about, *given), self._inputs())
            return softened(program, VELOCITY, WIDTHS), about

        return compiled(["virtual", described, *self.places], build)

    def _inputs(self) -> tuple[Input, ...]:
        rows = dict.fromkeys(("position", "velocity", "acceleration"), len(self.model.offset))
        rows |= {"applied": self.robot.n, "memory": self.n_memory, "channels": self.n_channels}
        rows |= {"parameters": len(self.values), "widths": len(self.model.offset)}
        return tuple(Input(name, n, shared=name != "memory") for name, n in rows.items())

    def _outputs(self, about: dict[str, Any], *given: Sequence[Scalar]) -> list[Scalar]:
        """Rows of `code` over its inputs; tells which joints they load and brake."""
        position, velocity, acceleration, applied, before, channels, values, _ = given
        places = list(zip(*self.places, strict=True))
        q = [(position[c] - zero) / ratio for c, ratio, zero in places]
        dq, ddq = ([x[c] / ratio for c, ratio, _ in places] for x in (velocity, acceleration))
        total: dict[int, Scalar] = dict(enumerate(applied))
        brakes: dict[int, Scalar] = {}
        memory: list[Scalar] = []
        for placed in self.placed:
            mine = channels[placed.channel : placed.channel + placed.term.n_channels(self.robot)]
            if placed.memory is not None:
                last = before[placed.at : placed.at + placed.memory.n_memory(self.robot)]
                rows, mine = placed.memory.stepped(self.robot, JointState(q, dq, ddq), last)
                memory += rows
            state = JointState(q, dq, ddq, mine)
            for (row, column), entry in placed.term.columns(self.robot, state).items():
                effort = entry * values[placed.first + column]
                total[row] = total[row] - effort if row in total else -effort
                if placed.term.on_motors:
                    brakes[row] = brakes[row] + effort if row in brakes else effort
        loads = sorted(total)
        forces = [total[row] / places[row][1] for row in loads]
        about.update(loads=loads, brakes=sorted(brakes))
        return [*forces, *(brakes[row] for row in sorted(brakes)), *memory]


class LawsInUse:
    """Laws that follow one simulation: buffers are made once, a step allocates nothing.

    Attributes:
        forces: Forces on MuJoCo's joints `dofs` after `step`, shape `(loads,)`.
        dofs: Numbers of MuJoCo's joints that are loaded.
        applied: Torques of the controller, shape `(n,)`; set before `step`.
    """

    def __init__(self, laws: Laws, position: Array, velocity: Array, acceleration: Array) -> None:
        """Laws over MuJoCo's own arrays of positions, velocities and accelerations."""
        self.laws, code = laws, laws.code
        self.applied, self._count = np.zeros(laws.robot.n), laws.robot.n_joints
        self._seen = position, velocity, acceleration
        carriers, ratios, zeros = (np.array(x) for x in laws.places)
        self._carriers, self._ratios, self._zeros = carriers, ratios, zeros
        self._loads, self._brakes = code.about["loads"], code.about["brakes"]
        self.dofs = carriers[self._loads]
        self._head = len(self._loads) + len(self._brakes)
        self._rows = [np.zeros((code.n_outputs, code.lanes)) for _ in range(2)]
        self._channels = np.zeros(laws.n_channels)
        self._memories: list[Any] = [None] * len(laws.scanned)
        self._widths = np.zeros(len(laws.model.offset))
        self._widths[carriers] = laws.widths * np.abs(ratios)
        self._values = np.ascontiguousarray(laws.values)
        shared = (self._channels, self._values, self._widths)
        addresses = [x for a in (*self._seen, self.applied) for x in (a.ctypes.data, 0)]
        rest = [x for a in shared for x in (a.ctypes.data, 0)]
        self.forces = np.zeros(len(self._loads))
        forces = (self.forces.ctypes.data, len(self.forces), np.float64(np.inf).view(np.int64))
        self._arguments = []
        for old, new in ((0, 1), (1, 0)):
            memory = self._rows[old][self._head :]
            before, after = ((x.ctypes.data, code.lanes) for x in (memory, self._rows[new]))
            called = (code.lanes, *addresses, *before, *rest, *after)
            self._arguments.append(np.array([*called, memory.ctypes.data, 0, *forces]))
        self._places = [arguments.ctypes.data for arguments in self._arguments]
        self._sample, self._turn = code.sample, 0
        self._bodies = Model(laws.robot)
        self.forget()

    def forget(self) -> None:
        """Begin anew where the joints are, with all memory at zero."""
        self.remember(self._joints(self._seen[0], self._zeros), np.zeros(self.laws.n_memory))

    def remember(self, q: Array, states: Array) -> None:
        """Set the memory: last positions from `q`, all joints, and states from a full memory."""
        memory = np.array(states, dtype=np.float64)
        for placed in self.laws.placed:
            if placed.memory is not None:
                for k, axis in enumerate(placed.memory.axes(self.laws.robot)):
                    memory[placed.at + k] = np.dot(axis.row, q)
        self._memories = [None] * len(self._memories)
        for rows in self._rows:
            rows[self._head :] = memory[:, None]

    def step(self) -> Array:
        """Forces on the joints `dofs` for one step, overwritten by the next; the memory goes on."""
        if self._memories:
            self._scan()
        self._sample(self._places[self._turn])
        self._turn = 1 - self._turn
        return self.forces

    def brakes(self) -> Array:
        """Torque of motor-side terms at the last step, shape `(n,)`."""
        result = np.zeros(self._count)
        if self._brakes:
            result[self._brakes] = self._rows[self._turn][len(self._loads) : self._head, 0]
        return result[: len(self.applied)]

    def _joints(self, x: Array, zeros: Array | float = 0.0) -> Array:
        """MuJoCo's values as those of all joints, shape `(n_joints,)`."""
        return np.asarray((x[self._carriers] - zeros) / self._ratios)

    def _scan(self) -> None:
        robot = self.laws.robot
        q = self._joints(self._seen[0], self._zeros)[:, None]
        dq, ddq = (self._joints(x)[:, None] for x in self._seen[1:])
        samples = TermSamples(q, dq, ddq, lambda tens: self._bodies.rigid_torque(q, dq, ddq, tens))
        for k, placed in enumerate(self.laws.scanned):
            if isinstance(placed.term, StatefulTerm):
                found, self._memories[k] = placed.term.remember(robot, samples, self._memories[k])
                self._channels[placed.channel : placed.channel + len(found)] = found[:, 0]


MEMORY_TIMESTEP = 1e-4  # coarsest step where friction has memory [s]

_FINEST_SHARE = 1.0 / 16.0
_STABILITY_POSTURES = 24
_STIFFEST_STEP = 0.5


def stable_timestep(laws: Laws) -> float:
    r"""The step `h`, halved until it follows damping and stiffness of the laws.

    $h\,\lambda_{max}(M^{-1} D) \le 1$ and $h\,\lambda_{max}(M^{-1} K)^{1/2} \le 1/2$ with the
    steepest `D` and `K` found at random postures, at rest, about rest and in motion, and at all
    bends of friction with memory.

    Raises:
        ModelError: A joint moves nothing, or the step would be absurdly fine.
    """
    robot, rng = laws.robot, np.random.default_rng(3)
    postures = postures_of(robot).q[:_STABILITY_POSTURES]
    masses = mass_matrices(laws.model, postures)
    least = np.diagonal(masses, axis1=1, axis2=2).min(axis=0)
    for joint, lightest in zip(robot.joints, least, strict=True):
        if lightest < 1e-9:
            raise ModelError(
                f"joint '{joint.name}' moves almost no inertia ({lightest:.2g})",
                where="truth of the virtual robot",
                fix="give the links beyond this joint a mass, or the joint a rotor inertia",
            )
    slopes = _slopes(laws)
    damping = stiffness = 0.0
    for q, mass in zip(postures, masses, strict=True):
        for speed in (0.0, 1.0, 1e3):
            dq = speed * laws.widths * rng.uniform(-1.0, 1.0, robot.n_joints)
            states = rng.choice([-1.0, 0.0, 1.0], laws.n_memory)
            slow, stiff = (
                float(np.abs(np.linalg.eigvals(np.linalg.solve(mass, slope))).max())
                for slope in slopes(q, dq, states)
            )
            damping, stiffness = max(damping, slow), max(stiffness, stiff)
    coarsest = MEMORY_TIMESTEP if laws.n_memory or laws.n_channels else TIMESTEP
    timestep = coarsest
    while timestep * damping > 1.0 or timestep * np.sqrt(stiffness) > _STIFFEST_STEP:
        timestep *= 0.5
        if timestep < _FINEST_SHARE * coarsest:
            raise ModelError(
                f"a law is too stiff to be simulated: it needs steps below {2e6 * timestep:.2g} µs",
                where="truth of the virtual robot",
                fix="give it larger smoothing speeds or presliding lengths, less friction, or the "
                "joints more rotor inertia",
            )
    return timestep


def _slopes(laws: Laws) -> Callable[[Array, Array, Array], tuple[Array, Array]]:
    """Damping and stiffness of all joints `(n_joints, n_joints)`, at positions, speeds, memory.

    By small differences, through the code that the plant runs.
    """
    model, joints = laws.model, laws.robot.n_joints
    x, v = np.zeros((2, len(model.offset)))
    used = LawsInUse(laws, x, v, np.zeros(len(x)))

    def braking(q: Array, dq: Array, before: Array, states: Array) -> Array:
        x[:], v[:] = model.map @ q + model.offset, model.map @ dq
        used.remember(before, states)
        result = np.zeros(len(x))
        result[used.dofs] = -used.step()
        return np.asarray(model.map.T @ result)

    def slopes(q: Array, dq: Array, states: Array) -> tuple[Array, Array]:
        base = braking(q, dq, q, states)
        slow, stiff = np.empty((2, joints, joints))
        for j, width in enumerate(laws.widths):
            turn = np.zeros(joints)
            turn[j] = 1e-3 * width
            slow[:, j] = (braking(q, dq + turn, q, states) - base) / turn[j]
            turn[j] = 1e-8
            stiff[:, j] = (braking(q + turn, dq, q, states) - base) / turn[j]
        return slow, stiff

    return slopes
