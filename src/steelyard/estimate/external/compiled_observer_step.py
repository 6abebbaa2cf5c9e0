r"""What an observer of external efforts needs of a model, and one step of it as machine code.

With momentum $p = M \dot q$ and $u = C^T \dot q - g - \tau_o$, where $\tau_o$ are all efforts
beside those of the inertia (friction, springs, offsets), $\dot p = \tau + u + J^T F$ under joint
efforts $\tau$ and a wrench $F$ on a frame.

The covariance $S$ of the efforts comes in as numbers; $A = J^T P J + S = L D L^T$ is solved here,
so that $\hat F = P J A^{-1} \tau$ has the variances of the diagonal of $P - P J A^{-1} J^T P$.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.frame_and_point_kinematics import (
    frame_of,
    frame_outputs,
    last_frame,
    refuse_fixed,
)
from steelyard.model.equations.inverse_dynamics import (
    JointState,
    Matrix,
    Scalar,
    along,
    solved_by_factors,
)
from steelyard.model.terms.term import Term
from steelyard.model.torque_and_quantities import (
    MOMENTUM,
    MOMENTUM_RATE,
    MOTION,
    TORQUE,
    Equations,
    Given,
    Quantity,
)
from steelyard.robot.robot import Frame, Robot
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program

Axes = Literal["frame", "base"]  # whose axes a wrench is given along


@dataclass(frozen=True, eq=False)
class Observed:
    """The parts of what the program computes at samples."""

    momentum: Array  # `(..., n)` [kg m²/s; kg m/s]
    drive: Array  # $u$, `(..., n)` [Nm; N]
    jacobian: Array  # of the frame's origin, then of its rotation, `(..., 6, n)`
    columns: Array  # regressor entries of the chosen parameters, `(..., n, c)`

    @classmethod
    def of(cls, entries: Array, n: int) -> "Observed":
        """The parts of the outputs, shape `(..., 2 n + 6 n + n c)`; views."""
        columns = entries[..., 8 * n :].reshape(*entries.shape[:-1], n, -1)
        jacobian = entries[..., 2 * n : 8 * n].reshape(*entries.shape[:-1], 6, n)
        return cls(entries[..., :n], entries[..., n : 2 * n], jacobian, columns)


def moved_frame(robot: Robot, name: str | None) -> Frame:
    """The frame of a name, the robot's end if `None`, if joints move it."""
    frame = frame_of(robot, last_frame(robot) if name is None else name)
    refuse_fixed(robot, frame)
    return frame


def observed_quantity(frame: Frame, axes: Axes, columns: tuple[int, ...]) -> Quantity:
    """Momentum, drive, Jacobian and regressor columns of a model at a sample."""

    def build(equations: Equations, given: Given) -> list[Scalar]:
        momentum, drive = momentum_and_drive(equations, given)
        jacobian = jacobian_of(equations, frame, axes, given)
        return [*momentum, *drive, *jacobian.ravel(), *_regressor(equations, given, columns)]

    return Quantity(
        "observed efforts",
        MOTION,
        build,
        shape=lambda part: (part.robot.n * (8 + len(columns)),),
        key=(axes, list(columns), frame.body, frame.rotation.tolist(), frame.position.tolist()),
    )


def columns_quantity(columns: tuple[int, ...]) -> Quantity:
    """Regressor columns of a model at a sample, shape `(n, c)`."""
    return Quantity(
        "chosen regressor columns",
        MOTION,
        lambda equations, given: _regressor(equations, given, columns),
        shape=lambda part: (part.robot.n, len(columns)),
        key=(list(columns),),
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
        more, width = term.n_channels(robot), len(term.parameters(robot))
        if term in kept:
            channels += given["channels"][channel : channel + more]
            parameters += given["parameters"][parameter : parameter + width]
        channel, parameter = channel + more, parameter + width
    return Equations(robot, tuple(kept)), {**given, "channels": channels, "parameters": parameters}


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


STATES = 4  # vectors handed to the next step: momentum, drive, slow velocities, external efforts


@dataclass(frozen=True, eq=False)
class StepProgram:
    """Machine code of a step.

    All inputs are those of one sample: the state `(4 n,)`; positions, velocities and efforts
    `(3 n,)`; what is left of the value before, the inverse of the time since then, and the
    observer's rate in rad/s `(3,)`; channels; parameters; the covariance of the efforts `(n n,)`
    and the variances of the wrench `(6,)`. Outputs are the state, accelerations behind the observer
    `(n,)`, wrench `(6,)` and its variances `(6,)`.
    """

    equations: Equations
    code: Code

    @classmethod
    def of(cls, equations: Equations, frame: Frame, axes: Axes) -> "StepProgram":
        """Compile, or load from the cache."""
        n, parameters = equations.robot.n, len(equations.parameters)
        sizes = {
            "state": STATES * n,
            "sample": 3 * n,
            "scalars": 3,
            "channels": equations.n_channels,
            "parameters": parameters,
            "covariance": n * n,
            "variances": 6,
        }

        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import symbolic

            inputs = [Input(name, size, shared=True) for name, size in sizes.items()]

            def outputs(*given: Sequence[Scalar]) -> list[Scalar]:
                return _outputs(equations, frame, axes, dict(zip(sizes, given, strict=True)))

            return symbolic(outputs, inputs), {}

        place = [axes, frame.body, frame.rotation.tolist(), frame.position.tolist()]
        return cls(equations, compiled(["observer step", place, equations.program_key], build))


def _outputs(equations: Equations, frame: Frame, axes: Axes, given: Given) -> list[Scalar]:
    state, sample, scalars = (given[name] for name in ("state", "sample", "scalars"))
    n = equations.robot.n
    old = [state[k * n : (k + 1) * n] for k in range(STATES)]
    q, dq, tau = (sample[k * n : (k + 1) * n] for k in range(3))
    slow, ddq = slow_velocities(dq, old[2], scalars)
    given = {**given, "q": q, "dq": dq, "ddq": ddq}
    momentum, drive, torque = observed_torque(
        equations, given, tau, (old[0], old[1], old[3]), scalars
    )
    rows = jacobian_of(equations, frame, axes, given)
    wrench, spread = _wrench(rows, given["covariance"], given["variances"], torque)
    return [*momentum, *drive, *slow, *torque, *ddq, *wrench, *spread]


def slow_velocities(
    dq: Sequence[Scalar], old: Sequence[Scalar], scalars: Sequence[Scalar]
) -> tuple[list[Scalar], list[Scalar]]:
    """Velocities behind the observer's low-pass, and the accelerations there, from the old ones."""
    left, _, rate = scalars
    slow = [v + left * (before - v) for v, before in zip(dq, old, strict=True)]
    return slow, [rate * (v - s) for v, s in zip(dq, slow, strict=True)]


def observed_torque(
    equations: Equations,
    given: Given,
    tau: Sequence[Scalar],
    old: tuple[Sequence[Scalar], Sequence[Scalar], Sequence[Scalar]],
    scalars: Sequence[Scalar],
) -> tuple[Sequence[Scalar], list[Scalar], list[Scalar]]:
    """Momentum, drive and external efforts `(n,)` after a step; scalars as of `StepProgram`."""
    left, inverse, _ = scalars
    old_momentum, old_drive, old_torque = old
    momentum, beside = momentum_and_drive(equations, given)
    drive = [effort + other for effort, other in zip(tau, beside, strict=True)]
    torque = []
    for k in range(equations.robot.n):
        mean = inverse * (momentum[k] - old_momentum[k]) - 0.5 * (drive[k] + old_drive[k])
        torque.append(mean + left * (old_torque[k] - mean))
    return momentum, drive, torque


def _wrench(
    jacobian: Matrix,
    covariance: Sequence[Scalar],
    variances: Sequence[Scalar],
    torque: Sequence[Scalar],
) -> tuple[list[Scalar], list[Scalar]]:
    """The weighted wrench and its variances."""
    n = len(torque)
    weighed = [[p * x for x in row] for p, row in zip(variances, jacobian, strict=True)]
    matrix = [
        [
            covariance[i * n + j] + along(jacobian[:, i], [row[j] for row in weighed])
            for j in range(n)
        ]
        for i in range(n)
    ]
    (efforts, *columns), _ = solved_by_factors(matrix, [torque, *weighed])
    wrench = [along(row, efforts) for row in weighed]
    each = zip(variances, weighed, columns, strict=True)
    return wrench, [variance - along(row, column) for variance, row, column in each]
