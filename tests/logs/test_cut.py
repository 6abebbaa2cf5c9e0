from math import inf
from pathlib import Path

import pytest

from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import Cut, parse_log_argument


@pytest.mark.parametrize(
    ("argument", "cut"),
    [
        ("run.parquet", Cut()),
        ("run.parquet@0.6:9.5", Cut(seconds=(0.6, 9.5))),
        ("run.parquet@0.6:", Cut(seconds=(0.6, inf))),
        ("run.parquet@:9.5", Cut(seconds=(-inf, 9.5))),
        ("run.parquet@:", Cut()),
        ("run.parquet#921:4442", Cut(rows=(921, 4442))),
        ("run.parquet#921:", Cut(rows=(921, None))),
        ("run.parquet#:4442", Cut(rows=(0, 4442))),
        ("a@home/run.parquet#1:2", Cut(rows=(1, 2))),
    ],
)
def test_cut_is_read_and_written(argument: str, cut: Cut) -> None:
    path, found = parse_log_argument(argument)
    assert found == cut
    assert path.name == "run.parquet"
    assert parse_log_argument(str(path) + cut.text) == (path, cut)


def test_a_file_with_such_a_name_is_that_file(tmp_path: Path) -> None:
    odd = tmp_path / "run@1:2.csv"
    odd.write_text("t,q\n0,0\n")
    assert parse_log_argument(str(odd)) == (odd, Cut())
    assert parse_log_argument(f"{odd}@3:4") == (odd, Cut(seconds=(3.0, 4.0)))


def test_a_folder_with_a_sign_in_its_name_is_no_cut() -> None:
    assert parse_log_argument("me@lab/run.csv") == (Path("me@lab/run.csv"), Cut())


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ("@9:3", "ends (3) before it starts (9)"),
        ("@3:3", "starts and ends at 3"),
        ("@-1:3", "'-1' is not a time"),
        ("@nan:3", "'nan' is not a time"),
        ("@a:3", "'a' is not a time"),
        ("#9:3", "ends (3) before it starts (9)"),
        ("#1.5:3", "'1.5' is not a row"),
        ("#-4:", "'-4' is not a row"),
        ("@5", "'@5' is not a window"),
    ],
)
def test_nonsense_is_refused(tmp_path: Path, window: str, words: str) -> None:
    log = tmp_path / "run.csv"
    log.write_text("t,q\n0,0\n")
    with pytest.raises(LogError) as caught:
        parse_log_argument(f"{log}{window}")
    assert words in caught.value.wrong
    assert "LOG@START:STOP" in caught.value.fix
    assert str(log) in caught.value.where
