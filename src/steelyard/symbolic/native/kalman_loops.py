r"""The time loops of the constant-acceleration Kalman smoother, as machine code.

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

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.symbolic.native import compiler
from steelyard.symbolic.native.compiled_programs import machine_code

KEPT = 11
"""Numbers kept per sample: predicted state (3), its covariance (6), innovation, its variance."""
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # order of the entries of a covariance


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
    drives = [ratio if order == 3 else 0.0, ratio if order == 2 else 0.0]
    head = np.concatenate((start, [spread[i, j] for i, j in PAIRS], drives))
    kept = np.empty((len(y), KEPT))
    if len(y):
        _loops()[0](*(x.ctypes.data for x in (y, h, head, kept)), len(y))
    return kept


def smoothed(kept: Array, steps: Array) -> tuple[Array, Array]:
    """States and their variances, each `(N, 3)`, back over what `filtered` kept."""
    back, h = np.ascontiguousarray(kept), np.ascontiguousarray(steps, dtype=np.float64)
    result = np.empty((len(back), 6))
    if len(back):
        _loops()[1](*(x.ctypes.data for x in (back, h, result)), len(back))
    return result[:, :3], result[:, 3:]


@cache
def _loops() -> tuple[Any, Any]:
    code = machine_code("kalman", lambda: (_forward() + _backward(), {}))[1]
    library = compiler.Library(code, ["kalman_forward", "kalman_backward"])
    return library.function("kalman_forward", 5), library.function("kalman_backward", 4)


@dataclass(frozen=True)
class _Number:
    """A double in code that is being written; arithmetic writes a line."""

    name: str
    lines: list[str]

    def _with(self, operation: str, other: "_Number | float") -> "_Number":
        right = other.name if isinstance(other, _Number) else f"{float(other)!r}"
        return written(self.lines, f"{operation} double {self.name}, {right}")

    def __add__(self, other: "_Number | float") -> "_Number":
        return self._with("fadd contract", other)

    def __sub__(self, other: "_Number | float") -> "_Number":
        return self._with("fsub contract", other)

    def __mul__(self, other: "_Number | float") -> "_Number":
        return self._with("fmul contract", other)

    def __truediv__(self, other: "_Number | float") -> "_Number":
        return self._with("fdiv", other)


def written(lines: list[str], expression: str) -> _Number:
    """A new name for an expression."""
    name = f"%v{len(lines)}"
    lines.append(f"{name} = {expression}")
    return _Number(name, lines)


def _loaded(lines: list[str], array: str, place: int, base: str = "") -> _Number:
    """Entry `place` of an array, counted from a number `base`."""
    at = f"{place}"
    if base:
        at = f"%a{len(lines)}"
        lines.append(f"{at} = add i64 {base}, {place}")
    pointer = f"%p{len(lines)}"
    lines.append(f"{pointer} = getelementptr double, ptr {array}, i64 {at}")
    return written(lines, f"load double, ptr {pointer}")


def _stored(lines: list[str], array: str, base: str, values: Iterable[_Number]) -> None:
    """Values to the entries of an array from a number `base` on."""
    for place, value in enumerate(values):
        lines.append(f"%a{len(lines)} = add i64 {base}, {place}")
        at = f"%a{len(lines) - 1}"
        pointer = f"%p{len(lines)}"
        lines.append(f"{pointer} = getelementptr double, ptr {array}, i64 {at}")
        lines.append(f"store double {value.name}, ptr {pointer}")


def _forward() -> str:
    """`void kalman_forward(y, h, head, kept, N)`; `head`: state, covariance, ratio by order."""
    entry: list[str] = []
    start = [_loaded(entry, "%head", k).name for k in range(9)]
    third, second = _loaded(entry, "%head", 9), _loaded(entry, "%head", 10)
    lines = [*entry, "br label %loop", "loop:", "%i = phi i64 [0, %entry], [%i1, %loop]"]
    names = [f"%s{k}" for k in range(9)]
    lines += [f"{x} = phi double [{start[k]}, %entry], [%n{k}, %loop]" for k, x in enumerate(names)]
    x0, x1, x2, p00, p01, p02, p11, p12, p22 = (_Number(name, lines) for name in names)
    y, h = _loaded(lines, "%y", 0, "%i"), _loaded(lines, "%h", 0, "%i")
    g = h * h * 0.5
    noise, lower = h * third, h * second
    x0, x1 = x0 + h * x1 + g * x2, x1 + h * x2
    a01, a02 = p01 + h * p11 + g * p12, p02 + h * p12 + g * p22
    a11, a12 = p11 + h * p12, p12 + h * p22
    p00 = p00 + h * p01 + g * p02 + h * a01 + g * a02 + noise * g * g * 0.2
    p00 = p00 + lower * g * (2.0 / 3.0)
    p01 = a01 + h * a02 + noise * g * h * 0.25 + lower * h * 0.5
    p02 = a02 + noise * g * (1.0 / 3.0)
    p11 = a11 + h * a12 + noise * g * (2.0 / 3.0) + lower
    p12, p22 = a12 + noise * h * 0.5, p22 + noise
    innovation, variance = y - x0, p00 + 1.0
    lines.append(f"%base = mul i64 %i, {KEPT}")
    _stored(lines, "%kept", "%base", (x0, x1, x2, p00, p01, p02, p11, p12, p22))
    lines.append("%tail = add i64 %base, 9")
    _stored(lines, "%kept", "%tail", (innovation, variance))
    k0, k1, k2 = p00 / variance, p01 / variance, p02 / variance
    after = [x0 + k0 * innovation, x1 + k1 * innovation, x2 + k2 * innovation]
    after += [k0, k1, k2, p11 - k1 * p01, p12 - k1 * p02, p22 - k2 * p02]
    lines += [f"%n{k} = fadd double {value.name}, -0.0" for k, value in enumerate(after)]
    return _function("kalman_forward", "ptr %y, ptr %h, ptr %head, ptr %kept, i64 %N", lines)


def _backward() -> str:
    """`void kalman_backward(kept, h, result, N)`: adjoint state, from the last sample on."""
    lines = ["br label %loop", "loop:", "%i = phi i64 [0, %entry], [%i1, %loop]"]
    names = [f"%s{k}" for k in range(9)]
    lines += [f"{x} = phi double [0.0, %entry], [%n{k}, %loop]" for k, x in enumerate(names)]
    l0, l1, l2, m00, m01, m02, m11, m12, m22 = (_Number(name, lines) for name in names)
    lines += ["%last = sub i64 %N, 1", "%j = sub i64 %last, %i", f"%base = mul i64 %j, {KEPT}"]
    x0, x1, x2, p00, p01, p02, p11, p12, p22, e, s = (
        _loaded(lines, "%kept", k, "%base") for k in range(KEPT)
    )
    h = _loaded(lines, "%h", 0, "%j")
    k0, k1, k2 = p00 / s, p01 / s, p02 / s
    u0 = m00 * k0 + m01 * k1 + m02 * k2
    u1 = m01 * k0 + m11 * k1 + m12 * k2
    u2 = m02 * k0 + m12 * k1 + m22 * k2
    l0 = l0 - (k0 * l0 + k1 * l1 + k2 * l2) - e / s
    one = _Number("1.0", lines)
    m00 = m00 - u0 * 2.0 + (k0 * u0 + k1 * u1 + k2 * u2) + one / s
    m01, m02 = m01 - u1, m02 - u2
    values = [x0, x1, x2]
    spreads = [p00, p11, p22]
    for k, row in enumerate(((p00, p01, p02), (p01, p11, p12), (p02, p12, p22))):
        a, b, c = row
        values[k] = values[k] - (a * l0 + b * l1 + c * l2)
        squares = a * a * m00 + b * b * m11 + c * c * m22
        mixed = a * b * m01 + a * c * m02 + b * c * m12
        spreads[k] = spreads[k] - squares - mixed * 2.0
    lines.append("%place = mul i64 %j, 6")
    _stored(lines, "%result", "%place", (*values, *spreads))
    g = h * h * 0.5
    b01, b02 = h * m00 + m01, g * m00 + h * m01 + m02
    b11, b12 = h * m01 + m11, g * m01 + h * m11 + m12
    b22 = g * m02 + h * m12 + m22
    after = [l0, h * l0 + l1, g * l0 + h * l1 + l2]
    after += [m00, b01, b02, h * b01 + b11, h * b02 + b12, g * b02 + h * b12 + b22]
    lines += [f"%n{k} = fadd double {value.name}, -0.0" for k, value in enumerate(after)]
    return _function("kalman_backward", "ptr %kept, ptr %h, ptr %result, i64 %N", lines)


def _function(name: str, arguments: str, lines: list[str]) -> str:
    """A function whose last block is a loop over `%i` up to `%N`."""
    body = "\n".join(lines)
    return f"""define void @{name}({arguments}) {{
entry:
{body}
%i1 = add i64 %i, 1
%f = icmp sge i64 %i1, %N
br i1 %f, label %exit, label %loop
exit:
ret void
}}
"""
