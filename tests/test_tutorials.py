"""Commands of the tutorials exist, and do what the page says; all run in `make prove`."""

import os
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded
from tutorial_pages import PAGES, ROOT, all_commands, differences, shows

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the commands are of a POSIX shell")
SHORT = ROOT / "docs/tutorials/payload.md"
"""The page whose commands take the least time."""


@pytest.fixture(autouse=True)
def _variables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the tutorials, and a wide terminal."""
    if not os.environ.get("STEELYARD_DATA"):
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("E", str(ROOT / "examples"))


@pytest.mark.slow
def test_commands_print_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def run(words: list[str]) -> tuple[int, str, str]:
        done = CliRunner().invoke(app, expanded(words))
        return done.exit_code, done.stdout, done.output

    assert differences(SHORT, tmp_path, run) == []


@pytest.mark.parametrize("page", [pytest.param(page, id=page.stem) for page in PAGES])
def test_every_command_has_its_options_and_files(page: Path) -> None:
    """The arguments are those of the command, and the data that they name are there."""
    found = all_commands(page)
    group = typer.main.get_command(app)
    for words in found:
        name, *rest = expanded(words)
        group.commands[name].make_context(name, rest)
        files = [word.split("@")[0].split("#")[0] for word in rest if word.startswith("/")]
        assert [file for file in files if not Path(file).is_file()] == []
    assert found


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("one two", True),
        ("one", False),
        ("one…", True),
        ("… two", True),
        ("… three", False),
        ("two…", False),
    ],
)
def test_a_line_is_shown_whole_but_where_it_says_so(line: str, shown: bool) -> None:
    assert shows("zero\n one   two\n", line) == shown
