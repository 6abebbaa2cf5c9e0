"""Every command of the tutorials does what its page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs/tutorials").glob("*.md"))
BLOCK = re.compile(r'^```(sh|text|toml)(?: title="([^"]+)")?\n(.*?)^```', re.M | re.S)


@pytest.mark.slow
@pytest.mark.usefixtures("searches_here")
@pytest.mark.skipif(sys.platform == "win32", reason="the commands are of a POSIX shell")
@pytest.mark.parametrize("page", [pytest.param(page, id=page.stem) for page in PAGES])
def test_commands_print_what_the_page_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not os.environ.get("STEELYARD_DATA"):
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("E", str(ROOT / "examples"))
    printed = ""
    for kind, title, text in BLOCK.findall(page.read_text("utf-8")):
        if kind == "toml" and title:
            edit(tmp_path / title, text)
        elif kind == "sh":
            done = [CliRunner().invoke(app, expanded(words)) for words in commands(page, text)]
            assert all(one.exit_code in (0, 3) for one in done), [one.output for one in done]
            printed = "\n".join(one.stdout for one in done)
        elif kind == "text":
            for line in text.splitlines():
                assert shows(printed, line), f"{line}\nis not in\n{printed}"


def shows(printed: str, line: str) -> bool:
    """Whether a line is printed, whole but where … stands for the rest of it."""
    words = " ".join(line.strip("…").split())
    lines = [" ".join(one.split()) for one in printed.splitlines()]
    if line.startswith("…"):
        return any(one.endswith(words) for one in lines)
    return any(one.startswith(words) if line.endswith("…") else one == words for one in lines)


def commands(page: Path, text: str) -> list[list[str]]:
    """The arguments of each command of a block, as the shell gives them to `steelyard`."""
    program = """set -e; steelyard() { printf '%s\\n' "$#" "$@"; }"""
    lines = subprocess.run(
        ["bash", "-c", f"{program}\n{assignments(page)}\n{text}"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    found = []
    while lines:
        count = int(lines.pop(0))
        found.append(lines[:count])
        lines = lines[count:]
    return found


def assignments(page: Path) -> str:
    """Variables that the page's commands set, for those that follow."""
    blocks = (text for kind, _, text in BLOCK.findall(page.read_text("utf-8")) if kind == "sh")
    return "\n".join(re.findall(r"^[A-Z]=.*$", "\n".join(blocks), re.M))


def edit(path: Path, lines: str) -> None:
    """Put lines into a robot file where the key of the first one is."""
    key = lines.split(" = ", 1)[0]
    text, count = re.subn(rf"^{key} = .*\n", lambda _: lines, path.read_text("utf-8"), flags=re.M)
    assert count == 1
    path.write_text(text, "utf-8")
