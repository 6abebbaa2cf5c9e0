"""The documents name what is there."""

import re
import shlex
from pathlib import Path

import pytest
import typer.main

from steelyard.cli.app import app
from steelyard.estimate.estimator_register import ESTIMATORS
from steelyard.logs.formats import FORMATS
from steelyard.model.laws.register import term_of
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.toml_schema import Section, checked, meanings_of

ROOT = Path(__file__).parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
NOTEBOOKS = [*(ROOT / "docs").rglob("*.ipynb")]


def snippets() -> list[tuple[str, str]]:
    """Parts of robot files in the documents: where, and their text."""
    return [
        (f"{path.name}-{number}", text)
        for path in sorted(DOCUMENTS)
        for number, text in enumerate(
            re.findall(r"```toml\n(.*?)```", path.read_text("utf-8"), re.S), start=1
        )
    ]


def test_every_citation_is_in_the_references() -> None:
    known = set(
        re.findall(r"^\| (\w+\d{4}) \|", (ROOT / "docs/references.md").read_text("utf-8"), re.M)
    )
    cited = {
        key
        for folder in ("src", "studies")
        for path in (ROOT / folder).rglob("*.py")
        for key in re.findall(r"\[([A-Z][A-Za-z]+\d{4})", path.read_text("utf-8"))
    }
    assert cited == known


def test_links_and_paths_lead_somewhere() -> None:
    missing = []
    for document in (*DOCUMENTS, *NOTEBOOKS):
        text = document.read_text("utf-8")
        links = re.findall(r"\]\((?!https?:)([^)#\s]+)", text)
        targets = ((link, (document.parent / link).resolve()) for link in links)
        missing += [link for link, at in targets if not at.exists()]
        paths = re.findall(r"`((?:src|tests|docs|examples|proofs|benchmarks)/[\w/.]+)", text)
        missing += [path for path in paths if "AREA" not in path and not (ROOT / path).exists()]
    assert missing == []


def test_anchors_are_headings() -> None:
    missing = []
    for document in DOCUMENTS:
        for link, anchor in re.findall(
            r"\]\((?!https?:)([^)#\s]*)#([^)\s]+)\)", document.read_text("utf-8")
        ):
            target = document.parent / link if link else document
            headings = re.findall(r"^#+ (.+)$", target.read_text("utf-8"), re.M)
            known = [re.sub(r"[^\w\- ]", "", h).lower().replace(" ", "-") for h in headings]
            missing += [] if anchor in known else [f"{document.name}: {link}#{anchor}"]
    assert missing == []


@pytest.mark.parametrize("text", [pytest.param(text, id=where) for where, text in snippets()])
def test_snippets_are_of_a_robot_file(text: str) -> None:
    if not re.search(r"^(urdf|mjcf) = |^\[robot\.dh\]", text, re.M):
        text = f'{text}\n[robot]\nurdf = "arm.urdf"\n'
    file = checked(Path("snippet.toml"), text, RobotFile)[0]
    for term in file.model.terms or () if file.model else ():
        finds_of(term_of(term, "snippet"))


def commands() -> list[tuple[str, list[str]]]:
    """Commands in the documents: where, and their words."""
    lines = [
        (path.name, line)
        for path in sorted(DOCUMENTS)
        for block in re.findall(r"^ *```sh\n(.*?)```", path.read_text("utf-8"), re.S | re.M)
        for line in block.replace("\\\n", " ").splitlines()
    ]
    return [
        (name, shlex.split(line, comments=True))
        for name, line in lines
        if re.match(r" *steelyard [a-z]", line)
    ]


def test_commands_and_options_exist() -> None:
    top, wrong = typer.main.get_command(app), []
    found = commands()
    for name, (_, *words) in found:
        command = top
        while hasattr(command, "commands") and words and words[0] in command.commands:
            command = command.commands[words.pop(0)]
        options = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
        given = [word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)]
        unknown = [option for option in given if option not in options]
        if hasattr(command, "commands") or unknown:
            wrong.append((name, command.name, *unknown))
    assert wrong == [] and len(found) > 20


def sections(base: type[Section] = Section) -> list[type[Section]]:
    """All tables of the robot file."""
    below = base.__subclasses__()
    return [*below, *(deeper for section in below for deeper in sections(section))]


@pytest.mark.parametrize("section", sections(), ids=lambda section: section.__name__)
def test_every_key_of_the_robot_file_is_described(section: type[Section]) -> None:
    described = meanings_of(section)
    assert sorted(described) == sorted(section.model_fields) and all(described.values())


def test_tables_of_formats_and_estimators_are_whole() -> None:
    text = (ROOT / "docs" / "logs.md").read_text("utf-8")
    rows = text.partition("| suffix |")[2].partition("\n\n")[0].split("\n")[2:]
    named = {x for row in rows for x in re.findall(r"`(\.[a-z0-9]+)`", row.split("|")[1])}
    assert named >= set(FORMATS), "the table of docs/logs.md lacks a format"
    text = (ROOT / "docs" / "estimation.md").read_text("utf-8")
    head = text.partition("Available with each estimator:\n\n")[2].split("\n")[0]
    columns = [cell.strip() for cell in head.split("|") if cell.strip()]
    listed = [name for cell in columns for name in cell.split(", ")]
    assert sorted(listed) == sorted(offer.name for offer in ESTIMATORS)
