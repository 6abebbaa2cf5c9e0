"""Operations and bytes of the UR10e's torque before and after a reduction.

Torque from base values: the regressor's columns that are left, each times its value. Counted are
arithmetic operations per sample, and bytes of the machine code for this processor; no time is
claimed.
"""

import tempfile
from pathlib import Path

from proofs.reduction.ur10e import ROBOT
from proofs.robots.scores import ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.model import Model
from steelyard.symbolic.native import compiler
from steelyard.symbolic.native.compiled_programs import _module
from steelyard.symbolic.program_and_softening import Program


def program_of(model: Model, names: tuple[str, ...]) -> tuple[Program, int]:
    """The columns of some base parameters, and multiplications and additions beside them."""
    program, places = model.columns_program
    wanted = {model.names.index(name) for name in names}
    mine = [
        output
        for (_row, column), output in zip(places, program.outputs, strict=True)
        if column in wanted
    ]
    return Program(program.inputs, program.steps, tuple(mine)).pruned(), 2 * len(mine)


def size_of(model: Model, names: tuple[str, ...]) -> tuple[int, int]:
    """Operations per sample, and bytes of machine code."""
    program, beside = program_of(model, names)
    code = compiler.compile_code(_module(program, compiler.lanes()))
    return program.n_operations + beside, len(code)


def main() -> list[Claim]:
    """The reduction of seven runs."""
    data_folder()
    with tempfile.TemporaryDirectory() as folder:
        full = steelyard.identify(ROBOT, ur10e_logs(), method="WLS", check=False)
        full.save(Path(folder) / "full")
        small = steelyard.reduce(Path(folder) / "full", ur10e_logs())
    model = full.model.model
    before = size_of(model, base_parameters(model).base_names)
    after = size_of(model, small.kept)
    return [
        Claim(
            f"{what}, {len(base_parameters(model))} to {len(small.kept)} parameters",
            f"{a} to {b} ({100.0 * b / a:.0f} %)",
            "fewer",
            b < a,
        )
        for what, a, b in zip(("operations", "bytes"), before, after, strict=True)
    ]


if __name__ == "__main__":
    main_of(main)
