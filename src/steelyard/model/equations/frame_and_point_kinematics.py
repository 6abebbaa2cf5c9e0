r"""Frames and points of a robot as machine code, on any chains: position, Jacobian and drift.

Everything is expressed in the base frame. The linear part of a Jacobian is the derivative of a
point's position, the angular part maps joint speeds to the angular velocity:
$\omega = J_\omega \dot q$.

With the linear and the angular velocity $v = J \dot q$, the accelerations are
$a = J \ddot q + \dot J \dot q$; the drift is $\dot J \dot q$. Passive joints follow the independent
ones, so that $J$ and the drift are those of the independent joints alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, named
from steelyard.model.equations import inverse_dynamics as rigid
from steelyard.model.equations.inverse_dynamics import JointState, Matrix, Scalar, Scalars, Vector
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.robot.robot import Frame, Robot, body_frames, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, compiled, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import carried_along, in_time, symbolic


@dataclass(frozen=True, eq=False)
class Points:
    """Points `(m, 3)` [m] that are fixed to bodies of a robot, each in its body's frame.

    The `code` maps `q` to positions, then their derivatives, point by point; `flow` `q` and `dq` to
    all positions, then all velocities; `bend` `q`, `dq` and `ddq` to all accelerations.
    """

    robot: Robot
    carriers: tuple[int, ...]
    places: Array
    code: Code
    flow: Program
    bend: Program

    def __reduce__(self) -> tuple[Any, ...]:
        """What pickle keeps: compiled code is of one process."""
        return points_on, (self.robot, self.carriers, self.places)

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Positions `(N, m, 3)` [m] and their derivatives `(N, m, 3, n)` at `q`, `(N, n)`."""
        m, n = len(self.carriers), self.robot.n
        values = self.code([q.T]).T
        slopes = values[:, 3 * m :].reshape(len(q), m, 3, n)
        return values[:, : 3 * m].reshape(len(q), m, 3), slopes


@dataclass(frozen=True, eq=False)
class FrameKinematics:
    """Pose, Jacobian and drift of one frame."""

    robot: Robot
    frame: Frame

    def __call__(self, q: Array) -> tuple[Array, Array, Array]:
        """Position `(N, 3)`, rotation `(N, 3, 3)` and Jacobian `(N, 6, n)` at `q`, `(N, n)`."""
        values = self._pose_code([q.T, passive_positions(self.robot, q.T)]).T
        count = len(q)
        jacobian = values[:, 12:].reshape(count, 6, self.robot.n)
        return values[:, :3], values[:, 3:12].reshape(count, 3, 3), jacobian

    def moving(self, q: Array, passive: Array, dq: Array) -> tuple[Array, Array, Array, Array]:
        """Origin `(3,)` [m], axes `(3, 3)`, Jacobian `(6, n)` and drift `(6,)`, in the base frame.

        At one sample: independent `q` `(n,)`, passive joints where loops close, and `dq` `(n,)`.
        """
        values = self._motion_code([q[:, None], passive[:, None], dq[:, None]])[:, 0]
        jacobian = values[12:-6].reshape(6, self.robot.n)
        return values[:3], values[3:12].reshape(3, 3), jacobian, values[-6:]

    @cached_property
    def _pose_code(self) -> Code:
        return self._code("frame", frame_outputs, ("q", "passive"))

    @cached_property
    def _motion_code(self) -> Code:
        return self._code("frame motion", _frame_motion_outputs, ("q", "passive", "dq"))

    def _code(self, what: str, outputs: Callable[..., list[Scalar]], names: Sequence[str]) -> Code:
        place = [self.frame.body, self.frame.rotation.tolist(), self.frame.position.tolist()]
        sizes = {"q": self.robot.n, "passive": len(self.robot.passive), "dq": self.robot.n}
        return compiled_equations(
            [what, robot_to_dict(self.robot), place],
            lambda *x: outputs(self.robot, self.frame, *x),
            [Input(name, sizes[name]) for name in names],
        )


def last_frame(robot: Robot) -> str:
    """Name of the frame at the robot's end: the last one on its last body, or that body's own.

    A robot with a floating base has no end: its base is taken.
    """
    if robot.floating:
        return robot.bodies[0].name
    last = len(robot.bodies) - 1
    on_it = [frame.name for frame in robot.frames if frame.body == last]
    return on_it[-1] if on_it else robot.bodies[last].name


def frame_of(robot: Robot, name: str | Frame | None) -> Frame:
    """The frame of a moving link, or of one fixed to a link or the base; the last if `None`."""
    if isinstance(name, Frame):
        return name
    name = last_frame(robot) if name is None else name
    frames = {frame.name: frame for frame in (*body_frames(robot)[1:], *robot.frames)}
    return named(name, frames, "frame", "frames", f"robot '{robot.name}'")


def refuse_fixed(robot: Robot, frame: Frame) -> None:
    """Refuse a frame of the base where one of a moving body is needed."""
    if frame.body < 0:
        raise ModelError(
            f"frame '{frame.name}' is fixed to the base: no joint moves it or feels what pushes "
            "there",
            where=f"robot '{robot.name}'",
            fix=f"name a frame on a moving link, such as '{last_frame(robot)}'",
        )


def frame_kinematics(robot: Robot, frame: str | Frame) -> FrameKinematics:
    """Pose, Jacobian and drift of a frame."""
    return FrameKinematics(robot, frame_of(robot, frame))


def frame_outputs(robot: Robot, frame: Frame, q: Scalars, passive: Scalars) -> list[Scalar]:
    r"""Position, rotation and Jacobian of a frame, row by row; loops are closed at the positions.

    Passive joints follow the independent ones with $\dot q_p = G \dot q_a$, so that a frame behind
    them has the Jacobian $J_a + J_p G$.
    """
    positions = [*q, *passive]
    position, slopes = rigid.carried_point(robot, positions, frame.body, frame.position)
    rotation, axes = _turned(robot, positions, frame)
    outputs = [*position, *rotation.ravel()]
    torque_map = None
    if max([*slopes, *axes], default=-1) >= robot.n:
        rest = [0.0] * robot.n
        _, torque_map = rigid.completed(robot, JointState(q, rest, rest, passive))
    for columns in (slopes, axes):
        entries = {(j, k): x for j, column in columns.items() for k, x in enumerate(column)}
        found = rigid.projected(robot, entries, torque_map)
        outputs += [found.get((j, k), 0.0) for k in range(3) for j in range(robot.n)]
    return outputs


def points_on(robot: Robot, carriers: Sequence[int], places: ArrayLike) -> Points:
    """Points of bodies, -1 is the base, at places in their frames `(m, 3)` [m].

    It is a `ModelError` if loops decide where one is.
    """
    points, n = frozen(places, (len(carriers), 3)), robot.n
    for body in carriers:
        refuse_passive(robot, body, robot.bodies[body].name if body >= 0 else "base")

    def build() -> tuple[Program, dict[str, Any]]:
        def outputs(q: Scalars) -> list[Scalar]:
            ends = [
                rigid.carried_point(robot, q, *one) for one in zip(carriers, points, strict=True)
            ]
            positions = [x for position, _ in ends for x in position]
            return [*positions, *(x for _, slopes in ends for x in _rows(slopes, n))]

        def flow(q: Scalars, dq: Scalars) -> list[Scalar]:
            positions = outputs(q)[: 3 * len(points)]
            return [*positions, *carried_along(positions, q, dq)]

        def bend(*state: Scalars) -> list[Scalar]:
            return in_time(flow, *state)[3 * len(points) :]

        inputs = [Input(name, n) for name in ("q", "dq", "ddq")]
        about = {"flow": symbolic(flow, inputs[:2]), "bend": symbolic(bend, inputs)}
        return symbolic(outputs, inputs[:1]), about

    code = compiled(["points", robot_to_dict(robot), list(carriers), points.tolist()], build)
    return Points(robot, tuple(carriers), points, code, *code.beside("flow", "bend"))


def refuse_passive(robot: Robot, body: int, name: str) -> None:
    """Points with programs of their motion hang on independent joints only."""
    for link in (robot.bodies[k] for k in reversed(robot.carriers(body))):
        if link.coordinate >= robot.n:
            raise ModelError(
                f"frame '{name}' hangs on joint '{link.joint}', which a closed loop determines",
                where=f"robot '{robot.name}'",
                fix="name a frame that hangs on driven joints only: the motion of frames behind "
                "passive joints has no bounds between samples",
            )


def _turned(robot: Robot, q: Scalars, frame: Frame) -> tuple[Matrix, dict[int, Vector]]:
    """Axes of a frame in the base frame, and the angular velocity per joint speed."""
    rotation, axes = rigid._constant(np.eye(3)), dict[int, Vector]()
    for link in (robot.bodies[k] for k in robot.carriers(frame.body)):
        if link.kind == "floating":
            axes = dict(enumerate(rigid._AXES, start=3))
            continue
        if link.kind == "revolute":
            axis = rigid._times(rotation @ rigid._constant(link.rotation @ link.axis), link.ratio)
            axes[link.coordinate] = axis + axes.get(link.coordinate, 0.0)
        turned, _ = rigid._placement(link, link.ratio * q[link.coordinate] + link.offset)
        rotation = rotation @ turned
    return rotation @ rigid._constant(frame.rotation), axes


def _rows(columns: dict[int, Vector], n: int) -> list[Scalar]:
    """Three rows of `n` from the columns that are not zero."""
    return [columns[j][axis] if j in columns else 0.0 for axis in range(3) for j in range(n)]


def _frame_motion_outputs(
    robot: Robot, frame: Frame, q: Scalars, passive: Scalars, dq: Scalars
) -> list[Scalar]:
    """Outputs of `frame_outputs`, and the drift: how the velocities grow while `dq` is constant."""
    found, n = frame_outputs(robot, frame, q, passive), robot.n
    rows = np.array(found[12:], dtype=object).reshape(6, n)
    velocities = [sum((x * rate for x, rate in zip(row, dq, strict=True)), 0.0) for row in rows]
    state, _ = rigid.completed(robot, JointState(q, dq, [0.0] * n, passive))
    return [*found, *carried_along(velocities, [*q, *passive], state.dq)]
