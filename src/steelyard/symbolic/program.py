r"""A traced program as a value: in JSON, run by NumPy, composed, softened, bounded over boxes.

In a traced program, what asks for the sign of a speed $v$ gets $\tanh(v/w)$, and what holds a
speed above next to nothing, $\max(|v|, \epsilon)$, holds it above $w$. A speed is any $c \cdot
\dot q$; its width is $w = \sum |c_j| w_j$ with the widths $w_j$ of the joints.

Bounds are sure in spite of rounding: from $[a, b]$ and $[c, d]$ every step makes an interval that
holds the result for every pair of numbers in them [Moore1966], moved outward by more than rounding
can have moved it inward. Many boxes go side by side, one per column.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Array

NUMPY: dict[str, np.ufunc] = {
    "neg": np.negative,
    "sqrt": np.sqrt,
    "abs": np.absolute,
    "sign": np.sign,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "tanh": np.tanh,
    "atan": np.arctan,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "less": np.less,
    "less_equal": np.less_equal,
    "minimum": np.minimum,
    "maximum": np.maximum,
}
"""Operations of programs and NumPy's functions for them; comparisons give 1 or 0."""


class Step(NamedTuple):
    """A `constant`, an `input` (array, entry), or an operation of `NUMPY` on earlier steps."""

    operation: str
    arguments: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True)
class InputArray:
    """One input array: its name, its entries per sample, and whether all samples share them."""

    name: str
    entries: int
    shared: bool = False


@dataclass(frozen=True)
class Program:
    """Inputs to outputs, sample by sample, by steps in order; `outputs` are numbers of steps."""

    inputs: tuple[InputArray, ...]
    steps: tuple[Step, ...]
    outputs: tuple[int, ...]

    @property
    def n_operations(self) -> int:
        """Arithmetic steps per sample."""
        return sum(step.operation not in ("constant", "input") for step in self.steps)

    def pruned(self) -> "Program":
        """The program without steps that no output needs."""
        needed = bytearray(len(self.steps))
        for number in self.outputs:
            needed[number] = 1
        for number in reversed(range(len(self.steps))):
            if needed[number] and self.steps[number].operation != "input":
                for argument in self.steps[number].arguments:
                    needed[argument] = 1
        place: dict[int, int] = {}
        steps: list[Step] = []
        for number, step in enumerate(self.steps):
            if needed[number]:
                place[number] = len(steps)
                if step.arguments and step.operation != "input":
                    step = Step(step.operation, tuple([place[a] for a in step.arguments]))
                steps.append(step)
        return Program(self.inputs, tuple(steps), tuple(place[k] for k in self.outputs))

    def last_use(self) -> Sequence[int]:
        """For every step the number of the last step that reads it; its own if none does."""
        last = list(range(len(self.steps)))
        for number, step in enumerate(self.steps):
            if step.operation != "input":
                for argument in step.arguments:
                    last[argument] = number
        return last


def run(program: Program, inputs: Sequence[Array]) -> Array:
    """Outputs `(outputs, N)` for one array per input: `(entries, N)`, or `(entries,)` if shared."""
    n_samples = next(
        x.shape[1] for x, a in zip(inputs, program.inputs, strict=True) if not a.shared
    )
    values: list[Array] = []
    for step in program.steps:
        if step.operation == "constant":
            values.append(np.float64(step.value))  # type: ignore[arg-type]
        elif step.operation == "input":
            values.append(inputs[step.arguments[0]][step.arguments[1]])
        else:
            value = NUMPY[step.operation](*(values[a] for a in step.arguments))
            values.append(value.astype(np.float64) if value.dtype == np.bool_ else value)
    result = np.empty((len(program.outputs), n_samples))
    for row, number in enumerate(program.outputs):
        result[row] = values[number]
    return result


_LARGEST_SPEED_FLOOR = 1e-6
Linear = Mapping[int, float]
"""Coefficients over the velocities; empty for what does not depend on them in this way."""


class _Softener:
    """A program under construction, with the linear parts of old steps and their new numbers."""

    def __init__(self, program: Program, velocity: int, widths: int | float) -> None:
        self.steps: list[Step] = []
        self.program, self._velocity, self._widths = program, velocity, widths
        self.number: list[int] = []
        self._linear: list[Linear] = []

    def push(self, operation: str, *arguments: int, value: float = 0.0) -> int:
        self.steps.append(Step(operation, arguments, value))
        return len(self.steps) - 1

    def take(self, step: Step) -> None:
        softened = self._softened(step)
        self._linear.append(self._slope(step))
        if softened is None:
            arguments = step.arguments
            if step.operation != "input":
                arguments = tuple(self.number[a] for a in arguments)
            softened = self.push(step.operation, *arguments, value=step.value)
        self.number.append(softened)

    def _softened(self, step: Step) -> int | None:
        if step.operation == "sign" and (speed := self._linear[step.arguments[0]]):
            relative = self.push("div", self.number[step.arguments[0]], self._width(speed))
            return self.push("tanh", relative)
        if step.operation == "maximum":
            for size, floor in (step.arguments, step.arguments[::-1]):
                inside, least = self.program.steps[size], self.program.steps[floor]
                speed = self._linear[inside.arguments[0]] if inside.operation == "abs" else {}
                if (
                    speed
                    and least.operation == "constant"
                    and 0.0 < least.value < _LARGEST_SPEED_FLOOR
                ):
                    return self.push("maximum", self.number[size], self._width(speed))
        return None

    def _width(self, speed: Linear) -> int:
        total = -1
        for joint, coefficient in speed.items():
            scale = self.push("constant", value=abs(coefficient))
            if isinstance(self._widths, float):
                width = self.push("constant", value=self._widths)
            else:
                width = self.push("input", self._widths, joint)
            part = self.push("mul", scale, width)
            total = part if total < 0 else self.push("add", total, part)
        return total

    def _slope(self, step: Step) -> Linear:
        """The step's value as a combination of velocities, if it is one."""
        if step.operation == "input":
            return {step.arguments[1]: 1.0} if step.arguments[0] == self._velocity else {}
        if step.operation not in ("neg", "add", "sub", "mul", "div"):
            return {}
        parts = [self._linear[a] for a in step.arguments]
        if step.operation == "neg":
            return {k: -c for k, c in parts[0].items()}
        a, b = parts
        if step.operation in ("add", "sub"):
            sign = 1.0 if step.operation == "add" else -1.0
            return {k: a.get(k, 0.0) + sign * b.get(k, 0.0) for k in {*a, *b}} if a and b else {}
        first, second = (self.program.steps[k] for k in step.arguments)
        if a and second.operation == "constant":
            factor = second.value if step.operation == "mul" else 1.0 / second.value
            return {k: factor * c for k, c in a.items()}
        if b and first.operation == "constant" and step.operation == "mul":
            return {k: first.value * c for k, c in b.items()}
        return {}


def softened(program: Program, velocity: int, widths: int | float) -> Program:
    """The program with jumps at zero speed spread over a width, or the array of that number."""
    writer = _Softener(program, velocity, widths)
    for step in program.steps:
        writer.take(step)
    outputs = tuple(writer.number[number] for number in program.outputs)
    return Program(program.inputs, tuple(writer.steps), outputs)


def program_to_json(program: Program) -> list[Any]:
    """Inputs, steps and outputs as lists."""
    return [
        [[a.name, a.entries, a.shared] for a in program.inputs],
        [
            [s.operation, s.value if s.operation == "constant" else s.arguments]
            for s in program.steps
        ],
        list(program.outputs),
    ]


def program_from_json(values: list[Any]) -> Program:
    """The program that `program_to_json` wrote."""
    inputs, steps, outputs = values
    return Program(
        tuple(InputArray(*x) for x in inputs),
        tuple(
            Step(name, value=rest) if name == "constant" else Step(name, tuple(rest))
            for name, rest in steps
        ),
        tuple(outputs),
    )


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
            array, entry = step.arguments
            values[number] = _given(boxes[array][:, entry])
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
    if isinstance(a, float):
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
    function: Callable[[Array], Array], least: float, most: float, relative: float = _LIBRARY
) -> Callable[[Interval], Interval]:
    """A function that never falls, with values from `least` to `most`."""

    def over(x: Interval) -> Interval:
        return np.clip(_outward(function(_bounds(x)), relative), least, most)

    return over


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
    passes: Array = ~(first > turns[1] + slack[1])
    return passes


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
