"""A model: a robot and the causes of its torque, linear in named parameters."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.errors import DataError, ModelError
from steelyard.kernel.equations.closed_chains import completed, projected
from steelyard.kernel.equations.dynamics import JointState, Scalar, inverse_dynamics
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.native.vector_ir import MAX_ANGLE
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program
from steelyard.motion import Motion
from steelyard.parameters import Parameter, Parameters
from steelyard.robot.json import robot_from_dict, robot_to_dict
from steelyard.robot.robot import Robot
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.register import DEFAULT_TERMS, description_of, term_of
from steelyard.terms.scan import Scan
from steelyard.terms.term import Columns, StatefulTerm, Term, channels_of

BLOCK = 4096


@dataclass(frozen=True, eq=False, repr=False)
class Model:
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

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps: compiled code is of one process."""
        return {"robot": self.robot, "terms": self.terms}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All standard parameters, term by term."""
        return tuple(p for term in self.terms for p in term.parameters(self.robot))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the standard parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the standard parameters."""
        return tuple(p.unit for p in self.parameters)

    @property
    def has_bodies(self) -> bool:
        """Whether rigid bodies are among the terms."""
        return any(term.role == "body" for term in self.terms)

    @cached_property
    def n_channels(self) -> int:
        """Channels that are computed along a motion, see `Scan`."""
        terms = sum(channels_of(term, self.robot) for term in self.terms)
        return len(self.robot.passive) + terms

    def columns(self, state: JointState) -> Columns:
        """Regressor entries `(effort row, standard parameter)` over symbols.

        Args:
            state: Independent joints, and all channels.
        """
        full, torque_map = completed(self.robot, state)
        entries: dict[tuple[int, int], Scalar] = {}
        for start, term, seen in self._seen(full):
            for (row, column), value in term.columns(self.robot, seen).items():
                entries[row, start + column] = value
        return projected(self.robot, entries, torque_map)

    def torque_of(self, state: JointState, values: Sequence[Scalar]) -> list[Scalar]:
        """Efforts over symbols: bodies by inverse dynamics, other terms by their columns."""
        full, torque_map = completed(self.robot, state)
        efforts: list[Scalar] = [0.0] * self.robot.n_joints
        for start, term, seen in self._seen(full):
            if term.role == "body":
                tens = [
                    [0.0] * 10 if body.massless else values[start + 10 * k : start + 10 * k + 10]
                    for k, body in enumerate(self.robot.bodies)
                ]
                for row, effort in enumerate(inverse_dynamics(self.robot, seen, tens)):
                    efforts[row] += effort
                continue
            for (row, column), value in term.columns(self.robot, seen).items():
                efforts[row] += value * values[start + column]
        entries = {(row, 0): effort for row, effort in enumerate(efforts)}
        rows = projected(self.robot, entries, torque_map)
        return [rows[row, 0] for row in range(self.robot.n)]

    def _seen(self, state: JointState) -> Iterator[tuple[int, Term, JointState]]:
        """Every term with its first parameter and the state with its own channels only."""
        first = 0
        for start, term in self._placed():
            count = channels_of(term, self.robot)
            mine = state.channels[first : first + count]
            yield start, term, JointState(state.q, state.dq, state.ddq, mine)
            first += count

    def _placed(self) -> Iterator[tuple[int, Term]]:
        start = 0
        for term in self.terms:
            yield start, term
            start += len(term.parameters(self.robot))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "robot": robot_to_dict(self.robot),
            "terms": [description_of(term) for term in self.terms],
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Model":
        """The model that `to_dict` wrote."""
        terms = tuple(term_of(t, "list of terms of a saved model") for t in data["terms"])
        return cls(robot_from_dict(data["robot"]), terms)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything the model's columns depend on."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()

    @cached_property
    def program_key(self) -> list[Any]:
        """What programs over this model's columns depend on: no fields that channels know alone."""
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
        from steelyard.kernel.program.trace import symbolic

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

        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.kernel.program.trace import symbolic

            inputs = (*self.inputs, Input("parameters", len(self.parameters), shared=True))
            return symbolic(lambda *x: self.torque_of(JointState(*x[:4]), x[4]), inputs), {}

        return compiled(["torque", self.program_key], build)

    @cached_property
    def bodies_only(self) -> "Model":
        """The rigid bodies of the robot as a tree, all joints independent."""
        robot = self.robot
        tree = robot.changed(coordinates=robot.joints, passive=(), loops=(), transmission=None)
        return Model(tree, (RigidBody(),))

    def scan(self, drop: bool = False) -> "Scan":
        """Begin to compute channels along a motion.

        Args:
            drop: Whether a loop that cannot close is passed over, see `Scan.closed`.
        """
        return Scan(self.robot, self.terms, self._rigid_torque, drop)

    def _rigid_torque(self, q: Array, dq: Array, ddq: Array, tens: Array) -> Array:
        """Torques of the bodies as a tree, shape `(n_joints, N)`."""
        channels = np.empty((0, q.shape[1]))
        shared = [False, False, False, False, True]
        return self.bodies_only.torque_code([q, dq, ddq, channels, tens], shared)

    def at(self, values: Parameters) -> "ValuedModel":
        """The model with values; standard parameters that are not named are zero.

        Raises:
            DataError: A value belongs to no parameter of the model.
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
class ValuedModel:
    """A model with values for its standard parameters.

    Base parameters come as standard ones with the others of each group at zero: the torque is the
    same.
    """

    model: Model
    values: Parameters

    def __repr__(self) -> str:
        return f"ValuedModel({self.model!r})"

    def torque(self, motion: Motion) -> Array:
        """Joint efforts along a motion.

        Args:
            motion: `N` samples of `n` joints.

        Returns:
            Shape `(N, n)` [Nm; N].

        Raises:
            DataError: The motion has another number of joints, turns beyond 1e5 rad, or opens a
                loop; or the efforts are too large for numbers.
        """
        if not isinstance(motion, Motion):
            raise DataError(
                f"a {type(motion).__name__} is no motion",
                where=f"model of '{self.model.robot.name}'",
                fix="give steelyard.Motion(t, q, dq, ddq), or trajectory.sample(t)",
            )
        if motion.n_joints != self.model.robot.n:
            raise DataError(
                f"the motion has {motion.n_joints} joints, the model {self.model.robot.n}",
                where=f"model of '{self.model.robot.name}'",
                fix=f"give columns for {', '.join(self.model.robot.joint_names)}",
            )
        check_angles(motion.q)
        result, scan = np.empty(motion.q.shape), self.model.scan()
        for start in range(0, len(motion), BLOCK):
            part = slice(start, start + BLOCK)
            q, dq, ddq = motion.q[part].T, motion.dq[part].T, motion.ddq[part].T
            result[part] = self.block(q, dq, ddq, scan(q, dq, ddq, motion.t[part])).T
        check_efforts(result)
        return result

    def block(self, q: Array, dq: Array, ddq: Array, channels: Array | None = None) -> Array:
        """Efforts of one block, joint-major.

        Args:
            q: Positions, shape `(n, B)`.
            dq: Velocities, shape `(n, B)`.
            ddq: Accelerations, shape `(n, B)`.
            channels: Shape `(n_channels, B)`, see `Scan`; `None` for a model without.
        """
        channels = np.empty((0, q.shape[1])) if channels is None else channels
        code = self.model.torque_code
        shared = [False, False, False, False, True]
        return code([q, dq, ddq, channels, self.values.values], shared)

    def start(self) -> "Stepper":
        """Begin to evaluate sample by sample, for controllers and streams."""
        return Stepper(self)


class Stepper:
    """Sample-by-sample evaluation; buffers are made once, so a step allocates one small array."""

    def __init__(self, valued: ValuedModel) -> None:
        code, n = valued.model.torque_code, valued.model.robot.n
        self._motion = np.zeros((3, n, code.lanes))
        self._inputs = list(self._motion)
        self._channels = np.zeros((valued.model.n_channels, code.lanes))
        self._scan = valued.model.scan()
        self._values = valued.values.values
        self._output = np.empty((n, code.lanes))
        self._arguments = [
            *(n for x in (*self._inputs, self._channels) for n in (x.ctypes.data, code.lanes)),
            self._values.ctypes.data,
            0,
            self._output.ctypes.data,
            code.lanes,
        ]
        self._code = code

    def step(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Joint efforts at one sample, each argument and the result of shape `(n,)`.

        Friction with memory remembers the steps before; a new motion needs a new stepper.

        Raises:
            DataError: An argument has another shape, or a position lies beyond 1e5 rad.
        """
        for buffer, values in zip(self._inputs, (q, dq, ddq), strict=True):
            row = np.asarray(values)
            if row.shape != (len(buffer),) or row.dtype.kind not in "iuf":
                raise DataError(
                    f"values of shape {row.shape}, type {row.dtype}, for {len(buffer)} joints",
                    where="q, dq or ddq",
                    fix="give one number per joint in each",
                )
            buffer[:] = row[:, None]
        check_angles(self._inputs[0])
        check_efforts(self._motion, "velocities and accelerations")
        if len(self._channels):
            self._channels[:] = self._scan(*(x[:, :1] for x in self._inputs))
        self._code.raw(self._code.lanes, *self._arguments)
        efforts: Array = self._output[:, 0].copy()
        check_efforts(efforts)
        return efforts


def check_efforts(values: Array, what: str = "efforts of the model") -> None:
    """No silent NaN.

    Raises:
        DataError: A value is not finite.
    """
    if not np.isfinite(values).all():
        raise DataError(
            f"a value of the {what} is not finite",
            where="velocities `dq` and accelerations `ddq`",
            fix="check their units, and leave out samples without a number",
        )


def check_angles(q: Array) -> None:
    """Machine code reduces angles exactly only up to a limit.

    Raises:
        DataError: A position lies beyond it, or is not a number.
    """
    if q.size and not np.abs(q).max() <= MAX_ANGLE:
        raise DataError(
            f"a joint position lies beyond {MAX_ANGLE:g} rad or is not finite",
            where="positions `q`",
            fix="check the unit of the position columns (rad, not encoder counts)",
        )
