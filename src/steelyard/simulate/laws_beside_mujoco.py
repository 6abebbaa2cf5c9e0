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
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import TIMESTEP, MujocoModel, mass_matrices
from steelyard.simulate.typical_torques_and_masses import postures_of
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, softened

VELOCITY, WIDTHS = 1, 6


@dataclass(frozen=True, eq=False)
class Laws:
    """Terms of a robot, ready to be evaluated at every step."""

    robot: Robot
    terms: tuple[Term, ...]  # the terms; neither bodies nor rotor inertia
    values: Array  # their parameters
    widths: Array  # speeds over which jumps at zero speed are spread, per joint of the robot
    model: MujocoModel

    @property
    def remembering(self) -> list[Presliding]:
        """Terms with memory, in the order in which the memory holds theirs."""
        return [term for term in self.terms if isinstance(term, Presliding)]

    @property
    def n_memory(self) -> int:
        """Rows of the memory."""
        return sum(term.n_memory(self.robot) for term in self.remembering)

    @cached_property
    def places(self) -> tuple[list[int], list[float], list[float]]:
        """Per joint its number, ratio and zero among MuJoCo's joints."""
        carriers = list(self.model.carriers)
        ratios = [float(self.model.map[c, j]) for j, c in enumerate(carriers)]
        return carriers, ratios, [float(self.model.offset[c]) for c in carriers]

    @cached_property
    def code(self) -> Code:
        """Machine code; `about` names the joints that its rows load and brake.

        Inputs: positions, velocities, accelerations, applied torques, memory, parameters, widths.
        Outputs: forces on the joints `loads`, torque of motor-side terms on the joints
        `brakes`, memory.
        """
        described = Model(self.robot, self.terms).to_dict()

        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import symbolic

            about: dict[str, Any] = {}
            rows = dict.fromkeys(("position", "velocity", "acceleration"), len(self.model.offset))
            rows |= {"applied": self.robot.n, "memory": self.n_memory}
            rows |= {"parameters": len(self.values), "widths": len(self.model.offset)}
            inputs = [Input(name, n, shared=name != "memory") for name, n in rows.items()]
            program = symbolic(lambda *given: self._outputs(about, *given), inputs)
            return softened(program, VELOCITY, WIDTHS), about

        return compiled(["virtual", described, *self.places], build)

    def _outputs(self, about: dict[str, Any], *given: Sequence[Scalar]) -> list[Scalar]:
        """Rows of `code` over its inputs; tells which joints they load and brake."""
        position, velocity, acceleration, applied, before, values, _ = given
        places = list(zip(*self.places, strict=True))
        q = [(position[c] - zero) / ratio for c, ratio, zero in places]
        dq, ddq = ([x[c] / ratio for c, ratio, _ in places] for x in (velocity, acceleration))
        total: dict[int, Scalar] = dict(enumerate(applied))
        brakes: dict[int, Scalar] = {}
        memory: list[Scalar] = []
        first = 0
        for term in self.terms:
            state = JointState(q, dq, ddq)
            if isinstance(term, Presliding):
                last = before[len(memory) : len(memory) + term.n_memory(self.robot)]
                rows, channels = term.stepped(self.robot, state, last)
                state, memory = JointState(q, dq, ddq, channels), memory + rows
            for (row, column), entry in term.columns(self.robot, state).items():
                effort = entry * values[first + column]
                total[row] = total[row] - effort if row in total else -effort
                if term.on_motors:
                    brakes[row] = brakes[row] + effort if row in brakes else effort
            first += len(term.parameters(self.robot))
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
        self._widths = np.zeros(len(laws.model.offset))
        self._widths[carriers] = laws.widths * np.abs(ratios)
        self._values = np.ascontiguousarray(laws.values)
        addresses = [x for a in (*self._seen, self.applied) for x in (a.ctypes.data, 0)]
        rest = [x for a in (self._values, self._widths) for x in (a.ctypes.data, 0)]
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
        self.forget()

    def forget(self) -> None:
        """Begin anew where the joints are, with all memory at zero."""
        q = (self._seen[0][self._carriers] - self._zeros) / self._ratios
        self.remember(q, np.zeros(self.laws.n_memory))

    def remember(self, q: Array, states: Array) -> None:
        """Set the memory: last positions from `q`, all joints, and states from a full memory."""
        memory, at = np.array(states, dtype=np.float64), 0
        for term in self.laws.remembering:
            here = [np.dot(axis.row, q) for axis in term.axes(self.laws.robot)]
            memory[at : at + len(here)] = here
            at += term.n_memory(self.laws.robot)
        for rows in self._rows:
            rows[self._head :] = memory[:, None]

    def step(self) -> Array:
        """Forces on the joints `dofs` for one step, overwritten by the next; the memory goes on."""
        self._sample(self._places[self._turn])
        self._turn = 1 - self._turn
        return self.forces

    def brakes(self) -> Array:
        """Torque of motor-side terms at the last step, shape `(n,)`."""
        result = np.zeros(self._count)
        result[self._brakes] = self._rows[self._turn][len(self._loads) : self._head, 0]
        return result[: len(self.applied)]


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
    coarsest = MEMORY_TIMESTEP if laws.n_memory else TIMESTEP
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
