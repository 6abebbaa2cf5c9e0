"""What needs an optional package says how it is installed; the rest works without."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import PackageError, available
from steelyard.base.progress import module_command
from steelyard.logs.formats import open_log, write_table, writer_for
from steelyard.report.result import frame

COLUMNS = {"time_s": np.array([0.0, 0.1, 0.2]), "q1_rad": np.array([1e-7, np.nan, -1.5])}


@pytest.fixture
def without_polars(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a Parquet file, where Polars cannot be imported."""
    pl.DataFrame(COLUMNS).write_parquet(tmp_path / "run.parquet")
    monkeypatch.setitem(sys.modules, "polars", None)
    return tmp_path


def test_a_package_is_available_or_not(without_polars: Path) -> None:
    assert available("numpy") and not available("polars")


@pytest.mark.parametrize(
    ("use", "what", "where"),
    [
        (lambda f: open_log(f / "run.parquet"), "Parquet files need", "run.parquet"),
        (lambda f: open_log(f), "Parquet files need", "run.parquet"),
        (lambda f: write_table(f / "new.parquet", COLUMNS), "Parquet files need", "new.parquet"),
        (
            lambda f: writer_for(f / "new.parquet")(f / "new.parquet", ["q"]).__enter__(),
            "Parquet files need",
            "new.parquet",
        ),
        (lambda f: frame([{"a": 1}], "scores"), "data frames need", "scores"),
    ],
)
def test_what_needs_polars_says_how_to_install_it(
    use: object, what: str, where: str, without_polars: Path
) -> None:
    with pytest.raises(PackageError, match=f"{what} the package polars") as caught:
        use(without_polars)  # type: ignore[operator]
    assert caught.value.where.endswith(where)
    source = 'pip install ".[polars]" in the source of steelyard'
    assert caught.value.fix == f"pip install polars, or {source}"
    assert not (without_polars / "new.parquet").exists()


def test_tables_are_written_and_read_without_polars(without_polars: Path) -> None:
    path = without_polars / "run.csv"
    write_table(path, COLUMNS)
    assert path.read_bytes().splitlines()[0] == b"time_s,q1_rad"
    log = open_log(path)
    (part,) = log.parts(log.columns)
    np.testing.assert_array_equal(part, np.column_stack(list(COLUMNS.values())))


def test_a_process_runs_the_module_of_the_package_and_none_of_the_folder(
    tmp_path: Path,
) -> None:
    (tmp_path / "platform.py").write_text("raise SystemExit('the module of the folder ran')")
    done = subprocess.run(module_command("platform"), cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and sys.platform[:3] in done.stdout.lower(), done.stderr
