"""Programs made of programs."""

from collections.abc import Mapping, Sequence

from steelyard.kernel.program.program import Program, Step


class Writer:
    """A program under construction.

    Attributes:
        steps: Assignments so far.
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._constants: dict[float, int] = {}

    def push(self, operation: str, *arguments: int, value: float = 0.0) -> int:
        """Add a step; its number."""
        self.steps.append(Step(operation, arguments, value))
        return len(self.steps) - 1

    def constant(self, value: float) -> int:
        """The step that holds a constant."""
        if value not in self._constants:
            self._constants[value] = self.push("constant", value=value)
        return self._constants[value]

    def plus(self, start: int, factor: int, slope: int) -> int:
        """`start + factor * slope`."""
        return self.push("add", start, self.push("mul", factor, slope))

    def weighed(self, slopes: Sequence[int]) -> int:
        """`k1 + 2 k2 + 2 k3 + k4`."""
        first, second, third, fourth = slopes
        middle = self.push("add", second, third)
        ends = self.push("add", first, fourth)
        return self.push("add", ends, self.push("add", middle, middle))

    def inlined(self, program: Program, given: Mapping[tuple[int, int], int]) -> list[int]:
        """Add all steps of a program; the steps that hold its outputs.

        Args:
            program: The program.
            given: Steps that take the place of input entries `(array, entry)`.
        """
        numbers: list[int] = []
        for step in program.steps:
            if step.operation == "constant":
                numbers.append(self.constant(step.value))
            elif step.operation != "input":
                numbers.append(self.push(step.operation, *(numbers[a] for a in step.arguments)))
            elif (step.arguments[0], step.arguments[1]) in given:
                numbers.append(given[step.arguments[0], step.arguments[1]])
            else:
                numbers.append(self.push("input", *step.arguments))
        return [numbers[k] for k in program.outputs]
