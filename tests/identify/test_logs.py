"""Folders of results: numbered by default, never replaced."""

from pathlib import Path

import pytest

from steelyard.base.errors import OutputError
from steelyard.base.files import new_folder


def test_default_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("steelyard-arm", "steelyard-arm-2", "steelyard-arm-3"):
        folder = new_folder(None, "steelyard-arm")
        assert folder == Path(name)
        folder.mkdir()


@pytest.mark.parametrize("default", ["", "steelyard-arm"])
def test_a_named_folder_must_not_exist(default: str, tmp_path: Path) -> None:
    assert new_folder(tmp_path / "new", default) == tmp_path / "new"
    with pytest.raises(OutputError, match="the output folder exists already") as caught:
        new_folder(tmp_path, default)
    assert ("without --output folders are numbered" in caught.value.fix) == bool(default)
