"""`identify` and `check` with workers: many logs of one robot, folders and URLs among them."""

import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import small_fleet as small
import steelyard
from steelyard.base import workers
from steelyard.base.errors import DataError, LogError, SteelyardError
from steelyard.cli.app import app
from steelyard.identify import many_logs, remembered_parts
from steelyard.logs import log_parts
from steelyard.logs.files_and_urls import Folder, StoredFile
from steelyard.logs.log_parts import LogPart
from steelyard.logs.remembered_work import RememberedWork

pytestmark = pytest.mark.slow

TAU = ("tau1", "tau2")
LOGS = Path("logs/r0")


def days(folder: Path, count: int, **more: object) -> Path:
    """The first days' logs of a robot in a folder of their own."""
    folder.mkdir()
    for day in range(count):
        name = f"2026-03-{day + 1:02d}.parquet"
        if more:
            small.write(folder / name, small.log(0, day, **more))  # type: ignore[arg-type]
        else:
            shutil.copy(LOGS / name, folder / name)
    return folder


def test_few_logs_give_what_they_give_without_workers(in_fleet: Path, tmp_path: Path) -> None:
    folder = days(tmp_path / "few", 5)
    plain = steelyard.identify("arm.toml", sorted(folder.glob("*")))
    found = steelyard.identify("arm.toml", folder, cluster="local:1")
    mine, its = (one.model.estimate for one in (found, plain))
    assert mine.parameters.names == its.parameters.names
    assert np.allclose(mine.parameters.values, its.parameters.values, rtol=0.0, atol=0.1 * its.std)
    assert np.all(mine.std < 3.0 * its.std) and np.all(its.std < 3.0 * mine.std)
    assert sorted(run.run for run in found.content.fitted) == sorted(
        run.run for run in plain.content.fitted
    )


def test_dask_gives_the_digits_of_one_process(in_fleet: Path, tmp_path: Path) -> None:
    alone = steelyard.identify("arm.toml", LOGS, cluster="local:1")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STEELYARD_CACHE", str(tmp_path))
        both = steelyard.identify("arm.toml", LOGS, cluster="local:2")
        checked = steelyard.check("arm.toml", LOGS, quick=True, cluster="local:2")
    assert both.model.text() == alone.model.text()
    alone_checked = steelyard.check("arm.toml", LOGS, quick=True, cluster="local:1")
    assert checked.to_dict() == alone_checked.to_dict()


def test_all_logs_count_and_a_new_one_is_all_that_is_read(in_fleet: Path, tmp_path: Path) -> None:
    six = steelyard.identify("arm.toml", days(tmp_path / "six", 6), cluster="local:1")
    every = steelyard.identify("arm.toml", LOGS, cluster="local:1")
    assert every.model.estimate.n_samples.sum() > 1.2 * six.model.estimate.n_samples.sum()
    assert "8 logs" in " ".join(every.content.notes)
    inputs = every.model.provenance.inputs
    assert sum(name.startswith("identification ") for name in inputs) == small.DAYS
    made = list[int]()
    real = workers.each

    def counted(work, common, items, cluster, processes):  # type: ignore[no-untyped-def]
        made.append(len(items))
        return real(work, common, items, None, 1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(remembered_parts, "each", counted)
        again = steelyard.identify("arm.toml", LOGS, cluster="local:1")
    assert made == [0] and again.model.text() == every.model.text()


def test_logs_that_do_not_count_are_named(in_fleet: Path, tmp_path: Path) -> None:
    folder = days(tmp_path / "mixed", 7)
    other = small.log(0, 7)
    small.write(folder / "other_unit.parquet", other | {k: 1e3 * other[k] for k in TAU})
    rest = {k: (x if k == "t" else np.full_like(x, x[0])) for k, x in other.items()}
    small.write(folder / "rest.parquet", rest)
    (folder / "cut.parquet").write_bytes((folder / "rest.parquet").read_bytes()[:900])
    found = steelyard.identify("arm.toml", folder, cluster="local:1")
    notes = "\n".join(found.content.notes)
    for name in ("other_unit", "rest", "cut"):
        assert f"left out: {folder / name}.parquet" in notes
    assert "another unit" in notes
    assert any(one.check == "logs left out" for one in found.content.limitations)


def in_amperes(gains: tuple[float, float], folder: Path, count: int) -> Path:
    """Logs of currents, for gains in Nm/A."""
    folder.mkdir()
    for day in range(count):
        table = small.log(0, day)
        currents = {f"tau{k + 1}": table[f"tau{k + 1}"] / gains[k] for k in range(2)}
        small.write(folder / f"{day}.parquet", table | currents)
    return folder


@pytest.mark.parametrize("gain", ["[5.0, 7.0]", '[5.0, "identify"]'])
def test_gains_scale_the_sums_of_workers(gain: str, in_fleet: Path, tmp_path: Path) -> None:
    folder = in_amperes((5.0, 7.0), tmp_path / "logs", 7)
    shutil.copy("arm.urdf", tmp_path)
    file = tmp_path / "arm.toml"
    text = Path("arm.toml").read_text().replace('unit = "Nm"', f'unit = "A"\ngain = {gain}')
    file.write_text(text.replace('kind = "joint_torque"', 'kind = "motor_current"'))
    plain = steelyard.identify(file, sorted(folder.glob("*")))
    found = steelyard.identify(file, folder, cluster="local:1")
    mine, its = found.model.estimate, plain.model.estimate
    off = np.abs(mine.parameters.values - its.parameters.values)
    assert np.all(off < 2.0 * its.std)


def test_scales_of_efforts_are_those_of_the_sums(in_fleet: Path, tmp_path: Path) -> None:
    folder = tmp_path / "scaled"
    folder.mkdir()
    for day in range(7):
        table = small.log(0, day)
        small.write(folder / f"{day}.parquet", table | {"tau2": 1.2 * table["tau2"]})
    shutil.copy("arm.urdf", tmp_path)
    file = tmp_path / "arm.toml"
    file.write_text(Path("arm.toml").read_text() + '[estimation]\neffort_scales = "auto"\n')
    plain = steelyard.identify(file, sorted(folder.glob("*")), check=False)
    found = steelyard.identify(file, folder, check=False, cluster="local:1")
    assert plain.model.effort_scales is not None and found.model.effort_scales is not None
    mine, its = found.model.estimate, plain.model.estimate
    off = np.abs(mine.parameters.values - its.parameters.values)
    assert np.all(off < 2.0 * its.std)
    line = next(note for note in found.content.notes if note.startswith("rms residual"))
    assert float(line.split("median of all parts ")[1].split(" %")[0]) < 1.0


def test_what_a_model_was_fitted_to_is_known_in_other_files(in_fleet: Path, tmp_path: Path) -> None:
    small.write(tmp_path / "x.parquet", small.log(0, 7))
    copy = tmp_path / "copy.csv"
    pl.read_parquet(tmp_path / "x.parquet").write_csv(copy)
    found = steelyard.identify("arm.toml", LOGS, cluster="local:1")
    found.model.save(tmp_path / "model.json")
    seen = steelyard.validate(tmp_path / "model.json", copy).content
    assert not seen.scores and seen.fitted
    with pytest.raises(DataError, match="both fitted and validated"):
        steelyard.identify("arm.toml", LOGS, copy, cluster="local:1")


def test_errors_of_other_logs_and_options_are_their_own(in_fleet: Path, tmp_path: Path) -> None:
    table = small.log(0, 9)
    small.write(tmp_path / "turned.parquet", table | {"tau2": -table["tau2"]})
    with pytest.raises(DataError) as told:
        steelyard.identify("arm.toml", LOGS, tmp_path / "turned.parquet", cluster="local:1")
    assert "turned" in told.value.where and "none" not in told.value.wrong
    with pytest.raises(SteelyardError, match="no drive gain is to be identified"):
        steelyard.identify("arm.toml", LOGS, payload_mass=2.0, cluster="local:1")


def test_copies_do_not_count_and_are_no_doubt(in_fleet: Path, tmp_path: Path) -> None:
    folder = days(tmp_path / "logs", 6)
    for number in range(6):
        shutil.copy(folder / "2026-03-01.parquet", folder / f"copy{number}.parquet")
    found = steelyard.identify("arm.toml", folder, cluster="local:1")
    assert len(found.content.fitted) == 6
    assert not any(one.check == "logs left out" for one in found.content.limitations)
    assert "it has the same bytes as" in " ".join(found.model.provenance.notes)


@pytest.mark.parametrize("cluster", ["", "local:0", "local:x", "foo", "tcp://localhost:1"])
def test_clusters_that_are_none_are_refused_first(cluster: str, in_fleet: Path) -> None:
    for call in (steelyard.identify, steelyard.check, steelyard.fleet):
        with pytest.raises(DataError, match="is no cluster|no scheduler"):
            call("arm.toml", LOGS, cluster=cluster)


def test_a_first_log_that_is_empty_and_one_at_rest(in_fleet: Path, tmp_path: Path) -> None:
    folder = tmp_path / "turned"
    folder.mkdir()
    for day in range(3):
        table = small.log(0, day)
        small.write(folder / f"{day}.parquet", table | {"tau2": -table["tau2"]})
    rest = {k: (x if k == "t" else np.full_like(x, x[0])) for k, x in small.log(0, 3).items()}
    small.write(folder / "rest.parquet", rest)
    (folder / "0000.csv").write_text("")
    found = steelyard.check("arm.toml", folder, fix=tmp_path / "fixed.toml", cluster="local:1")
    assert found.fixed is not None and found.fixed.changes
    wrong = {one.log for one in found.last.findings if one.severity.name == "WRONG"}
    assert "0000" in wrong and not wrong & {"0", "1", "2"}


def test_what_workers_cannot_do_is_refused(in_fleet: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="whole runs are needed for sensitivity"):
        steelyard.identify("arm.toml", LOGS, sensitivity=True, cluster="local:1")
    with pytest.raises(DataError, match="IV needs whole runs"):
        steelyard.identify("arm.toml", LOGS, method="IV", cluster="local:1")
    log = next(iter(LOGS.glob("*")))
    with pytest.raises(LogError, match="windows of logs"):
        steelyard.identify("arm.toml", f"{log}@1:9", cluster="local:1")
    with pytest.raises(DataError, match="both fitted and validated"):
        steelyard.identify("arm.toml", LOGS, log, cluster="local:1")
    with pytest.raises(LogError, match="named twice"):
        steelyard.check("arm.toml", [LOGS, log], cluster="local:1")
    (tmp_path / "none.csv").write_text("a,b\n1,2\n")
    with pytest.raises(LogError):
        steelyard.identify("arm.toml", tmp_path, cluster="local:1")


def test_file_urls_are_read(in_fleet: Path) -> None:
    log = LOGS / "2026-03-01.parquet"
    plain = steelyard.identify("arm.toml", LOGS, cluster="local:1")
    found = steelyard.identify("arm.toml", f"file://{in_fleet / LOGS}", cluster="local:1")
    assert np.array_equal(
        found.model.estimate.parameters.values, plain.model.estimate.parameters.values
    )
    checked = steelyard.check("arm.toml", f"file://{in_fleet / log}", quick=True, cluster="local:1")
    assert checked.last.severity.name == "OK"


def test_a_line_that_every_log_asks_for(in_fleet: Path, tmp_path: Path) -> None:
    folder = tmp_path / "turned"
    folder.mkdir()
    for day in range(3):
        table = small.log(0, day)
        small.write(folder / f"{day}.parquet", table | {"tau2": -table["tau2"]})
    fixed = tmp_path / "fixed.toml"
    found = steelyard.check("arm.toml", folder, fix=fixed, cluster="local:1")
    assert found.content.diagnosis.severity.name == "WRONG"
    assert found.fixed is not None and found.fixed.changes
    assert found.last.severity.name == "OK"
    assert {one.log for one in found.last.findings} == {"0", "1", "2"}


def test_no_line_that_one_log_asks_for(in_fleet: Path, tmp_path: Path) -> None:
    folder = days(tmp_path / "mixed", 3)
    table = small.log(0, 3)
    small.write(folder / "odd.parquet", table | {"tau2": -table["tau2"]})
    (folder / "cut.parquet").write_bytes((folder / "odd.parquet").read_bytes()[:900])
    found = steelyard.check("arm.toml", folder, fix="", cluster="local:1")
    assert found.fixed is not None and not found.fixed.changes
    wrong = [one for one in found.last.findings if one.severity.name == "WRONG"]
    assert {one.log for one in wrong} == {"odd", "cut"}
    odd = next(one for one in wrong if one.log == "odd")
    assert odd.fix is not None and "no line is written" in odd.fix.says


def test_the_middles_of_logs_spread_over_all_decide_first(in_fleet: Path) -> None:
    parts = tuple(
        LogPart(StoredFile(f"{k:03d}.csv", 9, ""), rows=(0, 300_000) if k == 50 else None)
        for k in range(100)
    )
    of = remembered_parts.DigestedParts(parts, ("",) * 100, {})
    memory = RememberedWork(Folder(in_fleet))
    chosen = many_logs.spread_over(many_logs.ManyLogs(of, memory))
    assert len(set(chosen)) == remembered_parts.TRIED
    numbers = [int(part.file.url[:3]) for part in chosen]
    first = sorted(numbers[: remembered_parts.SAMPLE])
    assert np.all(np.diff([0, *first, 100]) < 40)
    assert chosen[numbers.index(50)].rows == (130_000, 170_000)


def test_long_files_are_sampled_and_cut_for_workers(in_fleet: Path, tmp_path: Path) -> None:
    folder = days(tmp_path / "cut", 6)
    whole = steelyard.identify("arm.toml", folder, cluster="local:1").model.estimate
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_parts, "ROWS_OF_PART", 1250)
        patch.setattr(log_parts, "ROWS_OF_SAMPLE", 1000)
        found = steelyard.identify("arm.toml", folder, cluster="local:1")
    assert "12 parts of 6 logs" in found.content.notes[0] + found.content.notes[1]
    assert all("#" in run.run for run in found.content.fitted)
    mine = found.model.estimate
    assert np.all(np.abs(mine.parameters.values - whole.parameters.values) < 2.0 * whole.std)


def test_commands(in_fleet: Path, tmp_path: Path) -> None:
    given = ["identify", "arm.toml", str(LOGS), "--cluster", "local:1", "--json"]
    ran = CliRunner().invoke(app, [*given, "-o", str(tmp_path / "model")])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["output"] == str(tmp_path / "model")
    ran = CliRunner().invoke(app, ["check", "arm.toml", str(LOGS), "--cluster", "local:1"])
    assert ran.exit_code == 0, ran.output
    assert "Ok: no error was found" in ran.output
    assert f"steelyard identify arm.toml {LOGS} --cluster local:1" in " ".join(ran.output.split())
    # whatever a log is called, the model knows that it was fitted to it
    copy = shutil.copy(LOGS / "2026-03-08.parquet", tmp_path / "other.parquet")
    ran = CliRunner().invoke(app, ["validate", str(tmp_path / "model"), str(copy)])
    assert ran.exit_code == 0 and "fitted" in ran.output
