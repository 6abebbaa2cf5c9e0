"""C code of identified models: it computes what Python computes, on any compiler."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from closed_chains import CHAINS, five_bar
from in_c import (
    LIBM,
    STRICT,
    Library,
    apart,
    apart_in_sample,
    code_of,
    compiler,
    controller_on,
    run_compiler,
    self_tested,
    written,
)
from invented import tree
from law_cases import CASES
from moving import cycles, geared
from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import Motion
from steelyard.export.code.c_code import CCode, commented, identifiers
from steelyard.export.code.controller_functions import FUNCTIONS, Controller, regrouped
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.symbolic.source_code import Precision

LAWS = {f"law_{k}": case for k, case in enumerate(CASES)}
FIRST = {case.law: name for name, case in reversed(LAWS.items())}
"""The first case of each law."""
REMEMBERING = (*DEFAULT_TERMS, Dahl(length=2e-3))
PRECISIONS = {"double": 1e-12, "float": 1e-5}
COMPARED = [
    *((name, "double") for name in LAWS),
    *((name, "float") for name in FIRST.values()),
]
"""Cases of laws with precisions: all in double precision, the first of each law in single."""


def states(robot: Robot, count: int = 20, seed: int = 3) -> Motion:
    """Rest at zero, rest at half turns, then anything."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, robot.n))
    dq, ddq = rng.normal(size=(2, *q.shape)) * np.array([1.0, 3.0])[:, None, None]
    q[0], q[1], q[2] = 0.0, np.pi, -np.pi
    dq[:3] = ddq[:3] = 0.0
    return Motion(np.arange(count), *(x.astype(np.float32) for x in (q, dq, ddq)))


def wander(robot: Robot, count: int = 60) -> Motion:
    """Consecutive samples that begin at some speed and reverse."""
    q, dq, ddq = 0.01 * cycles(robot.n, 1, count)
    return Motion(0.001 * np.arange(count), *(x.T.astype(np.float32) for x in (q, dq, ddq)))


def torque_of(controller: Controller, motion: Motion) -> Array:
    return controller.model.at(controller.values).torque(motion)


def along(library: Library, name: str, arrays: list[Array], sizes: list[int]) -> Array:
    """Results of a function at samples, shape `(N, entries)`."""
    return np.array([library.call(name, list(row), sizes) for row in zip(*arrays, strict=True)])


@pytest.fixture(scope="module")
def controllers() -> dict[str, Controller]:
    """Controllers of every law on the robot with gears."""
    robot = geared()
    return {
        name: controller_on(robot.changed(name=name), (case.on(robot),), ["torque"])
        for name, case in LAWS.items()
    }


@pytest.fixture(scope="module")
def libraries(
    controllers: dict[str, Controller], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Precision], Library]:
    """The code of all compared cases of one precision, as one library."""

    def library(precision: Precision) -> Library:
        folder = tmp_path_factory.mktemp(precision)
        names = [name for name, compared in COMPARED if compared == precision]
        sources = [written(code_of(controllers[name], precision), folder) for name in names]
        return Library(sources, folder, precision)

    return cache(library)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "precision"), COMPARED)
def test_every_law_is_that_of_python(
    name: str,
    precision: Precision,
    controllers: dict[str, Controller],
    libraries: Callable[[Precision], Library],
) -> None:
    controller, library, tolerance = controllers[name], libraries(precision), PRECISIONS[precision]
    if controller.n_memory:
        motion = wander(controller.model.robot)
        found = library.along(name, controller.n_memory, motion.q, motion.dq, motion.ddq)
    else:
        motion = states(controller.model.robot)
        found = along(library, f"{name}_torque", [motion.q, motion.dq, motion.ddq], [4])
    wanted = torque_of(controller, motion)
    assert np.abs(wanted).max() > 0.01
    error = apart if tolerance < 1e-6 else apart_in_sample
    assert error(found, wanted) < tolerance


def compiled(controller: Controller, folder: Path) -> tuple[CCode, Library]:
    code = code_of(controller)
    return code, Library([written(code, folder)], folder, "double")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tree", "six-bar", "spatial"])
def test_every_function_is_that_of_python(name: str, tmp_path: Path) -> None:
    robot = tree() if name == "tree" else CHAINS[name]()
    frame = robot.bodies[-1].name
    controller = controller_on(robot, DEFAULT_TERMS, tuple(FUNCTIONS), [frame])
    code, library = compiled(controller, tmp_path)
    model = controller.model.at(controller.values)
    if robot.passive:
        rng = np.random.default_rng(1)
        path = robot.assembly[: robot.n] + np.cumsum(rng.uniform(-0.03, 0.03, (9, robot.n)), axis=0)
        motion = Motion(np.arange(9), path, *rng.normal(size=(2, *path.shape)))
    else:
        motion = states(robot, 9)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    tau, n, b = 5.0 * dq, robot.n, len(controller.parameters)
    closed = []
    if robot.passive:
        count = len(robot.passive)
        closed = [np.array([library.call(f"{code.name}_follow", [x], [count]) for x in q])]
    numbers = library.call(f"{code.name}_parameters", [], [b])
    accelerations = model.forward_dynamics(q, dq, tau)
    position, rotation = model.pose(q, frame)
    wanted = {
        "torque": ([dq, ddq], model.torque(motion)),
        "gravity": ([], model.gravity(q)),
        "bias": ([dq], model.bias(q, dq)),
        "friction": ([dq], model.friction(motion)),
        "mass": ([], model.mass_matrix(q)),
        "momentum": ([dq], model.momentum(q, dq)),
        "momentum_rate": ([dq], model.momentum_rate(q, dq)),
        "pose": ([], np.concatenate([position, rotation.reshape(-1, 9)], axis=1)),
        "jacobian": ([], model.jacobian(q, frame)),
    }
    for function, (arguments, value) in wanted.items():
        sizes = [size for _, size in code.functions[function][0].sizes]
        found = along(library, f"{code.name}_{function}", [q, *closed, *arguments], sizes)
        assert apart(found, value.reshape(len(q), -1)) < 1e-12, function
    columns = along(library, f"{code.name}_regressor", [q, *closed, dq, ddq], [n * b])
    assert apart(columns.reshape(-1, n, b) @ numbers, model.torque(motion)) < 1e-9
    found = along(library, f"{code.name}_forward_dynamics", [q, *closed, dq, tau], [n + 1])
    assert apart(found[:, :n], accelerations) < 1e-9 and found[:, n].min() > 0.0


@pytest.mark.slow
def test_memory_on_a_closed_chain(tmp_path: Path) -> None:
    robot = five_bar()
    controller = controller_on(robot, REMEMBERING)
    code, library = compiled(controller, tmp_path)
    motion = wander(robot)
    shifted = Motion(motion.t, motion.q + robot.assembly[:2], motion.dq, motion.ddq)
    size = 2 + controller.n_memory
    found = library.along(code.name, size, shifted.q, shifted.dq, shifted.ddq)
    assert apart(found, torque_of(controller, shifted)) < 1e-12


@pytest.mark.slow
def test_a_sample_that_is_no_number_passes(tmp_path: Path) -> None:
    robot = five_bar()
    controller = controller_on(robot, REMEMBERING)
    code, library = compiled(controller, tmp_path)
    motion, size = wander(robot), 2 + controller.n_memory
    q = motion.q + robot.assembly[:2]
    broken = q.copy()
    broken[20, 0] = np.nan
    found = library.along(code.name, size, broken, motion.dq, motion.ddq)
    assert np.isnan(found[20]).any() and np.isfinite(np.delete(found, 20, axis=0)).all()
    whole = library.along(code.name, size, q, motion.dq, motion.ddq)
    np.testing.assert_array_equal(found[:20], whole[:20])


@pytest.mark.slow
def test_friction_of_a_velocity_that_is_no_number_is_none(tmp_path: Path) -> None:
    controller = controller_on(tree(), (RigidBody(), Coulomb()), names=("friction",))
    code, library = compiled(controller, tmp_path)
    found = library.call(f"{code.name}_friction", [np.zeros(4), np.full(4, np.nan)], [4])
    assert np.isnan(found).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "precision"), [(tree(), "float"), (five_bar(), "double")], ids=PRECISIONS
)
def test_compilers_and_sanitizers_find_nothing(
    robot: Robot, precision: str, tmp_path: Path
) -> None:
    code = code_of(controller_on(robot, REMEMBERING, tuple(FUNCTIONS)), precision)  # type: ignore[arg-type]
    source = written(code, tmp_path)
    checked = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    for command in (
        (compiler(), "-std=c99", *STRICT, "-O2"),
        (compiler("g++"), "-x", "c++", "-std=c++11", *STRICT),
        (compiler(), "-std=c99", *STRICT, *checked),
    ):
        done = self_tested(code, source, *command)
        assert done.returncode == 0 and not done.stderr, done.stdout + done.stderr
        assert "0 values beyond" in done.stdout


@pytest.mark.slow
def test_the_self_test_finds_another_number(tmp_path: Path) -> None:
    code = code_of(controller_on(tree(), DEFAULT_TERMS))
    source = written(code, tmp_path)
    text = source.read_text()
    number = repr(float(code.controller.numbers[-1]))
    assert number in text
    source.write_text(text.replace(number, repr(1.001 * float(number))))
    done = self_tested(code, source, compiler(), "-std=c99")
    assert done.returncode == 1 and " 0 values beyond" not in done.stdout


@pytest.mark.slow
def test_only_the_mathematical_library_is_needed(tmp_path: Path) -> None:
    source = written(code_of(controller_on(five_bar(), REMEMBERING)), tmp_path)
    run_compiler(compiler(), "-std=c99", "-O2", "-c", source, "-o", tmp_path / "code.o")
    command = ["nm", "-P", str(tmp_path / "code.o")]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    symbols = [line.split()[:2] for line in lines]
    assert {name for name, kind in symbols if kind == "U"} <= LIBM
    assert {kind for _, kind in symbols} <= {"T", "t", "U", "r"}, "no variables outside functions"


def test_values_of_variables_live_as_long_as_they_are_read() -> None:
    from steelyard.symbolic.program_and_softening import InputArray as Input
    from steelyard.symbolic.source_code import variables_of
    from steelyard.symbolic.symbols_and_tracing import symbolic

    def chain(x: list) -> list:
        total = x[0] * x[1]
        for _ in range(50):
            total = total * x[0] + x[1]
        return [total]

    program = symbolic(chain, [Input("x", 2)])
    assert program.n_operations > 90 and variables_of(program)[1] == 1


ODD = {
    "robot": '2 "arms"*/ int main(){}??/',
    "joints": ["Gelenk-1", "gelenk 1", "élbow\n/*", "关节"],
}


@pytest.mark.slow
def test_odd_names_become_identifiers(tmp_path: Path) -> None:
    robot = tree()
    names = zip(ODD["joints"], robot.coordinates, strict=True)
    odd = robot.changed(
        name=ODD["robot"], coordinates=tuple(replace(c, name=name) for name, c in names)
    )
    code = code_of(controller_on(odd, DEFAULT_TERMS))
    assert code.name == "robot_2_arms_int_main"
    assert code.joints == ("gelenk_1", "gelenk_1_2", "elbow", "joint")
    done = self_tested(code, written(code, tmp_path), compiler(), "-std=c99", *STRICT)
    assert done.returncode == 0, done.stdout
    assert code.header().isascii() and "Gelenk-1 [rad, Nm]" in code.header()


def test_identifiers_differ_and_comments_stay_closed() -> None:
    assert identifiers(["a", "A", "a_2", "a"], "x") == ("a", "a_2", "a_2_2", "a_3")
    assert identifiers(["7", "", "--"], "joint") == ("joint_7", "joint", "joint_2")
    assert commented("a */ b /* c ??/ \\ d\n") == "a * / b / * c ? ?/ / d"
    assert commented("N/(rad/s)³, kg m², 关") == "N/(rad/s)^3, kg m^2, /u5173"


@pytest.mark.parametrize("make", [tree, geared, five_bar], ids=lambda make: make.__name__)
def test_regrouped_bodies_make_the_same_torque(make: object) -> None:
    robot = make()  # type: ignore[operator]
    open_chain = robot.changed(coordinates=robot.joints, passive=(), loops=(), transmission=None)
    model, motion = Model(open_chain, (RigidBody(),)), states(open_chain)
    tens = robot.nominal
    found = regrouped(robot, tens)
    pair = [
        model.at(Parameters(model.names, model.units, x.ravel())).torque(motion)
        for x in (tens, found)
    ]
    assert apart(*pair) < 1e-12
    assert (found != 0.0).sum() <= (tens != 0.0).sum() - 3 * len(robot.bodies)


def test_removed_parameters_need_no_operations() -> None:
    controller = controller_on(tree(), (RigidBody(), Coulomb()), ["torque"])
    values = controller.values.as_dict() | {f"coulomb.{c.name}": 0.0 for c in tree().coordinates}
    names, units = controller.values.names, controller.values.units
    without = replace(controller, values=Parameters(names, units, [values[n] for n in names]))
    bodies = controller_on(tree(), (RigidBody(),), ["torque"])
    counts = [c.functions[0].program.n_operations for c in (without, bodies, controller)]
    assert counts[0] == counts[1] < counts[2]
    assert not any(name.startswith("coulomb") for name in without.parameters)
