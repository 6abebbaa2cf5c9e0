"""Bounds of a program's outputs over boxes of its inputs, by interval arithmetic.

Bounds are sure in spite of rounding: from $[a, b]$ and $[c, d]$ every step makes an interval that
holds the result for every pair of numbers in them [Moore1966], moved outward by more than rounding
can have moved it inward. Many boxes go side by side, one per column.
"""

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.symbolic.program_and_softening import Program

Interval = Array | float
"""Bounds, shape `(2, B)` or `(2, 1)`: lower, upper; or one number that is exact."""

CHUNK = 1024  # boxes that go at once: their bounds stay in the cache of the processor

_ROUND = 4.5e-16
_TINY = 1e-300
_LIBRARY = 4e-15
"""Relative errors, more than twice those of arithmetic and of NumPy's elementary functions."""


def enclosed(
    program: Program, lower: Sequence[Array], upper: Sequence[Array]
) -> tuple[Array, Array]:
    """Lower and upper bounds of a program's outputs over boxes, each `(len(program.outputs), B)`.

    Per input lower and upper bounds, `(entries, B)`, or `(entries,)` where all boxes share them.
    Results are infinite where nothing is known, such as after a division by an interval that holds
    zero.
    """
    n_boxes = next(x.shape[1] for x, a in zip(lower, program.inputs, strict=True) if not a.shared)
    result = np.empty((2, len(program.outputs), n_boxes))
    kept, frees = set(program.outputs), [list[int]() for _ in program.steps]
    for number, last in enumerate(program.last_use()):
        if number not in kept:
            frees[last].append(number)  # no step reads it later
    for start in range(0, n_boxes, CHUNK):
        part = slice(start, start + CHUNK)
        boxes = [
            np.stack([low, high])[(..., *(() if a.shared else (part,)))]
            for low, high, a in zip(lower, upper, program.inputs, strict=True)
        ]
        with np.errstate(all="ignore"):
            _run(program, boxes, frees, result[:, :, part])
    unknown = np.isnan(result).any(axis=0)
    result[0][unknown], result[1][unknown] = -np.inf, np.inf
    return result[0], result[1]


def _run(program: Program, boxes: list[Array], frees: list[list[int]], result: Array) -> None:
    values: dict[int, Interval] = {}
    for number, step in enumerate(program.steps):
        if step.operation == "constant":
            values[number] = step.value
        elif step.operation == "input":
            values[number] = _given(boxes[step.arguments[0]][:, step.arguments[1]])
        elif step.operation == "mul" and step.arguments[0] == step.arguments[1]:
            values[number] = _square(values[step.arguments[0]])
        else:
            values[number] = _OPERATIONS[step.operation](*(values[a] for a in step.arguments))
        for unused in frees[number]:
            del values[unused]
    for row, number in enumerate(program.outputs):
        result[:, row] = _bounds(values[number])


def _given(bounds: Array) -> Interval:
    """An input; what all boxes share is a number if its bounds are one."""
    if bounds.ndim == 1:
        return float(bounds[0]) if bounds[0] == bounds[1] else bounds[:, None]
    return bounds


def _bounds(x: Interval) -> Array:
    return np.full((2, 1), x) if isinstance(x, float) else x


def _outward(x: Array, relative: float = _ROUND) -> Array:
    """Move fresh bounds outward, in place."""
    pad = np.abs(x)
    pad *= relative
    pad += _TINY
    x[0] -= pad[0]
    x[1] += pad[1]
    return x


def _negative(x: Interval) -> Interval:
    return -x if isinstance(x, float) else -x[::-1]


def _sum(a: Interval, b: Interval) -> Interval:
    for one, other in ((a, b), (b, a)):
        if isinstance(one, float) and one == 0.0:
            return other
    return _outward(_bounds(a) + _bounds(b))


def _product(a: Interval, b: Interval) -> Interval:
    if isinstance(a, float):
        a, b = b, a
    a = _bounds(a)
    if isinstance(b, float):
        return _multiple(a, b)
    four = (a[:, None] * b[None]).reshape(4, -1)
    low = four.min(axis=0)
    if np.isnan(low).any():
        # zero times unbounded is zero; what was unknown stays so
        nothing = np.isnan(four) & ~(np.isnan(a).any(axis=0) | np.isnan(b).any(axis=0))
        four[nothing] = 0.0
        low = four.min(axis=0)
    return _outward(np.stack([low, four.max(axis=0)]))


def _multiple(a: Array, factor: float) -> Interval:
    """A number times an interval; exact where nothing is rounded."""
    if factor == 0.0:
        return 0.0
    if abs(factor) == 1.0:
        return a if factor > 0.0 else -a[::-1]
    return _outward((a if factor > 0.0 else a[::-1]) * factor)


def _square(x: Interval) -> Interval:
    size = _bounds(_size(x))
    return np.maximum(_outward(size * size), 0.0)


def _quotient(a: Interval, b: Interval) -> Interval:
    """Unbounded where the divisor may be zero."""
    divisor = _bounds(b)
    spans = (divisor[0] <= 0.0) & (divisor[1] >= 0.0)
    inverse = _outward(1.0 / np.where(spans, 1.0, divisor)[::-1])
    inverse[0][spans], inverse[1][spans] = -np.inf, np.inf
    result = _bounds(_product(a, inverse))
    return np.where(np.isnan(divisor).any(axis=0), np.nan, result)


def _root(x: Interval) -> Interval:
    """Only of what is not negative; unbounded if nothing is."""
    bounds = _bounds(x)
    roots = np.maximum(_outward(np.sqrt(np.maximum(bounds, 0.0))), 0.0)
    roots[0][bounds[1] < 0.0], roots[1][bounds[1] < 0.0] = -np.inf, np.inf
    return roots


def _size(x: Interval) -> Interval:
    if isinstance(x, float):
        return abs(x)
    return np.stack([np.maximum(np.maximum(x[0], -x[1]), 0.0), np.maximum(-x[0], x[1])])


def _rising(
    function: Callable[[Array], Array], least: float, most: float
) -> Callable[[Interval], Interval]:
    """A function that never falls, with values from `least` to `most`."""
    return lambda x: np.clip(_outward(function(_bounds(x)), _LIBRARY), least, most)


def _wave(
    function: Callable[[Array], Array], lowest: float, highest: float
) -> Callable[[Interval], Interval]:
    """Sine or cosine, by the angles at which it is lowest and highest."""

    def over(x: Interval) -> Interval:
        bounds = _bounds(x)
        values = function(bounds)
        result = _outward(np.stack([values.min(axis=0), values.max(axis=0)]), _LIBRARY)
        result[0][_passes(bounds, lowest)] = -1.0
        result[1][_passes(bounds, highest)] = 1.0
        return np.clip(result, -1.0, 1.0)

    return over


def _passes(bounds: Array, angle: float) -> Array:
    """Whether an interval may hold `angle` plus whole turns."""
    turns = (bounds - angle) / (2.0 * np.pi)
    slack = 1e-14 * (1.0 + np.abs(turns))
    first = np.ceil(turns[0] - slack[0])
    return np.asarray(~(first > turns[1] + slack[1]))


def _truth(sure: np.ufunc, excluded: np.ufunc, a: Array, b: Array) -> Array:
    """1 and 0 of a comparison: what surely holds, and what is not excluded."""
    return np.stack([sure(a[1], b[0]), ~excluded(a[0], b[1])]).astype(np.float64)


_OPERATIONS: dict[str, Callable[..., Interval]] = {
    "add": _sum,
    "sub": lambda a, b: _sum(a, _negative(b)),
    "mul": _product,
    "div": _quotient,
    "neg": _negative,
    "sqrt": _root,
    "abs": _size,
    "sign": lambda x: np.sign(_bounds(x)),
    "sin": _wave(np.sin, -0.5 * np.pi, 0.5 * np.pi),
    "cos": _wave(np.cos, np.pi, 0.0),
    "exp": _rising(np.exp, 0.0, np.inf),
    "tanh": _rising(np.tanh, -1.0, 1.0),
    "atan": _rising(np.arctan, -np.inf, np.inf),
    "less": lambda a, b: _truth(np.less, np.greater_equal, _bounds(a), _bounds(b)),
    "less_equal": lambda a, b: _truth(np.less_equal, np.greater, _bounds(a), _bounds(b)),
    "minimum": lambda a, b: np.minimum(_bounds(a), _bounds(b)),
    "maximum": lambda a, b: np.maximum(_bounds(a), _bounds(b)),
}
