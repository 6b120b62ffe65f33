# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files of other programs are read, or the error says what they are; they are not damaged."""

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_columns import read_columns, topic_types
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.streams import open_bags
from test.support.messages import read_messages

FLOAT = "std_msgs/msg/Float64"
DATA = b"\0\1\0\0" + struct.pack("<d", 1.5)


def write(
    path: Path,
    profile: str,
    topics: dict[str, tuple[str, str, bytes]],
    compression: CompressionType = CompressionType.NONE,
) -> Path:
    """Write one number on each topic, with a message encoding, a schema encoding and a schema."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile, "a foreign program")
        for topic, (message, encoding, schema) in topics.items():
            number = writer.register_schema(FLOAT, encoding, schema)
            channel = writer.register_channel(topic, message, number)
            writer.add_message(channel, 1, DATA, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_profile_that_is_missing(tmp_path: Path) -> None:
    """A file without a profile is read, and recover adds the profile."""
    path = write(tmp_path / "a.mcap", "", {"/speed": ("cdr", "ros2msg", b"float64 data\n")})
    np.testing.assert_array_equal(read_columns(path, {"/speed": FLOAT})["/speed"]["data"], [1.5])
    result = recover(path, tmp_path / "b.mcap")
    assert (result.damages, result.lost) == ((), {})
    [(_, message)] = read_messages(tmp_path / "b.mcap", "/speed")
    assert message.data == 1.5


def test_header_of_before_2011(tmp_path: Path) -> None:
    """The joint states of old ROS 1 bags, whose header had another package, are read."""
    store = get_typestore(Stores.ROS1_NOETIC)
    definition, digest = store.generate_msgdef(JOINT_STATE)
    assert "std_msgs/Header" in definition
    header = store.types["std_msgs/msg/Header"](
        seq=1, stamp=store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2), frame_id=""
    )
    empty = np.zeros(0)
    state = store.types[JOINT_STATE](header, ["hitch"], np.array([2.0]), empty, empty)
    with Writer1(tmp_path / "old.bag") as bag:
        old = definition.replace("std_msgs/Header", "roslib/Header")
        connection = bag.add_connection("/s", JOINT_STATE, msgdef=old, md5sum=digest)
        bag.write(connection, 1, store.serialize_ros1(state, JOINT_STATE))
    with open_bags([tmp_path / "old.bag"]) as bags:
        defined, [block] = bags.defined("/s"), bags.blocks(["/s"])
    assert defined is not None
    reader = FieldReader(defined[2], JOINT_STATE, "position[hitch]")
    number = reader.read_one(block.message(0))
    assert number is not None
    assert (number.sec, number.nanosec, number.value) == (1, 2, 2.0)


def test_chunks_of_several_lz4_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All frames of a chunk are read, also by recover."""
    own = lz4.frame.compress

    def compress(data: bytes) -> bytes:
        half = len(data) // 2
        return bytes(own(data[:half]) + own(data[half:]))

    monkeypatch.setattr(lz4.frame, "compress", compress)
    topics = {"/a": ("cdr", "ros2msg", b"float64 data\n")}
    path = write(tmp_path / "a.mcap", "ros2", topics, CompressionType.LZ4)
    with open_bags([path]) as bags:
        assert sum(map(len, bags.blocks(["/a"]))) == 1
    assert recover(path, tmp_path / "b.mcap").saved == {"/a": 1}


def test_padded_records_outside_of_chunks(tmp_path: Path) -> None:
    """A record with fields of a later version of MCAP is kept."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2", "a foreign program")
        schema = writer.register_schema(FLOAT, "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/a", "cdr", schema)
        writer.add_message(channel, 1, DATA, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    path.write_bytes(padded(path.read_bytes(), b"more"))
    result = recover(path, tmp_path / "b.mcap")
    assert (result.saved, result.damages) == ({"/a": 1}, ())


def padded(content: bytes, more: bytes) -> bytes:
    """Return an MCAP file whose header, schemas and channels have more bytes at their ends."""
    source, actual = BytesIO(content), content[:8]
    source.seek(8)
    while len(head := source.read(9)) == 9:
        opcode, length = struct.unpack("<BQ", head)
        body = source.read(length)
        if opcode in (1, 3, 4):
            body += more
        actual += struct.pack("<BQ", opcode, len(body)) + body
    return actual + content[-8:]


def test_valid_files_that_cannot_be_read(tmp_path: Path) -> None:
    """A summary without channels is completed by a scan; an unknown compression is named."""
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, repeat_channels=False, compression=CompressionType.LZ4)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/a", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0" + bytes(8), 1)
        writer.finish()
    assert topic_types(path) == {"/a": "std_msgs/msg/Float64"}
    recover(path, tmp_path / "whole.mcap")
    assert topic_types(tmp_path / "whole.mcap") == {"/a": "std_msgs/msg/Float64"}
    content = (tmp_path / "whole.mcap").read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0lzma")
    footer = len(content) - 8 - 29
    summary = int.from_bytes(content[footer + 9 : footer + 17], "little")
    crc = zlib.crc32(content[summary : footer + 25]).to_bytes(4, "little")
    path.write_bytes(content[: footer + 25] + crc + content[-8:])
    with pytest.raises(BagError, match="compressed with lzma, which no reader here knows"):
        read_columns(path, {"/a": "std_msgs/msg/Float64"})
    result = recover(path, tmp_path / "other.mcap")
    assert "unknown compression 'lzma'" in result.damages[0]


def test_pipe_in_the_folder_of_a_bag(tmp_path: Path) -> None:
    """A pipe in place of a file that ``metadata.yaml`` names is refused instead of waited for."""
    path = tmp_path / "bag"
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP):
        pass
    [file] = path.glob("*.mcap")
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(BagError, match=rf"cannot be opened: {file.name} is a pipe, not a file"):
        topic_types(path)
