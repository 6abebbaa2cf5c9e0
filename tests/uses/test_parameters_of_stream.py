"""Changes of friction, gains and payload from the model, estimated on a stream."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import small_arm
import small_fleet
import steelyard
from steelyard.base.arrays import Array
from steelyard.cli.app import app
from steelyard.uses.watch.parameters_of_stream import STRETCH, StreamParameters
from steelyard.uses.watch.watch import event_line, record_of, start_watch

pytestmark = pytest.mark.slow

MINUTES = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, and a stream of the same arm with twice the friction of joint 2 from the middle."""
    place = tmp_path_factory.mktemp("stream")
    (place / "arm.urdf").write_text(small_arm.URDF)
    (place / "arm.toml").write_text(small_fleet.ROBOT_FILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        small_fleet.write(place / "fit.parquet", small_fleet.log(0, 0))
        steelyard.identify("arm.toml", "fit.parquet", check=False).save("model")
        stream(1.0).write_csv("same.csv")
        stream(2.0).write_csv("twice.csv")
        stream(1.0, (1.0, 0.0)).write_csv("still.csv")
    return place


def stream(friction: float, motion: tuple[float, float] = (1.0, 1.0)) -> pl.DataFrame:
    """Minutes of days' logs one after another."""
    parts, start = list[dict[str, Array]](), 0.0
    for day in range(60 * MINUTES // 25):
        number = 0 if day == 0 else 100 + day
        table = small_fleet.log(0, number, friction=friction, motion=motion)
        t = table["t"] - table["t"][0]
        parts.append({**table, "t": start + t})
        start += t[-1] + 0.01
    names = [name for name in parts[0] if name != "temp"]
    return pl.DataFrame({name: np.concatenate([p[name] for p in parts]) for name in names})


def published(folder: Path, log: str, forget: float = 600.0) -> list[StreamParameters]:
    begun = start_watch(folder / "model", identify=True, forget=forget)
    begun.watcher.payload, begun.watcher.thresholds = None, None
    rows = pl.read_csv(folder / log).select(begun.watcher.samples.columns).to_numpy()
    return [e for e in begun.watcher.take(rows) if isinstance(e, StreamParameters)]


def test_a_friction_that_doubled_is_published_with_its_interval(folder: Path) -> None:
    found = published(folder, "twice.csv")
    assert len(found) == MINUTES - 1 and found[0].time > 60.0
    shown = {(one.joint, one.quantity): one for one in found[-1].shown}
    friction = shown["joint2", "dry friction"]
    # days have scatter of their own, 2 %
    assert abs(friction.value - 1.0) < 0.1 and 0.0 < friction.half_width < 0.1
    assert "dry friction of joint2 +" in event_line(found[-1])
    record = record_of(found[-1])
    assert record["event"] == "parameters" and record["shown"][0]["joint"] == "joint1"
    # gravity of the links is no change, though a payload could take its place
    bodies = [
        shown[joint, "bodies"] for joint in ("joint1", "joint2") if (joint, "bodies") in shown
    ]
    assert bodies and all(abs(one.value) < 0.01 for one in bodies)
    others = [one for key, one in shown.items() if key != ("joint2", "dry friction")]
    assert all(abs(one.value) < 0.15 for one in others if not one.unit)


def test_intervals_contain_errors_of_the_model(folder: Path) -> None:
    begun = start_watch(folder / "model", identify=True)
    stream = begun.watcher.parameters
    assert stream is not None
    local = stream._local
    rows = pl.read_csv(folder / "same.csv").select(begun.watcher.samples.columns).to_numpy()
    information = stream._gather(rows[:2000])
    known = local.equations(information)
    # right-hand sides are linear in the model's values: those of another model differ by K delta
    rng = np.random.default_rng(0)
    off = 0.01 * rng.normal(size=len(local.values)) * np.abs(local.values)
    gram = [information.row_gram(row) / local.sigma[row] ** 2 for row in range(2)]
    expected = np.zeros(local.size)
    for row, seen in enumerate(local.layout.sees):
        moved = np.zeros(len(seen) + 1)
        moved[:-1] = off[list(seen)]
        expected += local.transforms[row][:, :-1].T @ gram[row] @ moved
    assert np.allclose(local.of_model(information) @ off, expected)
    assert np.all(np.diag(local.covariance) > 0.0) and known.matrix.shape[0] == local.size
    widths = []
    for scale in (0.0, 1.0, 100.0):
        again = start_watch(folder / "model", identify=True)
        again.watcher.payload, again.watcher.thresholds = None, None
        assert again.watcher.parameters is not None
        again.watcher.parameters._local.covariance = scale * local.covariance
        events = again.watcher.take(rows[:12000])
        last = [one for one in events if isinstance(one, StreamParameters)][-1]
        widths.append({(x.joint, x.quantity): x.half_width for x in last.shown})
    both = [key for key in widths[2] if key in widths[0]]
    assert both and all(widths[0][key] < widths[1][key] < widths[2][key] for key in both)


def test_what_did_not_change_stays(folder: Path) -> None:
    for one in published(folder, "same.csv")[-1].shown:
        assert abs(one.value) < 0.15 or one.unit


def test_old_samples_are_forgotten(folder: Path) -> None:
    slow, quick = (published(folder, "same.csv", forget)[-1].seconds for forget in (1e6, 60.0))
    assert slow == pytest.approx(60.0 * (MINUTES - 1), rel=0.01) and quick < 80.0


def test_what_the_motion_does_not_show_is_named(folder: Path) -> None:
    found = published(folder, "still.csv")
    assert any("dry friction of joint2" in one.stays for one in found)
    assert "not shown, so they stay: " in event_line(found[-1])


def test_stretches_with_a_payload_do_not_count(folder: Path) -> None:
    begun = start_watch(folder / "model", identify=True)
    rows = pl.read_csv(folder / "same.csv").select(begun.watcher.samples.columns).to_numpy()
    stream = begun.watcher.parameters
    assert stream is not None
    for k, row in enumerate(rows[: int(2.5 * STRETCH * 100)]):
        if k == 100:
            stream.spoil()
        stream.step(k / 100.0, row)
    assert (stream.used, stream.left_out) == (1, 1)


def test_stretches_with_a_contact_do_not_count(folder: Path) -> None:
    begun = start_watch(folder / "model", identify=True)
    table = pl.read_csv(folder / "same.csv").select(begun.watcher.samples.columns)
    rows, stream = table.to_numpy().copy(), begun.watcher.parameters
    assert stream is not None
    effort = table.columns.index("tau2")
    rows[2500:2600, effort] += 4.0
    for k, row in enumerate(rows[: int(3.5 * STRETCH * 100)]):
        stream.step(k / 100.0, row)
    assert (stream.used, stream.left_out) == (2, 1)


def test_command(folder: Path) -> None:
    shown = CliRunner().invoke(
        app,
        ["watch", str(folder / "model"), "--from", str(folder / "twice.csv"), "--timeout", "0",
         "--identify"],
    )  # fmt: skip
    assert shown.exit_code == 0, shown.output
    assert "dry friction of joint2" in shown.output
