r"""Forward dynamics over symbols: what torques do to a mechanism.

Efforts are linear in the accelerations, $\tau = M(q)\,\ddot q + h(q, \dot q)$, so the mass matrix
is their derivative and the rest is what is left at $\ddot q = 0$. Programs of this file take
parameters sample by sample: a sample is a lane, and many sets of parameters move side by side.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from steelyard.model.equations.closed_chains import solved_by_factors
from steelyard.model.equations.inverse_dynamics import Scalar, Scalars
from steelyard.symbolic.program_and_softening import InputArray, Program

Q, DQ, EFFORT, PARAMETERS, WIDTHS = range(5)  # numbers of the input arrays

Efforts = Callable[[Scalars], Scalars]  # accelerations to efforts


def inputs(n: int, parameters: int) -> tuple[InputArray, ...]:
    """Arrays that programs over `n` joints read; `WIDTHS` are the speeds that jumps turn over."""
    return (
        InputArray("q", n),
        InputArray("dq", n),
        InputArray("effort", n),
        InputArray("parameters", parameters),
        InputArray("widths", n, shared=True),
    )


def accelerations(efforts: Efforts, applied: Scalars) -> tuple[list[Scalar], list[Scalar]]:
    """Accelerations under applied efforts, by $M = L D L^T$, and the pivots `D`.

    The pivots are positive if and only if the mass matrix is positive definite.
    """
    from steelyard.symbolic.symbols_and_tracing import affine

    mass, bias = affine(efforts, len(applied))
    sides = [tau - rest for tau, rest in zip(applied, bias, strict=True)]
    (found,), pivots = solved_by_factors(mass, [sides])
    return found, pivots


def runge_kutta(program: Program, n: int) -> Program:
    """One step of the classical fourth-order method, efforts held.

    Of a program with inputs as `inputs`, and `n` accelerations, then pivots as outputs. It has the
    same inputs, and the step [s]; outputs are the new `q` and `dq`, then the least pivot of all
    stages.
    """
    from steelyard.symbolic.symbols_and_tracing import replayed, symbolic

    def build(q: Any, dq: Any, *rest: Any) -> list[Scalar]:
        *held, (step,) = rest
        half = 0.5 * step
        at, speed, pivots = q, dq, list[Scalar]()
        stages: list[tuple[Scalars, Scalars]] = []
        for ahead in (half, half, step, None):
            found = replayed(program, [at, speed, *held])
            stages.append((speed, found[:n]))
            pivots += found[n:]
            if ahead is not None:
                at = [x + ahead * v for x, v in zip(q, speed, strict=True)]
                speed = [x + ahead * a for x, a in zip(dq, found[:n], strict=True)]
        ends = []
        for start, slopes in zip((q, dq), zip(*stages, strict=True), strict=True):
            for x, first, second, third, fourth in zip(start, *slopes, strict=True):
                mean = (first + fourth + 2.0 * (second + third)) * (1.0 / 6.0)
                ends.append(x + step * mean)
        return [*ends, *([reduce(np.minimum, pivots)] if pivots else [])]

    return symbolic(build, (*program.inputs, InputArray("step", 1, shared=True)))
