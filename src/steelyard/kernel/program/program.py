"""A traced program: straight-line arithmetic in single assignment, a plain value."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

UNARY = ("neg", "sqrt", "abs", "sign", "sin", "cos", "exp", "tanh", "atan")
BINARY = ("add", "sub", "mul", "div", "less", "less_equal", "minimum", "maximum")


class Step(NamedTuple):
    """One assignment.

    Attributes:
        operation: `constant`, `input`, or a name of `UNARY` or `BINARY`.
        arguments: Numbers of earlier steps; for an input `(array, entry)`; empty for a constant.
        value: The constant.
    """

    operation: str
    arguments: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True)
class Array:
    """One input array: its name, its entries per sample, and whether all samples share them."""

    name: str
    entries: int
    shared: bool = False


@dataclass(frozen=True)
class Program:
    """Inputs to outputs, sample by sample.

    Attributes:
        inputs: The input arrays.
        steps: Assignments in order of evaluation.
        outputs: For every output entry the step that holds it.
    """

    inputs: tuple[Array, ...]
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
