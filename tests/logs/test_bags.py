"""Bags of every kind give back what the reference libraries wrote, bit for bit."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bag_writers import Note, in_order, joint_state, wrench, write_bag1, write_bag2, write_mcap
from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import Log
from steelyard.logs.messages.message_log import MessageLog

NAMES = tuple(f"arm_{k}_joint" for k in range(1, 7))
JOINTS = tuple(
    f"/joint_states/{quantity}/{name}"
    for quantity in ("position", "velocity", "effort")
    for name in NAMES
)
START = 1_700_000_000_123_456_789
Writer = Callable[[Path, Iterable[Note]], Path]
WRITERS: dict[str, Writer] = {
    "bag1": lambda folder, notes: write_bag1(folder / "run.bag", notes),
    "bag1-lz4": lambda folder, notes: write_bag1(folder / "run.bag", notes, "lz4"),
    "bag1-bz2": lambda folder, notes: write_bag1(folder / "run.bag", notes, "bz2"),
    "bag2-sqlite": lambda folder, notes: write_bag2(folder / "run", notes),
    "bag2-sqlite-packed": lambda folder, notes: write_bag2(folder / "run", notes, packed="message"),
    "bag2-sqlite-zstd": lambda folder, notes: write_bag2(folder / "run", notes, packed="file"),
    "db3-zstd": lambda folder, notes: (
        write_bag2(folder / "run", notes, packed="file") / "run.db3.zstd"
    ),
    "bag2-mcap": lambda folder, notes: write_bag2(folder / "run", notes, "mcap"),
    "db3": lambda folder, notes: write_bag2(folder / "run", notes) / "run.db3",
    "mcap-zstd": lambda folder, notes: write_mcap(folder / "run.mcap", notes, chunk=4000),
    "mcap-lz4": lambda folder, notes: write_mcap(folder / "run.mcap", notes, "lz4"),
    "mcap-plain": lambda folder, notes: write_mcap(folder / "run.mcap", notes, "none"),
    "mcap-unchunked": lambda folder, notes: write_mcap(
        folder / "run.mcap", notes, "none", use_chunking=False
    ),
}


def of_robot(
    rng: np.random.Generator, count: int, step: int = 2_000_000
) -> tuple[list[Note], np.ndarray]:
    """Joint states in an order of joints that changes, and the table they are."""
    table = rng.normal(size=(count, 18))
    notes = []
    for k, row in enumerate(table):
        order = rng.permutation(6)
        q, dq, tau = (row[first:][order] for first in (0, 6, 12))
        names = [NAMES[i] for i in order]
        notes.append(joint_state(START + k * step + k % 7 * 1001, names, q, dq, tau))
    return notes, table


@pytest.fixture(params=sorted(WRITERS))
def writer(request: pytest.FixtureRequest) -> Writer:
    return WRITERS[request.param]


def read(log: Log, columns: Iterable[str], **options: object) -> np.ndarray:
    return np.concatenate(list(log.parts(tuple(columns), **options)))  # type: ignore[arg-type]


def test_what_was_written_is_read(tmp_path: Path, writer: Writer) -> None:
    notes, table = of_robot(np.random.default_rng(1), 150)
    log = open_log(writer(tmp_path, notes))
    times = ("/joint_states/stamp", "/joint_states/log_time")
    assert log.columns[:2] == times
    assert sorted(log.columns) == sorted(times + JOINTS)
    found = read(log, (*times, *JOINTS))
    np.testing.assert_array_equal(found[:, 2:], table)
    np.testing.assert_array_equal(found[:, 0], [n.content["stamp"] / 10**9 for n in notes])
    np.testing.assert_array_equal(found[:, 1], [n.time / 10**9 for n in notes])


def test_times_of_nine_decimals_come_back(tmp_path: Path, writer: Writer) -> None:
    texts = [f"{k * 17}.{k * 123_456_79 % 10**9:09d}" for k in range(1, 100)]
    stamps = [int(text.replace(".", "")) for text in texts]
    notes = [joint_state(signature, NAMES[:1], [0.0], [], []) for signature in stamps]
    found = read(open_log(writer(tmp_path, notes)), ("/joint_states/stamp",))
    assert found[:, 0].tolist() == [float(text) for text in texts]


def test_topics_are_counted(tmp_path: Path, writer: Writer) -> None:
    notes, _ = of_robot(np.random.default_rng(2), 11, 100_000_000)
    more = [wrench(START + k * 250_000_000, [0.0] * 6) for k in range(5)]
    path = writer(tmp_path, in_order([*notes, *more]))
    joints, force = MessageLog.open(path).topics
    assert (joints["name"], joints["type"]) == ("/joint_states", "sensor_msgs/msg/JointState")
    assert (joints["count"], force["name"], force["count"]) == (11, "/wrench", 5)
    assert joints["rate"] == 10 / (notes[-1].time / 10**9 - notes[0].time / 10**9)
    assert force["rate"] == pytest.approx(4.0) and joints["rate"] == pytest.approx(10.0, rel=1e-3)
    log = open_log(path)
    assert log.topics == (joints, force)  # type: ignore[attr-defined]
    assert log.remarks == ()  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, np.ndarray]:
    notes, table = of_robot(np.random.default_rng(3), 60)
    stamps = [n.content["stamp"] / 10**9 for n in notes]
    path = write_mcap(tmp_path_factory.mktemp("small") / "run.mcap", notes, chunk=3000)
    return open_log(path), np.column_stack([stamps, table])


@settings(deadline=None, max_examples=40)
@given(
    size=st.integers(1, 70),
    start=st.integers(0, 70),
    stop=st.none() | st.integers(0, 70),
    order=st.permutations(range(19)),
)
def test_parts_are_the_table(
    small: tuple[Log, np.ndarray], size: int, start: int, stop: int | None, order: list[int]
) -> None:
    log, table = small
    columns = [("/joint_states/stamp", *JOINTS)[k] for k in order[:5]]
    parts = list(log.parts(columns, (start, stop), size))
    assert all(0 < len(part) <= size for part in parts)
    assert all(len(part) == size for part in parts[:-1])
    wanted = table[start:stop][:, order[:5]]
    found = np.concatenate(parts) if parts else wanted[:0]
    np.testing.assert_array_equal(found, wanted)


def test_a_gripper_on_the_same_topic_makes_no_rows(tmp_path: Path) -> None:
    notes, table = of_robot(np.random.default_rng(4), 40)
    gripper = [
        joint_state(n.content["stamp"] + 500_000, ["finger"], [k], [], [])
        for k, n in enumerate(notes)
    ]
    log = open_log(write_bag1(tmp_path / "run.bag", in_order([*notes, *gripper])))
    assert "/joint_states/position/finger" in log.columns
    assert "/joint_states/effort/finger" not in log.columns
    np.testing.assert_array_equal(read(log, JOINTS), table)
    both = read(log, ("/joint_states/stamp", JOINTS[0], "/joint_states/position/finger"))
    assert len(both) == 80
    np.testing.assert_array_equal(np.isnan(both[:, 1]), np.arange(80) % 2 == 1)
    np.testing.assert_array_equal(both[1::2, 2], np.arange(40.0))


def test_missing_names_and_values_are_nan_and_nameless_joints_are_numbered(tmp_path: Path) -> None:
    notes = [
        joint_state(START, ["a", "b"], [1.0, 2.0], [3.0, 4.0], []),
        joint_state(START + 10**7, ["b", "c"], [5.0], [6.0, 7.0], [8.0, 9.0]),
        joint_state(START, [], [0.5, 1.5], [], [2.5], "/nameless"),
    ]
    log = open_log(write_mcap(tmp_path / "run.mcap", notes))
    found = read(log, [f"/joint_states/{c}" for c in ("position/a", "position/b", "effort/c")])
    np.testing.assert_array_equal(found, [[1.0, 2.0, np.nan], [np.nan, 5.0, 9.0]])
    columns = [c for c in log.columns if c.startswith("/nameless") and "/" in c[10:]]
    assert columns == [f"/nameless/{c}" for c in ("position/0", "position/1", "effort/0")]
    np.testing.assert_array_equal(read(log, columns), [[0.5, 1.5, 2.5]])


def test_without_stamps_the_log_time_counts(tmp_path: Path) -> None:
    notes = [
        replace(joint_state(0, ["a"], [float(k)], [], []), time=START + k * 10**7) for k in range(5)
    ]
    log = open_log(write_bag2(tmp_path / "run", notes))
    signature, recorded = read(log, ("/joint_states/stamp", "/joint_states/log_time")).T
    np.testing.assert_array_equal(signature, recorded)
    assert signature[0] == START / 10**9


def test_files_of_a_split_bag_follow_each_other(tmp_path: Path) -> None:
    notes, table = of_robot(np.random.default_rng(5), 30)
    folder = write_bag2(tmp_path / "run", notes[:20], "mcap")
    write_bag2(tmp_path / "more", notes[20:], "mcap")
    (tmp_path / "more" / "more.mcap").rename(folder / "run_1.mcap")
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    assert "- run.mcap\n" in text
    start, _, rest = text.partition("  - run.mcap\n")
    metadata.write_text(f"{start}  - run.mcap\n  - 'run_1.mcap'\n{rest}")
    np.testing.assert_array_equal(read(open_log(folder), JOINTS), table)
    metadata.write_text(text.replace("- run.mcap\n", "- gone.mcap\n"))
    with pytest.raises(LogError, match="no such log file") as caught:
        open_log(folder)
    assert "run.mcap" in caught.value.fix
    metadata.write_text("rosbag2_bagfile_information:\n")
    with pytest.raises(LogError, match="'relative_file_paths'") as caught:
        open_log(folder)
    assert ".mcap file itself" in caught.value.fix


def test_nothing_is_written_beside_a_bag(tmp_path: Path, writer: Writer) -> None:
    notes, _ = of_robot(np.random.default_rng(6), 5)
    path = writer(tmp_path, notes)
    files = {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in tmp_path.rglob("*")}
    for p in (*files, tmp_path):
        p.chmod(0o555 if p.is_dir() else 0o444)
    try:
        read(open_log(path), JOINTS)
    finally:
        for p in (tmp_path, *files):
            p.chmod(0o755 if p.is_dir() else 0o644)
    assert files == {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in tmp_path.rglob("*")}


def test_the_content_counts_and_not_the_suffix(tmp_path: Path) -> None:
    notes, table = of_robot(np.random.default_rng(7), 5)
    write_mcap(tmp_path / "run.bag", notes)
    write_bag1(tmp_path / "run.bag.active", notes)
    for name in ("run.bag", "run.bag.active"):
        np.testing.assert_array_equal(read(open_log(tmp_path / name), JOINTS), table)
    (tmp_path / "run.db3").write_text("t,q\n0,1\n")
    with pytest.raises(LogError, match="neither an MCAP file nor the database") as caught:
        open_log(tmp_path / "run.db3")
    assert ".csv" in caught.value.fix


def test_a_column_that_is_not_there_is_named_with_its_neighbours(tmp_path: Path) -> None:
    notes, _ = of_robot(np.random.default_rng(8), 5)
    log = open_log(write_mcap(tmp_path / "run.mcap", notes))
    with pytest.raises(LogError, match="no column '/joint_states/position/arm_9_joint'") as caught:
        read(log, ("/joint_states/position/arm_9_joint",))
    assert "/joint_states/position/arm_" in caught.value.fix
