"""S-functions for Simulink, compiled against declarations and run step by step."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

from closed_chains import five_bar
from in_c import compiler, run_compiler
from invented import tree
from moving import cycles
from steelyard.base.motion import Motion
from steelyard.export.code.export_code import write_code
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Robot
from weighed import identified_of

STUBS = Path(__file__).parents[1] / "stubs" / "simulink"
REMEMBERING = (*DEFAULT_TERMS, Dahl(length=2e-3))
CASES = {
    "tree, with memory": (tree, REMEMBERING),
    "five_bar, static": (five_bar, DEFAULT_TERMS),
}


def wander(robot: Robot, count: int = 60) -> Motion:
    q, dq, ddq = (x.T for x in 0.05 * cycles(robot.n, 1, count))
    return Motion(0.01 * np.arange(count), q + robot.assembly[: robot.n], dq, ddq)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_block_computes_the_same(case: str, tmp_path: Path) -> None:
    make, terms = CASES[case]
    robot, motion, folder = make(), wander(make()), tmp_path / "block"
    model = identified_of(robot, terms)
    files = write_code(model, folder, "simulink").files
    (block,) = (folder / name for name in files if name.endswith("_sfun.c"))
    name = block.name.removesuffix("_sfun.c")
    library = tmp_path / "block.so"
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fPIC", "-shared")
    sources = (block, folder / f"{name}.c")
    run_compiler(compiler(), *flags, f"-I{STUBS}", *sources, "-o", library, "-lm")
    rows = np.ascontiguousarray(np.concatenate([motion.q, motion.dq, motion.ddq], axis=1))
    found = np.full((len(rows), robot.n + bool(robot.passive)), np.nan)
    addresses = (ctypes.c_void_p(x.ctypes.data) for x in (rows, found))
    outputs = ctypes.CDLL(str(library)).simulate(len(rows), *addresses)
    assert outputs == 1 + bool(robot.passive)
    np.testing.assert_allclose(found[:, : robot.n], model.torque(motion), rtol=1e-11, atol=1e-11)
    if robot.passive:
        assert np.abs(found[:, -1]).max() < 1e-12


def test_the_folder_says_what_was_not_run(tmp_path: Path) -> None:
    long = tree().changed(name=f"{'Very ' * 20}long *robot*")
    written = write_code(identified_of(long, REMEMBERING), tmp_path / "block", "simulink")
    assert sorted(p.name for p in (tmp_path / "block").iterdir()) == sorted(written.files)
    assert written.functions == ("start", "step") and written.absent == ()
    (script,) = (Path(name) for name in written.files if name.endswith(".m"))
    assert len(script.stem) <= 63
    block = script.stem.removeprefix("make_")
    assert f"{block}.c" in written.files
    assert f"#define S_FUNCTION_NAME {block}\n" in (tmp_path / "block" / f"{block}.c").read_text()
    assert f"mex {block}.c very_very" in (tmp_path / "block" / script).read_text()
    readme = (tmp_path / "block" / "README.md").read_text()
    for words in ("Not run in Simulink where it was written", "discrete", "slider_joint [m, N]"):
        assert words in readme, words
