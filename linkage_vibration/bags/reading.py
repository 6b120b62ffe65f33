# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads messages one by one from bags: ROS 1 ``.bag``, ROS 2 ``.db3``, ``.mcap`` and folders.

A log of a CAN bus is read as a bag. Messages come in the order of their log times, with one chunk
of the file in memory at a time (and the index of a ROS 1 bag, or all frames of a CAN log). Every
failure is a `BagError`, raised at the first message or when the damage is reached.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

from linkage_vibration.bags.can_logs import SUFFIXES, CanLogError, CanLogReader, can_log_suffix
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.version import check_versions
from linkage_vibration.support.yaml_size import refuse_unbounded

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    BagReader: TypeAlias = Reader1 | Reader2 | CanLogReader

# By suffix (a folder has none): the first bytes of a file, and what repairs an incomplete one.
_MAGIC = {".bag": b"#ROSBAG V2.0", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
_MAGIC |= dict.fromkeys(SUFFIXES, b"")
_ROS2_SCHEMAS = ("ros2msg", "ros2idl", "omgidl")
_REPAIR = {
    ".bag": "`rosbag reindex`",
    ".mcap": "`linkage-vibration recover`",
    ".db3": "`ros2 bag reindex` on its folder",
    "": "`ros2 bag reindex`",
}


class BagError(LinkageVibrationError):
    """A bag cannot be read, or lacks the requested topic."""


@dataclass(frozen=True, slots=True)
class JointStateRecord:
    """A recorded ``sensor_msgs/JointState``.

    Attributes
    ----------
    log_time, stamp : int
        Time of its recording, and stamp of its header, ns.
    frame_id, topic : str
        Frame of its header, and its topic.
    name : tuple of str
        Joint names.
    position, velocity, effort : ndarray, (n_joints,) or (0,)
        rad or m, rad/s or m/s, N m or N; empty if the message omits them.
    """

    log_time: int
    stamp: int
    frame_id: str
    topic: str
    name: tuple[str, ...]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]


def read_joint_states(path: Path, topic: str | None = None) -> Iterator[JointStateRecord]:
    """Yield the joint states of a bag in the order of their log times.

    They are those of a topic, by default of the only one that has joint states.
    """
    if topic is None:
        topic = _joint_state_topic(path)
    for log_time, message in read_messages(path, topic):
        if message.__msgtype__ != JOINT_STATE:
            raise BagError(
                f"Topic {topic} of {path} has the type {message.__msgtype__}; choose one of "
                f"{JOINT_STATE}."
            )
        yield _joint_state(path, topic, log_time, message)


def read_messages(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the log times, ns, and the messages of one topic of a bag, of any type.

    The fields of a message are attributes. The definition in the bag decodes it; a bag without one
    needs a type that ROS 2 defines.
    """
    with open_bag(path) as bag:
        connections = [c for c in bag.connections if c.topic == topic]
        if not connections:
            raise BagError(
                f"{path} has no topic {topic}; choose one of {_topic_list(bag.connections)}."
            )
        decode = _decoder(path, connections)
        for connection, log_time, data in bag.messages(connections):
            yield log_time, decode(data, connection.msgtype)


def _joint_state(path: Path, topic: str, log_time: int, message: Any) -> JointStateRecord:
    """Return a message as a record; its fields are those that the bag defines for the type."""
    try:
        stamp = message.header.stamp
        record = JointStateRecord(
            log_time=log_time,
            stamp=stamp.sec * 10**9 + stamp.nanosec,
            frame_id=message.header.frame_id,
            topic=topic,
            name=tuple(message.name),
            position=message.position,
            velocity=message.velocity,
            effort=message.effort,
        )
        same = isinstance(message.name, list) and all(
            values.dtype == np.float64
            for values in (record.position, record.velocity, record.effort)
        )
    except (AttributeError, TypeError):
        same = False
    if not same:
        raise BagError(
            f"{path} defines {JOINT_STATE} of topic {topic} in another way than ROS; record it "
            "again with the type of ROS."
        )
    return record


def _joint_state_topic(path: Path) -> str:
    """Return the only topic of a bag that has joint states."""
    with open_bag(path) as bag:
        topics = sorted({c.topic for c in bag.connections if c.msgtype == JOINT_STATE})
        if not topics:
            raise BagError(
                f"{path} has no topic of type {JOINT_STATE}; it has {_topic_list(bag.connections)}."
            )
    if len(topics) > 1:
        raise BagError(
            f"{path} has joint states on {len(topics)} topics; choose one of {', '.join(topics)}."
        )
    return topics[0]


def _topic_list(connections: "Sequence[Connection]") -> str:
    """Return the topics of a bag and their types as text."""
    topics = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
    return ", ".join(topics) or "no topics at all"


@contextmanager
def open_bag(path: Path) -> "Iterator[BagReader]":
    """Open a bag; every failure until it is closed is a `BagError`."""
    with bag_errors(path), bag_reader(path) as bag:
        check_topics(bag)
        yield bag


def check_topics(bag: "BagReader") -> None:
    """Raise an error for an open bag whose messages have no topics, as rosbags would skip them."""
    if bag.message_count and not bag.connections:
        raise ValueError("its summary has no channels")


def bag_reader(path: Path, *, by_chunks: bool = False) -> "BagReader":
    """Return a reader of a bag, to be opened inside of `bag_errors`.

    That of a ROS 1 bag is a `ChunkReader` if it is read ``by_chunks``.
    """
    check_versions("rosbags")
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError:
        raise BagError(
            "Reading bags needs rosbags; run `pip install linkage_vibration[bags]`."
        ) from None
    kind = _kind(path)
    if kind in SUFFIXES:
        return _can_log_reader(path)
    if kind != ".bag":
        return Reader2(path)
    if not by_chunks:
        return Reader1(path)
    from linkage_vibration.bags.ros1 import ChunkReader

    return ChunkReader(path)


def _can_log_reader(path: Path) -> CanLogReader:
    check_versions("python-can")
    try:
        return CanLogReader(path)
    except ImportError:
        raise BagError(
            f"Reading {path} needs python-can; run `pip install linkage_vibration[can]`."
        ) from None


def mcap_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; none if it has another format or is compressed by rosbag2."""
    if path.is_file():
        return [path] if path.suffix == ".mcap" else []
    text = (path / "metadata.yaml").read_text(encoding="utf-8")
    about = yaml.safe_load(text)["rosbag2_bagfile_information"]
    plain = about.get("compression_mode", "").lower() in ("", "none")
    if about["storage_identifier"] != "mcap" or not plain:
        return []
    return [path / Path(name).name for name in about["relative_file_paths"]]


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Turn every failure of reading a bag into a `BagError`."""
    try:
        yield
    except CanLogError as error:
        raise BagError(f"{path} {error}") from None
    except (LinkageVibrationError, ImportError):
        raise
    except OSError as error:
        raise BagError(
            f"{path} cannot be opened: {error.strerror or error}; check it and its permissions."
        ) from None
    # A damaged file makes rosbags raise errors of its own, of struct, SQLite, zstd and others.
    except Exception as error:
        if foreign := _foreign(path):
            raise BagError(f"{path} {foreign}") from error
        text = " ".join(str(error).split()) or type(error).__name__
        if can_log_suffix(path):
            remedy = "convert it again, or read what is left of it with the tool that wrote it"
            raise BagError(f"{path} is damaged or incomplete ({text}); {remedy}.") from error
        repair = _REPAIR["" if path.is_dir() else path.suffix]
        raise BagError(f"{path} is damaged or incomplete ({text}); try {repair}.") from error


def _foreign(path: Path) -> str:
    """Return why an intact MCAP file is not of ROS 2; empty if it is damaged or another file."""
    from mcap.reader import make_reader

    if path.is_dir() or path.suffix != ".mcap":
        return ""
    try:
        with path.open("rb") as file:
            reader = make_reader(file)
            profile, summary = reader.get_header().profile, reader.get_summary()
    except Exception:  # A damaged file makes mcap raise errors of its own, of struct and others.
        return ""
    if summary is None or not summary.channels:
        return ""
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        encoding = schema.encoding if schema else "none"
        if channel.message_encoding != "cdr" or encoding not in _ROS2_SCHEMAS:
            return (
                f"holds messages that are not of ROS 2: {channel.topic} has the encoding "
                f"{channel.message_encoding or 'none'} and the schema {encoding}; write a file "
                "with the messages of ROS 2 only, such as with `mcap filter`."
            )
    if profile != "ros2":
        return (
            f"does not state that its messages are those of ROS 2 (its profile is {profile!r}); "
            "`linkage-vibration recover` writes a copy that does."
        )
    return ""


def _kind(path: Path) -> str:
    """Return the suffix of a bag file, or an empty one for a folder; check that it is a bag."""
    if not path.exists():
        raise BagError(f"There is no bag {path}; check the path.")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise BagError(
                f"Folder {path} has no metadata.yaml; give a file of the bag, or create "
                "metadata.yaml with `ros2 bag reindex`."
            )
        _check_metadata(path / "metadata.yaml")
        return ""
    suffix = can_log_suffix(path) or path.suffix
    if suffix not in _MAGIC:
        raise BagError(
            f"{path} is not a bag; give a .bag, .mcap or .db3 file, or a log of a CAN bus "
            f"({', '.join(SUFFIXES)})."
        )
    magic = _MAGIC[suffix]
    with path.open("rb") as file:
        start = file.read(len(magic) or 1)
    if not start:
        raise BagError(f"{path} is empty, as its recording ended before anything was written.")
    if magic and not magic.startswith(start):
        raise BagError(f"{path} is not a {path.suffix} file, despite its name; give a bag.")
    return suffix


def _check_metadata(path: Path) -> None:
    """Raise an error for YAML that would need unbounded time or memory."""
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), yaml.SafeLoader)
        if root is not None:
            refuse_unbounded(root)
    except OSError as error:
        raise BagError(f"{path} cannot be opened: {error.strerror}; check it.") from None
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        text = " ".join(str(error).split())
        raise BagError(f"{path} is damaged ({text}); try {_REPAIR['']}.") from None


def _decoder(path: Path, connections: "list[Connection]") -> Callable[[bytes, str], Any]:
    """Return a function that decodes the messages of a topic's connections."""
    from rosbags.interfaces import ConnectionExtRosbag1, MessageDefinitionFormat
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    definitions = {
        (c.msgtype, c.msgdef.data)
        for c in connections
        if c.msgdef.format == MessageDefinitionFormat.MSG
    }
    # .db3 files from before ROS 2 Iron hold no definitions.
    store = get_typestore(Stores.EMPTY if definitions else Stores.LATEST)
    for type_name, text in sorted(definitions):
        # Before 2011 the header of ROS 1 had the name of another package.
        text = text.replace("roslib/Header", "std_msgs/Header")
        store.register(get_types_from_msg(text, type_name))
    for connection in connections:
        if connection.msgtype not in store.fielddefs:
            raise BagError(
                f"{path} has no definition of {connection.msgtype} of topic {connection.topic}; "
                "record it again with ROS 2 Iron or later, or as .mcap."
            )
    if isinstance(connections[0].ext, ConnectionExtRosbag1):
        return store.deserialize_ros1

    def decode(data: bytes, type_name: str) -> Any:
        # serialize_message of rclpy adds up to 8 bytes to a message that ends in empty arrays.
        for excess in (0, 4):
            try:
                return store.deserialize_cdr(data[: len(data) - excess], type_name)
            except (AssertionError, SerdeError):  # rosbags before 0.11.6 asserts
                continue
        return store.deserialize_cdr(data[:-8], type_name)

    return decode
