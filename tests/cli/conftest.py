"""A workshop with short logs of the demo arm, and one identification of it."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from cli.mistakes import workshop
from short_arm import short_logs
from steelyard.cli import shared_by_commands as commands
from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded
from steelyard.cli.shared_by_commands import computed
from steelyard.identify import repeated_motion_and_validation_split
from steelyard.simulate.simulate import write_demo_arm

Command = Callable[..., Result]


@pytest.fixture(scope="session")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot files and logs, made once; no test writes here."""
    return workshop(tmp_path_factory.mktemp("workshop")).parent / "given"


@pytest.fixture
def work(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty folder for one test, with a copy of `given` beside it."""
    place = tmp_path_factory.mktemp("fresh")
    copytree(given, place / "given")
    (place / "work").mkdir()
    return place / "work"


@pytest.fixture
def command(work: Path, few_stretches: None, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run a command in the folder `work` of the workshop, `identify` with `few_stretches`.

    `identified` calibrates on all. Logs of 2 s are cut.
    """
    monkeypatch.chdir(work)
    monkeypatch.setattr(repeated_motion_and_validation_split, "SHORTEST_CUT_LOG", 2.0)

    def run(*arguments: object) -> Result:
        return CliRunner().invoke(app, expanded([str(a) for a in arguments]))

    return run


@contextmanager
def results() -> Iterator[list[dict[str, Any]]]:
    """The numbers that commands compute meanwhile, which print text: `--json` of the same run."""
    found: list[dict[str, Any]] = []

    def kept(compute: Callable[..., Any], folder: Path | None) -> Any:
        result = computed(compute, folder)
        found.append(json.loads(json.dumps(result.to_dict(), allow_nan=False)))
        return result

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(commands, "computed", kept)
        yield found


@pytest.fixture(scope="session")
def identified(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of an identification with validation; beside it what it prints.

    `terminal.txt` is the text, `printed.json` the numbers.
    """
    return _identified(given, tmp_path_factory.mktemp("identified"))


@pytest.fixture(scope="session")
def six_given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot file and logs of the arm with six joints, which feel all of a load or a push."""
    folder = tmp_path_factory.mktemp("six")
    short_logs(folder, write=write_demo_arm)
    return folder


@pytest.fixture(scope="session")
def six_identified(six_given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as `identified`, of six joints and without checks, which take half of the time."""
    return _identified(six_given, tmp_path_factory.mktemp("identified_six"), "--no-check")


def _identified(given: Path, folder: Path, *options: str) -> Path:
    log, other = (str(given / f"{name}.csv") for name in ("identification", "validation"))
    arguments = ["identify", str(given / "demo_arm.toml"), log, "--validate", other, *options]
    with results() as found:
        done = CliRunner().invoke(app, [*arguments, "-o", str(folder / "out")])
    assert done.exit_code == 0, done.output
    (folder / "terminal.txt").write_text(done.stdout)
    (folder / "printed.json").write_text(json.dumps(found[0]))
    return folder / "out"
