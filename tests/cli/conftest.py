"""A workshop with short logs of the demo arm, and one identification of it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from cli.mistakes import workshop
from steelyard.cli.app import app, expanded

Command = Callable[..., Result]


@pytest.fixture(scope="session")
def shared_work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return workshop(tmp_path_factory.mktemp("workshop"))


@pytest.fixture
def command(shared_work: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run a command in the folder `work` of the workshop."""
    monkeypatch.chdir(shared_work)

    def run(*arguments: object) -> Result:
        return CliRunner().invoke(app, expanded([str(a) for a in arguments]))

    return run


@pytest.fixture(scope="session")
def given(shared_work: Path) -> Path:
    return shared_work.parent / "given"


@pytest.fixture(scope="session")
def identified(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output folder of an identification with validation, terminal output beside it."""
    folder = tmp_path_factory.mktemp("identified")
    log, other = (str(given / f"{name}.parquet") for name in ("identification", "validation"))
    arguments = ["identify", str(given / "demo_arm.toml"), log, "--validate", other]
    done = CliRunner().invoke(app, [*arguments, "-o", str(folder / "out")])
    assert done.exit_code == 0, done.output
    (folder / "terminal.txt").write_text(done.stdout)
    return folder / "out"
