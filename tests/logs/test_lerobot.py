"""Datasets of LeRobot, versions 2 and 3, and columns of lists in Parquet."""

import json
import random
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from short_arm import without_wrist
from steelyard import check, identify, load_robot
from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import silent
from steelyard.cli.app import app
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.logs.contents import content_of
from steelyard.logs.formats import open_log
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_columns import guess_signals
from steelyard.runs.runs_of_named_logs import log_file, log_files, runs_of, sample_of, sha256
from steelyard.simulate.ground_truth import random_truth

EPISODES, ROWS = 4, 400


def _lists(values: np.ndarray, kind: type[pl.List] | type[pl.Array]) -> pl.Series:
    dtype = pl.List(pl.Float32) if kind is pl.List else pl.Array(pl.Float32, values.shape[1])
    return pl.Series(values.astype(np.float32).tolist(), dtype=dtype)


def dataset(folder: Path, version: int) -> Path:
    """Four episodes of a simulated arm as that version lays them out."""
    loaded = without_wrist(folder)
    truth, names = random_truth(loaded.robot, 5), loaded.robot.joint_names
    frames = []
    for episode in range(EPISODES):
        trajectory = random_fourier(loaded.robot, seed=episode, period=8.0)
        t = np.arange(ROWS) / 50.0
        motion = trajectory.sample(t)
        torque = truth.model.at(truth.values).torque(motion)
        noise = np.random.default_rng(episode).standard_normal(torque.shape)
        columns = {
            "action": _lists(motion.q, pl.Array),
            "observation.state": _lists(motion.q, pl.List),
            "observation.effort": _lists(torque + 0.01 * torque.std(axis=0) * noise, pl.Array),
            "timestamp": t.astype(np.float32),
            "episode_index": np.full(ROWS, episode),
            "next.done": np.arange(ROWS) == ROWS - 1,
            "observation.images.top": ["frame.png"] * ROWS,
        }
        frames.append(pl.DataFrame(columns))
    root = folder / f"version{version}"
    data = root / "data" / "chunk-000"
    data.mkdir(parents=True)
    (root / "meta").mkdir()
    labels = {"motors": list(names)} if version == 2 else [f"{name}.pos" for name in names]
    features = {
        "action": {"dtype": "float32", "shape": [3], "names": labels},
        "observation.state": {"dtype": "float32", "shape": [3], "names": labels},
        "observation.effort": {"dtype": "float32", "shape": [3], "names": list(names)},
        "observation.images.top": {"dtype": "image", "shape": [480, 640, 3], "names": None},
    }
    info = {"codebase_version": f"v{version}.0", "fps": 50, "features": features}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    if version == 2:
        for episode, frame in enumerate(frames):
            frame.write_parquet(data / f"episode_{episode:06d}.parquet")
    else:
        pl.concat(frames[:3]).write_parquet(data / "file-000.parquet")
        frames[3].write_parquet(data / "file-001.parquet")
        (root / "meta" / "episodes").mkdir()
        frames[0].select("timestamp").write_parquet(root / "meta" / "episodes" / "file-000.parquet")
    return root


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_a_dataset_is_identified_and_validated_by_episodes(tmp_path: Path, version: int) -> None:
    root, robot = dataset(tmp_path, version), tmp_path / "arm.toml"
    told = CliRunner().invoke(
        app, ["init", str(tmp_path / "demo_arm.urdf"), str(root), "--no-input", "-o", str(robot)]
    )
    assert told.exit_code == 0, told.output
    assert f"{root}#0:1200" in told.output.replace("\n", "")
    assert not check(robot, root).last.severity
    found = identify(robot, f"{root}#0:1200", validate=f"{root}#1200:1600", check=False)
    assert found.scores["percent_of_used"].max() < 2.0
    assert len({*found.scores["run"]}) == EPISODES


@pytest.mark.parametrize("version", [2, 3])
def test_episodes_are_runs_on_one_clock(tmp_path: Path, version: int) -> None:
    root = dataset(tmp_path, version)
    suffix = ".pos" if version == 3 else ""
    log = open_log(root)
    assert log.columns[0] == f"action.shoulder_turn{suffix}"
    assert "observation.images.top" not in log.columns
    parts = log.parts(["timestamp", f"observation.state.elbow{suffix}"], size=500)
    table = np.concatenate(list(parts))
    steps = np.diff(table[:, 0])
    assert np.flatnonzero(steps > 1.0).tolist() == [399, 799, 1199] and steps.min() > 0.019
    part = np.concatenate(list(log.parts(["timestamp"], (700, 1300))))
    np.testing.assert_array_equal(part[:, 0], table[700:1300, 0])
    assert [one.text for one in log_files([str(root)])] == [
        f"{root}#{a}:{a + ROWS}" for a in range(0, EPISODES * ROWS, ROWS)
    ]
    assert [one.text for one in log_files([f"{root}#300:900"])] == [
        f"{root}#{a}:{b}" for a, b in ((300, 400), (400, 800), (800, 900))
    ]
    with pytest.raises(LogError, match="no episode in these rows"):
        log_files([f"{root}#5000:6000"])
    content = content_of(log)
    assert content.format == "LeRobot dataset" and content.rate is None
    assert content.remarks[0].startswith("4 episodes, each a run: #0:400, #400:800")
    before = sha256(root)
    (root / "videos").mkdir()
    (root / "videos" / "top.mp4").write_bytes(b"not read")
    assert sha256(root) == before


def test_an_episode_is_read_without_its_neighbours(tmp_path: Path) -> None:
    root = dataset(tmp_path, 3)
    loaded = load_robot(tmp_path / "demo_arm.toml")
    (file,) = log_files([f"{root}#400:800"])
    signals, _ = guess_signals(loaded.robot, *sample_of(root))
    (run,), _ = runs_of(loaded, signals, [file], (), silent)
    assert len(run.segments) == 1
    assert run.segments[0].stop - run.segments[0].start == pytest.approx(7.98, abs=0.05)


def test_a_command_for_one_log_asks_for_one_episode(tmp_path: Path) -> None:
    root = dataset(tmp_path, 2)
    assert log_file(f"{root}#400:800").text == f"{root}#400:800"
    with pytest.raises(LogError, match="4 episodes there, and one is needed") as caught:
        log_file(str(root))
    assert f"{root}#0:400" in caught.value.fix


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (None, ("1", "2", "3")),
        (["a", "a", "b"], ("1", "2", "3")),
        ({"left": ["a", "b"], "right": ["a"]}, ("left_a", "left_b", "right_a")),
    ],
)
def test_elements_with_odd_names_are_positions(
    tmp_path: Path, names: object, expected: tuple[str, ...]
) -> None:
    root = dataset(tmp_path, 2)
    file = root / "meta" / "info.json"
    info = json.loads(file.read_text())
    info["features"]["observation.state"]["names"] = names
    file.write_text(json.dumps(info))
    found = tuple(c for c in open_log(root).columns if c.startswith("observation.state"))
    assert found == tuple(f"observation.state.{name}" for name in expected)
    assert all(Column(name).quantity == "position" for name in found)


def test_lists_of_another_length_are_missing(tmp_path: Path) -> None:
    file = tmp_path / "log.parquet"
    lists = pl.Series([[1.0, 2.0], [3.0, 4.0, 5.0], [6.0], None], dtype=pl.List(pl.Float64))
    pl.DataFrame({"t": [0.0, 0.1, 0.2, 0.3], "q": lists}).write_parquet(file)
    log = open_log(file)
    assert log.columns == ("t", "q_1", "q_2")
    (table,) = log.parts(["q_2", "t"])
    np.testing.assert_array_equal(table[:, 0], [2.0, np.nan, np.nan, np.nan])


def test_a_page_of_long_lists_is_not_decoded(tmp_path: Path) -> None:
    file = tmp_path / "log.parquet"
    rows = pl.Series([[0.0] * 3_000_000], dtype=pl.List(pl.Float64))
    pl.DataFrame({"q": rows}).write_parquet(file, data_page_size=1 << 30)
    with pytest.raises(LogError, match="one of its pages holds"):
        open_log(file)


def _without(root: Path, *columns: str) -> None:
    for file in root.glob("data/*/*.parquet"):
        pl.read_parquet(file).drop(columns).write_parquet(file)


def test_what_no_dataset_has_is_refused(tmp_path: Path) -> None:
    root = dataset(tmp_path, 3)
    broken = tmp_path / "broken"

    def refused(words: str) -> None:
        with pytest.raises(LogError, match=words):
            log_files([str(broken)])
        shutil.rmtree(broken)

    shutil.copytree(root, broken)
    (broken / "meta" / "info.json").write_text("[" * 100_000)
    refused("it is no JSON")
    shutil.copytree(root, broken)
    (broken / "meta" / "info.json").write_text("[]")
    refused("it has no 'features'")
    shutil.copytree(root, broken)
    shutil.rmtree(broken / "data")
    refused("no folder data")
    shutil.copytree(root, broken)
    _without(broken, "episode_index", "timestamp")
    refused("no column 'episode_index' and no 'timestamp'")
    shutil.copytree(root, broken)
    first = broken / "data" / "chunk-000" / "file-000.parquet"
    table = pl.read_parquet(first)
    table.with_columns(pl.lit(None, dtype=pl.Int64).alias("episode_index")).write_parquet(first)
    refused("row 0 has no number of its episode")
    shutil.copytree(root, broken)
    table.with_columns(pl.col("episode_index") % 2).write_parquet(first)
    refused("not together")


def test_a_fuzzed_dataset_is_refused_or_read(tmp_path: Path) -> None:
    root, draw = dataset(tmp_path, 2), random.Random(3)
    files = [root / "meta" / "info.json", *sorted(root.glob("data/*/*.parquet"))]
    refused = 0
    for _ in range(60):
        file = draw.choice(files)
        whole = file.read_bytes()
        broken = bytearray(whole[: draw.randrange(len(whole))] if draw.random() < 0.3 else whole)
        for _ in range(draw.randrange(1, 9)):
            if broken:
                broken[draw.randrange(len(broken))] = draw.randrange(256)
        file.write_bytes(broken)
        try:
            for log in log_files([str(root)]):
                for part in open_log(log.path).parts(["timestamp"]):
                    assert part.shape[1] == 1
        except SteelyardError:
            refused += 1
        file.write_bytes(whole)
    assert refused > 5
