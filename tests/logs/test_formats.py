"""Laws over all formats: what was written is read, in parts of any size, from any row."""

from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.base.errors import LogError
from steelyard.logs.formats import FORMATS, open_log
from steelyard.logs.log_and_errors import Log

COLUMNS = ("time_s", "q1_rad", "q2_rad", "current1_A")
TABLE = np.arange(240.0).reshape(60, 4) / 7.0


MESSAGES = {".mcap", ".active", ".bag", ".db3", ".zstd"}
"""Logs of messages have laws of their own."""

SUFFIXES = sorted(set(FORMATS) - MESSAGES)
OPENERS = sorted({FORMATS[suffix]: suffix for suffix in SUFFIXES}.values())
"""One suffix of each opener."""


def write(path: Path) -> None:
    frame = pl.DataFrame(TABLE, schema=list(COLUMNS), orient="row")
    arrays = dict(zip(COLUMNS, TABLE.T, strict=True))
    if path.suffix == ".parquet":
        frame.write_parquet(path, row_group_size=16)
    elif path.suffix == ".npz":
        np.savez_compressed(path, **arrays)
    elif path.suffix == ".npy":
        np.save(path, frame.to_numpy(structured=True))
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays, do_compression=True)
    elif path.suffix in (".h5", ".hdf5"):
        with h5py.File(path, "w", track_order=True) as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=values, chunks=(16,), compression="gzip")
    elif path.suffix in (".csv", ".tsv", ".txt"):
        frame.write_csv(path)
    else:
        raise NotImplementedError(f"write a sound {path.suffix} file here")


@pytest.fixture(scope="module", params=SUFFIXES)
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = tmp_path_factory.mktemp("logs") / f"run{request.param}"
    write(path)
    return open_log(path)


def test_columns_are_named(log: Log) -> None:
    assert log.columns == COLUMNS


@pytest.mark.parametrize("log", OPENERS, indirect=True)
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=10
)
@given(
    size=st.integers(1, 70),
    start=st.integers(0, 70),
    stop=st.none() | st.integers(0, 70),
    columns=st.permutations(COLUMNS).flatmap(
        lambda order: st.integers(1, 4).map(lambda n: tuple(order[:n]))
    ),
)
def test_parts_are_the_table(
    log: Log, size: int, start: int, stop: int | None, columns: tuple[str, ...]
) -> None:
    parts = list(log.parts(columns, (start, stop), size))
    assert all(0 < len(part) <= size for part in parts)
    wanted = TABLE[start:stop][:, [COLUMNS.index(c) for c in columns]]
    read = np.concatenate(parts) if parts else wanted[:0]
    np.testing.assert_array_equal(read, wanted)


def test_a_missing_column_is_named_with_its_neighbours(log: Log) -> None:
    with pytest.raises(LogError) as caught:
        list(log.parts(("time_s", "q1_rd")))
    assert caught.value.wrong == "the log has no column 'q1_rd'"
    assert "'q1_rad'" in caught.value.fix
    assert "[signals]" in caught.value.fix
    assert caught.value.where == str(log.path)


def test_a_log_without_time_is_offered_its_rate(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("q1,tau1\n" + "0.1,0.2\n" * 3)
    for columns in (["time_s", "q1"], ["t", "q1", "tau1"]):
        with pytest.raises(LogError) as caught:
            list(open_log(path).parts(columns))
        assert caught.value.wrong == f"the log has no column '{columns[0]}'"
        assert "state rate = HZ instead of time" in caught.value.fix
    with pytest.raises(LogError) as caught:
        list(open_log(path).parts(["q1", "tau1", "target"]))
    assert "rate" not in caught.value.fix


def test_several_missing_columns_are_counted(log: Log) -> None:
    with pytest.raises(LogError) as caught:
        list(log.parts(("time_s", "a", "b", "c")))
    assert caught.value.wrong == (
        "3 of the 4 columns that are needed are not in the log: 'a', 'b', 'c'"
    )
    with pytest.raises(LogError, match=r"5 of the 6 .*: 'a', 'b', 'c', 'd', \.\.\."):
        list(log.parts(("time_s", *"abcde")))


def test_a_misspelt_pattern_is_matched_column_by_column(log: Log) -> None:
    with pytest.raises(LogError) as caught:
        list(log.parts(("time_s", "qq1_rad", "qq2_rad")))
    assert caught.value.fix.startswith("did you mean 'q1_rad', 'q2_rad'?; ")


@pytest.mark.parametrize(
    ("missing", "offered"),
    [("actual_q_5", "did you mean 'q_5'?; "), ("w_position", "the other columns are wr_s, ")],
)
def test_similar_columns_are_not_hidden_behind_others(
    tmp_path: Path, missing: str, offered: str
) -> None:
    path = tmp_path / "run.csv"
    names = ["time_s", *(f"x{k}" for k in range(20)), "wr_s", "q_5"]
    path.write_text(",".join(names) + "\n" + ",".join("1" for _ in names) + "\n")
    with pytest.raises(LogError) as caught:
        list(open_log(path).parts(["time_s", missing]))
    assert caught.value.fix.startswith(offered)


@pytest.mark.parametrize("other", ["dq2_rad_s", "ddq2_rad_s2", "q2_deg", "q2_ref_rad"])
def test_columns_of_another_quantity_or_unit_are_not_proposed(tmp_path: Path, other: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"time_s,q1_rad,{other}\n0.0,1.0,2.0\n")
    with pytest.raises(LogError) as caught:
        list(open_log(path).parts(["time_s", "q1_rad", "q2_rad"]))
    assert caught.value.fix.startswith(f"the other columns are {other};")


def test_columns_that_are_used_already_are_not_proposed(log: Log) -> None:
    used = tuple(log.columns[:-1])
    with pytest.raises(LogError) as caught:
        list(log.parts((*used, "q9_rad")))
    assert not any(f"'{name}'" in caught.value.fix for name in used)
    with pytest.raises(LogError) as caught:
        list(log.parts((*log.columns, "q9_rad")))
    assert caught.value.fix.startswith("all columns of the log are used: log this one too")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_cannot_be_read_is_reported(tmp_path: Path, suffix: str) -> None:
    missing = tmp_path / f"runn{suffix}"
    (tmp_path / f"run{suffix}").write_bytes(b"")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(LogError, match="no such log file") as caught:
        open_log(missing)
    assert f"run{suffix}" in caught.value.fix
    with pytest.raises(LogError, match="no such log file") as caught:
        open_log(tmp_path / f"run{suffix}[0:10]")
    assert "LOG@START:STOP" in caught.value.fix
    (tmp_path / "model.urdf").write_text("no log")
    with pytest.raises(LogError) as caught:
        open_log(tmp_path / f"2026-11-23_17-05-42{suffix}")
    assert caught.value.fix == f"the logs there are folder{suffix}, run{suffix}"
    with pytest.raises(LogError) as caught:
        open_log(tmp_path / "none" / f"run{suffix}")
    assert "there is no folder" in caught.value.fix
    with pytest.raises(LogError, match="is empty"):
        open_log(tmp_path / f"run{suffix}")
    with pytest.raises(LogError, match="the folder holds no log"):
        open_log(tmp_path / f"folder{suffix}")


def test_an_unknown_suffix_lists_the_known_ones(tmp_path: Path) -> None:
    (tmp_path / "run.xlsx").write_bytes(b"PK")
    with pytest.raises(LogError, match="'.xlsx'") as caught:
        open_log(tmp_path / "run.xlsx")
    assert ".parquet" in caught.value.fix and ".csv" in caught.value.fix
