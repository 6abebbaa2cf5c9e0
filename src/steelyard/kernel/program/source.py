"""Programs as source code of other languages: one assignment per step, few variables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

from steelyard.kernel.program.program import Program


@dataclass(frozen=True)
class Syntax:
    """How a language writes what programs do.

    Attributes:
        operations: Operation of a `Step` to its expression, with `{0}` and `{1}` for arguments.
        number: A number as a literal.
        assignment: A statement, with `{0}` for the variable and `{1}` for the expression.
    """

    operations: Mapping[str, str]
    number: Callable[[float], str]
    assignment: str


@dataclass(frozen=True)
class Source:
    """Statements of a program.

    Attributes:
        lines: The statements.
        variables: Number of variables `v0`, `v1`, ... that they use.
    """

    lines: tuple[str, ...]
    variables: int


def variables_of(program: Program) -> tuple[dict[int, int], int]:
    """A variable for every computed step, and how many there are.

    A variable is used again as soon as no later step reads its value.
    """
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
            heapify(free)
        place[number] = heappop(free)
    return place, count


def source_of(program: Program, outputs: Sequence[str], syntax: Syntax) -> Source:
    """A program as statements.

    Args:
        program: The program; its input arrays go by their names.
        outputs: Where each output entry is stored.
        syntax: The language.
    """
    place, count = variables_of(program)
    entries: dict[int, list[str]] = {}
    for name, number in zip(outputs, program.outputs, strict=True):
        entries.setdefault(number, []).append(name)

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
    return Source(tuple(lines), count)
