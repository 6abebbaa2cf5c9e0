"""What strangers wrote is shown, not obeyed; what fails is said in one message."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from rich.table import Table
from typer.testing import CliRunner

from steelyard.base.errors import LogError, visible
from steelyard.cli.app import app
from steelyard.cli.shared_by_commands import DEFECT, guarded
from steelyard.report.terminal import terminal

FORGED = "x\x1b]0;OWNED\x07\x1b[1A\x1b[2K\x1b[32mGOOD\u202e"


@pytest.mark.parametrize("letter", [*map(chr, range(32)), "\x7f", "\x9b", "\u2028", "\u202e"])
def test_control_characters_are_escaped(letter: str) -> None:
    assert visible(f"a{letter}b").isprintable()
    assert visible("Größe °") == "Größe °"


def test_a_console_prints_no_foreign_control_characters() -> None:
    text = io.StringIO()
    console = terminal(file=text, width=200)
    table = Table("column", FORGED)
    table.add_row(FORGED, "[bold]1")
    console.print(FORGED, table)
    printed = text.getvalue().replace("\n", "")
    assert printed.isprintable()
    assert printed.count(r"\x1b[1A") == 3


def test_an_error_is_lines_of_its_own_only() -> None:
    error = LogError(f"column {FORGED}", where="a\nGOOD: forged", fix="first\nsecond")
    assert str(error).replace("\n", "").isprintable()
    assert len(str(error).splitlines()) == 4  # the advice has two


def printed(*command: object) -> str:
    """What a command prints that works."""
    done = CliRunner().invoke(app, [str(word) for word in command])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_column_of_a_log_cannot_command_the_terminal(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k:.2f},{k},1\n" for k in range(40))
    (tmp_path / "evil.csv").write_text(f"time_s,q1,{FORGED}\n{rows}")
    assert printed("log", "info", tmp_path / "evil.csv").replace("\n", "").isprintable()


@pytest.mark.slow
def test_notes_of_a_simulated_robot_cannot_command_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="j" axis="0 1 0" range="-1 1"/>'
        '<geom size="0.1" pos="0.1 0 0"/></body></worldbody><tendon>'
        '<fixed name="t&#x9b;31m" stiffness="3"><joint joint="j" coef="2"/></fixed></tendon>'
        "</mujoco>"
    )
    command = ("simulate", tmp_path / "arm.xml", "--period", "0.5", "-o", tmp_path / "out")
    said = printed(*command)
    assert said.replace("\n", "").isprintable() and r"t\x9b31m" in said


@pytest.mark.slow
def test_an_encoding_without_a_letter_and_a_full_disk(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "steelyard", "doctor"]
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    assert (
        subprocess.run(command, env=ascii_only, cwd=tmp_path, capture_output=True).returncode == 0
    )
    if Path("/dev/full").exists():
        with open("/dev/full", "w") as full:
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
        assert done.returncode == 2
        assert "No space left" in done.stderr and "Traceback" not in done.stderr


def test_a_defect_is_said_in_one_message(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken() -> None:
        raise ZeroDivisionError("of nothing")

    monkeypatch.delenv("STEELYARD_TRACEBACK", raising=False)
    with pytest.raises(typer.Exit) as left:
        guarded(broken)()
    assert left.value.exit_code == DEFECT
    assert "a defect of steelyard: ZeroDivisionError: of nothing" in capsys.readouterr().err
    monkeypatch.setenv("STEELYARD_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        guarded(broken)()
