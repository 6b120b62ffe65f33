# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in chunks of ROS 1, and their CDR, are those of rosbags."""

import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.bags.ros1 import ChunkReader, find_messages, many_to_cdr

ROS1 = get_typestore(Stores.ROS1_NOETIC)
STORE = get_typestore(Stores.LATEST)
NAMES = st.lists(st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=9))
NUMBERS = st.lists(st.floats(), max_size=3)


def to_cdr(raw: bytes, type_name: str) -> bytes:
    """Convert one message."""
    return bytes(STORE.ros1_to_cdr(raw, type_name))


def joint_state(
    seq: int, frame: str, name: list[str], numbers: tuple[list[float], list[float], list[float]]
) -> bytes:
    """Return a joint state as ROS 1 serializes it."""
    stamp = ROS1.types["builtin_interfaces/msg/Time"](sec=seq // 7, nanosec=seq % 10**9)
    header = ROS1.types["std_msgs/msg/Header"](seq=seq, stamp=stamp, frame_id=frame)
    columns = dict(zip(("position", "velocity", "effort"), map(np.array, numbers), strict=True))
    floats: dict[str, Any] = {key: value.astype(float) for key, value in columns.items()}
    message = ROS1.types[JOINT_STATE](header=header, name=name, **floats)
    return bytes(ROS1.serialize_ros1(message, JOINT_STATE))


def assert_same_cdr(raws: list[bytes], type_name: str) -> None:
    """Compare each message with the CDR of rosbags."""
    for size in {len(raw) for raw in raws}:
        some = [raw for raw in raws if len(raw) == size]
        messages = np.frombuffer(b"".join(some), np.uint8).reshape(-1, size)
        found = {
            int(i): row.tobytes()
            for which, rows in many_to_cdr(messages, type_name, to_cdr)
            for i, row in zip(which, rows, strict=True)
        }
        assert [found[i] for i in range(len(some))] == [to_cdr(raw, type_name) for raw in some]


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.text("ab", max_size=3), NAMES), min_size=1, max_size=3),
    st.lists(
        st.tuples(
            st.integers(0, 2),
            st.integers(0, 2**32 - 1),
            st.tuples(NUMBERS, NUMBERS, NUMBERS),
        ),
        min_size=1,
        max_size=12,
    ),
)
def test_same_cdr_of_joint_states(
    publishers: list[tuple[str, list[str]]],
    sent: list[tuple[int, int, tuple[list[float], list[float], list[float]]]],
) -> None:
    """Joint states of mixed publishers are converted like each one alone."""
    raws = []
    for which, seq, numbers in sent:
        frame, name = publishers[which % len(publishers)]
        raws.append(joint_state(seq, frame, name, numbers))
    assert_same_cdr(raws, JOINT_STATE)


@given(st.lists(st.floats(), min_size=1, max_size=9))
def test_same_cdr_of_numbers(values: list[float]) -> None:
    """Single numbers, and messages of other types, are converted correctly."""
    assert_same_cdr([struct.pack("<d", value) for value in values], FLOAT64)
    assert_same_cdr([struct.pack("<d", value) for value in values], "std_msgs/msg/Int64")


@pytest.mark.parametrize("compression", [None, *Writer.CompressionFormat])
def test_same_messages_as_rosbags(
    tmp_path: Path, compression: Writer.CompressionFormat | None
) -> None:
    """Topics, times, bytes and counts are those of rosbags."""
    path, rng = tmp_path / "bag.bag", random.Random(1)
    writer = Writer(path)
    writer.chunk_threshold = 10_000
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = [
            writer.add_connection(topic, FLOAT64, typestore=ROS1) for topic in ("/a", "/b", "/c")
        ]
        for k in range(3000):
            time = 10**18 + k * 10**6 + rng.randrange(10**8)
            writer.write(rng.choice(connections), time, struct.pack("<d", k))
    with Reader(path) as reader:
        expected = sorted((c.id, time, bytes(raw)) for c, time, raw in reader.messages())
        counts = {c.topic: c.msgcount for c in reader.connections}
    found = []
    with ChunkReader(path) as chunks:
        assert {c.topic: c.msgcount for c in chunks.connections} == counts
        assert len(chunks.chunk_infos) > 5
        for chunk in chunks.chunk_infos:
            data = chunks.uncompressed(chunk.pos)
            for connection, start, size, time in zip(*find_messages(data), strict=True):
                found.append((int(connection), int(time), data[start : start + size]))
    assert sorted(found) == expected


def record(fields: list[tuple[bytes, bytes]], data: bytes) -> bytes:
    """Return a record with its fields in this order."""
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value
        for name, value in fields
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def test_headers_in_any_order() -> None:
    """Writers may order the fields of a header differently, and may add fields."""
    fields = [(b"op", b"\2"), (b"conn", struct.pack("<I", 7)), (b"time", struct.pack("<II", 3, 5))]
    more = [(b"note", b"=")]
    connection = [(b"op", b"\7"), (b"conn", struct.pack("<I", 7)), (b"topic", b"/a")]
    records = [fields, fields[::-1], connection, fields[1:] + more + fields[:1], fields[::-1]]
    data = b"".join(record(each, bytes([i])) for i, each in enumerate(records))
    connections, starts, sizes, times = find_messages(data)
    assert [data[start] for start in starts] == [0, 1, 3, 4]
    assert set(connections) == {7}
    assert set(sizes) == {1}
    assert set(times) == {3 * 10**9 + 5}


def test_incomplete_records() -> None:
    """A chunk that ends within a record is an error."""
    whole = record([(b"op", b"\2"), (b"conn", bytes(4)), (b"time", bytes(8))], b"12345678")
    for length in range(1, len(whole)):
        with pytest.raises((ValueError, struct.error)):
            find_messages(whole + whole[:length])
