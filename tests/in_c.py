"""Exported C code, compiled and called."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Array, Parameters
from steelyard.export.code.c_code import CCode, self_test
from steelyard.export.code.controller_functions import USUAL_FUNCTIONS, Controller
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Robot
from steelyard.symbolic.source_code import Precision

STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
LIBM = {"sin", "cos", "sincos", "sqrt", "fabs", "exp", "tanh", "atan", "fmax"}
"""Functions of the mathematical library that exported code may need."""


def compiler(name: str = "gcc") -> str:
    """A compiler; skips without it."""
    if shutil.which(name) is None:
        pytest.skip(f"{name} is not installed")
    return name


def controller_on(
    robot: Robot,
    terms: Sequence[Term],
    names: Sequence[str] = USUAL_FUNCTIONS,
    frames: Sequence[str] = (),
    seed: int = 0,
) -> Controller:
    """A controller of the robot's nominal bodies with invented values of other parameters."""
    model, rng = Model(robot, tuple(terms)), np.random.default_rng(seed)
    values = rng.uniform(0.1, 1.0, len(model.parameters))
    start = 0
    for term in model.terms:
        count = len(term.parameters(robot))
        if term.role == "body":
            values[start : start + count] = robot.nominal.ravel()
        start += count
    known = Parameters(model.names, model.units, values)
    return Controller(model, known, tuple(names), tuple(frames))


def written(code: CCode, folder: Path) -> Path:
    """Header and source of a C export; the path of the source."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{code.name}.h").write_text(code.header())
    source = folder / f"{code.name}.c"
    source.write_text(code.source())
    return source


def run_compiler(*arguments: object) -> None:
    """A call that must succeed without a word."""
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr[:2000]


def self_tested(code: CCode, source: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """The self-test of a code with its source, compiled by a command and run."""
    program = source.with_suffix("")
    test = source.with_name(f"{source.stem}_test.c")
    test.write_text(self_test(code))
    run_compiler(*command, source, test, "-o", program, "-lm")
    return subprocess.run([str(program)], capture_output=True, text=True)


class Library:
    """Functions of compiled sources."""

    def __init__(self, sources: Sequence[Path], folder: Path, precision: Precision) -> None:
        file = folder / f"code_{precision}.so"
        flags = ("-std=c99", "-O0", "-fPIC", "-shared", *STRICT)
        run_compiler(compiler(), *flags, *sources, "-o", file, "-lm")
        self._library = ctypes.CDLL(str(file))
        self._type = np.float64 if precision == "double" else np.float32

    def call(self, name: str, arrays: Sequence[Array], sizes: Sequence[int]) -> Array:
        """Results of one call, one after another."""
        given = [np.ascontiguousarray(x, dtype=self._type) for x in arrays]
        found = [np.full(size, np.nan, dtype=self._type) for size in sizes]
        addresses = [ctypes.c_void_p(x.ctypes.data) for x in (*given, *found)]
        getattr(self._library, name)(*addresses)
        return np.concatenate(found).astype(np.float64)

    def along(self, name: str, memory: int, q: Array, dq: Array, ddq: Array) -> Array:
        """Efforts along samples of shape `(N, n)` by `start` and `step`.

        Args:
            name: Prefix of the functions.
            memory: Entries of the state.
            q: Positions.
            dq: Velocities.
            ddq: Accelerations.
        """
        state = np.zeros(memory, dtype=self._type)
        address = ctypes.c_void_p(state.ctypes.data)
        first = [np.ascontiguousarray(x[0], dtype=self._type) for x in (q, dq)]
        start, step = (getattr(self._library, f"{name}_{x}") for x in ("start", "step"))
        start(address, *(ctypes.c_void_p(x.ctypes.data) for x in first))
        found = np.empty(q.shape, dtype=self._type)
        rows = [np.ascontiguousarray(x, dtype=self._type) for x in (q, dq, ddq)]
        for k in range(len(q)):
            step(address, *(ctypes.c_void_p(x[k].ctypes.data) for x in (*rows, found)))
        return found.astype(np.float64)


def code_of(controller: Controller, precision: Precision = "double") -> CCode:
    """The code of a controller."""
    return CCode(controller, precision, ("From a test.",))


def apart(found: Array, wanted: Array) -> float:
    """Largest error relative to one plus the value's size."""
    return float((np.abs(found - wanted) / (1.0 + np.abs(wanted))).max())


def apart_in_sample(found: Array, wanted: Array) -> float:
    """Largest error relative to one plus the largest value of its sample, arrays `(N, entries)`.

    Single precision has seven digits: an effort in which large ones cancel has fewer.
    """
    largest = 1.0 + np.abs(wanted).max(axis=1, keepdims=True)
    return float((np.abs(found - wanted) / largest).max())
