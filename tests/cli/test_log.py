"""`steelyard log`: what is in a log, and the same log in another format."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.mistakes import LOG
from steelyard.cli.log_commands import chosen, size_text
from steelyard.logs.formats import open_log


def test_info_shows_columns_and_the_clock(command: Command) -> None:
    done = command("log", "info", LOG, f"{LOG}@1:2")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    rows = len(pl.read_csv(LOG))
    assert f"text table, {size_text(Path(LOG).stat().st_size)}, {rows} rows" in words
    assert "time is 'time_s' in s" in words and "column kind first least greatest missing" in words
    assert f"{LOG}@1:2 text table" in words


def test_info_as_json(command: Command) -> None:
    (content,) = json.loads(command("log", "info", f"{LOG}#10:50", "--json").stdout)
    frame = pl.read_csv(LOG)[10:50]
    assert content["rows"] == 40 and content["time"] == {"name": "time_s", "unit": "s"}
    assert [column["name"] for column in content["columns"]] == frame.columns
    for column in content["columns"]:
        values = frame[column["name"]]
        assert (column["first"], column["least"], column["most"]) == (
            values[0], values.min(), values.max())  # fmt: skip
    kinds = [column["kind"] for column in content["columns"]]
    assert kinds[0] == "time" and {"position", "effort"} <= set(kinds)
    assert content["left_out"] == content["topics"] == content["remarks"] == []


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat", ".h5"])
def test_convert_keeps_every_bit(command: Command, tmp_path: Path, suffix: str) -> None:
    output = tmp_path / f"out{suffix}"
    done = command("log", "convert", f"{LOG}#5:700", output, "--columns", "time_s", "q*")
    frame = pl.read_csv(LOG)[5:700]
    names = ["time_s", *(name for name in frame.columns if name.startswith("q"))]
    assert done.stdout == f"wrote {output}: 695 rows of {len(names)} columns\n"
    log = open_log(output)
    assert list(log.columns) == names
    found = np.concatenate(list(log.parts(names)))
    assert found.tobytes() == frame.select(names).to_numpy().tobytes()
    assert [path.name for path in tmp_path.iterdir()] == [output.name]


def test_convert_as_json(command: Command, tmp_path: Path) -> None:
    output = tmp_path / "out.csv"
    facts = json.loads(command("log", "convert", LOG, output, "--json").stdout)
    frame = pl.read_csv(LOG)
    assert facts == {"output": str(output), "rows": len(frame), "columns": frame.columns}


def test_nothing_is_overwritten_or_half_written(command: Command, tmp_path: Path) -> None:
    output = tmp_path / "out.csv"
    output.write_text("mine")
    done = command("log", "convert", LOG, output)
    assert done.exit_code == 2 and "the file exists already" in done.stderr
    assert output.read_text() == "mine"
    done = command("log", "convert", LOG, tmp_path / "out.parquet", "--columns", "nothing")
    assert done.exit_code == 2 and "the log has no column 'nothing'" in done.stderr
    broken = tmp_path / "broken.npy"
    np.save(broken, np.ones((100, 3)))
    broken.write_bytes(broken.read_bytes()[:-8])
    done = command("log", "convert", broken, tmp_path / "out.parquet")
    assert done.exit_code == 2 and "larger than the file" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.npy", "out.csv"]


@pytest.mark.parametrize("clock", [[], ["time_s"]])
def test_files_of_one_clock_are_joined_by_row(
    command: Command, tmp_path: Path, clock: list[str]
) -> None:
    frame = pl.read_csv(LOG)
    q = [name for name in frame.columns if name.startswith("q")]
    tau = [name for name in frame.columns if name.startswith("tau")]
    one, other, out = tmp_path / "q.csv", tmp_path / "tau.parquet", tmp_path / "out.csv"
    frame[[*clock, *q]].write_csv(one)
    frame[[*clock, *tau]].write_parquet(other)
    done = command("log", "convert", f"{one}#3:", out, "--beside", other)
    assert done.exit_code == 0, done.output
    assert "note  row k of every file is taken as one sample" in done.stdout
    assert ("equal in them: time_s" in done.stdout) == bool(clock)
    assert pl.read_csv(out).equals(frame[3:][[*clock, *q, *tau]])


@pytest.mark.parametrize("change", ["shorter", "other clock"])
def test_files_of_two_clocks_are_not_joined(command: Command, tmp_path: Path, change: str) -> None:
    one, other = tmp_path / "q.csv", tmp_path / "tau.csv"
    t = np.arange(6.0)
    pl.DataFrame({"t": t, "q1": t}).write_csv(one)
    late = np.where(t > 3.0, t + 0.5, t)
    short = change == "shorter"
    pl.DataFrame({"t": t[:5] if short else late, "tau1": t[:5] if short else t}).write_csv(other)
    done = command("log", "convert", one, tmp_path / "out.csv", "--beside", other)
    words = " ".join(done.stderr.split())
    assert done.exit_code == 2 and "the logs have no common clock" in words
    assert ("tau.csv ends after row 4" if short else "'t' of tau.csv differs from row 4") in words
    assert not (tmp_path / "out.csv").exists()


def test_columns_are_chosen_by_name_then_by_pattern() -> None:
    known = ("t", "q_1", "q_2", "q[1]", "q*")
    assert chosen(known, []) == known
    assert chosen(known, ["q_*", "t"]) == ("q_1", "q_2", "t")
    assert chosen(known, ["q[1]", "q*", "no"]) == ("q[1]", "q*", "no")


@pytest.mark.parametrize(
    ("size", "text"), [(5, "5 B"), (2048, "2 KiB"), (1 << 45, "32 TiB"), (1 << 55, "3.277e+04 TiB")]
)
def test_sizes_are_short(size: int, text: str) -> None:
    assert size_text(size) == text


@pytest.mark.parametrize("name", ["info", "convert"])
def test_help_shows_an_example(name: str, command: Command) -> None:
    done = command("log", name, "--help")
    assert done.exit_code == 0 and f"Example: steelyard log {name}" in done.stdout
