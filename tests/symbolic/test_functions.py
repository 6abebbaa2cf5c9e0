"""Elementary functions of the vector code against NumPy, and programs of many pieces."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.symbolic import program_and_softening as numpy_backend
from steelyard.symbolic.native.compiled_programs import compiled
from steelyard.symbolic.native.llvm_vector_code import CHUNK
from steelyard.symbolic.program_and_softening import InputArray, Program, Step
from steelyard.symbolic.symbols_and_tracing import symbolic

WIDE = np.concatenate(
    [[0.0, -0.0], *(s * np.logspace(-9, e, 4001) for s in (1, -1) for e in (0, 2, 5))]
)
RANGES: dict[str, np.ndarray] = {
    "sin": WIDE,
    "cos": WIDE,
    "atan": WIDE,
    "abs": WIDE,
    "sign": WIDE,
    "neg": WIDE,
    "tanh": WIDE,
    "sqrt": np.abs(WIDE),
    "exp": np.linspace(-740.0, 705.0, 20011),
}


def unary(operation: str) -> Program:
    return Program((InputArray("x", 1),), (Step("input", (0, 0)), Step(operation, (0,))), (1,))


@pytest.mark.parametrize("operation", list(RANGES))
def test_unary_functions(operation: str) -> None:
    x = RANGES[operation]
    code = compiled(["test", operation], lambda: (unary(operation), {}))
    got, wanted = code([x[None]])[0], numpy_backend.run(unary(operation), [x[None]])[0]
    if operation in ("sin", "cos"):
        assert np.abs(got - wanted).max() < 1e-15
    else:
        relative = np.abs(got - wanted) / np.maximum(np.abs(wanted), 1e-300)
        assert relative.max() < 1e-15


@pytest.mark.parametrize(
    "operation", ["add", "sub", "mul", "div", "less", "less_equal", "minimum", "maximum"]
)
def test_binary_functions(operation: str) -> None:
    steps = (Step("input", (0, 0)), Step("input", (0, 1)), Step(operation, (0, 1)))
    program = Program((InputArray("x", 2),), steps, (2,))
    x = np.random.default_rng(0).choice([-1.5, -1.0, 0.5, 1.0, 2.0], (2, 103))
    code = compiled(["test", operation], lambda: (program, {}))
    assert np.array_equal(code([x]), numpy_backend.run(program, [x]))


@pytest.mark.parametrize(
    "build",
    [
        lambda x: [np.tanh(x[0]) * np.exp(x[1]) + np.arctan(x[0] / x[1])],
        lambda x: [np.sqrt(abs(x[0])), np.sign(x[1]) * (abs(x[1]) > 0.3)],
        lambda x: [x[0] ** 2 + 2.0 * x[1], 1.0 / x[1], x[0]],
    ],
)
def test_traced_expressions(build: Callable[..., list[Any]]) -> None:
    program = symbolic(build, [InputArray("x", 2)])
    x = np.random.default_rng(1).normal(size=(2, 50))
    wanted = [np.broadcast_to(w, (50,)) for w in build(x)]
    assert np.abs(numpy_backend.run(program, [x]) - wanted).max() < 1e-14


def test_unknown_operations_are_refused() -> None:
    with pytest.raises(NotImplementedError, match="programs do not know NumPy.s .arcsin."):
        symbolic(lambda x: [np.arcsin(x[0])], [InputArray("x", 1)])


def test_long_programs_are_cut_into_pieces() -> None:
    data = os.environ.get("STEELYARD_DATA")
    if not data:
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    models = Path(data).parent / "models" / "simple_humanoid_description" / "urdf"
    model = Model(load_robot(models / "simple_humanoid.urdf").robot, (RigidBody(),))
    n, p = model.robot.n, len(model.names)
    code = model.torque_code
    assert code.about["n_operations"] > 2 * CHUNK
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, n, 5))
    values = rng.normal(size=p)
    from oracles import pinocchio_regressor

    none = np.empty((0, 5))
    got = code([q, dq, ddq, none, values])
    for k in range(5):
        wanted = pinocchio_regressor(model.robot, q[:, k], dq[:, k], ddq[:, k]) @ values
        assert np.abs(got[:, k] - wanted).max() < 1e-10 * np.abs(wanted).max()
