"""Programs as source code of other languages, and as C99 functions that need only math.h."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Literal

import numpy as np

from steelyard.base.arrays import by_key
from steelyard.symbolic.program_and_softening import Program


@dataclass(frozen=True)
class Syntax:
    """How a language writes what programs do.

    `operations` of a `Step` have `{0}` and `{1}` for arguments; an assignment has `{0}` for the
    variable, `{1}` for the expression.
    """

    operations: Mapping[str, str]
    number: Callable[[float], str]
    assignment: str


def variables_of(program: Program) -> tuple[dict[int, int], int]:
    """A variable for every computed step, reused when no later one reads it."""
    last, free, count = program.last_use(), list[int](), 0
    place: dict[int, int] = {}
    for number, step in enumerate(program.steps):
        if step.operation in ("constant", "input"):
            continue
        for argument in set(step.arguments):
            if argument in place and last[argument] == number:
                heappush(free, place[argument])
        if not free:
            free, count = [count], count + 1
        place[number] = heappop(free)
    return place, count


def source_of(program: Program, outputs: Sequence[str], syntax: Syntax) -> tuple[list[str], int]:
    """Statements of a program, and how many variables `v0`, `v1`, ... they use."""
    place, count = variables_of(program)
    entries = by_key(zip(program.outputs, outputs, strict=True))

    def value(number: int) -> str:
        step = program.steps[number]
        if step.operation == "constant":
            return syntax.number(step.value)
        if step.operation == "input":
            array, entry = step.arguments
            return f"{program.inputs[array].name}[{entry}]"
        return f"v{place[number]}"

    lines: list[str] = []
    for number, step in enumerate(program.steps):
        if number in place:
            expression = syntax.operations[step.operation].format(*map(value, step.arguments))
            lines.append(syntax.assignment.format(value(number), expression))
        lines += [syntax.assignment.format(name, value(number)) for name in entries.get(number, [])]
    return lines, count


Precision = Literal["double", "float"]


@dataclass(frozen=True)
class CFunction:
    """A function in C: declaration, definition, bytes of local variables, arithmetic operations."""

    signature: str
    text: str
    stack: int
    operations: int


def c_literal(value: float, precision: Precision = "double") -> str:
    """A number in C, exact in its precision; negative ones in parentheses."""
    text = repr(float(value)) if precision == "double" else str(np.float32(value)) + "f"
    return f"({text})" if text.startswith("-") else text


def c_syntax_of(precision: Precision) -> Syntax:
    """How C writes what programs do."""
    suffix = "" if precision == "double" else "f"
    zero = c_literal(0.0, precision)
    functions = {"abs": "fabs"} | {f: f for f in ("sqrt", "sin", "cos", "exp", "tanh", "atan")}
    return Syntax(
        {
            "add": "{0} + {1}",
            "sub": "{0} - {1}",
            "mul": "{0} * {1}",
            "div": "{0} / {1}",
            "neg": "-{0}",
            "sign": f"{{0}} != {{0}} ? {{0}} : ({precision})(({{0}} > {zero}) - ({{0}} < {zero}))",
            "less": f"({precision})({{0}} < {{1}})",
            "less_equal": f"({precision})({{0}} <= {{1}})",
            "minimum": "{0} < {1} ? {0} : {1}",
            "maximum": "{0} > {1} ? {0} : {1}",
            **{name: f"{c}{suffix}({{0}})" for name, c in functions.items()},
        },
        lambda value: c_literal(value, precision),
        "    {0} = {1};",
    )


def c_function(
    program: Program, name: str, outputs: Sequence[tuple[str, int]], precision: Precision = "double"
) -> CFunction:
    """A program as one function `void name(const T q[n], ..., T tau[n])` of one precision.

    Output arrays, by name and size, are filled while inputs are still read: they must not overlap.
    """
    places = [f"{array}[{k}]" for array, size in outputs for k in range(size)]
    lines, count = source_of(program, places, c_syntax_of(precision))
    read = {s.arguments[0] for s in program.steps if s.operation == "input"}
    arguments = [
        *(f"const {precision} {x.name}[{x.entries}]" for x in program.inputs),
        *(f"{precision} {array}[{size}]" for array, size in outputs),
    ]
    signature = f"void {name}({', '.join(arguments)})"
    names = [f"v{k}" for k in range(count)]
    declared = [
        f"    {precision} {', '.join(names[k : k + 16])};" for k in range(0, len(names), 16)
    ]
    unread = [f"    (void){x.name};" for k, x in enumerate(program.inputs) if k not in read]
    body = "\n".join([*declared, *unread, *lines])
    size = 8 if precision == "double" else 4
    return CFunction(
        signature, f"{signature}\n{{\n{body}\n}}\n", size * count, program.n_operations
    )
