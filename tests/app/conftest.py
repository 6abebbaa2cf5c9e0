"""A simulated arm with logs, and a desk on a workspace whose work is done at once."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.guided import Finished, Server, serving, simulated_arm
from browser import chromium


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `arm.urdf`, `a.csv` and `b.csv`."""
    return simulated_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Finished:
    """A desk on an empty workspace; the current folder is the workspace, as for works."""
    made = Finished.on(tmp_path / "workspace")
    monkeypatch.chdir(made.workspace.folder)
    return made


@pytest.fixture
def ready(desk: Finished, arm: Path) -> Finished:
    """A desk on a workspace with the robot, both logs and a proposed robot file."""
    for name, kind in (("arm.urdf", "robot"), ("a.csv", "logs"), ("b.csv", "logs")):
        (desk.workspace.folder / kind / name).write_bytes((arm / name).read_bytes())
    desk.act("robot", "added")
    return desk


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A running app on an empty folder, entered."""
    pytest.importorskip("starlette")
    pytest.importorskip("uvicorn")
    with serving(tmp_path_factory.mktemp("served")) as running:
        running.enter()
        yield running


@pytest.fixture
def browser() -> None:
    """Skip without a browser and what drives it."""
    pytest.importorskip("playwright")
    pytest.importorskip("starlette")
    if chromium() is None:
        pytest.skip("no Chromium: apt-get install chromium")
