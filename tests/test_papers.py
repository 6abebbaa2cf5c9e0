"""The page of the papers' elements and their authors' doubts name what is there."""

import re
import shlex
from pathlib import Path

import pytest
import typer.main

import steelyard
from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.toml_schema import checked

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs" / "studies"
ELEMENTS = (FOLDER / "papers_element_by_element.md").read_text("utf-8")
TEXT = ELEMENTS + (FOLDER / "doubts.md").read_text("utf-8")
CODE = sorted(set(re.findall(r"`([^`]+)`", TEXT)))
COMMANDS = [code for code in CODE if re.match(r"steelyard \w+ ", code)]
KEYS = [code for code in CODE if re.match(r"\[.+?\] \w+ = ", code)]


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_parse(line: str) -> None:
    command, (name, *words) = typer.main.get_command(app), expanded(shlex.split(line)[1:])
    command = command.commands[name]  # type: ignore[attr-defined]
    with command.make_context(name, words) as context:
        assert context.args == []


@pytest.mark.parametrize("line", KEYS)
def test_keys_are_of_the_robot_file(line: str) -> None:
    table, keys = re.fullmatch(r"(\[+[\w.]+\]+) (.+)", line, re.S).groups()  # type: ignore[union-attr]
    text = "\n".join((table, *keys.split("; ")))
    if "robot.dh" not in table:
        text = '[robot]\nurdf = "arm.urdf"\n' + text
    checked(Path("line.toml"), text, RobotFile)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"\bsteelyard\.(\w+)", " ".join(CODE)))))
def test_python_names_are_public(name: str) -> None:
    assert hasattr(steelyard, name)


def test_files_exist() -> None:
    files = re.findall(r"`((?:studies|tests|proofs|docs|examples)/[\w/]+\.\w+)`", TEXT)
    assert len(files) > 10 and [file for file in files if not (ROOT / file).exists()] == []


def test_every_element_has_a_state() -> None:
    rows = re.findall(r"^\| (?!element|---)(.+) \|$", ELEMENTS, re.MULTILINE)
    assert len(rows) > 120
    for row in rows:
        *_, state = row.split(" | ")
        assert re.match(r"(works|substituted|not built)\b", state), row
        assert row.count(" | ") == 2, row
