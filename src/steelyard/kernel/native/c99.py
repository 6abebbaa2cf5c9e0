"""Programs as functions in C99 that need `<math.h>` alone, and are C++ as well."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.kernel.program.program import Program
from steelyard.kernel.program.source import Syntax, source_of

Precision = Literal["double", "float"]

_FUNCTIONS = {
    "sqrt": "sqrt",
    "abs": "fabs",
    "sin": "sin",
    "cos": "cos",
    "exp": "exp",
    "tanh": "tanh",
    "atan": "atan",
}


@dataclass(frozen=True)
class CFunction:
    """A function in C.

    Attributes:
        signature: Its declaration without the semicolon.
        text: Its definition.
        stack: Bytes of its local variables.
        operations: Arithmetic operations of a call.
    """

    signature: str
    text: str
    stack: int
    operations: int


def literal(value: float, precision: Precision = "double") -> str:
    """A number in C, exact in its precision; negative ones in parentheses."""
    text = repr(float(value)) if precision == "double" else str(np.float32(value)) + "f"
    return f"({text})" if text.startswith("-") else text


def syntax_of(precision: Precision) -> Syntax:
    """How C writes what programs do."""
    suffix = "" if precision == "double" else "f"
    zero = literal(0.0, precision)
    functions = {name: f"{c}{suffix}({{0}})" for name, c in _FUNCTIONS.items()}
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
            **functions,
        },
        lambda value: literal(value, precision),
        "    {0} = {1};",
    )


def c_function(
    program: Program,
    name: str,
    outputs: Sequence[tuple[str, int]],
    precision: Precision = "double",
) -> CFunction:
    """A program as one function `void name(const T q[n], ..., T tau[n])`.

    Output arrays are filled while inputs are still read: they must not overlap.

    Args:
        program: The program; its input arrays become arguments of the same names.
        name: The function's name.
        outputs: Names and entries of the output arrays, in the order of the program's outputs.
        precision: Type of all numbers.
    """
    places = [f"{array}[{k}]" for array, size in outputs for k in range(size)]
    source = source_of(program, places, syntax_of(precision))
    read = {s.arguments[0] for s in program.steps if s.operation == "input"}
    arguments = [
        *(f"const {precision} {x.name}[{x.entries}]" for x in program.inputs),
        *(f"{precision} {array}[{size}]" for array, size in outputs),
    ]
    signature = f"void {name}({', '.join(arguments)})"
    names = [f"v{k}" for k in range(source.variables)]
    declared = [
        f"    {precision} {', '.join(names[k : k + 16])};" for k in range(0, len(names), 16)
    ]
    unread = [f"    (void){x.name};" for k, x in enumerate(program.inputs) if k not in read]
    body = "\n".join([*declared, *unread, *source.lines])
    size = 8 if precision == "double" else 4
    return CFunction(
        signature, f"{signature}\n{{\n{body}\n}}\n", size * source.variables, program.n_operations
    )
