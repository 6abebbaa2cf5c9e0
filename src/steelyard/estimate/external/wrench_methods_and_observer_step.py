r"""The wrench that makes external efforts, by methods; a step of an observer as machine code.

A wrench $F$ on a frame makes efforts $\tau = J^T F$. With the covariance $S$ of what the model
predicts wrongly, and wrenches of the expected size $P$,

$$\hat F = (J S^{-1} J^T + P^{-1})^{-1} J S^{-1} \tau = P J (J^T P J + S)^{-1} \tau$$

with the covariance $P - P J (J^T P J + S)^{-1} J^T P$. The second form needs no inverse of $J$: it
is finite in singular postures, for any number of joints. What no effort shows stays at zero, with
an interval as wide as the expected size. $J^{-T} \tau$ knows neither $S$ nor $P$.

With momentum $p = M \dot q$ and $u = C^T \dot q - g - \tau_o$, where $\tau_o$ are all efforts
beside those of the inertia (friction, springs, offsets), $\dot p = \tau + u + J^T F$ under joint
efforts $\tau$: an observer needs $p$ and $u$ of a model. $S$ comes into its step as numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
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

FORCE = 30.0  # expected size of a force [N]: a firm push
LEVER = 0.1  # expected distance of a force from the frame's origin [m]
FORCES, LEVERS = (0.1, 1e5), (0.0, 100.0)  # range of expected forces [N] and levers [m]
TINY = 1e-12  # singular values of a Jacobian below this share of the largest are zero


@dataclass(frozen=True)
class Expected:
    """The size that wrenches are expected to have."""

    force: float = FORCE  # standard deviation of each component of the force [N]
    # that of each component of the moment, over `force` [m]; 0 for forces at the origin
    lever: float = LEVER

    def __post_init__(self) -> None:
        for name, value, (least, most), unit, usual in (
            ("force", self.force, FORCES, "N", "the size of a usual force, such as 30 N"),
            ("lever", self.lever, LEVERS, "m", "how far from the frame's origin, such as 0.1 m"),
        ):
            if not least <= value <= most:
                raise DataError(
                    f"a {name} of {value:g} {unit} is no expected size: {least:g} to {most:g} "
                    f"{unit} can be expected",
                    where=f"expected wrench (--{name})",
                    fix=f"give {usual}",
                )

    @property
    def variances(self) -> Array:
        """Diagonal of $P$, shape `(6,)`."""
        return frozen(np.repeat(np.square([self.force, self.force * self.lever]), 3))


@dataclass(frozen=True, eq=False)
class ExternalEfforts:
    """External efforts along a stretch of a log, behind a low-pass, and how far they may be off.

    They are $J^T F + A z + e$ with parameters $z$ of the model, independent and of variance 1, and
    residuals $e$, one part of which is slow, another one noise.
    """

    step: float  # time between samples [s]
    torque: Array  # external efforts, `(N, n)` [Nm; N]
    jacobian: Array  # of the frame, `(N, 6, n)`
    spread: Array  # $A$, `(N, n, k)`
    slow: Array  # standard deviation of the slow residuals, `(N, n)` [Nm; N]
    noise: Array  # that of the others, likewise
    correlation: Array  # of both between joints, `(n, n)`
    per_independent: float  # samples per independent one of the noise

    def part(self, at: slice) -> "ExternalEfforts":
        """Some consecutive samples."""
        names = ("torque", "jacobian", "spread", "slow", "noise")
        return replace(self, **{name: getattr(self, name)[at] for name in names})

    @property
    def covariance(self) -> Array:
        """$S$, shape `(N, n, n)`."""
        std = np.hypot(self.slow, self.noise)
        residual = std[:, :, None] * self.correlation * std[:, None, :]
        return np.asarray(self.spread @ self.spread.swapaxes(1, 2) + residual)


@dataclass(frozen=True, eq=False)
class Wrenches:
    """Estimated wrenches."""

    values: Array  # force [N] and moment [Nm], `(N, 6)`
    covariance: Array  # `(N, 6, 6)`
    # share of what is expected of a wrench that efforts decide, see `learned_of`, `(N, 6, 6)`
    learned: Array


@dataclass(frozen=True)
class Weighted:
    """Each sample by itself, weighted by the model's uncertainty and the expected size."""

    name: ClassVar[str] = "weighted"
    expected: Expected = Expected()  # the size of wrenches, beside which a direction is seen or not

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """Wrenches of all samples."""
        prior, jacobian = self.expected.variances, efforts.jacobian
        spread = jacobian * prior[:, None]
        together = jacobian.swapaxes(1, 2) @ spread + efforts.covariance
        gain = np.linalg.solve(together, spread.swapaxes(1, 2)).swapaxes(1, 2)
        covariance = np.diag(prior) - gain @ spread.swapaxes(1, 2)
        values = (gain @ efforts.torque[:, :, None])[:, :, 0]
        return Wrenches(values, covariance, learned_of(covariance, self.expected))


@dataclass(frozen=True)
class InverseJacobian:
    r"""$J^{-T} \tau$, by the pseudo-inverse where $J$ has none; large near singular postures."""

    name: ClassVar[str] = "inverse"
    expected: Expected = Expected()  # the size of wrenches, beside which a direction is seen or not

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """Wrenches of all samples."""
        inverse = np.linalg.pinv(efforts.jacobian.swapaxes(1, 2), rcond=TINY)
        values = (inverse @ efforts.torque[:, :, None])[:, :, 0]
        covariance = inverse @ efforts.covariance @ inverse.swapaxes(1, 2)
        return Wrenches(values, covariance, Weighted(self.expected)(efforts).learned)


def learned_of(covariance: Array, expected: Expected) -> Array:
    r"""Share of what is expected of a wrench that efforts decide, $1 - P^{-1/2} C P^{-1/2}$.

    $C$ is a covariance, and $P$ what it was before, shape `(N, 6, 6)`. Eigenvalues of 0 belong to
    directions that no effort shows, of 1 to those that efforts show exactly. Without a lever there
    is nothing to know of moments.
    """
    std = np.sqrt(expected.variances)
    scale = np.divide(1.0, std, out=np.zeros(6), where=std > 0.0)
    return np.asarray(np.eye(6) - scale[:, None] * covariance * scale)


def condition_numbers(jacobian: Array) -> Array:
    """Condition number of each Jacobian, `(N, 6, n)` to `(N,)`; infinite where it is singular."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    if jacobian.shape[2] < jacobian.shape[1]:
        return np.full(len(jacobian), np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(values[:, 0] / values[:, -1])


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
    """Momentum, drive, Jacobian and regressor columns of a model at a sample.

    Of a floating base, whose velocity and inclination are not known, momentum and drive are zero.
    """

    def build(equations: Equations, given: Given) -> list[Scalar]:
        momentum: Sequence[Scalar] = [0.0] * equations.robot.n
        drive = momentum
        if not equations.robot.floating:
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


def step_code(equations: Equations, frame: Frame, axes: Axes) -> Code:
    """Machine code of a step.

    All inputs are those of one sample: the state `(4 n,)`; positions, velocities and efforts
    `(3 n,)`; what is left of the value before, the inverse of the time since then, and the
    observer's rate in rad/s `(3,)`; channels; parameters; the covariance of the efforts `(n n,)`
    and the variances of the wrench `(6,)`. Outputs are the state, accelerations behind the observer
    `(n,)`, wrench `(6,)` and its variances `(6,)`.
    """
    n = equations.robot.n
    sizes = {
        "state": STATES * n,
        "sample": 3 * n,
        "scalars": 3,
        "channels": equations.n_channels,
        "parameters": len(equations.parameters),
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
    return compiled(["observer step", place, equations.program_key], build)


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
    jacobian, variances = jacobian_of(equations, frame, axes, given), given["variances"]
    weighed = [[p * x for x in row] for p, row in zip(variances, jacobian, strict=True)]
    matrix = [
        [
            given["covariance"][i * n + j] + along(jacobian[:, i], [row[j] for row in weighed])
            for j in range(n)
        ]
        for i in range(n)
    ]
    (efforts, *columns), _ = solved_by_factors(matrix, [torque, *weighed])
    wrench = [along(row, efforts) for row in weighed]
    each = zip(variances, weighed, columns, strict=True)
    spread = [variance - along(row, column) for variance, row, column in each]
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
    """Momentum, drive and external efforts `(n,)` after a step; scalars as of `step_code`."""
    left, inverse, _ = scalars
    old_momentum, old_drive, old_torque = old
    momentum, beside = momentum_and_drive(equations, given)
    drive = [effort + other for effort, other in zip(tau, beside, strict=True)]
    torque = []
    for k in range(equations.robot.n):
        mean = inverse * (momentum[k] - old_momentum[k]) - 0.5 * (drive[k] + old_drive[k])
        torque.append(mean + left * (old_torque[k] - mean))
    return momentum, drive, torque
