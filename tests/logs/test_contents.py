"""What is listed of a log, and windows of it."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.base.progress import Event, Stopped
from steelyard.logs.contents import content_of, kind_of, windowed
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import Cut


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "run.csv"
    rows = [[5000 + 10 * k, 0.1 * k, "x" if k % 4 == 0 else -k] for k in range(200)]
    rows[20][0] = "oops"  # has a repeated time stamp
    path.write_text("\n".join(",".join(map(str, row)) for row in [["t_ms", "q1", "a"], *rows]))
    return path


def test_columns_are_counted(path: Path) -> None:
    content = content_of(open_log(path))
    assert (content.rows, content.format, content.size) == (200, "text table", path.stat().st_size)
    assert content.time is not None and content.time.name == "t_ms" and content.time.unit == "ms"
    assert content.duration == pytest.approx(1.99) and content.rate == pytest.approx(100.0)
    time, q1, a = content.columns
    assert (time.kind, q1.kind, a.kind) == ("time", "position", "")
    assert (q1.first, q1.least, q1.most, q1.missing) == (0.0, 0.0, pytest.approx(19.9), 0.0)
    assert (a.first, a.least, a.most, a.missing) == (None, -199.0, -1.0, 0.25)


@pytest.mark.parametrize(
    ("cut", "rows"),
    [
        (Cut(), range(200)),
        (Cut(rows=(3, 9)), range(3, 9)),
        (Cut(seconds=(0.145, 0.245)), range(15, 25)),
        (Cut(seconds=(-np.inf, 0.045)), range(5)),
        (Cut(seconds=(1.9, np.inf)), range(190, 200)),
        (Cut(seconds=(0.195, 0.225)), range(21, 23)),
        (Cut(seconds=(5.0, 6.0)), range(0)),
    ],
)
def test_windows(path: Path, cut: Cut, rows: range) -> None:
    parts = list(windowed(open_log(path), ("q1",), cut))
    found = np.concatenate(parts)[:, 0] if parts else np.zeros(0)
    np.testing.assert_allclose(found, 0.1 * np.array(rows))
    assert content_of(open_log(path), cut).rows == len(rows)


def test_seconds_need_time(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("q1,a\n0,1\n1,2\n")
    with pytest.raises(LogError, match="none of its columns looks like time") as caught:
        list(windowed(open_log(path), ("q1",), Cut(seconds=(0.0, 1.0))))
    assert "LOG#START:STOP" in caught.value.fix and caught.value.where.endswith("run.csv@0:1")
    content = content_of(open_log(path))
    assert (content.time, content.duration, content.rate) == (None, None, None)


def test_columns_of_one_name_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,a,a\n0,1,2\n1,2,3\n")
    content = content_of(open_log(path))
    assert [column.name for column in content.columns] == ["t"]
    assert content.left_out == (("a", "2 columns are called so"),)


def test_it_can_be_stopped(path: Path) -> None:
    events: list[Event] = []
    with pytest.raises(Stopped):
        content_of(open_log(path), Cut(), lambda event: events.append(event) is not None)
    assert events[0].phase == "reading the log" and events[0].done > 0


def test_kinds_of_folders(tmp_path: Path) -> None:
    assert kind_of(tmp_path) == "Parquet folder"
    (tmp_path / "metadata.yaml").write_text("")
    assert kind_of(tmp_path) == "ROS 2 bag"
