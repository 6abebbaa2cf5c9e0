"""What is traced, written down value by value, and shortened as it is written.

What was computed before is not written again, constants are folded, and negatives move outwards
until an addition or a subtraction absorbs them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from steelyard.kernel.program.program import Array, Program, Step

_CURRENT: ContextVar["Tape"] = ContextVar("tape")
_FOLDED: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": lambda x: float((x > 0.0) - (x < 0.0)),
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "tanh": math.tanh,
    "atan": math.atan,
    "less": lambda a, b: float(a < b),
    "less_equal": lambda a, b: float(a <= b),
    "minimum": min,
    "maximum": max,
}


class Tape:
    """Values in the order they were requested; a value is its number.

    Attributes:
        operations: Name of every value's operation, as of a `Step`.
        left: Its first argument; of an input the array.
        right: Its second argument; of an input the entry; -1 if there is none.
        known: Constants, number to value.
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
        if operation in _SHORTENED:
            return _SHORTENED[operation](self, *arguments)
        if all(a in self.known for a in arguments):
            return self.constant(_FOLDED[operation](*(self.known[a] for a in arguments)))
        return self.written(operation, *arguments)

    def program(self, inputs: Sequence[Array], outputs: Sequence[int]) -> Program:
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
                place[number] = len(steps)
                steps.append(self._step(number, arguments, place))
        return Program(tuple(inputs), tuple(steps), tuple(place[x] for x in outputs))

    def arguments(self, number: int) -> tuple[int, ...]:
        """The values that one is computed from."""
        if self.operations[number] in ("constant", "input", "variable"):
            return ()
        left, right = self.left[number], self.right[number]
        return (left,) if right < 0 else (left, right)

    def _step(self, number: int, arguments: Sequence[int], place: dict[int, int]) -> Step:
        operation = self.operations[number]
        if operation == "constant":
            return Step(operation, (), self.known[number])
        if operation == "input":
            return Step(operation, (self.left[number], self.right[number]))
        return Step(operation, tuple(place[a] for a in arguments))

    def _new(self, operation: str, left: int, right: int) -> int:
        self.operations.append(operation)
        self.left.append(left)
        self.right.append(right)
        return len(self.operations) - 1


_SHORTENED: dict[str, Callable[..., int]] = {
    "add": Tape.add,
    "sub": Tape.sub,
    "mul": Tape.mul,
    "div": Tape.div,
    "neg": Tape.neg,
}
