r"""Forward dynamics over symbols: what torques do to a mechanism.

Efforts are linear in the accelerations, $\tau = M(q)\,\ddot q + h(q, \dot q)$, so the mass matrix
is their derivative and the rest is what is left at $\ddot q = 0$. Programs of this file take
parameters sample by sample: a sample is a lane, and many sets of parameters move side by side.
"""

from collections.abc import Callable, Sequence

from steelyard.model.equations.inverse_dynamics import Scalar
from steelyard.symbolic.program import InputArray, Program, Writer

Q, DQ, EFFORT, PARAMETERS, WIDTHS, STEP = range(6)
"""Numbers of the input arrays."""

Efforts = Callable[[Sequence[Scalar]], Sequence[Scalar]]
"""Accelerations to efforts."""


def inputs(n: int, parameters: int) -> tuple[InputArray, ...]:
    """Arrays that programs over `n` joints read; `WIDTHS` are the speeds that jumps turn over."""
    return (
        InputArray("q", n),
        InputArray("dq", n),
        InputArray("effort", n),
        InputArray("parameters", parameters),
        InputArray("widths", n, shared=True),
    )


def accelerations(efforts: Efforts, applied: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
    """Accelerations under applied efforts, by $M = L D L^T$, and the pivots `D`.

    The pivots are positive if and only if the mass matrix is positive definite.
    """
    from steelyard.symbolic.trace import affine

    mass, bias = affine(efforts, len(applied))
    sides = [tau - rest for tau, rest in zip(applied, bias, strict=True)]
    n = len(sides)
    lower: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    pivots: list[Scalar] = []
    for j in range(n):
        scaled = [lower[j][k] * pivots[k] for k in range(j)]
        pivots.append(mass[j][j] - _dot(lower[j][:j], scaled))
        for i in range(j + 1, n):
            lower[i][j] = (mass[i][j] - _dot(lower[i][:j], scaled)) / pivots[j]
    for i in range(n):
        sides[i] = sides[i] - _dot(lower[i][:i], sides[:i])
    found = [side / pivot for side, pivot in zip(sides, pivots, strict=True)]
    for i in reversed(range(n)):
        found[i] = found[i] - _dot([lower[k][i] for k in range(i + 1, n)], found[i + 1 :])
    return found, pivots


def runge_kutta(program: Program, n: int) -> Program:
    """One step of the classical fourth-order method, efforts held.

    Of a program with inputs as `inputs`, and `n` accelerations, then pivots as outputs. It has the
    same inputs, and the step [s]; outputs are the new `q` and `dq`, then the least pivot of all
    stages.
    """
    writer = Writer()
    step = writer.push("input", STEP, 0)
    half = writer.push("mul", step, writer.constant(0.5))
    sixth = writer.push("mul", step, writer.constant(1.0 / 6.0))
    q = [writer.push("input", Q, j) for j in range(n)]
    dq = [writer.push("input", DQ, j) for j in range(n)]
    at, speed, least = q, dq, None
    speeds: list[list[int]] = []
    forces: list[list[int]] = []
    for ahead in (half, half, step, None):
        given = {(array, j): x for array, xs in ((Q, at), (DQ, speed)) for j, x in enumerate(xs)}
        outputs = writer.inlined(program, given)
        speeds.append(speed)
        forces.append(outputs[:n])
        for pivot in outputs[n:]:
            least = pivot if least is None else writer.push("minimum", least, pivot)
        if ahead is not None:
            at = [writer.plus(x, ahead, v) for x, v in zip(q, speeds[-1], strict=True)]
            speed = [writer.plus(x, ahead, a) for x, a in zip(dq, forces[-1], strict=True)]
    ends = [
        writer.plus(x, sixth, writer.weighed([row[j] for row in slopes]))
        for start, slopes in ((q, speeds), (dq, forces))
        for j, x in enumerate(start)
    ]
    outputs_of = (*ends, *(() if least is None else (least,)))
    arrays = (*program.inputs, InputArray("step", 1, shared=True))
    return Program(arrays, tuple(writer.steps), outputs_of)


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total
