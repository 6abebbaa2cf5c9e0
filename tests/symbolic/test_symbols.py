"""Tracing over symbols: what is shortened, what NumPy's functions make of symbols, derivatives."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from invented import tree
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.model.model import Model
from steelyard.symbolic.program_and_softening import InputArray, Program, Step, run
from steelyard.symbolic.symbols_and_tracing import affine, carried_along, slopes_of, symbolic
from steelyard.symbolic.tape_and_derivatives import Tape

X = np.random.default_rng(2).normal(size=(3, 40))


def traced(build: Callable[[Any], Any]) -> Program:
    return symbolic(lambda x: [build(x)], [InputArray("x", 3)])


@pytest.mark.parametrize(
    ("build", "operations"),
    [
        (lambda x: 0.0 * x[0] + x[1], 0),
        (lambda x: x[0] - x[0], 0),
        (lambda x: np.negative(-x[0]), 0),
        (lambda x: (x[0] + x[1]) - x[1], 0),
        (lambda x: (x[0] - x[1]) + x[1], 0),
        (lambda x: (x[0] / x[1]) * x[1], 0),
        (lambda x: np.cos(np.float64(0.0)) * x[0], 0),
        (lambda x: x[0] + -1.0 * x[1], 1),
        (lambda x: -x[0] - x[1] * -x[2], 2),
        (lambda x: x[0] * x[1] + x[1] * x[0], 2),
        (lambda x: (x[0] - x[1]) * (x[1] - x[0]), 3),
        (lambda x: np.sin(x[0]) * np.sin(x[0]), 2),
    ],
)
def test_programs_are_short(build: Callable[[Any], Any], operations: int) -> None:
    program = traced(build)
    assert program.n_operations == operations
    np.testing.assert_allclose(run(program, [X])[0], build(X), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "build",
    [
        lambda x: np.sign(x[0]) * (x[1] > 0.2) + (x[1] >= 0.3) - (0.1 > x[2]),
        lambda x: np.maximum(x[0], 0.1) - np.minimum(x[1], np.float64(0.2)),
        lambda x: np.tanh(x[0]) + np.arctan(x[1]) * np.exp(-np.square(x[2])),
        lambda x: np.sqrt(np.abs(x[0])) / (1.0 + x[1] ** 2) - 3.0 / (2.0 - np.cos(x[2])),
        lambda x: (np.float64(2.0) * x[0] - np.float64(1.0)) * x[1],
    ],
)
def test_functions_of_numpy(build: Callable[[Any], Any]) -> None:
    np.testing.assert_allclose(run(traced(build), [X])[0], build(X), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    "build",
    [
        lambda x: x[0] if x[0] > 0.0 else -x[0],
        lambda x: max(x[0], 0.0),
        lambda x: np.where(np.array(x) > 0.0, 1.0, -1.0)[0],
        lambda x: 1.0 if x[0] == 0.0 else x[0],
        lambda x: x[0] ** 0,
        lambda x: x[0] ** -1,
        lambda x: x[0] ** 0.5,
    ],
)
def test_what_programs_do_not_know_is_refused(build: Callable[[Any], Any]) -> None:
    with pytest.raises(NotImplementedError, match="program"):
        traced(build)


def test_constants_have_a_truth() -> None:
    program = traced(lambda x: x[1] if 0.0 * x[0] + 1.0 > 0.0 else x[2])
    np.testing.assert_array_equal(run(program, [X])[0], X[1])


def test_arrays_of_symbols() -> None:
    weights = np.array([1.0, -2.0, 0.5])

    def build(x: Any) -> Any:
        vector = np.array(list(x), dtype=object)
        return (np.sin(vector) * x[0]) @ weights + (x[1] * vector)[2]

    assert np.allclose(run(traced(build), [X])[0], weights @ np.sin(X) * X[0] + X[1] * X[2])


def test_constants_are_outputs_too() -> None:
    program = symbolic(lambda x: [0.0, x[0], 2.5], [InputArray("x", 1)])
    assert run(program, [X[:1]]).T.tolist() == [[0.0, x, 2.5] for x in X[0]]


def smooth(x: Any) -> list[Any]:
    return [np.sin(x[0]) * x[1] / (2.0 + x[2] * x[2]), np.tanh(x[1]) - x[0], x[2]]


def slopes(x: np.ndarray) -> np.ndarray:
    """Derivatives by complex steps, `[output][variable]`."""
    steps = 1e-30j * np.eye(3)[:, :, None]
    return np.array([np.broadcast_to(smooth(x + s), x.shape) for s in steps]).imag / 1e-30


def test_derivatives() -> None:
    wanted = slopes(X)
    program = symbolic(lambda x: slopes_of(smooth(x), x), [InputArray("x", 3)])
    found = run(program, [X]).reshape(3, 3, -1)
    np.testing.assert_allclose(found, wanted.swapaxes(0, 1), rtol=1e-12, atol=1e-14)
    rates = symbolic(
        lambda x, v: carried_along(smooth(x), x, v), [InputArray("x", 3), InputArray("v", 3)]
    )
    speeds = X[:, ::-1].copy()
    along = np.einsum("vok,vk->ok", wanted, speeds)
    np.testing.assert_allclose(run(rates, [X, speeds]), along, rtol=1e-12, atol=1e-14)


def test_slopes_and_rest_of_what_is_linear() -> None:
    def build(x: Any) -> list[Any]:
        found, rest = affine(lambda y: [x[0] * y[0] - y[1] + x[1], np.cos(x[2])], 2)
        return [entry for row in found for entry in row] + rest

    wanted = [X[0], np.full(40, -1.0), np.zeros(40), np.zeros(40), X[1], np.cos(X[2])]
    assert np.allclose(run(symbolic(build, [InputArray("x", 3)]), [X]), wanted)


def test_steps_that_no_output_needs_are_left_out() -> None:
    steps = (
        Step("input", (0, 1)),
        Step("constant", (), 2.0),
        Step("input", (0, 0)),
        Step("mul", (0, 1)),
        Step("add", (2, 1)),
    )
    short = Program((InputArray("x", 3),), steps, (4, 4)).pruned()
    assert short.steps == (steps[1], steps[2], Step("add", (1, 0)))
    assert short.outputs == (2, 2)


def test_a_cold_start_traces_columns_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    begin = Tape.__init__
    monkeypatch.setenv("STEELYARD_CACHE", "")
    monkeypatch.setattr(Tape, "__init__", lambda tape: calls.append(tape) or begin(tape))
    base_regressor(Model(tree()))
    assert len(calls) == 1


def test_tracing_is_deterministic() -> None:
    assert Model(tree()).columns_program == Model(tree()).columns_program
