"""Scalars that stand for numbers still to come, with the operators and functions of numbers."""

from typing import Any

import numpy as np

from steelyard.symbolic.tape import Tape

_NAMES = {
    "absolute": "abs",
    "add": "add",
    "arctan": "atan",
    "cos": "cos",
    "divide": "div",
    "exp": "exp",
    "less": "less",
    "less_equal": "less_equal",
    "maximum": "maximum",
    "minimum": "minimum",
    "multiply": "mul",
    "negative": "neg",
    "sign": "sign",
    "sin": "sin",
    "sqrt": "sqrt",
    "subtract": "sub",
    "tanh": "tanh",
}
"""NumPy's functions that programs know."""
_TURNED = {"greater": "less", "greater_equal": "less_equal"}


class Symbol:
    """One value of a tape as a scalar.

    Attributes:
        tape: The tape.
        number: The value's number there.
    """

    __slots__ = ("number", "tape")

    def __init__(self, tape: Tape, number: int) -> None:
        self.tape = tape
        self.number = number

    def is_zero(self) -> bool:
        """Whether the value is zero by structure."""
        return self.tape.known.get(self.number) == 0.0

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions, entry by entry where an array is among the arguments."""
        name = ufunc.__name__
        if name in _TURNED:
            name, inputs = _TURNED[name], inputs[::-1]
        elif name == "square":
            name, inputs = "mul", (inputs[0], inputs[0])
        else:
            name = _NAMES.get(name)
        if name is None or method != "__call__" or options:
            raise NotImplementedError(f"programs do not know NumPy's '{ufunc.__name__}'")
        arrays = np.broadcast_arrays(*(_boxed(x) for x in inputs))
        result = np.empty(arrays[0].shape, dtype=object)
        for index in np.ndindex(result.shape):
            result[index] = self._applied(name, *(x[index] for x in arrays))
        return result[()]

    def _applied(self, operation: str, *arguments: Any) -> Any:
        if any(isinstance(x, np.ndarray) for x in arguments):
            return NotImplemented
        numbers = (number_of(self.tape, x) for x in arguments)
        return Symbol(self.tape, self.tape.apply(operation, *numbers))

    def __add__(self, other: Any) -> Any:
        return self._applied("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return self._applied("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return self._applied("sub", self, other)

    def __rsub__(self, other: Any) -> Any:
        return self._applied("sub", other, self)

    def __mul__(self, other: Any) -> Any:
        return self._applied("mul", self, other)

    def __rmul__(self, other: Any) -> Any:
        return self._applied("mul", other, self)

    def __truediv__(self, other: Any) -> Any:
        return self._applied("div", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._applied("div", other, self)

    def __lt__(self, other: Any) -> Any:
        return self._applied("less", self, other)

    def __le__(self, other: Any) -> Any:
        return self._applied("less_equal", self, other)

    def __gt__(self, other: Any) -> Any:
        return self._applied("less", other, self)

    def __ge__(self, other: Any) -> Any:
        return self._applied("less_equal", other, self)

    def __pow__(self, power: int) -> Any:
        if not isinstance(power, int) or power < 1:
            raise NotImplementedError(f"programs do not know the power {power}")
        value: Any = self
        for _ in range(power - 1):
            value = value * self
        return value

    def __neg__(self) -> Any:
        return self._applied("neg", self)

    def __abs__(self) -> Any:
        return self._applied("abs", self)

    def __eq__(self, other: object) -> bool:
        raise NotImplementedError("programs do not know '=='")

    def __bool__(self) -> bool:
        """The truth of a constant.

        Raises:
            NotImplementedError: The value is still to come, as in `if`, `max` or `np.where`.
        """
        if self.number in self.tape.known:
            return bool(self.tape.known[self.number])
        raise NotImplementedError(
            "a program does not branch: use np.minimum, np.maximum, or products with comparisons"
        )

    def sin(self) -> Any:
        """As NumPy asks the entries of an array for it."""
        return self._applied("sin", self)

    def cos(self) -> Any:
        """As NumPy asks the entries of an array for it."""
        return self._applied("cos", self)


def number_of(tape: Tape, scalar: Any) -> int:
    """The number of a symbol, or of a constant."""
    return scalar.number if isinstance(scalar, Symbol) else tape.constant(float(scalar))


def _boxed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value
    box = np.empty((), dtype=object)
    box[()] = value
    return box
