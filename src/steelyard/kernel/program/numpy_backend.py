"""Run a program with NumPy: the reference that every other backend must agree with."""

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.kernel.program.program import Program

_OPERATIONS: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "tanh": np.tanh,
    "atan": np.arctan,
    "less": lambda a, b: np.less(a, b).astype(np.float64),
    "less_equal": lambda a, b: np.less_equal(a, b).astype(np.float64),
    "minimum": np.minimum,
    "maximum": np.maximum,
}


def run(program: Program, inputs: Sequence[Array]) -> Array:
    """Evaluate a program.

    Args:
        program: The program.
        inputs: One array per input: `(entries, N)`, or `(entries,)` where all samples share it.

    Returns:
        Shape `(len(program.outputs), N)`.
    """
    n_samples = next(
        x.shape[1] for x, a in zip(inputs, program.inputs, strict=True) if not a.shared
    )
    values: list[Array] = []
    for step in program.steps:
        if step.operation == "constant":
            values.append(np.float64(step.value))  # type: ignore[arg-type]
        elif step.operation == "input":
            values.append(inputs[step.arguments[0]][step.arguments[1]])
        else:
            values.append(_OPERATIONS[step.operation](*(values[a] for a in step.arguments)))
    result = np.empty((len(program.outputs), n_samples))
    for row, number in enumerate(program.outputs):
        result[row] = values[number]
    return result
