r"""A traced program as a value: in JSON, run by NumPy, composed, softened at jumps.

In a traced program, what asks for the sign of a speed $v$ gets $\tanh(v/w)$, and what holds a
speed above next to nothing, $\max(|v|, \epsilon)$, holds it above $w$. A speed is any $c \cdot
\dot q$; its width is $w = \sum |c_j| w_j$ with the widths $w_j$ of the joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
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
        needed = set(self.outputs)
        for number in reversed(range(len(self.steps))):
            if number in needed and self.steps[number].operation != "input":
                needed.update(self.steps[number].arguments)
        place = {number: k for k, number in enumerate(sorted(needed))}
        steps = [self.steps[number] for number in place]
        for k, step in enumerate(steps):
            if step.operation != "input":
                steps[k] = step._replace(arguments=tuple([place[a] for a in step.arguments]))
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


def softened(program: Program, velocity: int, widths: int | float) -> Program:
    """The program with jumps at zero speed spread over a width, or the array of that number."""
    steps: list[Step] = []
    linear: list[Linear] = []
    number: list[int] = []  # of every old step among the new ones

    def push(operation: str, *arguments: int, value: float = 0.0) -> int:
        steps.append(Step(operation, arguments, value))
        return len(steps) - 1

    def width_of(speed: Linear) -> int:
        parts = []
        for joint, coefficient in speed.items():
            scale = push("constant", value=abs(coefficient))
            if isinstance(widths, float):
                width = push("constant", value=widths)
            else:
                width = push("input", widths, joint)
            parts.append(push("mul", scale, width))
        return reduce(lambda total, part: push("add", total, part), parts)

    for step in program.steps:
        linear.append(_slope(program, linear, step, velocity))
        given = step.arguments
        if step.operation != "input":
            given = tuple(number[a] for a in given)
        place, speed = _jump(program, linear, step)
        if not speed:
            number.append(push(step.operation, *given, value=step.value))
        elif step.operation == "sign":
            number.append(push("tanh", push("div", given[place], width_of(speed))))
        else:
            number.append(push("maximum", given[place], width_of(speed)))
    return Program(program.inputs, tuple(steps), tuple(number[k] for k in program.outputs))


def _jump(program: Program, linear: Sequence[Linear], step: Step) -> tuple[int, Linear]:
    """Which argument of a step is a speed, or its size held above almost nothing; and the speed."""
    if step.operation == "sign":
        return 0, linear[step.arguments[0]]
    for place, floor in ((0, 1), (1, 0)) if step.operation == "maximum" else ():
        size, least = (program.steps[step.arguments[k]] for k in (place, floor))
        held = least.operation == "constant" and 0.0 < least.value < _LARGEST_SPEED_FLOOR
        if held and size.operation == "abs":
            return place, linear[size.arguments[0]]
    return 0, {}


def _slope(program: Program, linear: Sequence[Linear], step: Step, velocity: int) -> Linear:
    """A step's value as a combination of velocities, if it is one."""
    if step.operation == "input":
        return {step.arguments[1]: 1.0} if step.arguments[0] == velocity else {}
    if step.operation == "neg":
        return {k: -c for k, c in linear[step.arguments[0]].items()}
    if step.operation not in ("add", "sub", "mul", "div"):
        return {}
    a, b = (linear[k] for k in step.arguments)
    first, second = (program.steps[k] for k in step.arguments)
    if step.operation in ("add", "sub"):
        sign = 1.0 if step.operation == "add" else -1.0
        return {k: a.get(k, 0.0) + sign * b.get(k, 0.0) for k in {*a, *b}} if a and b else {}
    if a and second.operation == "constant":
        factor = second.value if step.operation == "mul" else 1.0 / second.value
        return {k: factor * c for k, c in a.items()}
    if b and first.operation == "constant" and step.operation == "mul":
        return {k: first.value * c for k, c in b.items()}
    return {}


def program_to_json(program: Program) -> list[Any]:
    """Inputs, steps and outputs as lists."""
    inputs = [[a.name, a.entries, a.shared] for a in program.inputs]
    return [inputs, program.steps, program.outputs]


def program_from_json(values: list[Any]) -> Program:
    """The program that `program_to_json` wrote."""
    inputs, steps, outputs = values
    return Program(
        tuple(InputArray(*x) for x in inputs),
        tuple(Step(name, tuple(arguments), value) for name, arguments, value in steps),
        tuple(outputs),
    )
