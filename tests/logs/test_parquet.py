from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import LogError
from steelyard.logs.contents import content_of
from steelyard.logs.formats import open_log


def test_numbers_of_every_kind_become_floats(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pl.DataFrame(
        {
            "i": pl.Series([1, None, 3], dtype=pl.Int32),
            "f": pl.Series([1.5, float("nan"), 2.5], dtype=pl.Float32),
            "s": ["0.25", "abc", None],
            "none": pl.Series([None, None, None], dtype=pl.Null),
        }
    ).write_parquet(path)
    (part,) = open_log(path).parts(("i", "f", "s", "none"))
    nan = np.nan
    np.testing.assert_array_equal(
        part, [[1.0, 1.5, 0.25, nan], [nan, nan, nan, nan], [3.0, 2.5, nan, nan]]
    )


@pytest.mark.parametrize("content", [b"time,q\n0,1\n", b"PAR1" + b"\x00" * 40])
def test_another_kind_of_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.parquet"
    path.write_bytes(content)
    with pytest.raises(LogError, match="cannot be read as Parquet") as caught:
        open_log(path)
    assert ".csv" in caught.value.fix


def test_half_a_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pl.DataFrame({"a": np.arange(1000.0)}).write_parquet(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match="cannot be read as Parquet"):
        open_log(path)


def test_columns_without_numbers_are_left_out_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    columns = {
        "t": [0.0, 0.1],
        "q": [[1.0] * 257, [3.0, 4.0]],
        "on": [[True, False], [False, False]],
        "pose": [{"x": 1.0}, {"x": 2.0}],
        "grid": [[[1.0]], [[2.0]]],
    }
    pl.DataFrame(columns).write_parquet(path)
    log = open_log(path)
    assert log.columns == ("t", "on_1", "on_2")
    assert np.concatenate(list(log.parts(("on_1",)))).ravel().tolist() == [1.0, 0.0]
    why = dict(log.left_out)
    assert list(why) == ["pose", "grid", "q"] and "257 elements" in why["q"]
    assert [name for name, _ in content_of(log).left_out] == ["pose", "grid", "q"]
    with pytest.raises(LogError, match="no column 'q'"):
        list(log.parts(("q",)))
