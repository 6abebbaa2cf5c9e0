"""Strangers' bags: cut, flipped, empty, packed to burst. A clear error or a clean result."""

import bz2
import sqlite3
import struct
import subprocess
import sys
import textwrap
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter

from bag_writers import (
    ROS2,
    in_order,
    joint_state,
    message,
    wrench,
    write_bag1,
    write_bag2,
    write_mcap,
)
from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log

COLUMNS = ("/joint_states/stamp", "/joint_states/position/a", "/wrench/wrench/force/x")
COUNT = 40


def write(folder: Path, kind: str) -> Path:
    joints = [joint_state(k * 10**7, ["b", "a"], [0, k], [1, 2], [3, 4]) for k in range(COUNT)]
    force = [wrench(k * 10**7, [k, 0, 0, 0, 0, 0]) for k in range(COUNT)]
    notes = in_order([*joints, *force])
    if kind == "mcap":
        return write_mcap(folder / "run.mcap", notes, chunk=1500)
    if kind == "mcap-lz4":
        return write_mcap(folder / "run.mcap", notes, "lz4", chunk=1500)
    if kind == "mcap-plain":
        return write_mcap(folder / "run.mcap", notes, "none", chunk=1500, enable_crcs=False)
    if kind == "mcap-unchunked":
        return write_mcap(folder / "run.mcap", notes, "none", use_chunking=False)
    if kind == "bag1":
        return write_bag1(folder / "run.bag", notes)
    if kind == "bag1-bz2":
        return write_bag1(folder / "run.bag", notes, "bz2")
    return write_bag2(folder / "run", notes) / "run.db3"


KINDS = ("mcap", "mcap-lz4", "mcap-plain", "mcap-unchunked", "bag1", "bag1-bz2", "db3")


@dataclass(frozen=True)
class Whole:
    """A good bag."""

    path: Path
    data: bytes = field(repr=False)

    def beside(self, data: bytes | bytearray) -> Path:
        """Another file of that kind."""
        path = self.path.with_name(f"other{self.path.suffix}")
        path.write_bytes(data)
        return path


@pytest.fixture(scope="module", params=KINDS)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    path = write(tmp_path_factory.mktemp("whole"), request.param)
    return Whole(path, path.read_bytes())


def attempt(path: Path) -> np.ndarray | None:
    """The table, or nothing if it is refused in words."""
    try:
        log = open_log(path)
        parts = list(log.parts(tuple(c for c in COLUMNS if c in log.columns) or log.columns[:3]))
    except LogError as error:
        assert error.wrong and error.fix and str(path.parent) in error.where
        assert len(str(error)) < 3000
        return None
    return np.concatenate(parts) if parts else np.zeros((0, 3))


FUZZED = settings(
    deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@FUZZED
@given(part=st.floats(0.0, 1.0, exclude_max=True))
def test_cut_files_are_read_up_to_where_they_end(whole: Whole, part: float) -> None:
    table = attempt(whole.beside(whole.data[: int(part * len(whole.data))]))
    if table is not None and table.shape[1] == 3:
        assert len(table) <= COUNT
        np.testing.assert_array_equal(table[:, 1], np.arange(len(table)))


@pytest.mark.slow
@FUZZED
@given(st.lists(st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(1, 255)), max_size=4))
def test_flipped_bits_do_no_harm(whole: Whole, flips: list[tuple[float, int]]) -> None:
    changed = bytearray(whole.data)
    for part, mask in flips:
        changed[int(part * len(changed))] ^= mask
    attempt(whole.beside(changed))


@settings(FUZZED, max_examples=30)
@given(st.binary(max_size=200))
def test_rubbish_behind_a_true_start_is_refused(whole: Whole, rubbish: bytes) -> None:
    for start in (0, 8, 13, 100):
        attempt(whole.beside(whole.data[:start] + rubbish))


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("db3", "bag1-bz2")])
def test_half_of_a_recording_is_read_with_a_remark(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind)
    data = bytearray(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    path.write_bytes(data)
    log = open_log(path)
    (part,) = log.parts(COLUMNS[:2])
    assert 5 < len(part) < COUNT
    np.testing.assert_array_equal(part[:, 1], np.arange(len(part)))
    assert "it is read up to where it ends" in log.remarks[0]  # type: ignore[attr-defined]


def test_a_tail_of_zeros_is_the_end(tmp_path: Path) -> None:
    """File systems leave zeros where the last blocks were not written."""
    path = write(tmp_path, "mcap-unchunked")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + bytes(4096))
    assert len(attempt(path)) > 5  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["mcap", "mcap-lz4"])
def test_a_flipped_bit_in_a_chunk_is_reported_with_its_place(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind)
    data = bytearray(path.read_bytes())
    data[data.index(kind.partition("-")[2].encode() or b"zstd") + 100] ^= 8
    path.write_bytes(data)
    with pytest.raises(LogError, match="the record at byte [0-9]+ cannot be read") as caught:
        list(open_log(path).parts(COLUMNS))
    assert "mcap recover" in caught.value.fix


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("run.bag", b"#ROSBAG V1.2\n" + bytes(100), "of version V1.2"),
        ("run.bag", b"#ROSBAG V2.0\n", "the file ends in it"),
        ("run.bag", b"#ROSBAG V2.0\n" + b"\xff" * 100, "header is 4,294,967,295 bytes"),
        ("run.mcap", b"\x89MCAP0\r\n", "holds no messages"),
        ("run.mcap", b"\x89MCAP0\r\n" + b"\x05" + b"\xff" * 100, "was not announced"),
        ("run.db3", b"SQLite format 3\0" + bytes(1000), "database"),
        ("run.db3", b"\x28\xb5\x2f\xfd" + b"\xff" * 1000, "it cannot be unpacked"),
    ],
)
def test_stumps_are_refused(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(LogError, match=words):
        open_log(tmp_path / name)


def test_an_encrypted_bag_is_refused(tmp_path: Path) -> None:
    fields = (b"op=\x03", b"index_pos=" + bytes(8), b"encryptor=rosbag/AesCbcEncryptor")
    header = b"".join(struct.pack("<I", len(f)) + f for f in fields)
    data = b"#ROSBAG V2.0\n" + struct.pack("<I", len(header)) + header + bytes(4)
    (tmp_path / "run.bag").write_bytes(data)
    with pytest.raises(LogError, match="encrypted by rosbag/AesCbcEncryptor") as caught:
        open_log(tmp_path / "run.bag")
    assert "rosbag decrypt" in caught.value.fix


def test_packed_bags_of_another_kind_are_refused(tmp_path: Path) -> None:
    folder = write_bag2(tmp_path / "run", [joint_state(0, ["a"], [1], [], [])], packed="file")
    metadata = folder / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("compression_format: zstd", "compression_format: xz")
    )
    with pytest.raises(
        LogError, match=r"files are compressed \(xz\), where zstd is read"
    ) as caught:
        open_log(folder)
    assert "ros2 bag convert" in caught.value.fix


def test_errors_of_a_packed_bag_name_it_and_not_its_copy(tmp_path: Path) -> None:
    path = write(tmp_path, "db3")
    packed = tmp_path / "run.db3.zstd"
    packed.write_bytes(zstandard.compress(path.read_bytes()[:-100]))
    with pytest.raises(LogError, match="its database cannot be read .it has") as caught:
        open_log(packed)
    assert caught.value.where == str(packed)
    packed.write_bytes(zstandard.compress(b"something else"))
    with pytest.raises(LogError, match="neither an MCAP file nor the database") as caught:
        open_log(packed)
    assert caught.value.where == str(packed)


def test_a_packed_bag_that_unpacks_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """rosbags' reader fills the disk with it."""
    monkeypatch.setattr("steelyard.logs.messages.decompression.SPARE", 1 << 20)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(zeros("zstd", 64 << 20))
    with pytest.raises(LogError, match="more than 1000 times its packed size") as caught:
        open_log(path)
    assert caught.value.where == str(path)
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as Linux does it")
def test_a_packed_message_that_unpacks_to_gigabytes_is_one_too_long(tmp_path: Path) -> None:
    """rosbags' reader takes 0.9 GiB of memory for it."""
    notes = [joint_state(k * 10**7, ["a"], [k], [1], [2]) for k in range(COUNT)]
    folder = write_bag2(tmp_path / "run", notes, packed="message")
    with closing(sqlite3.connect(folder / "run.db3")) as base:
        base.execute("UPDATE messages SET data = ? WHERE id = 9", (zeros("zstd", 300 << 20),))
        base.commit()
    assert read_in_little(folder).strip() == str(COUNT)


def test_a_database_of_something_else_is_refused(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "run.db3")) as base:
        base.execute("CREATE TABLE songs (name TEXT)")
        base.execute("CREATE TABLE topics (id INTEGER)")
        base.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 "
            "FROM n) SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n"
        )
        base.commit()
    with pytest.raises(LogError, match="not a ROS 2 bag") as caught:
        open_log(tmp_path / "run.db3")
    assert "-wal" in caught.value.fix


def test_an_open_journal_is_remarked(tmp_path: Path) -> None:
    path = write(tmp_path, "db3")
    path.with_name("run.db3-wal").write_bytes(b"x" * 100)
    assert "run.db3-wal holds messages" in open_log(path).remarks[0]  # type: ignore[attr-defined]


def bomb(packed: bytes, size: int, packing: bytes) -> bytes:
    """An MCAP file of one chunk that unpacks to `size` bytes."""
    chunk = struct.pack("<QQQII", 0, 0, size, 0, len(packing)) + packing
    chunk += struct.pack("<Q", len(packed)) + packed
    return b"\x89MCAP0\r\n\x06" + struct.pack("<Q", len(chunk)) + chunk


def zeros(packing: str, size: int) -> bytes:
    """So many zeros, packed piecewise; the first bytes are a record that is as long."""
    start = b"\x80" + struct.pack("<Q", size - 9)
    pieces = (start if k == 0 else b"" for k in range(size >> 20))
    blocks = ((piece + bytes((1 << 20) - len(piece))) for piece in pieces)
    packer: Callable[[bytes], bytes]
    if packing == "lz4":
        context = lz4.frame.LZ4FrameCompressor()
        head = context.begin()
        return head + b"".join(map(context.compress, blocks)) + context.flush()
    maker = bz2.BZ2Compressor(1) if packing == "bz2" else zstandard.ZstdCompressor().compressobj()
    packer = maker.compress
    return b"".join(map(packer, blocks)) + maker.flush()


READ_IN_LITTLE = """
    import resource, sys
    from pathlib import Path
    import rosbags.typesys, mcap.records, zstandard, lz4.frame
    from steelyard.base.errors import LogError
    from steelyard.logs.formats import open_log
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + (64 << 20), now + (64 << 20)))
    try:
        log = open_log(sys.argv[1])
        print(sum(len(part) for part in log.parts(log.columns[:2])))
    except LogError as error:
        print(error.wrong)
"""


def read_in_little(path: Path) -> str:
    """What is read, or the error's words, in a process that may grow by 64 MiB."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(READ_IN_LITTLE), str(path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as Linux does it")
@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_small_files_that_unpack_to_gigabytes_are_refused_in_little_memory(
    tmp_path: Path, packing: str
) -> None:
    size = 300 << 20
    packed = zeros(packing, size)
    honest, lying = tmp_path / "honest.mcap", tmp_path / "lying.mcap"
    honest.write_bytes(bomb(packed, size, packing.encode()))
    lying.write_bytes(bomb(packed, 1000, packing.encode()))
    assert "it is a chunk of 314,572,800 bytes" in read_in_little(honest)
    assert "cannot be read" in read_in_little(lying)


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as Linux does it")
def test_huge_claims_need_no_memory(tmp_path: Path) -> None:
    start = b"\x89MCAP0\r\n"
    frame = b"\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", 2_000_000_000) + b"\x01\0\0"
    claims = {
        "record.mcap": start + b"\x03" + struct.pack("<Q", 1 << 40),
        "chunk.mcap": bomb(b"x" * 100, 1 << 40, b"zstd"),
        "frame.mcap": bomb(frame, 2_000_000_000, b"zstd"),
        "message.bag": b"#ROSBAG V2.0\n" + struct.pack("<I", 0xFFFFFFF0),
    }
    for name, data in claims.items():
        (tmp_path / name).write_bytes(data)
        assert len(read_in_little(tmp_path / name).strip()) > 10


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited as Linux does it")
def test_a_long_recording_needs_no_more_memory_than_a_part(tmp_path: Path) -> None:
    notes = [
        joint_state(k * 10**6, [f"joint_{i}" for i in range(7)], *np.zeros((3, 7)))
        for k in range(1000)
    ]
    picture = np.random.default_rng(1).bytes(3 << 20)
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema(notes[0].type, "", b"")
        image = writer.register_schema("sensor_msgs/msg/Image", "", b"")
        joints = writer.register_channel("/joint_states", "cdr", schema)
        camera = writer.register_channel("/camera", "cdr", image)
        for k, note in enumerate(notes):
            data = bytes(ROS2.serialize_cdr(message(ROS2, note), note.type))
            writer.add_message(joints, note.time, data, note.time)
            if k % 100 == 0:
                writer.add_message(camera, note.time, picture, note.time)
        writer.finish()
    assert read_in_little(tmp_path / "run.mcap").strip() == "1000"
