"""Bounds over boxes hold what NumPy computes inside them."""

import json
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from invented import tree
from steelyard.base.arrays import Array
from steelyard.symbolic.interval_bounds import CHUNK, enclosed
from steelyard.symbolic.program_and_softening import (
    NUMPY,
    Program,
    Step,
    program_from_json,
    program_to_json,
    run,
)
from steelyard.symbolic.program_and_softening import InputArray as Input

INPUTS = (Input("x", 3), Input("p", 2, shared=True))


def program_of(*steps: Step, outputs: Sequence[int] = (-1,)) -> Program:
    """Inputs x0, x1, x2, p0, p1, and then the steps."""
    given = [Step("input", (0, k)) for k in range(3)] + [Step("input", (1, k)) for k in range(2)]
    full = (*given, *steps)
    return Program(INPUTS, full, tuple(len(full) + k if k < 0 else k for k in outputs))


def drawn_program(rng: np.random.Generator) -> Program:
    """Some steps; exp and div on what cannot be out of their depth, for the comparison's sake."""
    steps: list[Step] = [Step("constant", value=float(rng.choice([0.0, 1.0, -1.0, 0.3, -2.5])))]
    for _ in range(rng.integers(1, 12)):
        count = 5 + len(steps)
        name = str(rng.choice([*NUMPY]))
        arguments = rng.integers(0, count, NUMPY[name].nin)
        if name in ("exp", "sqrt"):
            steps.append(Step({"exp": "tanh", "sqrt": "abs"}[name], (int(arguments[0]),)))
            arguments = np.array([count])
        steps.append(Step(name, tuple(int(a) for a in arguments)))
    return program_of(*steps, outputs=range(5, 5 + len(steps)))


def over(program: Program, low: Array, high: Array, p: Array | None = None) -> tuple[Array, Array]:
    """Bounds with exact shared inputs."""
    shared = np.array([0.7, -1.3]) if p is None else p
    return enclosed(program, [low, shared], [high, shared])


@given(seed=st.integers(0, 2**32 - 1), width=st.sampled_from([0.0, 1e-9, 0.1, 2.0, 30.0]))
@example(seed=117145, width=0.0)
@settings(max_examples=150, deadline=None)
def test_points_lie_inside(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    program = drawn_program(rng)
    middle = np.round(rng.normal(size=(3, 7)) * 3.0, int(rng.integers(0, 4)))
    low, high = middle - width, middle + width
    least, most = over(program, low, high)
    assert not np.isnan([least, most]).any() and np.all(least <= most)
    for _ in range(20):
        share = np.round(rng.uniform(size=(3, 7)), int(rng.integers(0, 5)))
        x = np.clip(low + (high - low) * share, low, high)
        with np.errstate(all="ignore"):
            values = run(program, [x, np.array([0.7, -1.3])])
        # a comparison hides what is no number; nothing after that is known
        known = np.logical_and.accumulate(np.isfinite(values), axis=0)
        assert np.all((values >= least)[known]) and np.all((values <= most)[known])


def box(*bounds: tuple[float, float]) -> tuple[Array, Array]:
    """One box of x."""
    full = (*bounds, *[(0.0, 0.0)] * (3 - len(bounds)))
    low, high = np.array(full).T
    return low[:, None], high[:, None]


@pytest.mark.parametrize(
    ("operation", "bounds", "least", "most"),
    [
        ("sin", [(0.0, 3.2)], np.sin(3.2), 1.0),
        ("sin", [(4.0, 5.0)], -1.0, np.sin(4.0)),
        ("sin", [(101.0, 101.2)], np.sin(101.0), np.sin(101.2)),
        ("cos", [(-0.1, 0.2)], np.cos(0.2), 1.0),
        ("cos", [(3.0, 10.0)], -1.0, 1.0),
        ("abs", [(-3.0, 2.0)], 0.0, 3.0),
        ("sqrt", [(-1.0, 4.0)], 0.0, 2.0),
        ("sqrt", [(-2.0, -1.0)], -np.inf, np.inf),
        ("sign", [(-1.0, 0.0)], -1.0, 0.0),
        ("less", [(0.0, 1.0), (1.0, 2.0)], 0.0, 1.0),
        ("less", [(0.0, 0.5), (1.0, 2.0)], 1.0, 1.0),
        ("less", [(1.0, 3.0), (0.0, 1.0)], 0.0, 0.0),
        ("less_equal", [(0.0, 1.0), (1.0, 2.0)], 1.0, 1.0),
        ("minimum", [(0.0, 3.0), (1.0, 2.0)], 0.0, 2.0),
        ("maximum", [(0.0, 3.0), (1.0, 2.0)], 1.0, 3.0),
        ("mul", [(-1.0, 2.0), (-3.0, 1.0)], -6.0, 3.0),
        ("div", [(1.0, 2.0), (-4.0, -2.0)], -1.0, -0.25),
        ("div", [(1.0, 2.0), (-1.0, 2.0)], -np.inf, np.inf),
        ("div", [(0.0, 1.0), (0.0, 2.0)], -np.inf, np.inf),
        ("exp", [(0.0, 1e9)], 1.0, np.inf),
        ("tanh", [(-1e9, 0.5)], -1.0, np.tanh(0.5)),
    ],
)
def test_ranges_are_sharp(
    operation: str, bounds: list[tuple[float, float]], least: float, most: float
) -> None:
    program = program_of(Step(operation, tuple(range(len(bounds)))))
    low, high = over(program, *box(*bounds))
    np.testing.assert_allclose([low.item(), high.item()], [least, most], rtol=1e-13, atol=1e-13)
    assert low.item() <= least and high.item() >= most


def test_a_square_is_not_negative() -> None:
    program = program_of(Step("mul", (0, 0)))
    low, high = over(program, *box((-1.0, 2.0)))
    assert low.item() == 0.0 and high.item() == pytest.approx(4.0)


def test_zero_times_unbounded_is_zero_and_unbounded_less_itself_is_unbounded() -> None:
    quotient = Step("div", (0, 1))
    product, difference = Step("mul", (2, 5)), Step("sub", (5, 5))
    program = program_of(quotient, product, difference, outputs=(6, 7))
    low, high = over(program, *box((1.0, 1.0), (-1.0, 1.0)))
    np.testing.assert_allclose(low[:, 0], [0.0, -np.inf], atol=1e-200)
    np.testing.assert_allclose(high[:, 0], [0.0, np.inf], atol=1e-200)


def test_overflow_is_reported_as_unknown() -> None:
    steps = [Step("mul", (0, 0)), Step("mul", (5, 5)), Step("neg", (6,)), Step("add", (6, 7))]
    low, high = over(program_of(*steps), *box((1e100, 1e100)))
    assert low.item() == -np.inf and high.item() == np.inf


def test_shared_boxes_and_many_boxes() -> None:
    program = program_of(Step("mul", (0, 3)), Step("add", (5, 4)))
    x = np.random.default_rng(0).normal(size=(3, CHUNK + 9))
    least, most = np.array([-1.0, 2.0]), np.array([3.0, 2.0])
    low, high = enclosed(program, [x, least], [x, most])
    ends = np.stack([-x[0], 3.0 * x[0]]) + 2.0
    np.testing.assert_allclose(low[0], ends.min(axis=0), atol=1e-14)
    np.testing.assert_allclose(high[0], ends.max(axis=0), atol=1e-14)


def torque_program() -> Program:
    """Inverse dynamics of a branched robot with its own bodies."""
    from steelyard.model.equations.inverse_dynamics import JointState
    from steelyard.model.laws.laws_without_friction import RigidBody
    from steelyard.model.model import Model
    from steelyard.symbolic.symbols_and_tracing import symbolic

    model = Model(tree(), (RigidBody(),))
    values = tree().nominal.ravel()
    inputs = [Input(name, 4) for name in ("q", "dq", "ddq")]
    return symbolic(lambda *x: model.torque_of(JointState(*x), values), inputs)


def test_torque_of_a_hundred_thousand_states() -> None:
    program, rng = torque_program(), np.random.default_rng(3)
    middle = [rng.normal(size=(4, 5)) for _ in range(3)]
    low, high = [m - 0.1 for m in middle], [m + 0.1 for m in middle]
    least, most = enclosed(program, low, high)
    shifts = rng.uniform(-0.1, 0.1, (3, 4, 20000, 5))
    shifts[:, :, :500] = np.sign(shifts[:, :, :500]) * 0.1
    states = [(m[:, None] + s).reshape(4, -1) for m, s in zip(middle, shifts, strict=True)]
    values = run(program, states).reshape(-1, 20000, 5)
    assert np.all(values >= least[:, None]) and np.all(values <= most[:, None])
    seen = values.max(axis=1) - values.min(axis=1)
    assert np.median((most - least) / seen) < 6.0


def test_widths_shrink_with_the_box() -> None:
    program, rng = torque_program(), np.random.default_rng(4)
    middle = [rng.normal(size=(4, 3)) for _ in range(3)]
    widths = []
    for size in (1e-2, 1e-4, 1e-6):
        least, most = enclosed(program, [m - size for m in middle], [m + size for m in middle])
        widths.append((most - least) / size)
    np.testing.assert_allclose(widths[1], widths[2], rtol=0.02)
    np.testing.assert_allclose(widths[0], widths[2], rtol=1.0)


def test_programs_come_back_from_json() -> None:
    program = torque_program()
    assert program_from_json(json.loads(json.dumps(program_to_json(program)))) == program
