r"""One step of an observer as machine code: from a sample to external efforts and the wrench.

The covariance $S$ of the efforts comes in as numbers; $A = J^T P J + S = L D L^T$ is solved here,
so that $\hat F = P J A^{-1} \tau$ has the variances of the diagonal of $P - P J A^{-1} J^T P$.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.dynamics.equations import Equations
from steelyard.dynamics.quantity import Given
from steelyard.estimation.external.observed import Axes, jacobian_of, momentum_and_drive
from steelyard.kernel.equations.dynamics import Scalar
from steelyard.kernel.native.compiled import Code, compiled
from steelyard.kernel.program.program import Array as Input
from steelyard.kernel.program.program import Program
from steelyard.robot.robot import Frame

STATES = 4
"""Vectors that a step hands to the next one: momentum, drive, slow velocities, external efforts."""


@dataclass(frozen=True, eq=False)
class StepProgram:
    """Machine code of a step.

    All inputs are those of one sample: the state `(4 n,)`; positions, velocities and efforts
    `(3 n,)`; what is left of the value before, the inverse of the time since then, and the
    observer's rate in rad/s `(3,)`; channels; parameters; the covariance of the efforts `(n n,)`
    and the variances of the wrench `(6,)`. Outputs are the state, accelerations behind the observer
    `(n,)`, wrench `(6,)` and its variances `(6,)`.

    Attributes:
        equations: The model.
        code: The program.
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
            from steelyard.kernel.program.trace import symbolic

            inputs = [Input(name, size, shared=True) for name, size in sizes.items()]
            return symbolic(lambda *x: _outputs(equations, frame, axes, *x), inputs), {}

        place = [axes, frame.body, frame.rotation.tolist(), frame.position.tolist()]
        return cls(equations, compiled(["observer step", place, equations.program_key], build))


def _outputs(
    equations: Equations,
    frame: Frame,
    axes: Axes,
    state: Sequence[Scalar],
    sample: Sequence[Scalar],
    scalars: Sequence[Scalar],
    channels: Sequence[Scalar],
    parameters: Sequence[Scalar],
    covariance: Sequence[Scalar],
    variances: Sequence[Scalar],
) -> list[Scalar]:
    n = equations.robot.n
    old = _vectors(state, n)
    q, dq, tau = _vectors(sample, n)
    slow, ddq = slow_velocities(dq, old[2], scalars)
    given = {"q": q, "dq": dq, "ddq": ddq, "channels": channels, "parameters": parameters}
    momentum, drive, torque = observed_torque(
        equations, given, tau, (old[0], old[1], old[3]), scalars
    )
    rows = jacobian_of(equations, frame, axes, given)
    wrench, spread = _wrench([list(row) for row in rows], covariance, variances, torque)
    return [*momentum, *drive, *slow, *torque, *ddq, *wrench, *spread]


def slow_velocities(
    dq: Sequence[Scalar], old: Sequence[Scalar], scalars: Sequence[Scalar]
) -> tuple[list[Scalar], list[Scalar]]:
    """Velocities behind the observer's low-pass, and the accelerations there.

    Args:
        dq: Velocities, `(n,)`.
        old: Slow velocities of the sample before, `(n,)`.
        scalars: See `StepProgram`.
    """
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
    """Momentum, drive and external efforts after a step, `(n,)` each.

    Args:
        equations: The model.
        given: `q`, `dq`, `ddq`, `channels` and `parameters`.
        tau: Joint efforts, `(n,)`.
        old: Momentum, drive and external efforts of the sample before.
        scalars: See `StepProgram`.
    """
    left, inverse, _ = scalars
    old_momentum, old_drive, old_torque = old
    momentum, beside = momentum_and_drive(equations, given)
    drive = [effort + other for effort, other in zip(tau, beside, strict=True)]
    torque = []
    for k in range(equations.robot.n):
        mean = inverse * (momentum[k] - old_momentum[k]) - 0.5 * (drive[k] + old_drive[k])
        torque.append(mean + left * (old_torque[k] - mean))
    return momentum, drive, torque


def _vectors(entries: Sequence[Scalar], n: int) -> list[Sequence[Scalar]]:
    """Vectors of `n` that stand one after another."""
    return [entries[k * n : (k + 1) * n] for k in range(len(entries) // n)]


def _wrench(
    jacobian: list[list[Scalar]],
    covariance: Sequence[Scalar],
    variances: Sequence[Scalar],
    torque: Sequence[Scalar],
) -> tuple[list[Scalar], list[Scalar]]:
    """The weighted wrench and its variances."""
    n = len(torque)
    weighed = [[p * x for x in row] for p, row in zip(variances, jacobian, strict=True)]
    lower: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    pivots: list[Scalar] = []
    for j in range(n):
        for i in range(j, n):
            value = covariance[i * n + j]
            for row, other in zip(jacobian, weighed, strict=True):
                value = value + row[i] * other[j]
            for k in range(j):
                value = value - lower[i][k] * pivots[k] * lower[j][k]
            if i == j:
                pivots.append(value)
            else:
                lower[i][j] = value / pivots[j]
    efforts = _forward(lower, list(torque))
    wrench: list[Scalar] = []
    spread: list[Scalar] = []
    for variance, row in zip(variances, weighed, strict=True):
        along = _forward(lower, row)
        scaled = [x / pivot for x, pivot in zip(along, pivots, strict=True)]
        wrench.append(_dot(scaled, efforts))
        spread.append(variance - _dot(scaled, along))
    return wrench, spread


def _forward(lower: list[list[Scalar]], side: list[Scalar]) -> list[Scalar]:
    """$L^{-1}$ times a vector."""
    found: list[Scalar] = []
    for i, value in enumerate(side):
        found.append(value - _dot(lower[i][:i], found))
    return found


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total
