"""The small fleet with a store in which all of its logs are done."""

import shutil
import uuid
from collections.abc import Callable
from pathlib import Path

import pytest

import small_arm
import small_fleet
import steelyard
from steelyard.base.arrays import Array


@pytest.fixture(scope="session")
def fleet_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot file, logs and a store in which all of them are done."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "arm.urdf").write_text(small_arm.URDF)
    (folder / "arm.toml").write_text(small_fleet.ROBOT_FILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        small_fleet.write_all(folder, range(small_fleet.DAYS))
        steelyard.fleet("arm.toml", "logs", store="store", processes=1)
    return folder


@pytest.fixture
def in_fleet(fleet_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(fleet_folder)
    return fleet_folder


@pytest.fixture
def with_log(in_fleet: Path) -> Callable[[Path, dict[str, Array] | bytes], Path]:
    """Write a log that replaces one of a copy of all logs; the copy's folder."""

    def change(path: Path, content: dict[str, Array] | bytes) -> Path:
        copy = in_fleet / f"copy-{uuid.uuid4().hex[:6]}"
        shutil.copytree(in_fleet / "logs", copy)
        own = copy / path
        own.parent.mkdir(parents=True, exist_ok=True)
        own.unlink(missing_ok=True)
        if isinstance(content, bytes):
            own.write_bytes(content)
        else:
            small_fleet.write(own, content)
        return copy

    return change
