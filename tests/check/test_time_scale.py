"""Without velocities a clock that runs wrong shows where accelerations and gravity disagree."""

from pathlib import Path

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.finding import Finding, Severity
from steelyard.check.signals.time_stamps_and_scale import clock_check
from steelyard.logs.clocks_and_combined_logs import Numbered
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

WITHOUT = ('velocity = "dq{}_rad_s"\n', "")


def found(arm: Arm, scale: float, *, velocities: bool = False) -> list[Finding]:
    table = arm.table.copy()
    table[:, 0] *= scale
    text = arm.text if velocities else arm.text.replace(*WITHOUT)
    return [f for f in clock_check(arm.case(table, text, known=False)) if f.severity]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.5, 0.93, 1.06, 2.0])
def test_a_clock_that_runs_fast_or_slow_is_found_with_its_scale(arm: Arm, scale: float) -> None:
    (finding,) = found(arm, scale)
    value, half = (finding.says.split("stamps are ")[1].split(" times")[0]).split(" ± ")
    assert float(value) == pytest.approx(scale, rel=0.005) and float(half) < 0.02
    assert ("slow" if scale < 1.0 else "fast") in finding.says
    assert finding.severity == Severity.WRONG or "length in the model file" in finding.says
    assert 0.9 < scale < 1.1 or finding.severity == Severity.WRONG


def test_the_right_clock_is_left_alone(arm: Arm) -> None:
    assert found(arm, 1.0) == found(arm, 1.0, velocities=True) == []


def test_logged_velocities_show_a_clock_that_is_far_off(arm: Arm) -> None:
    (finding,) = found(arm, 2.0, velocities=True)
    assert finding.severity == Severity.WRONG and "2 times d(q)/dt" in finding.says


@pytest.mark.parametrize("scale", [0.95, 1.04])
def test_logged_velocities_show_the_scale(arm: Arm, scale: float) -> None:
    (finding,) = found(arm, scale, velocities=True)
    assert finding.severity == Severity.DOUBTFUL and f"{scale:g} times d(q)/dt" in finding.says


def of_rows(arm: Arm, text: str, rate: int) -> Finding:
    """The finding on the log as it comes without its column of time."""
    arm.path.write_text(text.replace('time = "time_s"', f"rate = {rate}.0"))
    loaded = load_robot(arm.path)
    assert loaded.signals is not None
    log = Numbered(LogInMemory(Path("log"), arm.columns, arm.table))
    checked = CheckedLog(Recording(log, loaded.signals), Processing(), "log")
    (finding,) = clock_check(Case(loaded, (checked,), None))
    return finding


@pytest.mark.parametrize(
    ("rate", "word"), [(10, "open"), (30, "open"), (200, "ok"), (1000, "open")]
)
def test_a_declared_rate_that_nothing_tells_is_open(arm: Arm, rate: int, word: str) -> None:
    """The log's rate is 200 Hz: a fit confirms it, and finds none where the declared one is far."""
    finding = of_rows(arm, arm.text.replace(*WITHOUT), rate)
    assert finding.word == word and ("undecided" in finding.says) == (word == "open")


def test_velocities_tell_a_declared_rate(arm: Arm) -> None:
    finding = of_rows(arm, arm.text, 200)
    assert finding.word == "ok" and finding.answered


def test_one_joint_alone_tells_nothing(arm: Arm) -> None:
    table = arm.table.copy()
    table[:, 0] *= 2.0
    table[:, arm.at("q{}_rad")[1:]] = table[0, arm.at("q{}_rad")[1:]]
    table[:, arm.at("tau{}_Nm")[1:]] += 1e-3 * np.sin(table[:, :1])
    case = arm.case(table, arm.text.replace(*WITHOUT), known=False)
    assert all(f.severity == Severity.OK for f in clock_check(case))


def test_efforts_that_no_clock_explains_have_none(arm: Arm) -> None:
    table = arm.table.copy()
    q, dq = arm.motion.q, arm.motion.dq
    table[:, arm.at("tau{}_Nm")] = 20.0 * np.cos(q) + 3.0 * dq + 2.0 * np.sin(3.0 * q)
    case = arm.case(table, arm.text.replace(*WITHOUT), known=False)
    assert all(f.severity == Severity.OK for f in clock_check(case))
