"""Programs as plain JSON, so that what the cache keeps beside machine code can hold some."""

from typing import Any

from steelyard.kernel.program.program import Array, Program, Step


def program_to_json(program: Program) -> list[Any]:
    """Inputs, steps and outputs as lists."""
    return [
        [[a.name, a.entries, a.shared] for a in program.inputs],
        [
            [s.operation, s.value if s.operation == "constant" else s.arguments]
            for s in program.steps
        ],
        list(program.outputs),
    ]


def program_from_json(values: list[Any]) -> Program:
    """The program that `program_to_json` wrote."""
    inputs, steps, outputs = values
    return Program(
        tuple(Array(*x) for x in inputs),
        tuple(
            Step(name, value=rest) if name == "constant" else Step(name, tuple(rest))
            for name, rest in steps
        ),
        tuple(outputs),
    )
