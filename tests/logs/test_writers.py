"""What is written is read back bit for bit, in every format."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bag_writers import joint_state, write_bag2
from steelyard.base.errors import OutputError
from steelyard.logs.formats import WRITERS, matlab_names, open_log, parquet, writer_for

COLUMNS = ("t", "q_1", "q, in \"rad\"")  # fmt: skip
SUFFIXES = sorted(WRITERS)


def written(path: Path, table: np.ndarray, columns: Sequence[str], size: int = 5) -> Path:
    with writer_for(path)(path, columns) as write:
        for start in range(0, len(table), size):
            write(table[start : start + size])
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=6
)
@given(
    table=arrays(
        np.float64,
        st.tuples(st.integers(2, 30), st.just(3)),
        elements=st.floats(allow_subnormal=True, width=64),
    ),
    size=st.integers(1, 31),
)
def test_every_bit_comes_back(
    suffix: str, table: np.ndarray, size: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    table[np.isnan(table)] = np.nan  # one NaN is like another
    path = written(tmp_path_factory.mktemp("w") / f"run{suffix}", table, COLUMNS, size)
    log = open_log(path)
    assert len(log.columns) == 3
    found = np.concatenate(list(log.parts(log.columns)))
    found[np.isnan(found)] = np.nan
    assert found.tobytes() == table.tobytes()
    if suffix != ".mat":
        assert log.columns == COLUMNS


TABLE = np.random.default_rng(0).normal(size=(40, 3))


def test_other_readers_read_them(tmp_path: Path) -> None:
    names = ("t", "/joints/q", "a b")
    for suffix in SUFFIXES:
        written(tmp_path / f"run{suffix}", TABLE, names, 7)
    np.testing.assert_array_equal(pl.read_csv(tmp_path / "run.csv").to_numpy(), TABLE)
    np.testing.assert_array_equal(pl.read_parquet(tmp_path / "run.parquet").to_numpy(), TABLE)
    with np.load(tmp_path / "run.npz") as archive:
        np.testing.assert_array_equal(archive["/joints/q"], TABLE[:, 1])
    matrices = scipy.io.loadmat(tmp_path / "run.mat")
    np.testing.assert_array_equal(matrices["joints_q"], TABLE[:, 1:2])
    np.testing.assert_array_equal(matrices["a_b"], TABLE[:, 2:])
    with h5py.File(tmp_path / "run.h5") as file:
        np.testing.assert_array_equal(file["joints/q"][:], TABLE[:, 1])


def test_many_columns_and_no_rows(tmp_path: Path) -> None:
    names = [f"column_with_a_long_name_{k}" for k in range(300)]
    path = written(tmp_path / "run.parquet", np.ones((9, 300)), names)
    assert pl.read_parquet(path).columns == names
    empty = written(tmp_path / "none.parquet", np.zeros((0, 2)), ("a", "b"))
    assert pl.read_parquet(empty).shape == (0, 2)


def test_a_bag_in_sqlite_becomes_parquet(tmp_path: Path) -> None:
    """SQLite serves the thread that opened it, Polars draws rows by threads of its own."""
    notes = [joint_state(k * 10**6, ["a"], [k], [0], [0]) for k in range(200)]
    log = open_log(write_bag2(tmp_path / "run", notes))
    with writer_for(tmp_path / "run.parquet")(tmp_path / "run.parquet", log.columns) as write:
        for part in log.parts(log.columns, size=30):
            write(part)
    found = pl.read_parquet(tmp_path / "run.parquet")["/joint_states/position/a"]
    np.testing.assert_array_equal(found.to_numpy(), np.arange(200.0))


def test_parquet_is_written_in_bounded_memory(tmp_path: Path, peak: Callable[[], float]) -> None:
    part = np.random.default_rng(0).normal(size=(50_000, 20))
    with parquet(tmp_path / "run.parquet", [f"c{k}" for k in range(20)]) as write:
        for _ in range(40):
            write(part)
    assert pl.scan_parquet(tmp_path / "run.parquet").select(pl.len()).collect().item() == 2_000_000
    assert peak() < 200.0  # of 305 MiB


@pytest.mark.skipif(sys.platform != "linux", reason="this disk is always full on Linux only")
def test_a_full_disk_is_reported_by_the_system() -> None:
    with pytest.raises(OSError), parquet(Path("/dev/full"), ("t",)) as write:
        write(np.zeros((1000, 1)))


def test_names_for_matlab() -> None:
    given = ["q", "/arm/q[1]", "1st", "", "é", "q!", "a" * 70, "a" * 71]
    assert matlab_names(given) == ["q", "arm_q_1", "x1st", "x", "x_2", "q_2", "a" * 63,
                                   "a" * 61 + "_2"]  # fmt: skip


def test_files_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        writer_for(tmp_path / "run.csv")
    with pytest.raises(OutputError, match="cannot be written as '.bag'") as caught:
        writer_for(tmp_path / "run.bag")
    assert ", ".join(WRITERS) in caught.value.fix


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".h5"])
def test_two_columns_of_one_name_are_refused(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(OutputError, match="two columns would be called 'q'"):
        written(tmp_path / f"run{suffix}", TABLE, ("t", "q", "q"))


def test_a_dataset_cannot_be_a_group_too(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be paths in HDF5") as caught:
        written(tmp_path / "run.h5", TABLE, ("q", "q/1", "t"))
    assert "--columns" in caught.value.fix
