import sys
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.logs import text_table as delimited_module
from steelyard.logs.contents import TimeColumn, content_of
from steelyard.logs.formats import open_log
from steelyard.robot.init.guess_columns import guess_columns
from steelyard.robot.robot import Coordinate
from steelyard.runs.runs_of_named_logs import sample_of

NAN = np.nan


@pytest.fixture(autouse=True, params=["with Polars, kept", "without Polars, read at each pass"])
def polars(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param.startswith("without Polars"):
        monkeypatch.setitem(sys.modules, "polars", None)
        monkeypatch.setattr(delimited_module, "SMALL", 0)


def read(
    path: Path, content: str | bytes, columns: tuple[str, ...] = ("t", "a", "b")
) -> np.ndarray:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return np.concatenate(list(open_log(path).parts(columns)))


@pytest.mark.parametrize(
    "content",
    [
        "t,a,b\n0,1.5,-2e-1\n1,2.5,3\n",
        "t;a;b\n0;1.5;-2e-1\n1;2.5;3\n",
        "t;a;b\n0;1,5;-0,2\n1;2,5;3\n",
        "t\ta\tb\r\n0\t1.5\t-0.2\r\n1\t2.5\t3\r\n",
        "t a b\n0 1.5 -0.2\n1 2.5 3",
        "   t    a     b\n   0  1.5  -0.2 \n   1  2.5   3\n",
        '"t","a","b"\n"0","1.5","-0.2"\n1,2.5,3\n\n\n',
        "# t, a, b\n0, 1.5, -0.2\n1, 2.5, 3\n",
        "%t,a,b\n0,1.5,-0.2\n1,2.5,3\n",
        "\n\nt,a,b\n0,1.5,-0.2\n1,2.5,3\n",
        b"\xef\xbb\xbft,a,b\n0,1.5,-0.2\n1,2.5,3\n",
    ],
)
def test_dialects(tmp_path: Path, content: str | bytes) -> None:
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", content), [[0.0, 1.5, -0.2], [1.0, 2.5, 3.0]]
    )


@pytest.mark.parametrize(
    "content",
    [
        "what is all of this and all that\nis text, and no table\nof 3 numbers\n",
        "all that is all\n",
        "a, b, a\nsome text\n# 1, 2, 3\n",
    ],
)
def test_text_that_is_no_table_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(LogError, match="does not look like a table"):
        read(tmp_path / "bad.csv", content)


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        ("t,a,b\n", ("t", "a", "b")),
        ("t a b\n", ("t", "a", "b")),
        ("t,a,b\n0,left,right\n", ("t", "a", "b")),
        ("t,a,b\n,,\n", ("t", "a", "b")),
        ("t,a,b\nnothing here\n", ("t", "a", "b")),
        ("t a b\n0 left right\n", ("t", "a", "b")),
    ],
)
def test_tables_with_few_numbers_are_read(
    tmp_path: Path, content: str, columns: tuple[str, ...]
) -> None:
    path = tmp_path / "few.csv"
    path.write_text(content)
    assert open_log(path).columns == columns


def test_broken_cells_are_nan_and_no_row_is_lost(tmp_path: Path) -> None:
    content = (
        b"t,a,b\n0,1,2\n1,oops,2\n2,,2\n3,1e293,inf\n4,1\n5,1,2,9,9\n\n"
        b'7,"1,2\n8,\xff\xfe,2\n9,\x001,2\n10,"x,y",2\n11,1'
    )
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", content),
        [
            [0, 1, 2],
            [1, NAN, 2],
            [2, NAN, 2],
            [3, 1e293, np.inf],
            [4, 1, NAN],
            [5, 1, 2],
            [NAN, NAN, NAN],
            [7, 1, 2],
            [8, NAN, 2],
            [9, NAN, 2],
            [10, NAN, 2],
            [11, 1, NAN],
        ],
    )


def test_a_first_row_that_is_cut_does_not_cut_the_table(tmp_path: Path) -> None:
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", "t,a,b\n0\n1,2,3\n"), [[0, NAN, NAN], [1, 2, 3]]
    )


def test_a_small_file_is_parsed_once_and_again_when_it_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(delimited_module, "SMALL", 40)
    parsed = []
    for name in ("by_polars", "by_numpy"):
        usual = getattr(delimited_module, name)
        counted = lambda *a, usual=usual: parsed.append(len(a[0])) or usual(*a)  # noqa: E731
        monkeypatch.setattr(delimited_module, name, counted)
    text = "t,a,b\n0,1,2\n1,2,3\n"
    first = read(tmp_path / "run.csv", text)
    (again,) = open_log(tmp_path / "run.csv").parts(("t", "a", "b"))
    np.testing.assert_array_equal(again, first)
    assert len(parsed) == 1
    with pytest.raises(ValueError, match="read-only"):
        again[0, 0] = 5.0
    list(open_log(tmp_path / "run.csv").parts(("b",)))
    assert len(parsed) == 2
    np.testing.assert_array_equal(read(tmp_path / "run.csv", text + "2,3,4\n")[-1], [2, 3, 4])
    large = text + "2,3,4\n" * 4
    for _ in range(2):
        assert len(read(tmp_path / "large.csv", large)) == 6
    assert len(parsed) == 5


def test_chunks_do_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delimited_module, "SMALL", 0)
    table = np.arange(300.0).reshape(100, 3)
    text = "t,a,b\n" + "".join(f"{a},{b},{c}\n" for a, b, c in table)
    whole = read(tmp_path / "run.csv", text)
    monkeypatch.setattr(delimited_module, "CHUNK", 7 * 11)
    np.testing.assert_array_equal(read(tmp_path / "run.csv", text), whole)
    np.testing.assert_array_equal(whole, table)
    parts = open_log(tmp_path / "run.csv").parts(("t", "a", "b"), (13, 57), 4)
    np.testing.assert_array_equal(np.concatenate(list(parts)), table[13:57])


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        ("0,1.5,-0.2\n1,2.5,3\n", "column_1 column_2 column_3"),
        ("0 1.5 -0.2\n1 2.5 3\n", "column_1 column_2 column_3"),
        ("0;1,5;-0,2\n1;2,5;3\n", "column_1 column_2 column_3"),
        ("0,5 1,5 -0,2\n1,5 2,5 3\n", "column_1 column_2 column_3"),
        ("t|a|b\n0|1.5|-0.2\n1|2.5|3\n", "t a b"),
        ("# robot: UR\n# day: 5, 2\nt,a,b\n0,1.5,-0.2\n1,2.5,3\n", "t a b"),
        ("% made by hand\n% t a b\n0 1.5 -0.2\n1 2.5 3\n", "t a b"),
        ("Log of a robot\nDay;5\nt;a;b\n0;1,5;-0,2\n1;2,5;3\n", "t a b"),
        ("time,0,1\n0,1.5,-0.2\n1,2.5,3\n", "time 0 1"),
        ("t [s], q a [rad], b [Nm]\n0, 1.5, -0.2\n1, 2.5, 3\n", "t_[s] q_a_[rad] b_[Nm]"),
        ("t,q_deg,b\n[s],[deg],\n0,1.5,-0.2\n1,2.5,3\n", "t_[s] q_deg b"),
        ("t,a,b\ns,rad,Nm\n0,1.5,-0.2\n1,2.5,3\n", "t_[s] a_[rad] b_[Nm]"),
        ("\ufeff# x\n\nt\ta\tb\n0\t1.5\t-0.2\n1\t2.5\t3\n", "t a b"),
    ],
)
def test_first_lines(tmp_path: Path, content: str, columns: str) -> None:
    (tmp_path / "run.csv").write_text(content, encoding="utf-8")
    log = open_log(tmp_path / "run.csv")
    assert [name.replace(" ", "_") for name in log.columns] == columns.split()
    (part,) = log.parts(log.columns)
    wanted = [[0.0, 1.5, -0.2], [1.0, 2.5, 3.0]]
    np.testing.assert_array_equal(part, wanted if "0,5 " not in content else
                                  [[0.5, 1.5, -0.2], [1.5, 2.5, 3.0]])  # fmt: skip


def test_broken_first_rows_are_rows(tmp_path: Path) -> None:
    table = read(tmp_path / "run.csv", "t,a,b\n,,\nxyz\n0,1,2\n")
    np.testing.assert_array_equal(table, [[NAN] * 3, [NAN] * 3, [0, 1, 2]])


def test_the_recorder_of_ur_is_read_and_guessed(tmp_path: Path) -> None:
    fields = {"timestamp": 0, "target_q": 6, "target_qd": 6, "target_current": 6,
              "target_moment": 6, "actual_q": 6, "actual_qd": 6, "actual_current": 6,
              "actual_current_window": 6, "joint_control_output": 6, "actual_TCP_pose": 6,
              "actual_TCP_speed": 6, "actual_TCP_force": 6, "joint_temperatures": 6,
              "actual_execution_time": 0, "robot_mode": 0, "joint_mode": 6, "actual_momentum": 0,
              "actual_tool_accelerometer": 3, "actual_robot_current": 0,
              "actual_joint_voltage": 6}  # fmt: skip
    names = [f"{n}_{k}" for n, c in fields.items() for k in range(c)] + [
        n for n, c in fields.items() if c == 0
    ]
    names.sort(key=lambda name: name != "timestamp")
    rows = [[0.002 * k, *(0.1 * k + 0.01 * c for c in range(1, len(names)))] for k in range(9)]
    path = tmp_path / "robot_data.csv"
    path.write_text("\n".join(" ".join(map(str, row)) for row in [names, *rows]) + "\n")
    log = open_log(path)
    assert log.columns == tuple(names)
    (part,) = log.parts(log.columns)
    np.testing.assert_array_equal(part, rows)
    arm = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    joints = [Coordinate(f"{name}_joint", "revolute") for name in arm]
    section = guess_columns(joints, log.columns, dict(zip(names, part.T, strict=True))).section
    assert section.time == "timestamp"
    assert section.position == tuple(f"actual_q_{k}" for k in range(6))
    assert section.effort.columns == tuple(f"actual_current_{k}" for k in range(6))


@pytest.mark.parametrize("line", [b"0," * 20_000 + b"0\n", b"t," * 300_000])
def test_lines_without_end_are_refused(tmp_path: Path, line: bytes) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(line)
    with pytest.raises(LogError, match="that is no table of a robot"):
        open_log(path)


def test_an_endless_row_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"t,a\n0,1\n" + b"1" * (1 << 25))
    with pytest.raises(LogError, match="hold no ended row"):
        list(open_log(path).parts(("t",)))


def test_short_lines_of_many_columns_are_parsed_by_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(delimited_module, "CELLS", 21)
    table = read(tmp_path / "run.csv", "t,a,b\n" + "0,1,2\n" * 100)
    np.testing.assert_array_equal(table, [[0.0, 1.0, 2.0]] * 100)


@pytest.mark.parametrize("content", [b"\n\n", b" \n"])
def test_a_blank_file_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LogError, match="holds no table"):
        read(tmp_path / "run.csv", content)


@pytest.mark.parametrize("content", ["t,a\n0,1\n".encode("utf-16"), b"PAR1\x00\x15,\x00\n"])
def test_what_is_no_text_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LogError, match="not a text table") as caught:
        read(tmp_path / "run.csv", content)
    assert ".parquet" in caught.value.fix


@pytest.mark.parametrize(
    ("separator", "cells"),
    [
        (",", ("2025-03-04 10:00:00.010", "2025-03-04 10:00:00.020")),
        (",", ("2025-03-04T10:00:00.010Z", "2025-03-04T11:00:00.02+01:00")),
        (",", ('"2025/03/04 10:00:00.010 UTC"', '"2025/03/04 05:00:00.020-0500"')),
        (";", ("2025-03-04 10:00:00.010", "2025-03-04 10:00:00.020")),
        (" ", ("2025-03-04T10:00:00.010", "2025-03-04T10:00:00.020")),
    ],
)
def test_times_in_text_are_seconds(tmp_path: Path, separator: str, cells: tuple[str, str]) -> None:
    mark = "," if separator == ";" else "."
    rows = [("t", "a", "b"), (cells[0], f"1{mark}5", "-1"), (cells[1], f"2{mark}5", "x:y")]
    found = read(tmp_path / "run.csv", "\n".join(map(separator.join, rows)))
    expected = [[1741082400.01, 1.5, -1.0], [1741082400.02, 2.5, NAN]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_times_of_a_day_are_seconds_and_other_text_is_none(tmp_path: Path) -> None:
    found = read(tmp_path / "run.csv", "t,a,b\n10:00:00.5,1,aa:bb:cc\n2025-13-04 10:00:01,2,3\n")
    np.testing.assert_array_equal(found, [[36000.5, 1.0, NAN], [NAN, 2.0, 3.0]])


@pytest.mark.parametrize(
    ("names", "joined", "unit"),
    [
        (("secs", "nsecs"), "time_s", 1e9),
        (("header.stamp.sec", "header.stamp.nanosec"), "header.stamp.time_s", 1e9),
        (("tv_sec", "tv_usec"), "tv_time_s", 1e6),
        (("stampSecs", "stampNsecs"), "stamp_time_s", 1e9),
    ],
)
def test_a_clock_in_two_columns_is_one(
    tmp_path: Path, names: tuple[str, str], joined: str, unit: float
) -> None:
    t = 0.7 + 0.01 * np.arange(100)
    rows = [f"{int(x)},{round(x % 1 * unit)},{k},{-k}" for k, x in enumerate(t)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([",".join([*names, "q1", "tau1"]), *rows]))
    log = open_log(path)
    assert log.columns == (joined, "q1", "tau1")
    parts = list(log.parts(("q1", joined), (10, 90), 30))
    assert [len(part) for part in parts] == [30, 30, 20]
    found = np.concatenate(parts)
    np.testing.assert_allclose(found[:, 1], t[10:90], atol=1e-6)
    np.testing.assert_array_equal(found[:, 0], np.arange(10.0, 90.0))
    assert content_of(log).time == TimeColumn(joined, "s")


def test_of_columns_that_are_copies_the_first_is_used(tmp_path: Path) -> None:
    rows = [f"{k},{k % 7},{k * k},{k % 7}" for k in range(2000)]
    table = read(tmp_path / "run.csv", "\n".join(["t,a,b,a", *rows]))
    np.testing.assert_array_equal(table[:, 1], np.arange(2000) % 7)
    log = open_log(tmp_path / "run.csv")
    assert log.columns == ("t", "a", "b")
    assert content_of(log).left_out == (("a", "a copy of the column of this name"),)
    rows[1900] += "1"
    with pytest.raises(LogError, match="2 columns that are called 'a'"):
        read(tmp_path / "run.csv", "\n".join(["t,a,b,a", *rows]))
    np.testing.assert_array_equal(
        np.concatenate(list(open_log(tmp_path / "run.csv").parts(("b",))))[:, 0],
        np.arange(2000) ** 2,
    )


def test_words_that_do_not_change_are_in_a_sample(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("%time,name0,mode,position0,effort0\n0,elbow,a,1,2\n1,elbow,b,2,3\n")
    columns, sample = sample_of(path)
    assert columns == ("time", "name0", "mode", "position0", "effort0")
    assert sample["name0"].tolist() == ["elbow"] and np.isnan(sample["mode"]).all()


def test_a_column_that_is_not_used_may_be_ambiguous(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,q1,tau1,x,x\n0,1,2,3,4\n1,2,3,4,5\n")
    columns, sample = sample_of(path)
    assert columns == ("t", "q1", "tau1", "x") and "x" not in sample
    assert guess_columns([Coordinate("joint1", "revolute")], columns, sample).joints == ("joint1",)


def test_a_name_given_twice_is_ambiguous(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="2 columns that are called 'a'"):
        read(tmp_path / "run.csv", "t,a,a\n0,1,2\n", ("t", "a"))
