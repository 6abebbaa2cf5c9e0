"""Numbers of rows as a column of a log that has no clock."""

from pathlib import Path

import numpy as np
import polars as pl

from steelyard.logs.clocks_and_combined_logs import Numbered
from steelyard.logs.formats import open_log
from steelyard.robot.file.signals import ROW


def test_rows_are_numbered_from_the_first_whatever_is_read(tmp_path: Path) -> None:
    values = np.arange(10.0) ** 2
    pl.DataFrame({"a": values, "b": -values}).write_parquet(tmp_path / "log.parquet")
    log = Numbered(open_log(tmp_path / "log.parquet"))
    assert log.columns == ("a", "b", ROW)
    parts = list(log.parts(("b", ROW, "a"), (3, 9), 4))
    assert [len(part) for part in parts] == [4, 2]
    whole = np.concatenate(parts)
    np.testing.assert_array_equal(whole[:, 1], np.arange(3.0, 9.0))
    np.testing.assert_array_equal(whole[:, [0, 2]], np.stack((-values, values), axis=1)[3:9])
    (alone,) = log.parts((ROW,), (2, 5))
    np.testing.assert_array_equal(alone[:, 0], [2.0, 3.0, 4.0])
