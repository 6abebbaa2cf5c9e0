"""The torques that MuJoCo does not know, as machine code that reads MuJoCo's own memory.

One call per integration step takes the positions, velocities and last accelerations of MuJoCo's
joints and the applied torques, steps the memory of friction, and gives the forces. Laws that
jump at zero speed are softened, see `kernel.program.smoothing`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState, Scalar
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program
from steelyard.kernel.program.smoothing import softened
from steelyard.model import Model
from steelyard.robot.robot import Robot
from steelyard.terms.memory import Presliding
from steelyard.terms.term import Samples, StatefulTerm, Term, channels_of
from steelyard.virtual.mujoco_model import MujocoModel

VELOCITY, WIDTHS = 1, 7


@dataclass(frozen=True)
class Placed:
    """A term with its place in the program's inputs.

    Attributes:
        term: The term.
        first: Its first parameter.
        memory: How its memory steps; `None` without.
        at: First row of its memory: positions along its axes, then states.
        channel: Its first channel among those of laws that are stepped by their own scan.
    """

    term: Term
    first: int
    memory: Presliding | None
    at: int
    channel: int


@dataclass(frozen=True, eq=False)
class Laws:
    """Terms of a robot, ready to be evaluated at every step.

    Attributes:
        robot: The robot.
        terms: The terms; neither bodies nor rotor inertia.
        values: Their parameters.
        widths: Speeds over which jumps at zero speed are spread, per joint of the robot.
        model: Where MuJoCo's joints are.
    """

    robot: Robot
    terms: tuple[Term, ...]
    values: Array
    widths: Array
    model: MujocoModel

    @cached_property
    def placed(self) -> tuple[Placed, ...]:
        """The terms with their places."""
        found, first, at, channel = [], 0, 0, 0
        for term in self.terms:
            memory = term if isinstance(term, Presliding) else None
            found.append(Placed(term, first, memory, at, channel))
            first += len(term.parameters(self.robot))
            if memory is not None:
                at += memory.n_memory(self.robot)
            else:
                channel += channels_of(term, self.robot)
        return tuple(found)

    @property
    def n_memory(self) -> int:
        """Rows of the memory."""
        memories = (p.memory for p in self.placed)
        return sum(memory.n_memory(self.robot) for memory in memories if memory is not None)

    @property
    def scanned(self) -> tuple[Placed, ...]:
        """Terms that are stepped by their own scan."""
        return tuple(p for p in self.placed if p.memory is None and channels_of(p.term, self.robot))

    @property
    def n_channels(self) -> int:
        """Channels of the terms that are stepped by their own scan."""
        return sum(channels_of(p.term, self.robot) for p in self.scanned)

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
            from steelyard.kernel.program.trace import symbolic

            about: dict[str, Any] = {}

            def outputs(*x: Any) -> list[Scalar]:
                rows, found = self._outputs(*x)
                about.update(found)
                return rows

            program = symbolic(outputs, self._inputs())
            return softened(program, VELOCITY, WIDTHS), about

        return compiled(["virtual", described, *self.places], build)

    def _inputs(self) -> tuple[Input, ...]:
        n = len(self.model.offset)
        return (
            Input("position", n, shared=True),
            Input("velocity", n, shared=True),
            Input("acceleration", n, shared=True),
            Input("applied", self.robot.n, shared=True),
            Input("memory", self.n_memory),
            Input("channels", self.n_channels, shared=True),
            Input("parameters", len(self.values), shared=True),
            Input("widths", n, shared=True),
        )

    def _outputs(
        self,
        position: Sequence[Scalar],
        velocity: Sequence[Scalar],
        acceleration: Sequence[Scalar],
        applied: Sequence[Scalar],
        before: Sequence[Scalar],
        channels: Sequence[Scalar],
        values: Sequence[Scalar],
        _: Sequence[Scalar],
    ) -> tuple[list[Scalar], dict[str, Any]]:
        places = list(zip(*self.places, strict=True))
        q = [(position[c] - zero) / ratio for c, ratio, zero in places]
        dq, ddq = ([x[c] / ratio for c, ratio, _ in places] for x in (velocity, acceleration))
        total: dict[int, Scalar] = dict(enumerate(applied))
        brakes: dict[int, Scalar] = {}
        memory: list[Scalar] = []
        for placed in self.placed:
            mine = channels[placed.channel : placed.channel + channels_of(placed.term, self.robot)]
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
        behind = sorted(brakes)
        rows = [*forces, *(brakes[row] for row in behind), *memory]
        return rows, {"loads": loads, "brakes": behind}


class LawsInUse:
    """Laws that follow one simulation: buffers are made once, a step allocates nothing.

    Attributes:
        laws: The laws.
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
        self._bodies = Model(laws.robot).bodies_only
        self.forget()

    def forget(self) -> None:
        """Begin anew where the joints are, with all memory at zero."""
        q = self._joints(self._seen[0], self._zeros)
        self.remember(q, np.zeros(self.laws.n_memory))

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
        samples = Samples(q, dq, ddq, lambda tens: self._rigid(q, dq, ddq, tens))
        for k, placed in enumerate(self.laws.scanned):
            if isinstance(placed.term, StatefulTerm):
                found, self._memories[k] = placed.term.remember(robot, samples, self._memories[k])
                self._channels[placed.channel : placed.channel + len(found)] = found[:, 0]

    def _rigid(self, q: Array, dq: Array, ddq: Array, tens: Array) -> Array:
        shared = [False, False, False, False, True]
        return self._bodies.torque_code([q, dq, ddq, np.empty((0, 1)), tens], shared)
