"""Ctrl-C: exit code 130, no traceback, nothing left; see `proofs/product/interrupt.py`."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cli.mistakes import LOG, ROBOT, leftovers

DRIVER = Path(__file__).parent / "interrupted_at.py"
CHECK = ("check", "../given/clock.toml", LOG, "--fix", "fixed.toml", "-o", "out")
IDENTIFY = ("identify", ROBOT, LOG, "--validate", "../given/validation.csv")


def pressed(function: str, arguments: tuple[str, ...], work: Path) -> tuple[int, str, list[str]]:
    """Exit code and message of a command stopped at a function, and the functions it entered."""
    report = work.parent / "entered.txt"
    done = subprocess.run(
        [sys.executable, str(DRIVER), function, str(report), *arguments],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.returncode, done.stderr, report.read_text().splitlines()


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        ("app.expanded", IDENTIFY),
        ("identify.<module>", IDENTIFY),
        ("files._beside", IDENTIFY),
        ("gather.gather", IDENTIFY),
        ("show.progress_bar.<locals>.watch", IDENTIFY),
        ("identify.Identification.write", IDENTIFY),
        ("page.render", IDENTIFY),
        ("files.write_table", ("simulate", ROBOT, "--period", "1")),
        ("files.write_json", ("simulate", ROBOT, "--period", "1")),
        ("examine.examine", IDENTIFY),
        ("check_page.render_check", CHECK),
        ("files.whole_folder", CHECK),
        ("files.whole_file", CHECK),
        ("edits.edited", CHECK),
        ("files._remove", ("simulate", ROBOT, "--period", "1")),
        ("template.drafted", ("init", "../given/demo_arm.urdf")),
        ("files.whole_file", ("init", "../given/demo_arm.urdf")),
    ],
)
def test_ctrl_c_leaves_nothing(function: str, arguments: tuple[str, ...], work: Path) -> None:
    code, errors, entered = pressed(function, arguments, work)
    assert function in entered
    assert (code, errors) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []


def test_ctrl_c_comes_too_late_once_results_take_their_place(work: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, errors, entered = pressed("terminal.summary", (*IDENTIFY, "-o", str(out)), work)
    assert "terminal.summary" in entered
    assert (code, errors) == (0, "")
    assert sorted(p.name for p in out.iterdir()) == ["model.json", "parameters.csv", "report.html"]


def test_the_reduced_model_stays_when_the_next_motion_is_stopped(
    work: Path, tmp_path: Path
) -> None:
    code, errors, _ = pressed("x.y", (*IDENTIFY, "-o", str(tmp_path / "full")), work)
    assert (code, errors) == (0, "")
    options = ("--robot", IDENTIFY[1], "--next", str(tmp_path / "motion"), "--stop", "one_fewer")
    arguments = ("reduce", str(tmp_path / "full"), IDENTIFY[2], "-o", str(tmp_path / "small"))
    code, errors, entered = pressed("design.design_excitation", (*arguments, *options), work)
    assert "design.design_excitation" in entered
    assert (code, errors) == (130, f"stopped: {tmp_path / 'small'} is written, nothing else\n")
    assert (tmp_path / "small" / "model.json").exists()
    assert not (tmp_path / "motion").exists()


def test_ctrl_c_from_outside_while_it_works(work: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "steelyard", "simulate", ROBOT, "--period", "200"],
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
import os, signal, sys
from steelyard.cli import interrupt
from steelyard.cli.main import main
from steelyard.cli import app as commands

class Deaf:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def swallow(arguments):
    Deaf()
    return arguments

commands.expanded = swallow
main()
"""


def test_ctrl_c_that_a_callback_swallows_is_not_lost(work: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED, *IDENTIFY],
        cwd=work,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (130, "stopped: nothing was written\n")
    assert leftovers(work) == []
