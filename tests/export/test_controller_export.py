"""Code for controllers on disk: the Python file, and models that no controller can use."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard
from closed_chains import five_bar
from invented import tree
from moving import cycles
from steelyard.base.errors import DataError, ModelError
from steelyard.base.motion import Motion
from steelyard.export.code.export_code import controller_of, end_frames, origin_of, write_code
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Frame, LoopClosure, Robot
from weighed import identified_of

REMEMBERING = (*DEFAULT_TERMS, Dahl(length=2e-3))


def module(robot: Robot, path: Path, **options: Any) -> tuple[Any, dict[str, Any]]:
    """A model, and what the Python file of it defines."""
    identified = identified_of(robot, options.pop("terms", DEFAULT_TERMS))
    write_code(identified, path, "python", **options)
    names: dict[str, Any] = {}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return identified, names


def wander(robot: Robot, count: int = 40) -> Motion:
    q, dq, ddq = (x.T for x in 0.05 * cycles(robot.n, 1, count))
    return Motion(0.01 * np.arange(count), q + robot.assembly[: robot.n], dq, ddq)


def test_the_python_file_computes_the_same(tmp_path: Path) -> None:
    model, names = module(tree(), tmp_path / "tree.py")
    motion = wander(tree())
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    torque = model.torque(motion)
    assert names["JOINTS"] == model.joints
    np.testing.assert_allclose(names["torque"](q, dq, ddq), torque, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(names["torque"](q[3], dq[3], ddq[3]), torque[3], rtol=1e-12)
    np.testing.assert_allclose(names["mass"](q), model.mass_matrix(q), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(names["friction"](q, dq), model.friction(motion), rtol=1e-12)
    columns, values = names["regressor"](q, dq, ddq), np.array([*names["PARAMETERS"].values()])
    assert columns.shape == (40, 4, len(values))
    np.testing.assert_allclose(columns @ values, torque, rtol=1e-9, atol=1e-9)
    left, tip = (names[f"pose_{frame}"](q)[0] for frame in ("left", "tip"))
    np.testing.assert_allclose(left, model.pose(q, "left")[0], atol=1e-14)
    np.testing.assert_allclose(tip, model.pose(q, "tip")[0], atol=1e-14)


def test_the_python_file_steps_with_memory_on_a_closed_chain(tmp_path: Path) -> None:
    model, names = module(five_bar(), tmp_path / "arm.py", terms=REMEMBERING)
    motion = wander(five_bar())
    state = names["State"](motion.q[0], motion.dq[0])
    found = [state.step(*x) for x in zip(motion.q, motion.dq, motion.ddq, strict=True)]
    np.testing.assert_allclose(found, model.torque(motion), rtol=1e-11, atol=1e-11)
    assert state.gap < 1e-12 and not {"torque", "friction", "regressor"} & names.keys()
    passive, gap = names["follow"](motion.q[5])
    weight = names["gravity"](motion.q[5], passive)
    np.testing.assert_allclose(weight, model.gravity(motion.q[5]), rtol=1e-11)
    assert gap < 1e-12


def test_the_python_file_keeps_its_state_at_a_sample_that_is_no_number(tmp_path: Path) -> None:
    _, names = module(five_bar(), tmp_path / "arm.py", terms=REMEMBERING)
    motion = wander(five_bar())
    state = names["State"](motion.q[0], motion.dq[0])
    assert np.isnan(state.step(np.full(2, np.nan), motion.dq[0], motion.ddq[0])).all()
    assert np.isnan(state.gap)
    assert np.isfinite(state.step(motion.q[1], motion.dq[1], motion.ddq[1])).all()


def test_the_python_file_refuses_other_shapes(tmp_path: Path) -> None:
    _, names = module(tree(), tmp_path / "arm.py")
    with pytest.raises(ValueError, match=r"q of shape \(4,\) or \(N, 4\) expected, not \(6,\)"):
        names["gravity"](np.zeros(6))


def test_code_by_the_name_of_its_language(tmp_path: Path) -> None:
    model = identified_of(tree())
    found = steelyard.export_code(model, tmp_path / "c", to="c", precision="float")
    assert "torque" in found
    with pytest.raises(steelyard.SteelyardError, match="argument 'to' cannot be 'rust'") as caught:
        steelyard.export_code(model, tmp_path / "r", to="rust")
    assert "'c' or 'python'" in caught.value.fix


def test_no_target_of_cmake_has_a_reserved_name(tmp_path: Path) -> None:
    write_code(identified_of(replace(tree(), name="test")), tmp_path / "c", "c")
    text = (tmp_path / "c" / "CMakeLists.txt").read_text()
    assert "add_library(test_dynamics STATIC test.c)" in text


@pytest.mark.slow
def test_an_open_chain_shows_in_the_closure_error(tmp_path: Path) -> None:
    short = LoopClosure("tip", (1, 3), [[0.3, 0.0, 0.0], [0.32, 0.0, 0.0]])
    robot = five_bar().changed(loops=(short,), assembly=(2.0, 1.1, -1.0, 1.0))
    _, names = module(robot, tmp_path / "arm.py")
    assert names["follow"]([2.0, 1.1])[1] < 1e-12 and names["follow"]([2.9, 0.0])[1] > 1e-3


def test_the_folder_of_c_says_what_it_is(tmp_path: Path) -> None:
    written = write_code(
        identified_of(tree(), REMEMBERING), tmp_path / "c", "c", "float", (), ["tip"]
    )
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == sorted(written.files)
    assert written.absent == ("torque", "friction", "regressor")
    header, readme = ((tmp_path / "c" / n).read_text() for n in ("tree.h", "README.md"))
    assert "void tree_jacobian(const float q[4], float columns[24]);" in header
    assert "tree_torque" not in header and "tree_state" in header
    assert f"at most {written.stack} bytes" in header and "robot arm.toml: sha256 ab12" in header
    for words in ("FMA", "1e5 rad", "| `TREE_JOINT_SLIDER_JOINT` |", "the desired velocity"):
        assert words in readme, words
    with pytest.raises(Exception, match="exists already"):
        write_code(identified_of(tree()), tmp_path / "c", "c")


def changed(**fields: Any) -> Any:
    model = identified_of(tree())
    return replace(model, signals=replace(model.signals, **fields))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"unknown_gains": (False, True, False, False)}, "gain of joint 'slider_joint' is unknown"),
        (
            {"effort_units": ("A",) * 4, "gains": np.array([1.0, 0.5, 0.7, 0.2])},
            "gain of joint 'trunk_joint' is unknown",
        ),
        ({"effort_kind": "gravity_compensated_torque"}, "the model lacks the weight"),
    ],
)
def test_models_without_torques_are_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        controller_of(changed(**fields))
    assert caught.value.fix.startswith("identify ")


def test_functions_and_frames_by_name() -> None:
    model = identified_of(tree())
    assert controller_of(model, ["mass"], ["tip"]).names == ("mass",)
    with pytest.raises(DataError, match="no function 'torqe'") as caught:
        controller_of(model, ["torqe"])
    assert "did you mean 'torque'" in caught.value.fix
    with pytest.raises(ModelError, match="no frame 'hand'"):
        controller_of(model, (), ["hand"])


def test_frames_at_the_ends() -> None:
    assert end_frames(tree()) == ("left", "tip")
    tool = Frame("tool", 3, np.eye(3), np.zeros(3))
    assert end_frames(tree().changed(frames=(tool,))) == ("left", "tool")


def test_the_head_says_on_which_side_of_the_gears_efforts_are() -> None:
    assert "friction included" in origin_of(identified_of(tree()))[-1]
    behind = " ".join(origin_of(changed(effort_kind="link_torque")))
    assert "add the friction of motors and gears" in behind
