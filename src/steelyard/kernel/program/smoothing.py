r"""Laws that jump at zero speed, made steep instead: an integration with fixed steps needs slopes.

In a traced program, what asks for the sign of a speed $v$ gets $\tanh(v/w)$, and what holds a
speed above next to nothing, $\max(|v|, \epsilon)$, holds it above $w$. A speed is any $c \cdot
\dot q$; its width is $w = \sum |c_j| w_j$ with the widths $w_j$ of the joints.
"""

from collections.abc import Mapping

from steelyard.kernel.program.compose import Writer
from steelyard.kernel.program.program import Program, Step

_NOTHING = 1e-6
Linear = Mapping[int, float]
"""Coefficients over the velocities; empty for what does not depend on them in this way."""


class _Softener(Writer):
    """A program under construction, with the linear parts of its steps.

    Attributes:
        number: Old step to new step.
    """

    def __init__(self, program: Program, velocity: int, widths: int | float) -> None:
        super().__init__()
        self.program, self._velocity, self._widths = program, velocity, widths
        self.number: list[int] = []
        self._linear: list[Linear] = []

    def take(self, step: Step) -> None:
        """Write one step of the old program, softened if it jumps."""
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
                speed = self._size_of_speed(size)
                least = self.program.steps[floor]
                if speed and least.operation == "constant" and 0.0 < least.value < _NOTHING:
                    return self.push("maximum", self.number[size], self._width(speed))
        return None

    def _size_of_speed(self, number: int) -> Linear:
        step = self.program.steps[number]
        return self._linear[step.arguments[0]] if step.operation == "abs" else {}

    def _width(self, speed: Linear) -> int:
        total = -1
        for joint, coefficient in speed.items():
            scale = self.push("constant", value=abs(coefficient))
            part = self.push("mul", scale, self._width_of(joint))
            total = part if total < 0 else self.push("add", total, part)
        return total

    def _width_of(self, joint: int) -> int:
        if isinstance(self._widths, float):
            return self.push("constant", value=self._widths)
        return self.push("input", self._widths, joint)

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
    """The program with jumps at zero speed spread over the widths.

    Args:
        program: The program.
        velocity: Number of its input array of velocities.
        widths: Number of its input array of widths, one per velocity; or a width for all, a
            float.
    """
    writer = _Softener(program, velocity, widths)
    for step in program.steps:
        writer.take(step)
    outputs = tuple(writer.number[number] for number in program.outputs)
    return Program(program.inputs, tuple(writer.steps), outputs)
