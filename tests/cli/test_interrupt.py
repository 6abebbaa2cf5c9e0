"""Ctrl-C: exit code 130, no traceback, nothing left; see `proofs/product/interrupt.py`."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from shutil import copy
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

import steelyard
from cli.interrupted_at import press_at
from cli.mistakes import LOG, ROBOT, leftovers
from small_arm import URDF
from steelyard.cli import interrupt
from steelyard.cli.app import app
from steelyard.cli.main import main
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import write_motion

DRIVER = Path(__file__).parent / "interrupted_at.py"
SMALL, FIRST, SECOND = "../given/arm.toml", "../given/first.csv", "../given/second.csv"
CHECK = ("check", "../given/arm_ms.toml", FIRST, "--quick", "--fix", "fixed.toml")
IDENTIFY = ("identify", SMALL, FIRST, "--validate", SECOND, "--no-check")
SIMULATE = ("simulate", SMALL, "--period", "1")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot with two joints, a robot file for it with a wrong unit, and two short logs."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "arm.urdf").write_text(URDF)
    (folder / "arm.toml").write_text('[robot]\nurdf = "arm.urdf"\n')
    robot = folder / "arm.toml"
    steelyard.simulate(robot, folder / "first", period=3.0, seed=0)
    arm, motion = steelyard.load_robot(robot).robot, folder / "drawn" / "trajectory.json"
    motion.parent.mkdir()
    write_motion(motion, random_fourier(arm, seed=1, period=3.0), arm)
    steelyard.simulate(robot, folder / "second", motion, seed=0)
    for name in ("first", "second"):
        (folder / name / "log.csv").rename(folder / f"{name}.csv")
    drafted = folder / "arm_ms.toml"
    arguments = [str(folder / "arm.urdf"), str(folder / "first.csv"), "-o", str(drafted)]
    made = CliRunner().invoke(app, ["init", *arguments])
    assert made.exit_code == 0, made.output
    text = drafted.read_text()
    assert text.count('time_unit = "s"') == 1
    drafted.write_text(text.replace('time_unit = "s"', 'time_unit = "ms"'))
    return folder


@pytest.fixture
def work(work: Path, small: Path) -> Path:
    """A fresh folder beside these files."""
    for file in small.glob("*.*"):
        copy(file, work.parent / "given")
    return work


def pressed_here(
    function: str, arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> tuple[object, list[str]]:
    """Exit code of a command stopped at a function, in this process, and what it entered."""
    monkeypatch.setattr(sys, "argv", ["steelyard", *arguments])
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(interrupt, "_state", interrupt._State())
    before, entered = signal.getsignal(signal.SIGINT), dict[str, None]()
    press_at(function, entered)
    try:
        main()
    except SystemExit as end:
        return end.code, list(entered)
    finally:
        sys.settrace(None)
        signal.signal(signal.SIGINT, before)
    raise AssertionError("a command ends with an exit code")


def pressed(function: str, arguments: tuple[str, ...], work: Path) -> tuple[int, str, list[str]]:
    """Exit code and message of a command stopped at a function, and the functions it entered."""
    report = work.parent / "entered.txt"
    done = subprocess.run(
        [sys.executable, str(DRIVER), function, str(report), *arguments],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=600,
    )
    return done.returncode, done.stderr, report.read_text().splitlines()


@pytest.mark.slow
def test_ctrl_c_while_modules_are_loaded_leaves_nothing(work: Path) -> None:
    code, errors, entered = pressed("identify.<module>", IDENTIFY, work)
    assert "identify.<module>" in entered
    assert (code, errors) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []


@pytest.mark.slow
@pytest.mark.usefixtures("few_stretches")
@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        ("options_with_several_values.expanded", IDENTIFY),
        ("files._beside", IDENTIFY),
        ("gather.gather", IDENTIFY),
        ("scores_and_model_report.render", IDENTIFY),
        ("shared_by_commands.progress_bar.<locals>.watch", SIMULATE),
        ("formats.write_table", SIMULATE),
        ("files._remove", SIMULATE),
        ("findings_text_and_page.render_check", (*CHECK, "-o", "out")),
        ("toml_edits.edited", CHECK),
        ("files.whole_file", ("init", "../given/demo_arm.urdf")),
    ],
)
def test_ctrl_c_leaves_nothing(
    function: str,
    arguments: tuple[str, ...],
    work: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(work)
    code, entered = pressed_here(function, arguments, monkeypatch)
    assert function in entered
    assert (code, capsys.readouterr().err) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []


@pytest.mark.slow
@pytest.mark.usefixtures("few_stretches")
def test_ctrl_c_comes_too_late_once_results_take_their_place(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(work)
    arguments = (*IDENTIFY, "-o", "out")
    code, entered = pressed_here("scores_and_model_report.print_report", arguments, monkeypatch)
    assert "scores_and_model_report.print_report" in entered
    assert (code, capsys.readouterr().err) == (0, "")
    names = sorted(p.name for p in Path("out").iterdir())
    assert names == ["model.json", "parameters.csv", "report.html"]


@pytest.mark.slow
def test_the_reduced_model_stays_when_the_next_motion_is_stopped(
    identified: Path,
    work: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(work)
    options = ("--robot", ROBOT, "--next", "motion", "--stop", "one_fewer", "-o", "small")
    arguments = ("reduce", str(identified), LOG, *options)
    code, entered = pressed_here("excite.design_excitation", arguments, monkeypatch)
    assert "excite.design_excitation" in entered
    assert (code, capsys.readouterr().err) == (130, "stopped: small is written, nothing else\n")
    assert Path("small/model.json").exists() and not Path("motion").exists()


@pytest.mark.slow
def test_what_no_one_can_catch_is_shown_as_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = list[object]()
    monkeypatch.setattr(sys, "unraisablehook", shown.append)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(interrupt, "_state", interrupt._State())
    interrupt.install()
    for kind in (ValueError, interrupt.Interrupted):
        sys.unraisablehook(SimpleNamespace(exc_type=kind))  # type: ignore[arg-type]
    assert [one.exc_type for one in shown] == [ValueError]  # type: ignore[attr-defined]


def test_ctrl_c_from_outside_while_it_works(work: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "steelyard", "simulate", SMALL, "--period", "200"],
        cwd=work,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not leftovers(work) and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []


SWALLOWED = """
import os, signal
from steelyard.cli.main import main
from steelyard.cli import options_with_several_values

class Deaf:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def swallow(arguments):
    Deaf()
    return arguments

options_with_several_values.expanded = swallow
main()
"""


@pytest.mark.slow
def test_ctrl_c_that_a_callback_swallows_is_not_lost(work: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED, *SIMULATE],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []
