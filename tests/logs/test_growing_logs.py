"""Rows of logs that are still being written."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from bag_writers import joint_state, write_mcap
from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log
from steelyard.logs.growing_logs import BATCH_ROWS, file_pieces, pipe_pieces, rows_of, rows_of_lines

WANTED = ("t", "b")
TABLE = b"Recorder 3.1\ngain 2\n# free text\nt,a,b\n0,1,2\n0.1,1.5,3\n\n0.2,x,\n0.3,1,4\n0.4,1"
ROWS = [[0.0, 2.0], [0.1, 3.0], [0.2, np.nan], [0.3, 4.0]]
OBJECTS = (
    b'{"t": 0, "b": 2, "c": [1]}\n{"b": 3, "t": 0.1}\n{"t": 0.2, "b": "x"}\n{"t": 0.3, "b": 4}\n'
)


def cut(text: bytes, size: int) -> list[bytes]:
    return [text[k : k + size] for k in range(0, len(text), size)]


def read(pieces: Iterable[bytes]) -> Array:
    return np.concatenate(list(rows_of_lines(Path("x"), WANTED, pieces)))


@pytest.mark.parametrize("size", [1, 2, 3, 7, 20, 1000])
@pytest.mark.parametrize("text", [TABLE, OBJECTS], ids=["csv", "json"])
def test_rows_are_the_same_however_the_bytes_are_cut(text: bytes, size: int) -> None:
    found = read(cut(text, size))
    assert np.array_equal(found[:4], ROWS, equal_nan=True)
    assert np.isnan(found[4:]).all() and len(found) == (5 if text is TABLE else 4)


def test_other_separators_and_a_broken_line_of_json() -> None:
    semicolons = b"t;b\n0,5;1,25\n1,0;2\n"
    assert read([semicolons]).tolist() == [[0.5, 1.25], [1.0, 2.0]]
    broken = read([b'{"t": 0, "b": 1}\n{"t": 1, "b"\n[3]\n'])
    assert np.isnan(broken[1:]).all() and broken[0].tolist() == [0.0, 1.0]


def test_clocks_are_those_of_the_finished_log() -> None:
    pieces = [b"secs,nsecs,b\n3,500000000,1\n", b"3,750000000,2\n"]
    found = np.concatenate(list(rows_of_lines(Path("x"), ("time_s", "b"), pieces)))
    assert found.tolist() == [[3.5, 1.0], [3.75, 2.0]]
    found = read([b"t,a,b\n10:00:00.5,1,2\n10:00:00.75,1,3\n"])
    assert found.tolist() == [[36000.5, 2.0], [36000.75, 3.0]]


def test_lines_of_json_that_cannot_be_parsed_are_passed_over() -> None:
    deep = b'{"a":' * 50_000 + b"1" + b"}" * 50_000 + b"\n"
    huge = b'{"t": 1, "b": 1' + b"0" * 400 + b"}\n"
    found = read([deep, OBJECTS[:30], OBJECTS[30:], deep, huge])
    assert np.array_equal(found[1:5], ROWS, equal_nan=True)
    assert np.isnan(found[0]).all() and np.isnan(found[5]).all() and np.isnan(found[6, 1])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"{\n" * 600, "there is no table"),
        (b"", "there is no table"),
        (b"t,a\n0,1\n1,2\n", "has no column 'b'"),
        (b'{"t": 0}\n', "has no column 'b'"),
        (b"words\n" * 600, "there is no table"),
        (b"t,b\n" + b"1" * (1 << 21), "a line is longer than 1 MiB"),
    ],
)
def test_what_is_no_table_is_refused(text: bytes, words: str) -> None:
    with pytest.raises(LogError, match=words):
        read([text])


def appended(path: Path, pieces: Iterable[bytes]) -> Callable[[], bool]:
    """What a recorder does while the reader waits: it appends a piece, until it ends."""
    rest = iter(pieces)

    def waiting() -> bool:
        piece = next(rest, None)
        if piece is None:
            return False
        with path.open("ab") as file:
            file.write(piece)
        return True

    return waiting


def no_input() -> bytes:
    raise AssertionError("standard input is not read")


def test_a_file_that_grows(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.touch()
    rows = list(rows_of(str(path), WANTED, appended(path, cut(TABLE, 5)), no_input))
    assert len(rows) > 1 and np.array_equal(np.concatenate(rows)[:4], ROWS, equal_nan=True)


def test_a_file_that_is_cut_off_or_replaced_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(TABLE)

    def shorter() -> bool:
        path.write_bytes(b"t,b\n")
        return True

    def other() -> bool:
        (tmp_path / "new").write_bytes(TABLE)
        (tmp_path / "new").replace(path)
        return True

    for change in (other, shorter):
        with pytest.raises(LogError, match="replaced or cut off"):
            list(file_pieces(path, change))
        path.write_bytes(TABLE)


def test_a_pipe_ends_with_its_writer_or_when_nobody_waits() -> None:
    pieces = cut(TABLE, 9)
    given = iter([*pieces, b""])
    assert list(pipe_pieces(lambda: next(given), lambda: True)) == pieces
    begun = iter([b"t,b\n"])

    def read() -> bytes:
        return next(begun, b"")

    assert b"".join(pipe_pieces(read, lambda: True)) == b"t,b\n"


@pytest.mark.parametrize(
    ("name", "words"), [("gone.csv", "no such file"), ("run.parquet", "cannot be read while")]
)
def test_sources_that_cannot_be_read(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "run.parquet").touch()
    with pytest.raises(LogError, match=words):
        list(rows_of(str(tmp_path / name), WANTED, lambda: False, no_input))


JOINTS = ["one", "two"]
COLUMNS = (
    "/joint_states/stamp",
    "/joint_states/position/one",
    "/joint_states/effort/two",
    "/more/position/one",
)


def recorded(tmp_path: Path, compression: str) -> Path:
    notes = []
    for k in range(400):
        q = [0.01 * k, -0.01 * k]
        notes.append(joint_state(10_000_000 * k, JOINTS, q, q, q))
        notes.append(joint_state(10_000_000 * k - 1, JOINTS, q, q, q, topic="/more"))
    return write_mcap(tmp_path / "whole.mcap", notes, compression, chunk=5000)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_mcap_that_grows_has_the_rows_of_the_finished_file(
    compression: str, tmp_path: Path
) -> None:
    whole = recorded(tmp_path, compression)
    wanted = np.concatenate(list(open_log(whole).parts(COLUMNS)))
    data, path = whole.read_bytes(), tmp_path / "run.mcap"
    path.write_bytes(data[:3])
    waiting = appended(path, cut(data[3:], 2777))
    parts = list(rows_of(str(path), COLUMNS, waiting, no_input))
    assert np.array_equal(np.concatenate(parts), wanted, equal_nan=True)
    assert len(wanted) == 400 and max(map(len, parts)) <= BATCH_ROWS


def test_mcap_that_ends_in_the_middle_gives_what_is_there(tmp_path: Path) -> None:
    whole = recorded(tmp_path, "zstd")
    wanted = np.concatenate(list(open_log(whole).parts(COLUMNS)))
    data, path = whole.read_bytes(), tmp_path / "run.mcap"
    path.write_bytes(data[: len(data) // 2])
    found = np.concatenate(list(rows_of(str(path), COLUMNS, lambda: False, no_input)))
    assert 100 < len(found) < 300
    assert np.array_equal(found[:-1], wanted[: len(found) - 1], equal_nan=True)


def test_mcap_without_the_columns_is_refused(tmp_path: Path) -> None:
    whole = recorded(tmp_path, "none")
    with pytest.raises(LogError, match="has no column '/joint_states/position/three'"):
        list(rows_of(str(whole), ("/joint_states/position/three",), lambda: True, no_input))
