"""Trace equations over symbols into a `Program`, with their derivatives."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from steelyard.model.equations.inverse_dynamics import JointState, Scalar, inverse_dynamics
from steelyard.robot.robot import Robot
from steelyard.symbolic.program import InputArray, Program
from steelyard.symbolic.symbols import Symbol, number_of
from steelyard.symbolic.tape import Tape, backward, edges, forward

Entries = Mapping[tuple[int, int], Scalar]


def symbolic(build: Callable[..., Sequence[Scalar]], inputs: Sequence[InputArray]) -> Program:
    """Trace `build`, called with one list of scalar symbols per input array."""
    with Tape().recording() as tape:
        outputs = build(*_symbols(tape, inputs))
        return tape.program(inputs, _numbers(tape, outputs))


def rigid_columns(robot: Robot, state: JointState) -> Entries:
    """Regressor of all bodies, `(row, 10 * body + number)` to symbol.

    The reverse-mode derivative of the inverse dynamics with respect to the ten numbers of every
    body; entries that are zero by structure, as those of frames without mass, are left out.
    """
    tape = Tape.current()
    numbers = [tape.variable() for _ in range(10 * len(robot.bodies))]
    flat: list[Scalar] = [Symbol(tape, number) for number in numbers]
    tens = [
        [0.0] * 10 if body.massless else flat[10 * k : 10 * k + 10]
        for k, body in enumerate(robot.bodies)
    ]
    efforts = _numbers(tape, inverse_dynamics(robot, state, tens))
    between, one = edges(tape, numbers), tape.constant(1.0)
    entries: dict[tuple[int, int], Scalar] = {}
    for row, effort in enumerate(efforts):
        slopes = backward(tape, between, {effort: one})
        for column, number in enumerate(numbers):
            if number in slopes and tape.known.get(slopes[number]) != 0.0:
                entries[row, column] = Symbol(tape, slopes[number])
    return entries


def affine(
    build: Callable[[Sequence[Scalar]], Sequence[Scalar]], n: int
) -> tuple[list[list[Scalar]], list[Scalar]]:
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


def carried_along(
    values: Sequence[Scalar], variables: Sequence[Scalar], speeds: Sequence[Scalar]
) -> list[Scalar]:
    """How fast expressions change while their variables change at given speeds."""
    tape = Tape.current()
    moving = _numbers(tape, variables)
    rates = dict(zip(moving, _numbers(tape, speeds), strict=True))
    found = forward(tape, edges(tape, moving), rates)
    zero = tape.constant(0.0)
    return [Symbol(tape, found.get(number, zero)) for number in _numbers(tape, values)]


def slopes_of(values: Sequence[Scalar], variables: Sequence[Scalar]) -> list[Scalar]:
    """Derivatives of expressions by variables, value by value."""
    tape = Tape.current()
    by, zero, one = _numbers(tape, variables), tape.constant(0.0), tape.constant(1.0)
    between = edges(tape, by)
    found: list[Scalar] = []
    for number in _numbers(tape, values):
        slopes = backward(tape, between, {number: one})
        found += [Symbol(tape, slopes.get(variable, zero)) for variable in by]
    return found


def replayed(program: Program, symbols: Sequence[Sequence[Scalar]]) -> list[Any]:
    """A program's outputs as expressions over symbols, one list of them per input array."""
    tape = Tape.current()
    values: list[int] = []
    for step in program.steps:
        if step.operation == "constant":
            values.append(tape.constant(step.value))
        elif step.operation == "input":
            array, entry = step.arguments
            values.append(number_of(tape, symbols[array][entry]))
        else:
            values.append(tape.apply(step.operation, *(values[k] for k in step.arguments)))
    return [Symbol(tape, values[k]) for k in program.outputs]


def _symbols(tape: Tape, inputs: Sequence[InputArray]) -> list[list[Symbol]]:
    """One list per input array."""
    return [
        [Symbol(tape, tape.written("input", k, entry)) for entry in range(array.entries)]
        for k, array in enumerate(inputs)
    ]


def _numbers(tape: Tape, scalars: Sequence[Scalar]) -> list[int]:
    return [number_of(tape, scalar) for scalar in scalars]
