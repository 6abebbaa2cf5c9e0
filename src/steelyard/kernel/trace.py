"""Trace equations over CasADi symbols into a `Program`.

The only file of the package that imports CasADi; a kernel found in the cache never comes here.
"""

import operator
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from steelyard.kernel.dynamics import JointState, Scalar, inverse_dynamics
from steelyard.kernel.program import BINARY, Array, Program, Step
from steelyard.robot.robot import Robot

Entries = Mapping[tuple[int, int], Scalar]
_LOCK = threading.Lock()


def symbolic(build: Callable[..., Sequence[Scalar]], inputs: Sequence[Array]) -> Program:
    """Trace `build`, called with one list of scalar symbols per input array.

    Raises:
        NotImplementedError: The equations use an operation that no backend knows.
    """
    casadi = _casadi()
    with _LOCK:
        symbols = [casadi.SX.sym(array.name, array.entries) for array in inputs]
        lists = [[s[k] for k in range(a.entries)] for s, a in zip(symbols, inputs, strict=True)]
        outputs = casadi.vertcat(*build(*lists))
        function = casadi.Function("f", symbols, casadi.cse([outputs]))
        return _single_assignment(function, tuple(inputs))


def rigid_columns(robot: Robot, state: JointState) -> Entries:
    """Regressor of all bodies, `(row, 10 * body + number)` to symbol.

    The reverse-mode derivative of the inverse dynamics with respect to the ten numbers of every
    body; entries that are zero by structure, as those of frames without mass, are left out.
    """
    casadi = _casadi()
    count = 10 * len(robot.bodies)
    numbers = casadi.SX.sym("phi", count)
    tens: list[list[Scalar]] = [
        [0.0] * 10 if body.massless else [numbers[10 * k + i] for i in range(10)]
        for k, body in enumerate(robot.bodies)
    ]
    entries: dict[tuple[int, int], Scalar] = {}
    for row, effort in enumerate(inverse_dynamics(robot, state, tens)):
        gradient = casadi.gradient(effort, numbers)
        for column in range(count):
            if not gradient[column].is_zero():
                entries[row, column] = gradient[column]
    return entries


def affine(
    build: Callable[[Sequence[Scalar]], Sequence[Scalar]], n: int
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Slopes, rows of `n`, and values at zero of expressions that are linear in `n` variables."""
    casadi = _casadi()
    x = casadi.SX.sym("x", n)
    values = casadi.vertcat(*build([x[k] for k in range(n)]))
    slopes = casadi.densify(casadi.jacobian(values, x))
    rest = casadi.densify(casadi.substitute(values, x, casadi.SX.zeros(n)))
    rows = range(values.numel())
    return [[slopes[row, k] for k in range(n)] for row in rows], [rest[row] for row in rows]


def pulled_back(program: Program, arrays: Sequence[int]) -> Program:
    r"""The reverse derivative of a program, $\sum_k s_k \, \partial y_k / \partial x$.

    Args:
        program: Inputs $x$, outputs $y$.
        arrays: Numbers of the input arrays by whose entries it is differentiated.

    Returns:
        Inputs as the program's, and the seeds $s$, one per output; outputs are the derivatives,
        array by array.
    """
    casadi = _casadi()
    with _LOCK:
        symbols = [casadi.SX.sym(array.name, array.entries) for array in program.inputs]
        seeds = casadi.SX.sym("seeds", len(program.outputs))
        outputs = casadi.vertcat(*replayed(program, symbols))
        by = casadi.vertcat(*(symbols[k] for k in arrays))
        slopes = casadi.densify(casadi.gradient(casadi.dot(seeds, outputs), by))
        function = casadi.Function("f", [*symbols, seeds], casadi.cse([slopes]))
        return _single_assignment(function, (*program.inputs, Array("seeds", seeds.numel())))


def carried_along(
    values: Sequence[Scalar], variables: Sequence[Scalar], speeds: Sequence[Scalar]
) -> list[Scalar]:
    """How fast expressions change while their variables change at given speeds."""
    casadi = _casadi()
    rates = casadi.jtimes(*(casadi.vertcat(*x) for x in (values, variables, speeds)))
    return list(casadi.vertsplit(casadi.densify(rates)))


def slopes_of(values: Sequence[Scalar], variables: Sequence[Scalar]) -> list[Scalar]:
    """Derivatives of expressions by variables, value by value."""
    casadi = _casadi()
    slopes = casadi.jacobian(casadi.vertcat(*values), casadi.vertcat(*variables))
    return list(casadi.vertsplit(casadi.vec(casadi.densify(slopes.T))))


def is_zero(scalar: Scalar) -> bool:
    """Whether an expression is zero by structure."""
    return bool(_casadi().SX(scalar).is_zero())


def replayed(program: Program, symbols: Sequence[Any]) -> list[Scalar]:
    """A program's outputs as expressions over symbols, one vector of them per input array."""
    casadi = _casadi()
    named: dict[str, Callable[..., Scalar]] = {
        "add": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "div": operator.truediv,
        "neg": operator.neg,
        "abs": casadi.fabs,
        "less": casadi.lt,
        "less_equal": casadi.le,
        "minimum": casadi.fmin,
        "maximum": casadi.fmax,
    }
    values: list[Scalar] = []
    for step in program.steps:
        if step.operation == "constant":
            values.append(casadi.SX(step.value))
        elif step.operation == "input":
            array, entry = step.arguments
            values.append(symbols[array][entry])
        else:
            operation = named.get(step.operation) or getattr(casadi, step.operation)
            values.append(operation(*(values[k] for k in step.arguments)))
    return [values[k] for k in program.outputs]


def _casadi() -> Any:
    import casadi

    casadi.GlobalOptions.setNumpyMode(1)
    return casadi


def _single_assignment(function: Any, inputs: tuple[Array, ...]) -> Program:
    """CasADi's instruction list reuses work slots; give every assignment its own number."""
    operations = _operations()
    steps: list[Step] = []
    slot: dict[int, int] = {}
    outputs = [-1] * int(function.nnz_out())

    def push(operation: str, *arguments: int, value: float = 0.0) -> int:
        steps.append(Step(operation, arguments, value))
        return len(steps) - 1

    casadi = _casadi()
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        if code == casadi.OP_OUTPUT:
            outputs[function.instruction_output(k)[1]] = slot[function.instruction_input(k)[0]]
            continue
        target = function.instruction_output(k)[0]
        if code == casadi.OP_CONST:
            slot[target] = push("constant", value=float(function.instruction_constant(k)))
        elif code == casadi.OP_INPUT:
            slot[target] = push("input", *function.instruction_input(k))
        elif code not in operations:
            raise NotImplementedError(f"CasADi operation number {code}")
        else:
            arguments = [slot[x] for x in function.instruction_input(k)]
            slot[target] = operations[code](push, *arguments)
    if not function.sparsity_out(0).is_dense():
        raise NotImplementedError("an output is zero by structure")
    return Program(inputs, tuple(steps), tuple(outputs))


def _operations() -> dict[int, Callable[..., int]]:
    """How each CasADi operation is written with ours."""
    casadi = _casadi()

    def plain(name: str) -> Callable[..., int]:
        return lambda push, *arguments: push(name, *arguments[: 2 if name in BINARY else 1])

    return {
        casadi.OP_ADD: plain("add"),
        casadi.OP_SUB: plain("sub"),
        casadi.OP_MUL: plain("mul"),
        casadi.OP_DIV: plain("div"),
        casadi.OP_NEG: plain("neg"),
        casadi.OP_SIN: plain("sin"),
        casadi.OP_COS: plain("cos"),
        casadi.OP_SQRT: plain("sqrt"),
        casadi.OP_FABS: plain("abs"),
        casadi.OP_SIGN: plain("sign"),
        casadi.OP_EXP: plain("exp"),
        casadi.OP_TANH: plain("tanh"),
        casadi.OP_ATAN: plain("atan"),
        casadi.OP_LT: plain("less"),
        casadi.OP_LE: plain("less_equal"),
        casadi.OP_FMIN: plain("minimum"),
        casadi.OP_FMAX: plain("maximum"),
        casadi.OP_SQ: lambda push, a, *_: push("mul", a, a),
        casadi.OP_TWICE: lambda push, a, *_: push("add", a, a),
        casadi.OP_INV: lambda push, a, *_: push("div", push("constant", value=1.0), a),
        casadi.OP_ASSIGN: lambda push, a, *_: a,
        casadi.OP_IF_ELSE_ZERO: lambda push, a, b: push("mul", a, b),
    }
