"""The observer of exported code: external efforts and contact as in Python."""

import ctypes
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from closed_chains import five_bar
from in_c import STRICT, apart, compiler, run_compiler, self_tested, written
from invented import tree
from moving import geared
from steelyard.base.arrays import Array
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.export.code.c_code import CCode
from steelyard.export.code.controller_functions import Controller, ObserverNumbers
from steelyard.export.code.export_code import controller_of, write_code
from steelyard.export.code.python_code import python_code
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Robot
from steelyard.symbolic.source_code import Precision
from weighed import identified_of

BANDWIDTH = 8.0
CASES: dict[str, tuple[Callable[[], Robot], bool]] = {
    "tree": (tree, False),
    "geared": (geared, True),
    "five_bar": (five_bar, True),
}
"""Robots, and whether their friction remembers."""


def model_of(name: str) -> IdentifiedModel:
    make, remembers = CASES[name]
    terms = (*DEFAULT_TERMS, Dahl(length=2e-3)) if remembers else DEFAULT_TERMS
    return identified_of(make(), terms)


def thresholds_of(n: int) -> ContactThresholds:
    """Known thresholds of all ranges, none for the first joint."""
    limits = np.array([6.0, 9.0, 7.0, 8.0, 10.0]) * np.ones((n, 5))
    limits[0] = np.nan
    edges = np.tile([0.01, 0.1, 0.25], (n, 1))
    return ContactThresholds(
        edges, BANDWIDTH, 1.0, 60.0, limits, ((True,) * 5,) * n, np.full(n, np.nan)
    )


def controller(model: IdentifiedModel) -> Controller:
    found = controller_of(model, ["observer"])
    return replace(found, observer=ObserverNumbers(BANDWIDTH, thresholds_of(model.robot.n)))


def samples(robot: Robot, count: int, step: float = 0.002) -> tuple[Array, ...]:
    """Times with jitter and two gaps, positions that rest now and then, velocities, efforts."""
    rng = np.random.default_rng(4)
    t = np.cumsum(step * rng.uniform(0.8, 1.2, count))
    t[count // 3 :] += 0.5
    t[count // 2 :] += 0.1
    rates = 1.0 + 0.37 * np.arange(robot.n)
    moving = np.maximum(np.sin(0.9 * t), 0.0)[:, None]
    q = robot.assembly[: robot.n] + 0.1 * moving**2 * np.sin(t[:, None] * rates)
    dq = np.gradient(q, t, axis=0)
    tau = 5.0 * np.sin(0.7 * t[:, None] * rates) + rng.normal(size=q.shape)
    return t, q, dq, tau


def in_python(model: IdentifiedModel, given: tuple[Array, ...]) -> tuple[Array, Array]:
    """External efforts and contact of every sample."""
    observer = model.observe(thresholds=thresholds_of(model.robot.n))
    efforts, contact = [], []
    for sample in zip(*given, strict=True):
        observer.step(*sample)
        efforts.append(observer.torque)
        contact.append(observer.contact)
    return np.array(efforts), np.array(contact)


@cache
def observed(name: str) -> tuple[IdentifiedModel, tuple[Array, ...], Array, Array]:
    """A model, samples of 4 s in which all ranges of speed and rests are, and what Python finds."""
    model = model_of(name)
    given = samples(model.robot, 500, step=0.008)
    return model, given, *in_python(model, given)


def in_c(
    code: CCode, folder: Path, precision: Precision, given: tuple[Array, ...]
) -> tuple[Array, Array, list[int]]:
    """The same of compiled code, and what every step returns."""
    file = folder / "observer.so"
    flags = ("-std=c99", "-O0", "-fPIC", "-shared", *STRICT)
    run_compiler(compiler(), *flags, written(code, folder), "-o", file, "-lm")
    library = ctypes.CDLL(str(file))
    number = np.float64 if precision == "double" else np.float32
    start, step, contact = (
        getattr(library, f"{code.name}_observer_{x}") for x in ("start", "step", "contact")
    )
    state = ctypes.create_string_buffer(1 << 14)
    start(state, ctypes.c_double(BANDWIDTH))
    t, *arrays = given
    rows = [np.ascontiguousarray(x, dtype=number) for x in arrays]
    found = np.zeros(rows[0].shape, dtype=number)
    joints = np.zeros(rows[0].shape, dtype=np.intc)
    results = []
    for k in range(len(t)):
        places = [ctypes.c_void_p(x[k].ctypes.data) for x in (*rows, found)]
        results.append(step(state, ctypes.c_double(t[k]), *places))
        count = contact(state, ctypes.c_void_p(joints[k].ctypes.data))
        assert count == joints[k].sum()
    return found.astype(np.float64), joints.astype(bool), results


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_c_observes_what_python_observes(name: str, tmp_path: Path) -> None:
    model, given, efforts, contact = observed(name)
    code = CCode(controller(model), "double", ())
    found, joints, results = in_c(code, tmp_path, "double", given)
    assert apart(found, efforts) < 1e-12
    assert np.array_equal(joints, contact)
    assert 0.05 < contact[:, 1:].mean() < 0.95 and not contact[:, 0].any()
    assert [k for k, result in enumerate(results) if result] == [
        0,
        len(results) // 3,
        len(results) // 2,
    ]


@pytest.mark.slow
def test_single_precision_is_close(tmp_path: Path) -> None:
    model = model_of("tree")
    given = tuple(x.astype(np.float32).astype(np.float64) for x in samples(model.robot, 500))
    code = CCode(controller(model), "float", ())
    found, _, _ = in_c(code, tmp_path, "float", given)
    assert apart(found, in_python(model, given)[0]) < 1e-3


def test_time_that_does_not_increase_changes_nothing(tmp_path: Path) -> None:
    model = model_of("tree")
    t, *rest = samples(model.robot, 300)
    code = CCode(controller(model), "double", ())
    once, _, _ = in_c(code, tmp_path / "once", "double", (t, *rest))
    again = tuple(np.repeat(x, 2, axis=0) for x in (t, *rest))
    twice, _, results = in_c(code, tmp_path / "twice", "double", again)
    assert results[1::2] == [-1] * 300
    assert np.array_equal(twice[::2], once)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "precision"), [*((name, "double") for name in CASES), ("tree", "float")]
)
def test_the_self_test_passes_strictly_in_c_and_cpp(
    name: str, precision: Precision, tmp_path: Path
) -> None:
    code = CCode(controller(model_of(name)), precision, ())
    source = written(code, tmp_path)
    assert "observer_step" in (tmp_path / f"{code.name}.h").read_text()
    for command in (
        (compiler(), "-std=c99", *STRICT),
        (compiler("g++"), "-x", "c++", "-std=c++11", *STRICT),
    ):
        done = self_tested(code, source, *command)
        assert done.returncode == 0, done.stdout
    assert "observer" in (tmp_path / f"{code.name}_test.c").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_python_files_observe_too(name: str) -> None:
    model, given, efforts, contact = observed(name)
    names: dict[str, object] = {}
    exec(python_code(controller(model), ()), names)
    observer = names["Observer"]()  # type: ignore[operator]
    for k, sample in enumerate(zip(*given, strict=True)):
        observer.step(*sample)
        assert apart(observer.torque, efforts[k]) < 1e-12
        assert np.array_equal(observer.contact, contact[k])
    with pytest.raises(ValueError, match="time does not increase"):
        observer.step(*(x[-1] for x in given))


def test_the_observer_is_exported_by_name(tmp_path: Path) -> None:
    model = model_of("tree")
    found = write_code(model, tmp_path / "c", "c", functions=["observer", "torque"])
    assert {"torque", "observer_start", "observer_step"} <= set(found.functions)
    assert "observer_contact" not in found.functions
    header = next((tmp_path / "c").glob("*.h")).read_text()
    assert "OBSERVER_BANDWIDTH 8.0" in header and "observer_contact" not in header
    assert "_observer_step" in (tmp_path / "c" / "README.md").read_text()
    alone = write_code(model, tmp_path / "alone", "c", functions=["observer"])
    assert "torque" not in alone.functions
    usual = write_code(model, tmp_path / "usual", "c")
    assert "observer_step" not in usual.functions
