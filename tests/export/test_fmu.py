"""FMUs: valid by fmpy, the same efforts as Python, and interface code without warnings."""

import importlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from closed_chains import five_bar
from in_c import STRICT, compiler, run_compiler
from invented import tree
from moving import cycles
from steelyard.base.errors import OutputError
from steelyard.base.motion import Motion
from steelyard.export.code import fmu_ros2_simulink
from steelyard.export.code.export_code import write_code
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Robot
from weighed import identified_of

REMEMBERING = (*DEFAULT_TERMS, Dahl(length=2e-3))
NOT_OFFERED = """GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate
    DeSerializeFMUstate GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives
    CancelStep GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus"""
"""Functions of the interface that only return an error."""

CASES = {
    "tree, with memory": (tree, REMEMBERING),
    "five_bar, static": (five_bar, DEFAULT_TERMS),
}


def fmpy() -> Any:
    return pytest.importorskip(
        "fmpy", reason='fmpy is not installed: pip install "steelyard[test]"'
    )


def wander(robot: Robot, count: int = 60) -> Motion:
    q, dq, ddq = (x.T for x in 0.05 * cycles(robot.n, 1, count))
    return Motion(0.01 * np.arange(count), q + robot.assembly[: robot.n], dq, ddq)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_unit_is_valid_and_computes_the_same(case: str, tmp_path: Path) -> None:
    tool = fmpy()
    compiler("cc")
    make, terms = CASES[case]
    model, path = identified_of(make(), terms), tmp_path / "arm.fmu"
    write_code(model, path, "fmu")
    validation = importlib.import_module("fmpy.validation")
    assert validation.validate_fmu(str(path)) == []
    described = tool.read_model_description(str(path))
    robot, motion = model.model.robot, wander(make())
    names = [v.name for v in described.modelVariables]
    assert names[: robot.n] == [f"q_{joint}" for joint in robot.joint_names]
    unit = tool.fmi2.FMU2Slave(
        guid=described.guid,
        unzipDirectory=tool.extract(str(path), str(tmp_path / "unit")),
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="arm",
    )
    rows = np.concatenate([motion.q, motion.dq, motion.ddq], axis=1).tolist()
    inputs, outputs = list(range(3 * robot.n)), list(range(3 * robot.n, len(names)))
    unit.instantiate()
    for _ in range(2):  # the second time after a reset
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.setReal(inputs, rows[0])
        unit.exitInitializationMode()
        found = []
        for k, row in enumerate(rows):
            unit.setReal(inputs, row)
            unit.doStep(motion.t[k], 0.01)
            found.append(unit.getReal(outputs))
        np.testing.assert_allclose(
            np.array(found)[:, : robot.n], model.torque(motion), rtol=1e-9, atol=1e-9
        )
        if robot.passive:
            assert names[-1] == "closure_error" and np.abs(np.array(found)[:, -1]).max() < 1e-12
        unit.reset()
    with pytest.raises(Exception, match="fmi2SetReal"):
        unit.setReal([outputs[0]], [1.0])
    unit.freeInstance()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_interface_compiles_without_warnings(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, terms = CASES[case]
    monkeypatch.setattr(fmu_ros2_simulink, "compiler", lambda: None)
    path = tmp_path / "arm.fmu"
    names = write_code(identified_of(make(), terms), path, "fmu").files
    assert not any(name.startswith("binaries") for name in names), "sources alone"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    (source,) = (tmp_path / "sources").glob("*_fmi2.c")
    for command in ((compiler(), "-std=c99"), (compiler("g++"), "-x", "c++", "-std=c++11")):
        run_compiler(*command, *STRICT, "-c", source, "-o", tmp_path / "a.o")
    text = source.read_text()
    assert all(f"fmi2{name}(" in text for name in NOT_OFFERED.split())


def test_the_same_model_is_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_ros2_simulink, "compiler", lambda: None)
    paths = [tmp_path / name for name in ("a.fmu", "b.fmu")]
    for path in paths:
        write_code(identified_of(tree()), path, "fmu")
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_compiler_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho no licence >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(fmu_ros2_simulink, "compiler", lambda: str(broken))
    monkeypatch.setattr(fmu_ros2_simulink.platform, "system", lambda: "Linux")
    monkeypatch.setattr(fmu_ros2_simulink.platform, "machine", lambda: "x86_64")
    with pytest.raises(OutputError, match="the compiler fails: no licence"):
        write_code(identified_of(tree()), tmp_path / "arm.fmu", "fmu")
    assert not (tmp_path / "arm.fmu").exists()
