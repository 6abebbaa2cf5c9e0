"""The tape on which equations are traced and shortened, and derivatives written on the same tape.

What was computed before is not written again, constants are folded, and negatives move outwards
until an addition or a subtraction absorbs them.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from steelyard.symbolic.program_and_softening import NUMPY, InputArray, Program, Step

_CURRENT: ContextVar["Tape"] = ContextVar("tape")


class Tape:
    """Values in the order they were requested; a value is its number.

    Each has the operation of a `Step`, and two arguments, -1 where there is none; of an input these
    are the array and the entry. `known` are constants, number to value.
    """

    def __init__(self) -> None:
        self.operations: list[str] = []
        self.left: list[int] = []
        self.right: list[int] = []
        self.known: dict[int, float] = {}
        self._numbers: dict[tuple[str, int, int], int] = {}
        self._constants: dict[float, int] = {}

    @contextmanager
    def recording(self) -> Iterator["Tape"]:
        """What is traced within writes on this tape."""
        token = _CURRENT.set(self)
        try:
            yield self
        finally:
            _CURRENT.reset(token)

    @staticmethod
    def current() -> "Tape":
        """The tape that is being written on."""
        return _CURRENT.get()

    def constant(self, value: float) -> int:
        """A constant; the two zeros are one."""
        number = self._constants.get(value)
        if number is None:
            number = self._new("constant", -1, -1)
            self._constants[value] = number
            self.known[number] = value
        return number

    def written(self, operation: str, left: int, right: int = -1) -> int:
        """The value of an operation, as it stands."""
        key = (operation, left, right)
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = self._new(operation, left, right)
        return number

    def variable(self) -> int:
        """A value of which nothing is known, and of which no program knows."""
        return self._new("variable", -1, -1)

    def add(self, a: int, b: int) -> int:
        """Sum."""
        known, operations = self.known, self.operations
        if a in known:
            a, b = b, a
        if b in known:
            if known[b] == 0.0:
                return a
            if a in known:
                return self.constant(known[a] + known[b])
        if operations[b] == "neg":
            return self.sub(a, self.left[b])
        if operations[a] == "neg":
            return self.sub(b, self.left[a])
        for x, y in ((a, b), (b, a)):
            if operations[x] == "sub" and self.right[x] == y:
                return self.left[x]
        return self.written("add", a, b) if a < b else self.written("add", b, a)

    def sub(self, a: int, b: int) -> int:
        """Difference."""
        known, operations = self.known, self.operations
        if a == b:
            return self.constant(0.0)
        if b in known:
            if known[b] == 0.0:
                return a
            if a in known:
                return self.constant(known[a] - known[b])
        elif a in known and known[a] == 0.0:
            return self.neg(b)
        if operations[b] == "neg":
            return self.add(a, self.left[b])
        if operations[a] == "neg":
            return self.neg(self.add(self.left[a], b))
        if operations[a] == "add" and b in (self.left[a], self.right[a]):
            return self.right[a] if self.left[a] == b else self.left[a]
        opposite = self._numbers.get(("sub", b, a))
        return self.written("sub", a, b) if opposite is None else self.neg(opposite)

    def mul(self, a: int, b: int) -> int:
        """Product."""
        known, operations = self.known, self.operations
        if a in known:
            a, b = b, a
        if b in known:
            factor = known[b]
            if factor == 0.0:
                return b
            if factor == 1.0:
                return a
            if factor == -1.0:
                return self.neg(a)
            if a in known:
                return self.constant(known[a] * factor)
        if operations[a] == "neg":
            return self.neg(self.mul(self.left[a], b))
        if operations[b] == "neg":
            return self.neg(self.mul(a, self.left[b]))
        for x, y in ((a, b), (b, a)):
            if operations[x] == "div" and self.right[x] == y:
                return self.left[x]
        return self.written("mul", a, b) if a < b else self.written("mul", b, a)

    def div(self, a: int, b: int) -> int:
        """Quotient."""
        known, operations = self.known, self.operations
        if a in known and known[a] == 0.0:
            return a
        if b in known and known[b] != 0.0:
            if known[b] in (1.0, -1.0):
                return self.mul(a, b)
            if a in known:
                return self.constant(known[a] / known[b])
        if operations[a] == "neg":
            return self.neg(self.div(self.left[a], b))
        if operations[b] == "neg":
            return self.neg(self.div(a, self.left[b]))
        return self.constant(1.0) if a == b else self.written("div", a, b)

    def neg(self, a: int) -> int:
        """Negative."""
        if a in self.known:
            return self.constant(-self.known[a])
        return self.left[a] if self.operations[a] == "neg" else self.written("neg", a)

    def apply(self, operation: str, *arguments: int) -> int:
        """Any operation of a `Step`."""
        if operation in ("add", "sub", "mul", "div", "neg"):
            return int(getattr(self, operation)(*arguments))
        if all(a in self.known for a in arguments):
            return self.constant(float(NUMPY[operation](*(self.known[a] for a in arguments))))
        return self.written(operation, *arguments)

    def program(self, inputs: Sequence[InputArray], outputs: Sequence[int]) -> Program:
        """What the outputs depend on, depth first: values are used soon after they are known."""
        place: dict[int, int] = {}
        steps: list[Step] = []
        for output in outputs:
            waiting = [output]
            while waiting:
                number = waiting[-1]
                if number in place:
                    waiting.pop()
                    continue
                arguments = self.arguments(number)
                missing = [a for a in arguments if a not in place]
                if missing:
                    waiting += missing[::-1]
                    continue
                waiting.pop()
                operation, place[number] = self.operations[number], len(steps)
                if operation == "input":
                    step = Step(operation, (self.left[number], self.right[number]))
                else:
                    read = tuple(place[a] for a in arguments)
                    step = Step(operation, read, self.known.get(number, 0.0))
                steps.append(step)
        return Program(tuple(inputs), tuple(steps), tuple(place[x] for x in outputs))

    def arguments(self, number: int) -> tuple[int, ...]:
        """The values that one is computed from."""
        if self.operations[number] in ("constant", "input", "variable"):
            return ()
        left, right = self.left[number], self.right[number]
        return (left,) if right < 0 else (left, right)

    def _new(self, operation: str, left: int, right: int) -> int:
        self.operations.append(operation)
        self.left.append(left)
        self.right.append(right)
        return len(self.operations) - 1


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

    From the edges behind the variables and the seeds $s_k$ of values $y_k$; values that the outputs
    do not depend on are left out.
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
