"""A robot and the terms of its torque as equations over symbols, and the programs made of them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.model.equations.closed_chains import completed, projected
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.laws.register import description_of
from steelyard.model.laws.rigid_body import RigidBody, body_efforts
from steelyard.model.terms.friction_memory import Presliding, Scan
from steelyard.model.terms.term import Columns, StatefulTerm, Term, channels_of
from steelyard.robot.robot import Robot, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program


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
        return names_of(self, lambda term: term.cause == "friction")

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the standard parameters."""
        return tuple(p.unit for p in self.parameters)

    @cached_property
    def n_channels(self) -> int:
        """Channels that are computed along a motion, see `Scan`."""
        terms = sum(channels_of(term, self.robot) for term in self.terms)
        return len(self.robot.passive) + terms

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
        full, _ = completed(self.robot, state)
        return [x for term in self._remembering for x in term.started(self.robot, full)]

    def stepped(self, state: JointState, memory: Scalars) -> tuple[list[Scalar], list[Scalar]]:
        """Memory of friction after one step, and all channels there, from the state at its end."""
        full, _ = completed(self.robot, state)
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
        full, torque_map = completed(self.robot, state)
        entries: dict[tuple[int, int], Scalar] = {}
        for start, term, seen in self._seen(full):
            for (row, column), value in term.columns(self.robot, seen).items():
                entries[row, start + column] = value
        return projected(self.robot, entries, torque_map)

    def torque_of(self, state: JointState, values: Scalars) -> list[Scalar]:
        """Efforts over symbols: bodies by inverse dynamics, other terms by their columns."""
        full, torque_map = completed(self.robot, state)
        efforts: list[Scalar] = [0.0] * self.robot.n_joints
        for start, term, seen in self._seen(full):
            if term.role == "body":
                for row, effort in enumerate(body_efforts(self.robot, seen, values[start:])):
                    efforts[row] += effort
                continue
            for (row, column), value in term.columns(self.robot, seen).items():
                efforts[row] += value * values[start + column]
        entries = {(row, 0): effort for row, effort in enumerate(efforts)}
        rows = projected(self.robot, entries, torque_map)
        return [rows[row, 0] for row in range(self.robot.n)]

    def _seen(self, state: JointState) -> Iterator[tuple[int, Term, JointState]]:
        """Every term with its first parameter and the state with its own channels only."""
        first = start = 0
        for term in self.terms:
            mine = state.channels[first : first + channels_of(term, self.robot)]
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
        from steelyard.symbolic.symbols_and_tracing import symbolic

        places: list[tuple[int, int]] = []

        def build(*x: Any) -> list[Scalar]:
            columns = self.columns(JointState(*x))
            places.extend(columns)
            return list(columns.values())

        program = symbolic(build, self.inputs)
        return program, tuple(places)

    @cached_property
    def torque_code(self) -> Code:
        """Machine code of the torque; inputs as `inputs`, and the shared parameters."""
        return compiled_equations(
            ["torque", self.program_key],
            lambda *x: self.torque_of(JointState(*x[:4]), x[4]),
            (*self.inputs, Input("parameters", len(self.parameters), shared=True)),
        )

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


def names_of(equations: Equations, chosen: Callable[[Term], bool]) -> tuple[str, ...]:
    """Names of the parameters of some terms."""
    terms = (term for term in equations.terms if chosen(term))
    return tuple(p.name for term in terms for p in term.parameters(equations.robot))
