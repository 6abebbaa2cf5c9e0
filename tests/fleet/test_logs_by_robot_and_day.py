"""Robot and day in paths, and messages about URLs."""

from pathlib import Path

import pytest

from steelyard.base.errors import LogError
from steelyard.fleet.logs_by_robot_and_day import parts_of
from steelyard.logs.files_and_urls import files_of, without_secrets


def test_urls_that_cannot_be_read() -> None:
    with pytest.raises(LogError, match="cannot be read|not installed") as told:
        files_of("nonsense://user:password@host/logs?token=1")
    assert "password" not in str(told.value) and "token" not in str(told.value)
    assert told.value.where == "nonsense://host/logs"
    assert without_secrets("s3://key:secret@bucket/a?X-Amz-Signature=1") == "s3://bucket/a"
    assert without_secrets("zip://a::http://bob:secret@host/b") == "zip://a::http://host/b"


NAMED = {
    ("a/r1/2026-01-02.csv", "a", None): ("r1", "2026-01-02"),
    ("a/2026-01-02/r1.csv", "a", None): ("r1", "2026-01-02"),
    ("a/cell2/r1/20260102T0800.csv", "a", None): ("cell2/r1", "2026-01-02"),
    ("a/r1_day03.csv", "a", None): ("r1", "0003"),
    ("a/week7/arm4.csv", "a", "{day}/{robot}"): ("arm4", "week7"),
    ("a/arm4_7_x.csv", "a", "{robot}_{day}_*"): ("arm4", "7"),
    ("a/arm4/7/x.csv", "a", "{robot}/{day}/*"): ("arm4", "7"),
    ("a/arm_1_2026-05-13.csv", "a", "{robot}_{day}"): ("arm_1", "2026-05-13"),
    ("a/2026-03-01/r3/run_20260301.csv", "a", None): ("r3", "2026-03-01"),
    ("a/r1/2026-05-13_1012.csv", "a", None): ("r1", "2026-05-13"),
}


@pytest.mark.parametrize("case", NAMED)
def test_robot_and_day_in_paths(
    case: tuple[str, str, str | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, argument, names = case
    monkeypatch.chdir(tmp_path)
    Path(path).parent.mkdir(parents=True)
    Path(path).write_text("t\n1\n")
    (part,) = parts_of([argument], names)[0]
    assert (part.robot, part.day) == NAMED[case]


def test_paths_that_do_not_say_the_day(tmp_path: Path) -> None:
    names_of = ("r1/13-05-2026_1012.csv", "SN20240101/2026/05/13/a.csv", "a-20191203/day7.csv")
    for number, name in enumerate(names_of):
        own = tmp_path / str(number) / name
        own.parent.mkdir(parents=True)
        own.write_text("t\n1\n")
        with pytest.raises(LogError, match="no date|several days"):
            parts_of([str(tmp_path / str(number))])
    (tmp_path / "arm.csv").write_text("t\n1\n")
    for names, wrong in (
        (None, "no date"), ("{robot}-{day}", "does not fit"), ("{robot}", "once each"),
    ):  # fmt: skip
        with pytest.raises(LogError, match=wrong):
            parts_of([str(tmp_path / "arm.csv")], names)
