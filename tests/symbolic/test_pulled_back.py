"""The reverse derivative of programs against central differences, for all operations."""

import numpy as np
import pytest

from steelyard.base.arrays import Array as Values
from steelyard.symbolic.native.compiled_programs import compiled
from steelyard.symbolic.program_and_softening import NUMPY, InputArray, Program, Step, run
from steelyard.symbolic.symbols_and_tracing import pulled_back

KINKED = ("abs", "sign", "less", "less_equal", "minimum", "maximum")
INPUTS = (InputArray("x", 3), InputArray("y", 2), InputArray("w", 2, shared=True))
FAR = 0.02
"""How far from a kink a sample is kept."""

UNARY, BINARY = ([x for x, f in NUMPY.items() if f.nin == n] for n in (1, 2))


class Draft:
    """A random program that is defined everywhere, and how far its kinks are."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.steps: list[Step] = []
        self.kinks: list[int] = []
        for array, given in enumerate(INPUTS):
            for entry in range(given.entries):
                self.push("input", array, entry)
        self.push("constant", value=float(self.random.normal()))

    def push(self, operation: str, *arguments: int, value: float = 0.0) -> int:
        self.steps.append(Step(operation, arguments, value))
        return len(self.steps) - 1

    def positive(self, number: int) -> int:
        half = self.push("constant", value=0.5)
        return self.push("add", half, self.push("mul", number, number))

    def grow(self, operation: str) -> None:
        """One more step with random arguments, mostly the newest."""
        last = len(self.steps)
        a, b = (int(k) for k in last - 1 - self.random.geometric(0.15, 2).clip(1, last) + 1)
        if operation in ("sqrt", "exp", "mul", "div"):
            a = self.push("tanh", a)
        if operation == "sqrt":
            a = self.positive(a)
        if operation == "div":
            b = self.positive(b)
        if operation in KINKED:
            self.kinks.append(self.push("sub", a, b) if operation in BINARY else a)
        self.push(operation, *((a, b) if operation in BINARY else (a,)))

    def program(self, outputs: list[int]) -> Program:
        return Program(INPUTS, tuple(self.steps), tuple(outputs))


def drafted(seed: int) -> tuple[Program, list[Values]]:
    """A program with every operation, and inputs at which none is near a kink."""
    draft = Draft(seed)
    for operation in draft.random.permutation([*UNARY, *BINARY, *UNARY, *BINARY]):
        draft.grow(str(operation))
    ends = [int(k) for k in draft.random.choice(len(draft.steps), 5)]
    outputs = [*ends, len(draft.steps) - 1, ends[0], 5]
    x, y = draft.random.normal(size=(3, 9000)), draft.random.normal(size=(2, 9000))
    shared = draft.random.normal(size=2)
    distance = np.abs(run(draft.program(draft.kinks), [x, y, shared]))
    never = np.ptp(distance, axis=1, keepdims=True) == 0.0
    far = np.flatnonzero(((distance > FAR) | never).all(axis=0))[:20]
    if len(far) < 5:
        return drafted(seed + 1000)
    return draft.program(outputs), [x[:, far], y[:, far], shared]


def differences(program: Program, inputs: list[Values], seeds: Values, array: int) -> Values:
    """Fourth-order central differences of the seeded sum by one input array."""

    def total(entry: int, step: float) -> Values:
        moved = [x.copy() for x in inputs]
        moved[array][entry] += step
        return np.asarray(np.sum(seeds * run(program, moved), axis=0))

    h = 1e-3

    def slope(entry: int, step: float) -> Values:
        return (total(entry, step) - total(entry, -step)) / (2.0 * step)

    entries = range(INPUTS[array].entries)
    return np.array([(4.0 * slope(k, h / 2.0) - slope(k, h)) / 3.0 for k in entries])


@pytest.mark.parametrize("seed", range(25))
def test_random_programs(seed: int) -> None:
    program, inputs = drafted(seed)
    count = inputs[0].shape[1]
    assert {s.operation for s in program.steps} >= {*UNARY, *BINARY}
    seeds = np.random.default_rng(seed).normal(size=(len(program.outputs), count))
    back = pulled_back(program, (1, 0, 2))
    assert back.inputs == (*program.inputs, InputArray("seeds", len(program.outputs)))
    found = run(back, [*inputs, seeds])
    assert found.shape == (7, count)
    expected = np.vstack([differences(program, inputs, seeds, array) for array in (1, 0, 2)])
    size = np.abs(expected).max()
    assert size > 1e-3
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * size)


@pytest.mark.parametrize("operation", [*UNARY, *BINARY])
def test_each_operation_alone(operation: str) -> None:
    arguments = (0, 1) if operation in BINARY else (0,)
    steps = (Step("input", (0, 0)), Step("input", (0, 1)), Step(operation, arguments))
    program = Program((InputArray("x", 2),), steps, (2,))
    x = np.array([[0.3, 1.7, 0.2], [0.7, 0.4, 1.1]])
    found = run(pulled_back(program, (0,)), [x, np.ones((1, 3))])
    expected = np.empty((2, 3))
    h = 1e-6
    for k, step in enumerate(h * np.eye(2)):
        up, down = (run(program, [x + side * step[:, None]])[0] for side in (1, -1))
        expected[k] = (up - down) / (2.0 * h)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)


def test_what_depends_on_nothing_has_no_slope() -> None:
    steps = (Step("input", (0, 0)), Step("constant", (), 3.0), Step("sign", (0,)))
    program = Program((InputArray("x", 2), InputArray("y", 1)), steps, (1, 2, 1))
    found = run(
        pulled_back(program, (0, 1)), [np.ones((2, 4)), np.ones((1, 4)), np.full((3, 4), 7.0)]
    )
    np.testing.assert_array_equal(found, np.zeros((3, 4)))


def test_machine_code_says_the_same() -> None:
    program, inputs = drafted(100)
    back = pulled_back(program, (0, 1))
    code = compiled(["test of a program pulled back"], lambda: (back, {}))
    seeds = np.random.default_rng(0).normal(size=(len(program.outputs), inputs[0].shape[1]))
    found = code([*inputs, seeds])
    np.testing.assert_allclose(found, run(back, [*inputs, seeds]), rtol=1e-12, atol=1e-12)
