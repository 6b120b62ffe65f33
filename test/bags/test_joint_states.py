# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Joint states that are decoded together are those that rosbags decodes one by one."""

import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.joint_states import CdrError, JointStateReader
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.streams import Block

STORE = get_typestore(Stores.LATEST)
WORDS = st.text(st.characters(exclude_categories=["C"]), max_size=9)
NUMBERS = st.lists(st.floats(width=64), max_size=4)
MESSAGES = st.lists(
    st.tuples(
        st.integers(-(2**31), 2**31 - 1),
        st.integers(0, 2**32 - 1),
        WORDS,
        st.lists(WORDS, max_size=4),
        NUMBERS,
        NUMBERS,
        NUMBERS,
        st.booleans(),
    ),
    min_size=1,
    max_size=8,
)


def message(sec: int, nanosec: int, frame: str, name: list[str], *numbers: list[float]) -> Any:
    """Return a joint state of rosbags."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    header = STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
    arrays = dict(zip(("position", "velocity", "effort"), map(np.array, numbers), strict=True))
    arrays = {key: value.astype(float) for key, value in arrays.items()}
    return STORE.types[JOINT_STATE](header=header, name=name, **arrays)


def block_of(data: list[bytes]) -> Block:
    """Return a block of messages with other bytes between them."""
    sizes = np.array([len(some) for some in data], np.int64)
    starts = 3 + np.cumsum(sizes + 5) - sizes - 5
    buffer = np.frombuffer(b"abc" + b"".join(some + b"other" for some in data), np.uint8)
    zeros = np.zeros(len(data), np.int64)
    return Block(buffer, starts, sizes, zeros, zeros, zeros)


@settings(max_examples=200)
@given(MESSAGES)
def test_against_rosbags(contents: list[Any]) -> None:
    """Stamps, strings and numbers are exact for any layout and either byte order."""
    messages = [message(*content[:-1]) for content in contents] * 2
    orders = [content[-1] for content in contents] * 2
    data = [
        bytes(STORE.serialize_cdr(one, JOINT_STATE, little_endian=little))
        for one, little in zip(messages, orders, strict=True)
    ]
    reader, seen = JointStateReader(), []
    for some in reader.read(block_of(data), np.arange(len(data))):
        for i, row in enumerate(some.rows):
            seen.append(int(row))
            one = messages[row]
            assert (some.sec[i], some.nanosec[i]) == (
                one.header.stamp.sec,
                one.header.stamp.nanosec,
            )
            assert (some.frame_id, some.name) == (one.header.frame_id, one.name)
            assert some.position[:, i].tobytes() == one.position.tobytes()
            assert some.velocity[:, i].tobytes() == one.velocity.tobytes()
            assert some.data[i].tobytes() == data[row]
    assert sorted(seen) == list(range(len(data)))
    assert reader.unreadable == 0
    alone = JointStateReader()
    for one, encoded in zip(messages, data, strict=True):
        found = alone.read_one(encoded)
        assert (found.sec, found.nanosec) == (one.header.stamp.sec, one.header.stamp.nanosec)
        assert (found.frame_id, found.name) == (one.header.frame_id, one.name)
        assert np.array(found.position).tobytes() == one.position.tobytes()
        assert np.array(found.velocity).tobytes() == one.velocity.tobytes()


def test_padding_is_ignored() -> None:
    """Padding bytes may have any value, as they do in messages of DDS."""
    one = bytes(STORE.serialize_cdr(message(1, 2, "", ["ab"], [1.0], [], []), JOINT_STATE))
    at = one.index(b"ab\x00") + 3
    other = one[:at] + b"\x7f" + one[at + 1 :]
    found = list(JointStateReader().read(block_of([one, other]), np.arange(2)))
    assert len(found) == 1
    np.testing.assert_array_equal(found[0].position, [[1.0, 1.0]])
    alone = JointStateReader()
    assert alone.read_one(one) == alone.read_one(other)
    assert sum(map(len, alone._layouts.values())) == 1


def test_number_of_layouts_is_bounded() -> None:
    """A publisher whose messages all differ does not use unbounded memory."""
    data = [
        bytes(STORE.serialize_cdr(message(k, 0, f"{k:05}", ["a"], [k], [], []), JOINT_STATE))
        for k in range(1000)
    ]
    reader = JointStateReader()
    found = {int(some.sec[0]): some for some in reader.read(block_of(data), np.arange(1000))}
    assert sorted(found) == list(range(1000))
    assert all(some.position[0, 0] == k for k, some in found.items())
    assert sum(map(len, reader._layouts.values())) <= 256
    assert [reader.read_one(one).sec for one in data] == list(range(1000))
    assert sum(map(len, reader._layouts.values())) <= 256


@pytest.mark.parametrize("seed", range(20))
def test_damaged_messages(seed: int) -> None:
    """Bytes that are not a joint state are counted and reported without an exception."""
    rng = random.Random(seed)
    good = bytes(
        STORE.serialize_cdr(message(1, 2, "base", ["a", "b"], [1, 2], [3, 4], []), JOINT_STATE)
    )
    data = [good, b"", b"\x00", good[:40], b"\xff" * len(good)]
    for _ in range(100):
        spoilt = bytearray(good)
        for _ in range(rng.choice([1, 3, 10])):
            spoilt[rng.randrange(len(spoilt))] = rng.randrange(256)
        data.append(bytes(spoilt))
    reader = JointStateReader()
    read = sum(len(some.rows) for some in reader.read(block_of(data), np.arange(len(data))))
    assert read + reader.unreadable == len(data)
    assert reader.unreadable >= 4
    assert "is not a joint state" in reader.fault
    unreadable = 0
    for one in data:
        try:
            reader.read_one(one)
        except CdrError:
            unreadable += 1
    assert unreadable == reader.unreadable
