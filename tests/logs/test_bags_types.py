"""Messages of any type: by the bag's own definitions, as JSON, or not at all."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bag_writers import FLOATS, ROS2, Note, joint_state, message, write_json_mcap, write_mcap
from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log

DRIVES = """
std_msgs/Header header
duration since
bool enabled
int8 mode
string note
float32[3] current
Drive[] drives
Drive spare
================================================================================
MSG: lab_msgs/Drive
uint16 COUNT=4
float64 temperature
time read
"""


def drives_store(stores: Stores) -> Any:
    store = get_typestore(stores)
    store.register(get_types_from_msg(DRIVES, "lab_msgs/msg/Drives"))
    return store


def drives(store: Any) -> Any:
    types = store.types
    signature = types["builtin_interfaces/msg/Time"](12, 500_000_000)
    since = types["builtin_interfaces/msg/Duration"](-1, 250_000_000)
    header = types["std_msgs/msg/Header"]
    head = (
        header(7, signature, "") if "seq" in header.__dataclass_fields__ else header(signature, "")
    )
    drive = types["lab_msgs/msg/Drive"]
    return types["lab_msgs/msg/Drives"](
        head, since, True, -3, "x", np.array([0.5, 1.5, 2.5], dtype=np.float32),
        [drive(40.0, signature), drive(41.0, signature)], drive(42.0, signature),
    )  # fmt: skip


EXPECTED = {
    "stamp": 12.5, "log_time": 77.0, "since": -0.75, "enabled": 1.0, "mode": -3.0,
    "current/0": 0.5, "current/1": 1.5, "current/2": 2.5,
    "drives/0/temperature": 40.0, "drives/0/read": 12.5,
    "drives/1/temperature": 41.0, "drives/1/read": 12.5,
    "spare/temperature": 42.0, "spare/read": 12.5,
}  # fmt: skip


def of_drives(folder: Path, kind: str) -> Path:
    if kind == "bag1":
        store = drives_store(Stores.ROS1_NOETIC)
        with Writer1(folder / "run.bag") as first:
            channel = first.add_connection("/drives", "lab_msgs/msg/Drives", typestore=store)
            data = store.serialize_ros1(drives(store), "lab_msgs/msg/Drives")
            first.write(channel, 77 * 10**9, data)
        return folder / "run.bag"
    store = drives_store(Stores.ROS2_JAZZY)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(folder / "run", version=9, storage_plugin=plugin) as second:
        connection = second.add_connection("/drives", "lab_msgs/msg/Drives", typestore=store)
        data = store.serialize_cdr(drives(store), "lab_msgs/msg/Drives")
        second.write(connection, 77 * 10**9, data)
    return folder / "run"


@pytest.mark.parametrize("kind", ["bag1", "sqlite3", "mcap"])
def test_types_of_the_bag_itself_are_read(tmp_path: Path, kind: str) -> None:
    log = open_log(of_drives(tmp_path, kind))
    assert log.columns == tuple(f"/drives/{name}" for name in EXPECTED)
    (part,) = log.parts(log.columns)
    np.testing.assert_array_equal(part, [list(EXPECTED.values())])


def test_big_endian_and_wire_definitions_in_idl_are_read(tmp_path: Path) -> None:
    idl = b"module lab_msgs { module msg { struct Pose { double x; sequence<double> y; }; }; };"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 x\nfloat64[] y\n", "lab_msgs/msg/Pose"))
    pose = store.types["lab_msgs/msg/Pose"](1.5, np.array([2.5, 3.5]))
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("lab_msgs/msg/Pose", "ros2idl", idl)
        channel = writer.register_channel("/pose", "cdr", schema)
        for k, little in enumerate((True, False)):
            data = store.serialize_cdr(pose, "lab_msgs/msg/Pose", little_endian=little)
            writer.add_message(channel, k, bytes(data), k)
        writer.finish()
    log = open_log(tmp_path / "run.mcap")
    (part,) = log.parts(("/pose/x", "/pose/y/0", "/pose/y/1"))
    np.testing.assert_array_equal(part, [[1.5, 2.5, 3.5]] * 2)


def test_known_types_need_no_definition(tmp_path: Path) -> None:
    note = joint_state(5 * 10**9, ["a"], [1.5], [], [])
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        data = bytes(ROS2.serialize_cdr(message(ROS2, note), note.type))
        for topic, name in (("/joint_states", note.type), ("/odd", "lab_msgs/msg/Odd")):
            schema = writer.register_schema(name, "", b"")
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, note.time, data, note.time)
        writer.finish()
    log = open_log(tmp_path / "run.mcap")
    (part,) = log.parts(("/joint_states/stamp", "/joint_states/position/a"))
    np.testing.assert_array_equal(part, [[5.0, 1.5]])
    with pytest.raises(LogError, match="'lab_msgs/msg/Odd' is not defined in the file") as caught:
        list(log.parts(("/odd/position",)))
    assert "with its definition" in caught.value.fix
    assert [t["problem"] != "" for t in open_log(tmp_path / "run.mcap").topics] == [False, True]  # type: ignore[attr-defined]


def test_json_is_read(tmp_path: Path) -> None:
    signature = {"sec": 3, "nsec": 250_000_000}
    joints = {"header": {"stamp": signature}, "name": ["b", "a"], "position": [2, 1.0]}
    free = {"timestamp": signature, "tcp": {"force": [1, 2.5, None]}, "ok": True, "n": 10**400}
    notes = [("/js", 4 * 10**9, joints), ("/free", 5 * 10**9, free)]
    log = open_log(write_json_mcap(tmp_path / "run.mcap", notes))
    columns = ("/js/stamp", "/js/log_time", "/js/position/a", "/js/position/b")
    assert sorted(log.columns[:4]) == sorted(columns)
    (part,) = log.parts(columns)
    np.testing.assert_array_equal(part, [[3.25, 4.0, 1.0, 2.0]])
    (part,) = log.parts(("/free/stamp", "/free/tcp/force/1", "/free/ok", "/free/n"))
    np.testing.assert_array_equal(part, [[3.25, 2.5, 1.0, np.nan]])
    assert "/free/tcp/force/2" not in log.columns


def test_huge_arrays_are_left_out_and_growing_ones_have_their_first_length(tmp_path: Path) -> None:
    def note(k: int, values: list[float]) -> Note:
        return Note("/cmd", FLOATS, k, {"data": values})

    notes = [note(k, [1.0] * (2 if k < 200 else 5)) for k in range(300)]
    notes += [Note("/map", FLOATS, 7, {"data": [0.0] * 257})]
    log = open_log(write_mcap(tmp_path / "run.mcap", notes))
    assert [c for c in log.columns if "/data/" in c] == ["/cmd/data/0", "/cmd/data/1"]
    (part,) = log.parts(("/cmd/data/1",))
    assert len(part) == 300 and np.all(part == 1.0)


def test_a_log_without_numbers_lists_its_topics(tmp_path: Path) -> None:
    notes = [Note("/chatter", "std_msgs/msg/String", 0, {"data": "hello"})]
    with pytest.raises(LogError, match="no topic of the log holds numbers") as caught:
        open_log(write_mcap(tmp_path / "run.mcap", notes))
    assert "/chatter (std_msgs/msg/String" in caught.value.wrong
    assert "sensor_msgs/msg/JointState" in caught.value.fix


def test_encodings_that_are_not_read_are_named(tmp_path: Path) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("lab.Pose", "protobuf", b"")
        writer.add_message(writer.register_channel("/pose", "protobuf", schema), 0, b"\0", 0)
        writer.finish()
    with pytest.raises(LogError, match="encoding 'protobuf' is not read; cdr, ros1 and json"):
        open_log(tmp_path / "run.mcap")


def test_messages_that_cannot_be_decoded_are_rows_of_nan(tmp_path: Path) -> None:
    notes = [joint_state(k * 10**9, ["a"], [k], [], []) for k in range(1, 4)]
    store = ROS2.serialize_cdr(message(ROS2, notes[0]), notes[0].type)
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema(notes[0].type, "", b"")
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k, data in enumerate([bytes(store), bytes(store)[:30], bytes(store)]):
            writer.add_message(channel, k, data, k)
        writer.finish()
    (part,) = open_log(tmp_path / "run.mcap").parts(
        ("/joint_states/stamp", "/joint_states/position/a")
    )
    np.testing.assert_array_equal(part, [[1, 1], [np.nan, np.nan], [1, 1]])


@pytest.mark.parametrize(
    ("definition", "words"),
    [
        ("float64 x\nlab_msgs/Gone g\n", "lacks the type 'lab_msgs/msg/Gone'"),
        ("float64[999999999] x\n", "holds more than"),
        ("string[999999999] x\n", "holds more than"),
        ("Odd[2] x\n", "contains itself"),
        ("Nil[] x\n" + "=" * 80 + "\nMSG: lab_msgs/Nil\n\n", "a sequence of nothing"),
        ("float64[ x\n", "cannot be understood"),
        ("#" * 300_000, "cannot be understood"),
    ],
)
def test_definitions_of_strangers(tmp_path: Path, definition: str, words: str) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("lab_msgs/msg/Odd", "ros1msg", definition.encode())
        channel = writer.register_channel("/odd", "ros1", schema)
        writer.add_message(channel, 0, bytes(100), 0)
        writer.finish()
    with pytest.raises(LogError, match=words):
        open_log(tmp_path / "run.mcap")


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        (
            "ros2idl",
            "module a { module msg { const long long X = 1 << 30000000000; "
            "struct B { double x; }; }; };",
        ),
        ("ros2idl", "module a { module msg { const long X = 9 << Y; struct B { double x; }; }; };"),
        ("ros2msg", "string[65000] s"),
    ],
)
def test_definitions_that_fill_the_memory_are_not_read(
    tmp_path: Path, dialect: str, text: str
) -> None:
    path = _of_type(tmp_path / "large.mcap", dialect, text)
    with pytest.raises(LogError) as refused:
        open_log(path)
    assert "shifts a constant" in str(refused.value) or "holds more than" in str(refused.value)


def test_a_shift_in_a_comment_of_a_message_is_none(tmp_path: Path) -> None:
    text = '# errors of joint k: bit 1 << k\nstring S="a << b"\nfloat64[8] x\n'
    columns = open_log(_of_type(tmp_path / "run.mcap", "ros2msg", text)).columns
    assert sum(name.startswith("/b/x") for name in columns) == 8


def _of_type(path: Path, dialect: str, text: str) -> Path:
    """Messages of zeros of a type that is defined so."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        schema = writer.register_schema("a/msg/B", dialect, text.encode())
        channel = writer.register_channel("/b", "cdr", schema)
        for k in range(5):
            writer.add_message(channel, k * 10**7, bytes((0, 1, 0, 0, *bytes(64))), k * 10**7)
        writer.finish()
    return path
