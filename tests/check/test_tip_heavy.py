"""Arms with most of their mass in the last link, whose mass the model file does not know well."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from steelyard.base.arrays import Array
from steelyard.check.all_checks import Diagnosis, examine
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.decision.hypothesis_checks import EFFORT_KIND, EFFORT_SIGN, PAYLOAD
from steelyard.check.finding import Finding, Severity
from steelyard.cli.app import app
from steelyard.logs.formats import open_log
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.init.guess_columns import guess_signals
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

LINKS = (("z", 0.1, 0.1), ("y", 0.12, 0.3), ("y", 0.28, 0.3), ("x", 0.25, 0.12), ("y", 0.05, 0.15))
"""Axis, distance from the joint before [m] and mass [kg] of all links but the last."""
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
CHECKED = (EFFORT_KIND, EFFORT_SIGN, PAYLOAD)


def urdf(tip: float) -> str:
    """An arm of six joints whose last link weighs `tip` [kg]."""
    parts = ['<robot name="tip_heavy"><link name="base"/>']
    parent = "base"
    for k, (axis, away, mass) in enumerate((*LINKS, ("x", 0.08, tip)), start=1):
        inertia = mass * (0.05 if k == 6 else 0.06) ** 2
        where = f"0 0 {away}" if k < 3 else f"{away} 0 0"
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="{0.05 if k == 6 else 0.1} 0 0.01"/>'
            f'<mass value="{mass}"/><inertia ixx="{0.6 * inertia}" iyy="{inertia}" '
            f'izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint{k}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link{k}"/><origin xyz="{where}"/><axis xyz="{AXES[axis]}"/>'
            '<limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint>'
        )
        parent = f"link{k}"
    return "".join(parts) + "</robot>"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[str, ...], Array]:
    """Columns and rows of an arm near the one with 0.6 kg in its last link."""
    folder = tmp_path_factory.mktemp("tip")
    (folder / "arm.urdf").write_text(urdf(0.6))
    arguments = ["simulate", str(folder / "arm.urdf"), "--period", "6", "--seed", "1"]
    done = CliRunner().invoke(app, [*arguments, "-o", str(folder / "run")])
    assert done.exit_code == 0, done.output
    log = open_log(folder / "run" / "log.csv")
    return log.columns, np.concatenate(list(log.parts(log.columns)))


def examined(path: Path, tip: float, columns: tuple[str, ...], table: Array) -> Diagnosis:
    """What is found of a log with a model file whose last link weighs `tip` [kg]."""
    path.write_text(urdf(tip))
    loaded = load_robot(path)
    sample = dict(zip(columns, table.T, strict=True))
    signals, _ = guess_signals(loaded.robot, columns, sample)
    checked = CheckedLog(
        Recording(LogInMemory(Path("log"), columns, table), signals), Processing(), "log"
    )
    return examine(Case(loaded, (checked,), None), checks=CHECKED)


def named(found: Diagnosis, check: str) -> Finding:
    (finding,) = [f for f in found.findings if f.check == check]
    return finding


def test_lighter_links_are_doubtful_beside_a_factor_on_efforts(tmp_path: Path, log) -> None:
    found = examined(tmp_path / "arm.urdf", 1.25, *log)
    assert found.severity == Severity.DOUBTFUL and not found.edits
    finding = named(found, "effort kind")
    assert "efforts are off by a factor" in finding.says and "lighter" in finding.says
    assert not named(found, "payload").answered


def test_a_factor_that_the_last_link_explains_as_well_is_open(tmp_path: Path, log) -> None:
    columns, table = log[0], log[1].copy()
    efforts = [k for k, name in enumerate(columns) if name.startswith("tau")]
    # such efforts as an arm of the model file has whose last link is 1.5 times lighter
    table[:, efforts] *= 1.6
    found = examined(tmp_path / "arm.urdf", 0.9, columns, table)
    assert found.severity == Severity.OK and not found.edits


def test_factors_that_no_link_explains_stay_wrong(tmp_path: Path, log) -> None:
    columns, table = log[0], log[1].copy()
    efforts = [k for k, name in enumerate(columns) if name.startswith("tau")]
    table[:, efforts] *= 0.05
    found = examined(tmp_path / "arm.urdf", 0.6, columns, table)
    assert named(found, "effort kind").severity == Severity.WRONG and not found.edits


@pytest.mark.slow
@pytest.mark.parametrize("joint", [2, 4])
def test_a_sign_is_not_taken_for_another_last_link(tmp_path: Path, log, joint: int) -> None:
    columns, table = log[0], log[1].copy()
    table[:, columns.index(f"tau{joint}_Nm")] *= -1.0
    found = examined(tmp_path / "arm.urdf", 0.6, columns, table)
    assert named(found, "effort sign").severity == Severity.WRONG
    gain = [-1.0 if k == joint else 1.0 for k in range(1, 7)]
    assert [edit.value for edit in found.edits] == [gain]
