"""Scalars that stand for numbers still to come, and equations over them traced into a `Program`.

Symbols have the operators and functions of numbers; derivatives are written on the same tape.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from steelyard.symbolic.program_and_softening import NUMPY, InputArray, Program
from steelyard.symbolic.tape_and_derivatives import Tape, backward, edges, forward

Scalar = Any
Scalars = Sequence[Scalar]

_NAMES = {function.__name__: name for name, function in NUMPY.items()}
_TURNED = {"greater": "less", "greater_equal": "less_equal"}


def _operator(operation: str, turned: bool = False) -> Callable[..., Any]:
    """A method of a symbol for an operation, with another scalar behind it or, turned, before."""

    def apply(self: "Symbol", *other: Any) -> Any:
        return self._applied(operation, *((*other, self) if turned else (self, *other)))

    return apply


class Symbol:
    """One value of a tape as a scalar, by its number there."""

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
        arrays = np.broadcast_arrays(*(np.asarray(x, dtype=object) for x in inputs))
        result = np.empty(arrays[0].shape, dtype=object)
        for index in np.ndindex(result.shape):
            result[index] = self._applied(name, *(x[index] for x in arrays))
        return result[()]

    def _applied(self, operation: str, *arguments: Any) -> Any:
        if any(isinstance(x, np.ndarray) for x in arguments):
            return NotImplemented
        numbers = (number_of(self.tape, x) for x in arguments)
        return Symbol(self.tape, self.tape.apply(operation, *numbers))

    __add__, __radd__ = _operator("add"), _operator("add", turned=True)
    __sub__, __rsub__ = _operator("sub"), _operator("sub", turned=True)
    __mul__, __rmul__ = _operator("mul"), _operator("mul", turned=True)
    __truediv__, __rtruediv__ = _operator("div"), _operator("div", turned=True)
    __lt__, __gt__ = _operator("less"), _operator("less", turned=True)
    __le__, __ge__ = _operator("less_equal"), _operator("less_equal", turned=True)

    def __pow__(self, power: int) -> Any:
        if not isinstance(power, int) or power < 1:
            raise NotImplementedError(f"programs do not know the power {power}")
        value: Any = self
        for _ in range(power - 1):
            value = value * self
        return value

    __neg__, __abs__ = _operator("neg"), _operator("abs")
    # as NumPy asks the entries of an array for them
    sin, cos = _operator("sin"), _operator("cos")

    def __eq__(self, other: object) -> bool:
        raise NotImplementedError("programs do not know '=='")

    def __bool__(self) -> bool:
        """The truth of a constant; what is still to come has none: no `if`, no `max`."""
        if self.number in self.tape.known:
            return bool(self.tape.known[self.number])
        raise NotImplementedError(
            "a program does not branch: use np.minimum, np.maximum, or products with comparisons"
        )


def number_of(tape: Tape, scalar: Any) -> int:
    """The number of a symbol, or of a constant."""
    return scalar.number if isinstance(scalar, Symbol) else tape.constant(float(scalar))


def symbolic(build: Callable[..., Scalars], inputs: Sequence[InputArray]) -> Program:
    """Trace `build`, called with one list of scalar symbols per input array."""
    with Tape().recording() as tape:
        return tape.program(inputs, _numbers(tape, build(*_symbols(tape, inputs))))


def affine(build: Callable[[Scalars], Scalars], n: int) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Slopes, rows of `n`, and values at zero of expressions that are linear in `n` variables."""
    tape = Tape.current()
    variables = [tape.variable() for _ in range(n)]
    values = _numbers(tape, build([Symbol(tape, x) for x in variables]))
    between, zero, one = edges(tape, variables), tape.constant(0.0), tape.constant(1.0)
    columns = [forward(tape, between, {x: one}) for x in variables]
    slopes = [[Symbol(tape, column.get(y, zero)) for column in columns] for y in values]
    return slopes, list(build([0.0] * n))


def pulled_back(program: Program, arrays: Sequence[int]) -> Program:
    r"""The reverse derivative of a program, $\sum_k s_k \, \partial y_k / \partial x$.

    Inputs are the program's, and the seeds $s$, one per output $y$; outputs are the derivatives by
    the entries $x$ of the input arrays whose numbers are given, array by array.
    """
    inputs = (*program.inputs, InputArray("seeds", len(program.outputs)))
    with Tape().recording() as tape:
        *symbols, given = _symbols(tape, inputs)
        seeds: dict[int, int] = {}
        for output, seed in zip(replayed(program, symbols), given, strict=True):
            old = seeds.get(output.number)
            seeds[output.number] = seed.number if old is None else tape.add(old, seed.number)
        by = [symbol.number for k in arrays for symbol in symbols[k]]
        slopes = backward(tape, edges(tape, by), seeds)
        zero = tape.constant(0.0)
        return tape.program(inputs, [slopes.get(number, zero) for number in by])


def carried_along(values: Scalars, variables: Scalars, speeds: Scalars) -> list[Scalar]:
    """How fast expressions change while their variables change at given speeds."""
    tape = Tape.current()
    moving = _numbers(tape, variables)
    rates = dict(zip(moving, _numbers(tape, speeds), strict=True))
    found = forward(tape, edges(tape, moving), rates)
    zero = tape.constant(0.0)
    return [Symbol(tape, found.get(number, zero)) for number in _numbers(tape, values)]


def in_time(build: Callable[..., Scalars], *state: Scalars) -> list[Scalar]:
    """Rates of expressions of all parts of a state but the last, each the next one's integral."""
    before, after = ([x for part in parts for x in part] for parts in (state[:-1], state[1:]))
    return carried_along(build(*state[:-1]), before, after)


def slopes_of(values: Scalars, variables: Scalars) -> list[Scalar]:
    """Derivatives of expressions by variables, value by value."""
    tape = Tape.current()
    by, zero, one = _numbers(tape, variables), tape.constant(0.0), tape.constant(1.0)
    between = edges(tape, by)
    found: list[Scalar] = []
    for number in _numbers(tape, values):
        slopes = backward(tape, between, {number: one})
        found += [Symbol(tape, slopes.get(variable, zero)) for variable in by]
    return found


def replayed(
    program: Program,
    symbols: Sequence[Scalars],
    instead: Mapping[str, Callable[..., Scalar]] = MappingProxyType({}),
) -> list[Any]:
    """A program's outputs over symbols of its inputs; functions may replace operations."""
    tape = Tape.current()
    values: list[int] = []
    for step in program.steps:
        if step.operation == "constant":
            values.append(tape.constant(step.value))
        elif step.operation == "input":
            array, entry = step.arguments
            values.append(number_of(tape, symbols[array][entry]))
        elif step.operation in instead:
            given = (Symbol(tape, values[k]) for k in step.arguments)
            values.append(number_of(tape, instead[step.operation](*given)))
        else:
            values.append(tape.apply(step.operation, *(values[k] for k in step.arguments)))
    return [Symbol(tape, values[k]) for k in program.outputs]


def _symbols(tape: Tape, inputs: Sequence[InputArray]) -> list[list[Symbol]]:
    return [
        [Symbol(tape, tape.written("input", k, entry)) for entry in range(array.entries)]
        for k, array in enumerate(inputs)
    ]


def _numbers(tape: Tape, scalars: Scalars) -> list[int]:
    return [number_of(tape, scalar) for scalar in scalars]
