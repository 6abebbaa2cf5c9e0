r"""The constant-acceleration Kalman filter and smoother along time, as machine code.

Time is counted in steps and the measurement's variance is one, so one number is left: the jerk's
intensity $\rho$. With $x = (q, \dot q, \ddot q)$, a step $h$, $F$ the motion at constant
acceleration and $Q$ the integrated white jerk,

$$Q = \rho \begin{pmatrix} h^5/20 & h^4/8 & h^3/6 \\ h^4/8 & h^3/3 & h^2/2 \\ h^3/6 & h^2/2 & h
\end{pmatrix}.$$

A measured velocity is one order lower: $x = (\dot q, \ddot q)$ with the lower right of $Q$.

Backward it takes Bryson and Frazier's form of the Rauch-Tung-Striebel smoother [Bierman1977]: the
same result, without the inverse of a covariance.

The normal equations of all states are banded, too, but `scipy.linalg.solveh_banded` takes eleven
times as long for 1e5 samples (50 ms), gives no variances and no innovations, and loses digits that
this form keeps: at $\rho$ = 4e-5, of a real motion, positions are off by 3e-9 of their range and
accelerations by 5e-7 (2e-13 and 3e-9 here), at 1e-12 by 2 %, and at 1e-18 its Cholesky factor does
not exist.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.symbolic.native.compiled_programs import Code, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input

KEPT = 11
"""Numbers kept per sample: predicted state (3), its covariance (6), innovation, its variance."""
STATE = 9  # numbers that a sample hands on to the next one
BLOCK = 8199  # samples that are smoothed at a time: rows are an odd number of cache lines
UPPER = np.triu_indices(3)  # order of the entries of a covariance
FULL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # place of each entry in that order
MEASURED = np.array([1.0, 0.0, 0.0])  # what of the state is measured


def transition(step: Any) -> tuple[Any, Any]:
    """Motion over a time step, and its covariance under white jerk of intensity one; `(3, 3)`."""
    h, g = step, step * step * 0.5
    motion = np.array([[1.0, h, g], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    a, b, c, d = g * g * h * 0.2, g * g * 0.5, g * h * (1.0 / 3.0), g * h * (2.0 / 3.0)
    return motion, np.array([[a, b, c], [b, d, g], [c, g, h]])


def filtered(
    values: Array, steps: Array, ratio: float, start: Array, spread: Array, order: int = 3
) -> Array:
    r"""The Kalman filter of one channel; returns what it keeps of each sample, `(N, KEPT)`.

    Args:
        values: Measurements, shape `(N,)`.
        steps: Time since the sample before, in units of choice, shape `(N,)`; the first is 0.
        ratio: Intensity of the jerk over the variance of a measurement, $\rho$.
        start: State predicted for the first sample, shape `(3,)`.
        spread: Its covariance, shape `(3, 3)`, in measurement variances.
        order: 3 if the white jerk drives the third number of the state, 2 if the second: then the
            third stays what it is.
    """
    y, h = (np.ascontiguousarray(x, dtype=np.float64) for x in (values, steps))
    if y.shape != h.shape or y.ndim != 1:
        raise ValueError("values and steps differ in shape")
    kept = np.empty((KEPT, len(y) + 1))
    kept[:STATE, 0] = np.concatenate((start, spread[UPPER]))
    drives = np.array([ratio if order == 3 else 0.0, ratio if order == 2 else 0.0])
    _along_time(_codes()[0], kept, [y, np.append(h[1:], 0.0), drives])
    kept = kept[:, :-1]
    kept[9], kept[10] = y - kept[0], kept[3] + 1.0
    return kept.T


def smoothed(kept: Array, steps: Array) -> tuple[Array, Array]:
    """States and their variances, each `(N, 3)`, back over what `filtered` kept."""
    result, state = np.empty((6, len(kept))), np.zeros(STATE)
    for stop in range(len(kept), 0, -BLOCK):
        part = slice(max(stop - BLOCK, 0), stop)
        back = [np.ascontiguousarray(x[part][::-1].T, dtype=np.float64) for x in (kept, steps)]
        states = np.empty((STATE + 6, back[0].shape[1] + 1))
        states[:STATE, 0] = state
        _along_time(_codes()[1], states, back)
        state, result[:, part] = states[:STATE, -1], states[STATE:, :0:-1]
    return result[:3].T, result[3:].T


def _along_time(code: Code, states: Array, inputs: Sequence[Array]) -> None:
    """Fill `states`, `(outputs, N + 1)`: outputs at a sample are inputs at the next one.

    They begin with the first column; the other inputs are `(entries, N)`, or shared.
    """
    width = states.shape[1]
    given = (x for one in inputs for x in (one.ctypes.data, one.shape[-1]))
    at = states.ctypes.data
    code.raw(width - 1, at, width, *given, at + states.itemsize, width)


@cache
def _codes() -> tuple[Code, Code]:
    state, step = Input("state", STATE), Input("step", 1)
    forward = [state, Input("measured", 1), step, Input("drives", 2, shared=True)]
    backward = [state, Input("kept", KEPT), step]
    return (
        compiled_equations("Kalman filter", _forward, forward, lanes=1),
        compiled_equations("Kalman smoother", _backward, backward, lanes=1),
    )


def _forward(state: Any, measured: Any, step: Any, drives: Any) -> list[Any]:
    """State and covariance predicted for the next sample, a step later, from those for this one."""
    x, p = np.array(state[:3]), np.array(state[3:])[FULL]
    gain = p[0] / (p[0, 0] + 1.0)
    motion, wander = transition(step[0])
    x = motion @ (x + gain * (measured[0] - x[0]))
    p = motion @ (p - np.outer(gain, p[0])) @ motion.T + drives[0] * wander
    p[:2, :2] = p[:2, :2] + drives[1] * wander[1:, 1:]
    return [*x, *p[UPPER]]


def _backward(state: Any, kept: Any, step: Any) -> list[Any]:
    """Adjoint state before a sample's step from the one behind it; state and variances there."""
    adjoint, m = np.array(state[:3]), np.array(state[3:])[FULL]
    x, p, innovation, variance = np.array(kept[:3]), np.array(kept[3:9])[FULL], kept[9], kept[10]
    gain = p[0] / variance
    u = m @ gain
    adjoint = adjoint - MEASURED * (gain @ adjoint + innovation / variance)
    m = m - np.outer(MEASURED, u) - np.outer(u, MEASURED)
    m = m + np.outer(MEASURED, MEASURED) * (gain @ u + 1.0 / variance)
    motion, _ = transition(step[0])
    back = motion.T @ m @ motion
    return [*motion.T @ adjoint, *back[UPPER], *x - p @ adjoint, *np.diag(p - p @ m @ p)]
