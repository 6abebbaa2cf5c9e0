"""Bags written by the reference libraries, for tests of their readers."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
FLOATS = "std_msgs/msg/Float64MultiArray"


@dataclass(frozen=True)
class Note:
    """A message to be written: topic, type, log time [ns] and content."""

    topic: str
    type: str
    time: int
    content: dict[str, Any]


def header(store: Any, ns: int) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    kind = store.types["std_msgs/msg/Header"]
    return kind(0, time, "base") if "seq" in kind.__dataclass_fields__ else kind(time, "base")


def joint_state(
    ns: int, names: Sequence[str], q: Any, dq: Any, tau: Any, topic: str = "/joint_states"
) -> Note:
    content = {"stamp": ns, "name": list(names), "position": q, "velocity": dq, "effort": tau}
    return Note(topic, JOINT_STATE, ns + 100_000, content)


def wrench(ns: int, values: Sequence[float], topic: str = "/wrench") -> Note:
    return Note(topic, WRENCH, ns + 100_000, {"stamp": ns, "values": values})


def floats(ns: int, values: Sequence[float], topic: str = "/cmd") -> Note:
    return Note(topic, FLOATS, ns, {"data": values})


def message(store: Any, note: Note) -> Any:
    types, c = store.types, note.content
    if note.type == JOINT_STATE:
        arrays = [np.array(c[k], dtype=float) for k in ("position", "velocity", "effort")]
        return types[JOINT_STATE](header(store, c["stamp"]), c["name"], *arrays)
    if note.type == WRENCH:
        vector = types["geometry_msgs/msg/Vector3"]
        both = types["geometry_msgs/msg/Wrench"](vector(*c["values"][:3]), vector(*c["values"][3:]))
        return types[WRENCH](header(store, c["stamp"]), both)
    if note.type == FLOATS:
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        return types[FLOATS](layout, np.array(c["data"], dtype=float))
    return types[note.type](**c)


def in_order(notes: Iterable[Note]) -> list[Note]:
    return sorted(notes, key=lambda note: note.time)


def write_bag1(path: Path, notes: Iterable[Note], compression: str = "") -> Path:
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        channels: dict[str, Any] = {}
        for note in notes:
            if note.topic not in channels:
                channels[note.topic] = writer.add_connection(note.topic, note.type, typestore=ROS1)
            data = ROS1.serialize_ros1(message(ROS1, note), note.type)
            writer.write(channels[note.topic], note.time, data)
    return path


def write_bag2(
    path: Path, notes: Iterable[Note], storage: str = "sqlite3", packed: str = ""
) -> Path:
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    with writer:
        channels: dict[str, Any] = {}
        for note in notes:
            if note.topic not in channels:
                channels[note.topic] = writer.add_connection(note.topic, note.type, typestore=ROS2)
            data = ROS2.serialize_cdr(message(ROS2, note), note.type)
            writer.write(channels[note.topic], note.time, data)
    return path


def write_mcap(
    path: Path,
    notes: Iterable[Note],
    compression: str = "zstd",
    chunk: int = 1 << 20,
    **options: Any,
) -> Path:
    """ROS 2 messages as CDR."""
    with path.open("wb") as file:
        writer = McapWriter(
            file, chunk_size=chunk, compression=CompressionType[compression.upper()], **options
        )
        writer.start("ros2")
        channels: dict[str, int] = {}
        for note in notes:
            if note.topic not in channels:
                text, _ = ROS2.generate_msgdef(note.type, ros_version=2)
                schema = writer.register_schema(note.type, "ros2msg", text.encode())
                channels[note.topic] = writer.register_channel(note.topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(message(ROS2, note), note.type))
            writer.add_message(channels[note.topic], note.time, data, note.time)
        writer.finish()
    return path


def write_json_mcap(path: Path, notes: Iterable[tuple[str, int, dict[str, Any]]]) -> Path:
    """Messages as JSON: topic, log time [ns], content."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("free", "jsonschema", b'{"type": "object"}')
        channels: dict[str, int] = {}
        for topic, time, content in notes:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], time, json.dumps(content).encode(), time)
        writer.finish()
    return path
