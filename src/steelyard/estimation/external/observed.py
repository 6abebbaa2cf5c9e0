r"""What an observer of external efforts needs of a model at a sample, as one program.

With momentum $p = M \dot q$ and $u = C^T \dot q - g - \tau_o$, where $\tau_o$ are all efforts
beside those of the inertia (friction, springs, offsets), $\dot p = \tau + u + J^T F$ under joint
efforts $\tau$ and a wrench $F$ on a frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics.equations import Equations
from steelyard.dynamics.quantity import MOMENTUM, MOMENTUM_RATE, MOTION, TORQUE, Given, Quantity
from steelyard.errors import ModelError
from steelyard.kernel.equations.dynamics import JointState, Matrix, Scalar
from steelyard.kernel.quantities.kinematics import frame_of, frame_outputs, last_frame
from steelyard.robot.robot import Frame, Robot
from steelyard.terms.term import Term, channels_of

Axes = Literal["frame", "base"]
"""Whose axes a wrench is given along."""


@dataclass(frozen=True, eq=False)
class Observed:
    """The parts of what the program computes at samples.

    Attributes:
        momentum: Shape `(..., n)` [kg m²/s; kg m/s].
        drive: $u$, shape `(..., n)` [Nm; N].
        jacobian: Of the frame's origin, then of its rotation, shape `(..., 6, n)`.
        columns: Regressor entries of the chosen parameters, shape `(..., n, c)`.
    """

    momentum: Array
    drive: Array
    jacobian: Array
    columns: Array

    @classmethod
    def of(cls, entries: Array, n: int) -> "Observed":
        """The parts of the outputs, shape `(..., 2 n + 6 n + n c)`; views."""
        columns = entries[..., 8 * n :].reshape(*entries.shape[:-1], n, -1)
        jacobian = entries[..., 2 * n : 8 * n].reshape(*entries.shape[:-1], 6, n)
        return cls(entries[..., :n], entries[..., n : 2 * n], jacobian, columns)


def moved_frame(robot: Robot, name: str | None) -> Frame:
    """The frame of a name, the robot's end if `None`, if joints move it.

    Raises:
        ModelError: There is no such frame, or it is fixed to the base.
    """
    frame = frame_of(robot, last_frame(robot) if name is None else name)
    if frame.body < 0:
        raise ModelError(
            f"frame '{frame.name}' is fixed to the base: no joint feels what pushes there",
            where=f"robot '{robot.name}'",
            fix=f"name a frame on a moving link, such as '{last_frame(robot)}'",
        )
    return frame


def observed_quantity(frame: Frame, axes: Axes, columns: tuple[int, ...]) -> Quantity:
    """Momentum, drive, Jacobian and regressor columns of a model at a sample.

    Args:
        frame: The frame that the wrench acts on.
        axes: Whose axes the wrench is given along.
        columns: Indices of standard parameters of the model.
    """

    def build(equations: Equations, given: Given) -> list[Scalar]:
        momentum, drive = momentum_and_drive(equations, given)
        jacobian = jacobian_of(equations, frame, axes, given)
        return [*momentum, *drive, *jacobian.ravel(), *_regressor(equations, given, columns)]

    key = (axes, list(columns), frame.body, frame.rotation.tolist(), frame.position.tolist())
    return Quantity(
        "observed efforts",
        MOTION,
        lambda _: True,
        build,
        lambda part: (part.robot.n * (8 + len(columns)),),
        key,
    )


def columns_quantity(columns: tuple[int, ...]) -> Quantity:
    """Regressor columns of a model at a sample, shape `(n, c)`.

    Args:
        columns: Indices of standard parameters of the model.
    """
    return Quantity(
        "chosen regressor columns",
        MOTION,
        lambda _: True,
        lambda equations, given: _regressor(equations, given, columns),
        lambda part: (part.robot.n, len(columns)),
        (list(columns),),
    )


def momentum_and_drive(
    equations: Equations, given: Given
) -> tuple[Sequence[Scalar], Sequence[Scalar]]:
    """Momentum $p$, and $u$: what changes it beside joint efforts and wrenches."""
    state = {name: given[name] for name in ("q", "dq", "channels", "parameters")}
    inertia = _part(equations, state, lambda term: term.cause == "inertia")
    others = _part(equations, given, lambda term: term.cause != "inertia")
    rates = zip(MOMENTUM_RATE.build(*inertia), TORQUE.build(*others), strict=True)
    return MOMENTUM.build(*inertia), [change - effort for change, effort in rates]


def _part(
    equations: Equations, given: Given, enters: Callable[[Term], bool]
) -> tuple[Equations, Given]:
    """Some terms, with their own parameters and channels."""
    robot, kept = equations.robot, [term for term in equations.terms if enters(term)]
    channels, parameters = list(given["channels"][: len(robot.passive)]), list[Scalar]()
    channel, parameter = len(robot.passive), 0
    for term in equations.terms:
        more, width = channels_of(term, robot), len(term.parameters(robot))
        if term in kept:
            channels += given["channels"][channel : channel + more]
            parameters += given["parameters"][parameter : parameter + width]
        channel, parameter = channel + more, parameter + width
    own = {**given, "channels": channels, "parameters": parameters}
    return Equations(robot, tuple(kept)), own


def jacobian_of(equations: Equations, frame: Frame, axes: Axes, given: Given) -> Matrix:
    """Jacobian of a frame along the chosen axes, shape `(6, n)`."""
    robot = equations.robot
    found = frame_outputs(robot, frame, given["q"], given["channels"][: len(robot.passive)])
    rows = np.array(found[12:], dtype=object).reshape(2, 3, robot.n)
    if axes == "frame":
        turned = np.array(found[3:12], dtype=object).reshape(3, 3).T
        rows = np.array([turned @ part for part in rows], dtype=object)
    return rows.reshape(6, robot.n)


def _regressor(equations: Equations, given: Given, columns: tuple[int, ...]) -> list[Scalar]:
    state = JointState(given["q"], given["dq"], given["ddq"], given["channels"])
    entries = equations.columns(state)
    return [entries.get((row, k), 0.0) for row in range(equations.robot.n) for k in columns]
