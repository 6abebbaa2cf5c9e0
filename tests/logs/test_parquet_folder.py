"""Folders of Parquet files that continue each other."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.base.errors import LogError
from steelyard.logs.parquet import ParquetLog

LENGTHS = (13, 1, 0, 20, 6)
TABLE = np.arange(2.0 * sum(LENGTHS)).reshape(-1, 2)


def write(path: Path, table: np.ndarray, columns: tuple[str, ...] = ("t", "q")) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pl.DataFrame(table, schema=list(columns), orient="row").write_parquet(path, row_group_size=7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs") / "run"
    names = ["day=1/part-2", "day=1/part-10", "day=2/part-1", "day=10/part-1", "day=10/part-1-b"]
    start = 0
    for name, length in zip(names, LENGTHS, strict=True):
        write(folder / f"{name}.parquet", TABLE[start : start + length])
        start += length
    write(folder / "_metadata" / "x.parquet", TABLE[:3])
    write(folder / ".hidden.parquet", TABLE[:3])
    (folder / "_SUCCESS").write_text("")
    return folder


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(size=st.integers(1, 50), start=st.integers(0, 50), stop=st.none() | st.integers(0, 50))
def test_rows_continue_in_the_natural_order_of_names(
    folder: Path, size: int, start: int, stop: int | None
) -> None:
    log = ParquetLog.of_folder(folder)
    parts = list(log.parts(("q", "t"), (start, stop), size))
    assert all(0 < len(part) <= size for part in parts)
    found = np.concatenate(parts) if parts else TABLE[:0]
    np.testing.assert_array_equal(found, TABLE[start:stop, ::-1])
    assert log.n_rows == len(TABLE)


def test_columns_may_be_in_another_order(tmp_path: Path) -> None:
    write(tmp_path / "a.parquet", TABLE[:3])
    write(tmp_path / "b.parquet", TABLE[3:6, ::-1], ("q", "t"))
    (first, second) = ParquetLog.of_folder(tmp_path).parts(("t", "q"))
    np.testing.assert_array_equal(np.concatenate((first, second)), TABLE[:6])


def test_other_columns_are_named_with_both_files(tmp_path: Path) -> None:
    write(tmp_path / "a.parquet", TABLE[:3])
    write(tmp_path / "b.parquet", TABLE[:3], ("t", "q2"))
    with pytest.raises(LogError, match="the second has no 'q', also 'q2'") as caught:
        ParquetLog.of_folder(tmp_path)
    assert "a.parquet and" in caught.value.where and "b.parquet" in caught.value.where


def test_a_folder_without_logs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="the folder holds no log") as caught:
        ParquetLog.of_folder(tmp_path)
    assert "metadata.yaml" in caught.value.fix


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    write(tmp_path / "a.parquet", TABLE[:3])
    (tmp_path / "b.parquet").write_bytes(b"PAR1 no PAR1")
    with pytest.raises(LogError, match="cannot be read as Parquet") as caught:
        ParquetLog.of_folder(tmp_path)
    assert "b.parquet" in caught.value.where
    (tmp_path / "c.parquet").write_bytes(b"")
    (tmp_path / "b.parquet").unlink()
    with pytest.raises(LogError, match="is empty"):
        ParquetLog.of_folder(tmp_path)
