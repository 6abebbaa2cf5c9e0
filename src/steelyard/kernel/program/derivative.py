"""Derivatives of what a tape holds, written on the same tape."""

from collections.abc import Iterator, Mapping, Sequence

from steelyard.kernel.program.tape import Tape

Edges = Sequence[tuple[int, Sequence[tuple[int, int]]]]
"""Values, each with those arguments that depend on the variables and its derivatives by them."""


def edges(tape: Tape, variables: Sequence[int]) -> Edges:
    """How all values that depend on some variables do so, in order of evaluation."""
    inside = set(variables)
    found: list[tuple[int, Sequence[tuple[int, int]]]] = []
    for number in range(min(variables, default=0), len(tape.operations)):
        if any(a in inside for a in tape.arguments(number)):
            partials = [x for x in _partials(tape, number) if x[0] in inside]
            if partials:
                inside.add(number)
                found.append((number, partials))
    return found


def backward(tape: Tape, between: Edges, seeds: Mapping[int, int]) -> dict[int, int]:
    r"""Derivatives $\sum_k s_k\,\partial y_k / \partial x$ by all values $x$, in reverse mode.

    Args:
        tape: The tape.
        between: The edges from the variables on.
        seeds: Value $y_k$ to its seed $s_k$.

    Returns:
        Value to derivative; values that the outputs do not depend on are left out.
    """
    slopes = dict(seeds)
    add, mul = tape.add, tape.mul
    for number, arguments in reversed(between):
        slope = slopes.get(number)
        if slope is not None:
            for argument, partial in arguments:
                part = mul(slope, partial)
                old = slopes.get(argument)
                slopes[argument] = part if old is None else add(old, part)
    return slopes


def forward(tape: Tape, between: Edges, rates: Mapping[int, int]) -> dict[int, int]:
    """How fast values change while some variables change at given rates; others are left out."""
    found = dict(rates)
    for number, arguments in between:
        for argument, partial in arguments:
            if argument in found:
                part = tape.mul(partial, found[argument])
                old = found.get(number)
                found[number] = part if old is None else tape.add(old, part)
    return found


def _partials(tape: Tape, number: int) -> Iterator[tuple[int, int]]:
    """The arguments of a value, each with the value's derivative by it."""
    arguments = tape.arguments(number)
    a, b = arguments[0], arguments[-1]
    one = tape.constant(1.0)
    match tape.operations[number]:
        case "add":
            yield from ((a, one), (b, one))
        case "sub":
            yield from ((a, one), (b, tape.constant(-1.0)))
        case "mul":
            yield from ((a, b), (b, a))
        case "div":
            inverse = tape.div(one, b)
            yield from ((a, inverse), (b, tape.neg(tape.mul(number, inverse))))
        case "neg":
            yield a, tape.constant(-1.0)
        case "sqrt":
            yield a, tape.div(tape.constant(0.5), number)
        case "abs":
            yield a, tape.apply("sign", a)
        case "sin":
            yield a, tape.apply("cos", a)
        case "cos":
            yield a, tape.neg(tape.apply("sin", a))
        case "exp":
            yield a, number
        case "tanh":
            yield a, tape.sub(one, tape.mul(number, number))
        case "atan":
            yield a, tape.div(one, tape.add(one, tape.mul(a, a)))
        case "minimum" | "maximum" as operation:
            first = tape.apply("less_equal", *((a, b) if operation == "minimum" else (b, a)))
            yield from ((a, first), (b, tape.sub(one, first)))
