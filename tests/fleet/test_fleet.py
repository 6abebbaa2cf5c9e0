"""Fleets: changes by robot, cause and day; remembered work; logs that do not count; workers."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import small_fleet as small
import steelyard
from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import Event, Stopped
from steelyard.cli.app import app
from steelyard.fleet.fleet_result_and_page import Fleet
from steelyard.fleet.logs_by_robot_and_day import parts_of
from steelyard.logs.files_and_urls import files_of
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

pytestmark = pytest.mark.slow

WithLog = Callable[[Path, "dict[str, Array] | bytes"], Path]
R0D2 = Path("r0/2026-03-03.parquet")


def again(logs: Path | str = "logs", **more: object) -> Fleet:
    return steelyard.fleet("arm.toml", str(logs), store="store", processes=1, **more)  # type: ignore[arg-type]


def test_changes_by_robot_cause_and_day(in_fleet: Path) -> None:
    found = again()
    told = {c.robot: (c.cause.what, c.cause.joint, c.day) for c in found.changes}
    assert told == {
        "r1": ("payload", "", "2026-03-05"),
        "r3": ("dry friction", "joint2", "2026-03-06"),
        "r4": ("effort scale", "joint1", "2026-03-04"),
    }
    sizes = {c.robot: (float(c.size[0]), 1.96 * float(c.std[0])) for c in found.changes}
    for robot, true in (("r1", 0.5), ("r3", 1.0), ("r4", 1.0 / 0.95 - 1.0)):
        value, half = sizes[robot]
        assert abs(value - true) < half < 0.5 * true
    assert found.work.made == 0 and not found.left_out
    assert [found.status(k) for k in range(5)] == ["same", "changed", "same", "changed", "changed"]


def test_shared_bodies(in_fleet: Path) -> None:
    found = again()
    robot, base = found.model.robot, found.model.base
    nominal = {
        f"{kind}.{body.name}": x
        for body, ten in zip(robot.bodies, robot.nominal, strict=True)
        for kind, x in zip(INERTIAL_NAMES, ten, strict=True)
    }
    true = dict(
        zip(
            base.base_names,
            base.base_values([nominal.get(n, 0.0) for n in base.names]),
            strict=True,
        )
    )
    estimate = found.model.estimate
    for (name, value), half in zip(
        estimate.parameters.as_dict().items(), estimate.half_width, strict=True
    ):
        if name in nominal:
            assert abs(value - true[name]) < 1.5 * half < 0.3


def test_one_new_day_is_all_that_is_read(in_fleet: Path, tmp_path: Path) -> None:
    logs, before = tmp_path / "logs", tmp_path / "later"
    shutil.copytree(in_fleet / "logs", logs)
    before.mkdir()
    for path in logs.rglob("2026-03-08.parquet"):
        path.rename(before / f"{path.parent.name}.parquet")
    without = again(logs)
    assert without.days.n_days == 7 and without.work.made == 0
    for path in before.iterdir():
        path.rename(logs / path.stem / "2026-03-08.parquet")
    assert again(logs).work.made == 0  # the same bytes, wherever they lie
    small.write(logs / "r0" / "2026-03-09.parquet", small.log(0, 8))
    assert again(logs).work.made == 1


def test_no_flipped_bit_changes_a_number(in_fleet: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    shutil.copytree(in_fleet / "store", store)
    first = again()
    rng = np.random.default_rng(0)
    for path in sorted(store.glob("*.entry")):
        content = bytearray(path.read_bytes())
        content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(content))
    found = steelyard.fleet("arm.toml", "logs", store=store, processes=1)
    assert found.work.damaged >= 40 and found.work.made == 40
    assert found.model.text() == first.model.text()
    assert "damaged" in found.work.words


def test_stopped_work_goes_on_where_it_was(in_fleet: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    steelyard.plan_fleet("arm.toml", "logs", store=store, processes=1)

    def stop(event: Event) -> bool:
        return not (event.phase == "logs" and event.done >= 10)

    with pytest.raises(Stopped):
        steelyard.fleet("arm.toml", "logs", store=store, processes=1, progress=stop)
    assert steelyard.fleet("arm.toml", "logs", store=store, processes=1).work.made == 29


def test_plan_says_what_is_left(in_fleet: Path, tmp_path: Path) -> None:
    plan = steelyard.plan_fleet("arm.toml", "logs", store=tmp_path, processes=2)
    assert (plan.parts, plan.left, plan.robots, plan.days) == (40, 39, 5, 8)
    assert 0.0 < plan.seconds < 60.0 and plan.memory > 100 << 20
    assert "5 robots, 8 days, 40 parts" in str(plan) and "39 parts" in str(plan)


CASES: dict[str, tuple[Callable[[], dict[str, Array] | bytes], str]] = {
    "degrees": (lambda: _scaled("q", np.degrees(1.0)), "the model does not explain it"),
    "other unit of efforts": (
        lambda: _scaled("tau", 1000.0),
        "times those of the model: another unit",
    ),
    "opposite sign": (lambda: _scaled("tau", -1.0), "most efforts have the opposite sign"),
    "at rest": (lambda: small.log(0, 2, motion=(0.0, 0.0)), "no joint moves"),
    "another robot": (lambda: {"t": np.arange(100.0), "q1": np.zeros(100)}, "not in the log"),
    "cut off": (lambda: b"PAR1 and then nothing", "cannot be read"),
    "empty": (lambda: b"", "empty"),
    "the same bytes": (lambda: small.place_of(Path(), 0, 1).read_bytes(), "has the same bytes as"),
    "the same time": (lambda: _scaled("t", 1.0 - 86400.0 / 1.8e9), "its clock overlaps that of"),
}


def _scaled(kind: str, factor: float) -> dict[str, Array]:
    table = small.log(0, 2)
    return {name: factor * x if name.startswith(kind) else x for name, x in table.items()}


@pytest.mark.parametrize("case", CASES)
def test_logs_that_do_not_count_are_named(case: str, with_log: WithLog) -> None:
    content, wrong = CASES[case]
    found = again(with_log(R0D2, content()))
    assert [(one.robot, one.day) for one in found.left_out][:1] == [("r0", "2026-03-03")] or (
        case == "the same time"
    )
    assert len(found.left_out) == 1
    (left,) = found.left_out
    assert wrong in left.wrong and left.fix and "r0" in left.log
    fix = "" if left.at_rest else left.fix
    assert any(left.log in line and fix in line for line in found.limits)
    assert {c.robot for c in found.changes} == {"r1", "r3", "r4"}


def test_a_fleet_of_which_no_log_can_be_used(in_fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "r1_2026-01-01.csv").write_text("a,b\n1,2\n")
    with pytest.raises(LogError, match="does not have the column|no column|columns"):
        again(tmp_path)


def test_two_processes_give_the_same_digits(in_fleet: Path, tmp_path: Path) -> None:
    found = steelyard.fleet("arm.toml", "logs", store=tmp_path, processes=2)
    assert found.model.text() == again().model.text()
    assert found.robots_json() == again().robots_json()


@pytest.mark.filterwarnings("ignore")  # of a cluster that ends
def test_dask_gives_the_same_digits(in_fleet: Path, tmp_path: Path) -> None:
    found = steelyard.fleet("arm.toml", "logs", store=tmp_path, cluster="local:2")
    assert found.work.made == 40 and found.robots_json() == again().robots_json()


@pytest.mark.filterwarnings("ignore")  # of the server
def test_logs_and_store_on_s3(
    in_fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    boto3 = pytest.importorskip("boto3")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in (
        ("AWS_ENDPOINT_URL", f"http://{host}:{port}"),
        ("AWS_ACCESS_KEY_ID", "testing"),
        ("AWS_SECRET_ACCESS_KEY", "secret"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
    ):
        monkeypatch.setenv(name, value)
    try:
        client = boto3.client("s3", endpoint_url=f"http://{host}:{port}")
        client.create_bucket(Bucket="plant")
        for path in (in_fleet / "logs").rglob("*.parquet"):
            name = path.relative_to(in_fleet).as_posix()
            client.upload_file(str(path), "plant", name)
        url, store = "s3://plant/logs", "s3://plant/store"
        found = steelyard.fleet("arm.toml", url, store=store, processes=1)
        assert found.robots_json() == again().robots_json()
        assert steelyard.fleet("arm.toml", url, store=store, processes=1).work.made == 0
        with pytest.raises(LogError, match="there is no log"):
            files_of("s3://plant/nothing")
        with pytest.raises(LogError) as told:
            files_of("s3://no-such-bucket/logs")
        assert "secret" not in str(told.value) and "no-such-bucket" in told.value.where
    finally:
        server.stop()


def test_file_urls_are_as_paths(in_fleet: Path) -> None:
    found = again(f"file://{in_fleet}/logs")
    assert found.work.made == 0 and len(found.changes) == 3


def test_a_table_of_logs_with_temperatures(in_fleet: Path) -> None:
    rows = [
        f"logs/r{robot}/2026-03-{day + 1:02d}.parquet,unit {robot},{day:02d},{20 + day}"
        for robot in range(5)
        for day in range(8)
    ]
    table = in_fleet / "table.csv"
    table.write_text("log,robot,day,temperature\n" + "\n".join(rows) + "\n")
    found = again(table)
    assert {c.robot for c in found.changes} == {"unit 1", "unit 3", "unit 4"}
    assert "Temperature is logged" in found.claim


BAD_TABLES = {
    "log,robot,day\nlogs/r0/2026-03-01.parquet,,1\n": "a cell is empty",
    "log,robot,day\n": "has no rows",
    "log,robot,day,temperature\nlogs/r0/2026-03-01.parquet,a,1,warm\n": "'warm' is not a number",
    "log,robot,day,temperature\nlogs/r0/2026-03-01.parquet,a,1,inf\n": "'inf' is not a number",
    "file,robot,date\nx,a,1\n": "has the columns file, robot, date",
}


@pytest.mark.parametrize("text", BAD_TABLES)
def test_bad_tables(text: str, in_fleet: Path) -> None:
    (in_fleet / "bad.csv").write_text(text)
    with pytest.raises(LogError, match=BAD_TABLES[text]) as told:
        parts_of(["bad.csv"])
    assert "bad.csv" in told.value.where


def test_a_long_file_is_cut_into_parts_that_add_up(in_fleet: Path, tmp_path: Path) -> None:
    from steelyard.logs import log_parts

    whole = again("logs/r0").days.robots[0].equations[2]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_parts, "ROWS_OF_PART", 900)
        found = again("logs/r0")
    assert found.work.parts > 8
    cut = found.days.robots[0].equations[2]
    assert np.allclose(cut.counts, whole.counts, rtol=0.1)
    size = np.sqrt(np.outer(np.diag(whole.matrix), np.diag(whole.matrix)))
    assert np.abs(cut.matrix - whole.matrix).max() < 0.2 * size.max()


def test_columns_of_temperature_that_do_not_fit(in_fleet: Path) -> None:
    with pytest.raises(SteelyardError, match="3 columns of temperature do not fit 2 joints"):
        again(temperature=["temp", "temp", "temp"])


def test_command_and_its_files(in_fleet: Path) -> None:
    arguments = ["fleet", "arm.toml", "logs", "--store", "store", "--processes", "1"]
    shown = CliRunner().invoke(app, [*arguments, "-o", "out"])
    assert shown.exit_code == 1, shown.output
    assert "5 robots over 8 days: 3 changed" in shown.output
    lines = Path("out/robots.jsonl").read_text().splitlines()
    robots = [json.loads(line) for line in lines]
    assert [one["status"] for one in robots] == ["same", "changed", "same", "changed", "changed"]
    assert robots[3]["changes"][0]["what"] == "dry friction"
    assert steelyard.load_model("out/model.json").joints == ("joint1", "joint2")
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "dry friction of joint2" in page and "2026-03-06" in page
    planned = CliRunner().invoke(app, [*arguments, "--plan", "--json"])
    assert json.loads(planned.output)["left"] == 0
    alone = CliRunner().invoke(
        app, [*arguments[:2], "logs/r0", *arguments[3:], "--json", "-o", "o2"]
    )
    assert alone.exit_code == 0 and json.loads(alone.output)["robots"][0]["robot"] == "r0"


@pytest.mark.skipif(os.name == "nt", reason="needs permissions of files")
def test_a_store_that_cannot_be_written(in_fleet: Path) -> None:
    Path("file").write_text("")
    with pytest.raises(SteelyardError):
        steelyard.fleet("arm.toml", "logs", store="file/store")


def write_fleet(folder: Path, days: int, robots: int, **more: object) -> Path:
    """Logs of a small fleet; what is given is of every log, or a function of robot and day."""
    for robot in range(robots):
        for day in range(days):
            own = {k: x(robot, day) if callable(x) else x for k, x in more.items()}
            table = small.log(robot, day, **own)  # type: ignore[arg-type]
            small.write(folder / f"r{robot}" / f"2026-03-{day + 1:02d}.parquet", table)
    return folder


def test_a_failure_that_passes_is_not_remembered(
    in_fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from steelyard.estimate.information import part_information as information

    store = tmp_path / "store"
    shutil.copytree(in_fleet / "store", store)
    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    small.write(logs / "r2" / "2026-03-09.parquet", small.log(2, 8))
    real = information.on_disk

    def failing(url: str) -> object:
        if "2026-03-09" in url:
            raise LogError("the URL cannot be read", where=url, fix="renew the credentials")
        return real(url)

    def unread(file: object) -> str:
        raise LogError("the URL cannot be read", where="", fix="")

    with monkeypatch.context() as patch:
        patch.setattr(information, "on_disk", failing)
        patch.setattr(information, "digest", unread)
        found = steelyard.fleet("arm.toml", logs, store=store, processes=1)
    assert [one.wrong for one in found.left_out] == ["the URL cannot be read"]
    found = steelyard.fleet("arm.toml", logs, store=store, processes=1)
    assert not found.left_out and found.work.made == 1


def test_a_change_of_most_robots_is_found(in_fleet: Path, tmp_path: Path) -> None:
    def doubled(robot: int, day: int) -> float:
        return 2.0 if robot < 5 and day >= 3 + robot else 1.0

    logs = write_fleet(tmp_path / "logs", 10, 8, friction=doubled)
    found = steelyard.fleet("arm.toml", logs, store=tmp_path / "store", processes=1)
    told = {(c.robot, c.cause.what, c.cause.joint, c.day) for c in found.changes}
    assert told == {(f"r{k}", "dry friction", "joint2", f"2026-03-{k + 4:02d}") for k in range(5)}
    assert all(c.p < 0.05 for c in found.changes)


def test_one_odd_day_is_told_as_one(in_fleet: Path, tmp_path: Path) -> None:
    def odd(robot: int, day: int) -> float:
        return 2.0 if (robot, day) in ((1, 4), (2, 9)) else 1.0

    logs = write_fleet(tmp_path / "logs", 10, 5, friction=odd)
    found = steelyard.fleet("arm.toml", logs, store=tmp_path / "store", processes=1)
    assert [(c.robot, c.day, c.until) for c in found.changes] == [
        ("r1", "2026-03-05", "2026-03-06"),
        ("r2", "2026-03-10", ""),
    ]
    assert [found.status(k) for k in (1, 2)] == ["was changed", "changed"]
    assert "2026-03-05, gone on 2026-03-06" in str(found)
    assert "that day alone so far" in str(found) and "1 was changed" in found.headline


def test_a_temperature_that_is_missing_or_of_another_unit(in_fleet: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    for day, warm in ((2, np.nan), (4, 297.0)):
        table = small.log(2, day)
        table["temp"] = np.full(len(table["t"]), warm)
        small.write(logs / "r2" / f"2026-03-{day + 1:02d}.parquet", table)
    without = {k: x for k, x in small.log(2, 5).items() if k != "temp"}
    small.write(logs / "r2" / "2026-03-06.parquet", without)
    good, found = (
        steelyard.fleet("arm.toml", x, store="store", temperature="temp", processes=1)
        for x in ("logs", logs)
    )
    one, other = good.days.scatter, found.days.scatter
    assert np.all(np.abs(one.slope - other.slope) <= 2.0 * one.slope_std + 1e-12)
    assert np.all(other.slope_std <= 1.5 * one.slope_std)
    said = "no plausible temperature on r2 2026-03-03, r2 2026-03-05, r2 2026-03-06"
    assert any(line.startswith(said) for line in found.limits) and not found.left_out


def test_the_same_motion_with_a_clock_from_zero_counts_once(in_fleet: Path, tmp_path: Path) -> None:
    import polars as pl

    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    for path in logs.rglob("*.parquet"):
        table = pl.read_parquet(path)
        table.with_columns(pl.col("t") - pl.col("t").first()).write_parquet(path)
    table = pl.read_parquet(logs / "r0" / "2026-03-02.parquet")
    table.write_csv(logs / "r0" / "again_2026-03-02.csv")
    found = again(logs)
    assert ["has the same motion as" in one.wrong for one in found.left_out] == [True]


def test_a_joint_that_never_moves_is_named(in_fleet: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    for day in range(8):
        table = small.log(2, day, motion=(1.0, 0.0))
        small.write(logs / "r2" / f"2026-03-{day + 1:02d}.parquet", table)
    found = again(logs)
    assert "dry friction joint2" in found.robots_json()[2]["not_seen"]
    assert any("the motion does not show it: r2: " in line for line in found.limits)
    assert {c.robot for c in found.changes} == {"r1", "r3", "r4"}


def test_quiet_first_days(in_fleet: Path, tmp_path: Path) -> None:
    def still(robot: int, day: int) -> tuple[float, float]:
        return (0.0, 0.0) if day == 0 else (1.0, 1.0)

    logs = write_fleet(tmp_path / "logs", 4, 7, motion=still)
    found = steelyard.fleet("arm.toml", logs, store=tmp_path / "store", processes=1)
    assert len(found.left_out) == 7 and all(one.at_rest for one in found.left_out)
    assert found.days.n_days == 3 and not found.changes


def test_a_robot_without_a_log_that_counts_is_named(in_fleet: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    for path in (logs / "r2").iterdir():
        path.write_bytes(b"")
    found = again(logs)
    assert found.robots_json()[-1] == {"robot": "r2", "days": 0, "status": "no log"}
    assert "1 without a log that counts" in found.headline


def test_levels_have_intervals(in_fleet: Path) -> None:
    for one in again().robots_json():
        for own in one["level_and_half_width"].values():
            assert all(half > 0.0 for _, half in own.values())


def test_files_without_a_day_are_named(in_fleet: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    shutil.copytree(in_fleet / "logs", logs)
    (logs / "r0" / "notes.txt").write_text("oiled")
    assert any("notes.txt" in line for line in again(logs).limits)


def test_two_folders_with_a_robot_of_one_name(in_fleet: Path, tmp_path: Path) -> None:
    shutil.copytree(in_fleet / "logs" / "r0", tmp_path / "a" / "r0")
    shutil.copytree(in_fleet / "logs" / "r1", tmp_path / "b" / "r0")
    with pytest.raises(LogError, match="two folders have a robot 'r0'"):
        parts_of([str(tmp_path / "a"), str(tmp_path / "b")])
    robots = {part.robot for part in parts_of([str(tmp_path)])[0]}
    assert robots == {"a/r0", "b/r0"}


def test_days_are_in_the_order_of_their_numbers(in_fleet: Path) -> None:
    rows = [f"logs/r0/2026-03-{day + 1:02d}.parquet,r0,{day + 5}" for day in range(8)]
    (in_fleet / "numbers.csv").write_text("log,robot,day\n" + "\n".join(rows) + "\n")
    days = [part.day for part in parts_of(["numbers.csv"])[0]]
    assert days == [str(day + 5) for day in range(8)]


def test_a_robot_file_of_another_robot(in_fleet: Path, tmp_path: Path) -> None:
    other = (in_fleet / "arm.urdf").read_text().replace('axis xyz="0 1 0"', 'axis xyz="0 0 1"')
    (tmp_path / "arm.urdf").write_text(other)
    (tmp_path / "arm.toml").write_text((in_fleet / "arm.toml").read_text())
    with pytest.raises(
        LogError, match="24 logs can be identified, the first one: failed check, mounting"
    ):
        steelyard.fleet(tmp_path / "arm.toml", "logs", store=tmp_path / "s", processes=1)


def test_a_model_that_explains_little_is_said(
    in_fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    assert not any("explains" in line for line in again().limits)
    monkeypatch.setattr(sys.modules["steelyard.fleet.fleet"], "LEAST_EXPLAINED", 1.0)
    assert any("is the robot file that of these robots?" in line for line in again().limits)


@pytest.mark.parametrize("days", [1, 2])
def test_one_robot_over_few_days(days: int, in_fleet: Path, tmp_path: Path) -> None:
    logs = write_fleet(tmp_path / "logs", days, 1)
    found = steelyard.fleet("arm.toml", logs, store=tmp_path / "store", processes=1)
    assert not found.changes and found.status(0) == ("one day" if days == 1 else "same")
    assert found.headline.startswith("Nothing can be said" if days == 1 else "No change found")
    assert any("only large changes can be told" in line for line in found.limits)
    assert "robot" in str(found) and found.report() and found.to_dict()


def test_fewer_false_alarms_ask_for_more(in_fleet: Path) -> None:
    often, seldom = (again(false_alarms=rate).days for rate in (100.0, 1e-6))
    assert often.level > 0.5 > 1e-3 > seldom.level
    assert {c.robot for c in often.changes} >= {c.robot for c in seldom.changes}
    assert "0.01 false changes a year" in again(false_alarms=0.01).claim
