"""Broken files of tables: an error or a table; `proofs/logs/fuzzing.py` does it at length.

HDF5 is read by a process of its own, which takes too long for many cases here.
"""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log

TABLE = np.random.default_rng(0).normal(size=(40, 4))


def sound(folder: Path, suffix: str) -> bytes:
    path = folder / f"sound{suffix}"
    arrays = {"t": TABLE[:, 0], "q": TABLE[:, 1:]}
    frame = pl.DataFrame(TABLE, schema=["t", "q_1", "q_2", "q_3"])
    if suffix == ".npz":
        np.savez_compressed(path, **arrays)
    elif suffix == ".npy":
        np.save(path, TABLE)
    elif suffix == ".mat":
        scipy.io.savemat(path, arrays | {"data": arrays}, do_compression=False)
    elif suffix == ".parquet":
        frame.write_parquet(path, row_group_size=16)
    else:
        frame.write_csv(path)
    return path.read_bytes()


changes = st.lists(
    st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.binary(min_size=0, max_size=8)),
    max_size=4,
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".npy", ".mat"])
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60
)
@given(changes=changes, length=st.floats(0.0, 1.0), cut=st.booleans())
def test_broken_files_are_an_error_or_a_table(
    suffix: str,
    changes: list[tuple[float, bytes]],
    length: float,
    cut: bool,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    data = bytearray(sound(folder, suffix))
    for place, content in changes:
        at = int(place * len(data))
        data[at : at + len(content)] = content
    path = folder / f"broken{suffix}"
    path.write_bytes(data[: int(length * len(data))] if cut else data)
    try:
        log = open_log(path)
        names = [name for name in log.columns if log.columns.count(name) == 1]
        parts = list(log.parts(names))
    except LogError as error:
        assert error.wrong and error.fix and str(path) in error.where
        return
    assert all(part.dtype == np.float64 and part.shape[1] == len(names) for part in parts)


def test_a_page_of_too_many_values_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    frame = pl.DataFrame({"t": np.zeros(1 << 22)})
    frame.write_parquet(path, row_group_size=1 << 22, data_page_size=1 << 30)
    with pytest.raises(LogError, match="one of its pages holds 4194304 values") as caught:
        open_log(path)
    assert caught.value.where == str(path)


def test_columns_of_long_pages_are_read_a_few_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    rows = 1 << 19
    table = {f"c{k}": np.arange(rows) % 7 + 0.5 * k for k in range(9)}
    frame = pl.DataFrame(table)
    frame.write_parquet(path, row_group_size=rows, data_page_size=1 << 30)
    names = [f"c{k}" for k in (3, 1, 8, 0, 7)]
    (part,) = open_log(path).parts(names, (1000, 2000))
    np.testing.assert_array_equal(part, frame[1000:2000].select(names).to_numpy())
