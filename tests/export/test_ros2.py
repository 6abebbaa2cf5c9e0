"""ROS 2 packages, compiled against declarations of the interfaces and run."""

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest

from closed_chains import five_bar
from in_c import compiler, run_compiler
from invented import tree
from moving import cycles
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.export.code.export_code import write_code
from steelyard.export.code.fmu_ros2_simulink import text_literal
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.terms.axes_and_fields import spread
from steelyard.model.terms.term import Columns
from steelyard.robot.robot import LoopClosure, Robot
from weighed import identified_of

STUBS = Path(__file__).parents[1] / "stubs" / "ros2"
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
ODD = ('Gelenk"1"', "gelenk*/1", "élbow\\n", "关节??/")


def wander(robot: Robot, count: int = 20) -> Motion:
    q, dq, ddq = (x.T for x in 0.05 * cycles(robot.n, 1, count))
    return Motion(0.01 * np.arange(count), q + robot.assembly[: robot.n], dq, ddq)


def odd_tree() -> Robot:
    names = zip(ODD, tree().coordinates, strict=True)
    coordinates = tuple(replace(joint, name=name) for name, joint in names)
    return tree().changed(name='2 <arms> & "b"*/', coordinates=coordinates)


def package(model: IdentifiedModel, folder: Path) -> str:
    """Write a package; the name of its C code."""
    files = write_code(model, folder, "ros2").files
    assert all((folder / name).is_file() for name in files)
    (header,) = (Path(name) for name in files if name.endswith(".h"))
    return header.stem


def program(folder: Path, name: str, *sources: Path) -> Path:
    """An executable of C++ sources with the C code."""
    code, found = folder / "code.o", folder / sources[0].stem
    run_compiler(
        compiler(), "-std=c99", "-Wall", "-Werror", "-c", folder / f"src/{name}.c", "-o", code
    )
    run_compiler(
        compiler("g++"), *STRICT, f"-I{STUBS}", f"-I{folder}/src", *sources, code, "-o", found
    )
    return found


def run(path: Path, given: Sequence[object]) -> tuple[Array, str]:
    """What a program prints for what it reads, and its errors."""
    words = " ".join(map(str, given))
    done = subprocess.run([str(path)], input=words, capture_output=True, text=True)
    return np.array(done.stdout.split(), dtype=float), done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("make", [five_bar, odd_tree])
def test_the_plugin_computes_the_same(make: object, tmp_path: Path) -> None:
    robot: Robot = make()  # type: ignore[operator]
    model, motion, k = identified_of(robot), wander(robot), 7
    name = package(model, tmp_path / "p")
    path = program(tmp_path / "p", name, tmp_path / "p/src/solver.cpp", STUBS / "driver.cpp")
    q, dq, ddq = (x[k : k + 1] for x in (motion.q, motion.dq, motion.ddq))
    found, error = run(path, [robot.n, *map(repr, np.concatenate([q, dq, ddq]).ravel().tolist())])
    assert not error
    wanted = [
        model.torque(motion)[k],
        model.bias(q, dq)[0] - model.gravity(q)[0],
        model.gravity(q)[0],
        model.mass_matrix(q)[0].ravel(),
        model.friction(motion)[k],
    ]
    np.testing.assert_allclose(found, np.concatenate(wanted), rtol=1e-11, atol=1e-11)
    _, error = run(path, [robot.n + 1, *[0.0] * 3 * (robot.n + 1)])
    assert error == f"{robot.n + 1} values of {robot.n} joints"


@pytest.mark.slow
def test_chains_that_cannot_close_are_refused(tmp_path: Path) -> None:
    short = LoopClosure("tip", (1, 3), [[0.3, 0.0, 0.0], [0.32, 0.0, 0.0]])
    robot = five_bar().changed(loops=(short,), assembly=(2.0, 1.1, -1.0, 1.0))
    name = package(identified_of(robot), tmp_path / "p")
    path = program(tmp_path / "p", name, tmp_path / "p/src/solver.cpp", STUBS / "driver.cpp")
    found, error = run(path, [2, 2.9, 0.0, *[0.0] * 4])
    assert "do not close" in error and not len(found)


@pytest.mark.slow
@pytest.mark.parametrize("make", [tree, five_bar])
def test_the_node_fills_efforts_of_joints_in_any_order(make: object, tmp_path: Path) -> None:
    robot: Robot = make()  # type: ignore[operator]
    model, motion = identified_of(robot), wander(robot)
    name = package(model, tmp_path / "p")
    path = program(tmp_path / "p", name, tmp_path / "p/src/fill_efforts.cpp")
    order = np.arange(robot.n)[::-1]
    names = [robot.joint_names[k] for k in order]
    arrays = [x[:, order] for x in (motion.q, motion.dq, motion.ddq)]
    rows = np.concatenate(arrays, axis=1)
    given = [robot.n, len(rows), *names, *map(repr, rows.ravel().tolist())]
    found, error = run(path, given)
    assert not error
    wanted = model.torque(motion)[:, order]
    np.testing.assert_allclose(found.reshape(wanted.shape), wanted, rtol=1e-11, atol=1e-11)
    other = [robot.n, 1, *names[:-1], "wheel", *[0.0] * 3 * robot.n]
    found, error = run(path, other)
    assert not len(found)
    assert error == f"trajectory not published: joint '{names[-1]}' is missing"
    more = [robot.n + 1, 1, *names, "wheel", *[0.0] * 3 * (robot.n + 1)]
    found, error = run(path, more)
    assert not len(found) and f"has {robot.n + 1} joints, the model {robot.n}" in error


def test_the_description_of_the_package_names_the_plugin(tmp_path: Path) -> None:
    model = identified_of(odd_tree())
    name = package(model, tmp_path / "p")
    described = ElementTree.parse(tmp_path / "p/package.xml").getroot()
    title = described.findtext("name")
    assert title == f"{name}_inverse_dynamics_solver" and described.get("format") == "3"
    depends = {element.text for element in described.findall("depend")}
    cmake = (tmp_path / "p/CMakeLists.txt").read_text()
    assert f"project({title} C CXX)" in cmake
    for depend in depends - {"eigen"}:
        assert f"find_package({depend} REQUIRED)" in cmake
    library = ElementTree.parse(tmp_path / "p/plugin.xml").getroot()
    assert library.get("path") == title and f"add_library({title} SHARED" in cmake
    (plugin,) = library
    source = (tmp_path / "p/src/solver.cpp").read_text()
    kinds = ", ".join(plugin.get(key, "") for key in ("type", "base_class_type"))
    assert f"PLUGINLIB_EXPORT_CLASS({kinds})" in source
    readme = (tmp_path / "p/README.md").read_text()
    assert "Not built with ROS 2 where it was written" in readme
    assert f"`{plugin.get('name')}`" in readme


@dataclass(frozen=True)
class Positional(Viscous):
    """Friction that grows with the position as well."""

    law: ClassVar[str] = "positional"  # machine code is cached by the names of laws

    def columns(self, robot: Robot, state: JointState) -> Columns:
        return spread(self.axes(robot), [a.of(state.dq) * a.of(state.q) for a in self.axes(robot)])


@pytest.mark.slow
def test_friction_of_positions_is_part_of_the_torque_only(tmp_path: Path) -> None:
    robot, motion = tree(), wander(tree())
    model = identified_of(robot, (RigidBody(), Positional()))
    name = package(model, tmp_path / "p")
    path = program(tmp_path / "p", name, tmp_path / "p/src/solver.cpp", STUBS / "driver.cpp")
    row = np.concatenate([motion.q[7], motion.dq[7], motion.ddq[7]])
    found, error = run(path, [robot.n, *map(repr, row.tolist())])
    assert "depends on positions too" in error
    np.testing.assert_allclose(found[: robot.n], model.torque(motion)[7], rtol=1e-11, atol=1e-11)
    assert "friction of this model depends" in (tmp_path / "p/README.md").read_text().lower()


def test_friction_with_memory_is_refused(tmp_path: Path) -> None:
    model = identified_of(tree(), (*DEFAULT_TERMS, Dahl(length=2e-3)))
    with pytest.raises(ModelError, match="friction has memory"):
        write_code(model, tmp_path / "p", "ros2")
    assert not (tmp_path / "p").exists()


def test_literals_have_the_bytes_of_the_name() -> None:
    assert text_literal('a"b\\1?é') == '"a\\042b\\1341\\077\\303\\251"'
