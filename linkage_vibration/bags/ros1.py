# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads ROS 1 bags by the chunk, and converts their joint states to CDR in large groups.

Own code because rosbags takes 10 times as long for each message (`python -m benchmark.libraries`),
and keeps an index of all messages in memory. Damage may raise any exception.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

_UINT32 = struct.Struct("<I")
_MESSAGE = b"\x02"  # the opcode of a message
_STAMP = 12  # bytes before the frame: sequence number and time, or in CDR encapsulation and time


class ChunkReader(Reader):
    """A ROS 1 bag that is read by its chunks; `messages` of its base class finds nothing."""

    def open(self) -> None:
        """Open the bag, and count its messages."""
        super().open()
        counts: Counter[int] = Counter()
        for chunk in self.chunk_infos:
            counts.update(chunk.connection_counts)
        self.connections = [c._replace(msgcount=counts[c.id]) for c in self.connections]

    def read_index_data(self, *_: Any) -> None:
        """Skip the index of the messages."""

    def uncompressed(self, position: int) -> bytes:
        """Return the records of the chunk at this position; damage may raise any exception."""
        assert self.bio is not None
        chunk = self.chunks[position]
        self.bio.seek(chunk.datapos)
        data = self.bio.read(chunk.datasize)
        if len(data) < chunk.datasize:
            raise ValueError("the file ends within a chunk")
        return chunk.decompressor(data)


def find_messages(data: bytes) -> tuple[Integers, Integers, Integers, Integers]:
    """Return the messages among the records of a chunk; damage may raise any exception.

    They are four columns, (n,): connection, position, number of bytes, and log time in ns.
    """
    places: list[tuple[int, int, int, int]] = []
    position, end = 0, len(data)
    while position < end:
        [head] = _UINT32.unpack_from(data, position)
        [size] = _UINT32.unpack_from(data, position + 4 + head)
        places.append((position + 4, head, position + 8 + head, size))
        position += 8 + head + size
    if position > end:
        raise ValueError("a record is longer than the rest of its chunk")
    heads, lengths, starts, sizes = np.array(places, np.int64).reshape(-1, 4).T
    connections, times = np.full(len(places), -1), np.zeros(len(places), np.int64)
    buffer = np.frombuffer(data, np.uint8)
    for length in np.unique(lengths):
        left = np.flatnonzero(lengths == length)
        while len(left):
            # Headers of one writer have the same order of fields and differ only in values.
            headers = sliding_window_view(buffer, length)[heads[left]]
            fields = _fields(headers[0].tobytes())
            shared = np.ones(length, bool)
            if fields["op"][1] == _MESSAGE:
                conn, time = fields["conn"][0], fields["time"][0]
                shared[conn : conn + 4] = shared[time : time + 8] = False
            alike = (headers[:, shared] == headers[0, shared]).all(axis=1)
            rows = left[alike]
            if not shared.all():
                connections[rows] = _uint32(headers[alike], conn)
                times[rows] = _uint32(headers[alike], time) * 10**9
                times[rows] += _uint32(headers[alike], time + 4)
            left = left[~alike]
    is_message = connections >= 0
    return connections[is_message], starts[is_message], sizes[is_message], times[is_message]


def _fields(header: bytes) -> dict[str, tuple[int, bytes]]:
    """Return the position and the value of each field by name."""
    fields, position = {}, 0
    while position < len(header):
        [size] = _UINT32.unpack_from(header, position)
        name, _, value = header[position + 4 : position + 4 + size].partition(b"=")
        position += 4 + size
        fields[name.decode()] = position - len(value), value
    return fields


def _uint32(rows: Bytes, at: int) -> Integers:
    return np.ascontiguousarray(rows[:, at : at + 4]).view("<u4")[:, 0].astype(np.int64)


def many_to_cdr(
    messages: Bytes, type_name: str, to_cdr: Callable[[bytes, str], bytes]
) -> Iterator[tuple[Integers, Bytes]]:
    """Convert messages of one type, (n, size), to CDR; yield their indices and bytes by groups.

    Joint states of one publisher differ only in their stamps and numbers. So ``to_cdr`` converts
    one of them, and only their numbers are copied for the others. The same goes for single numbers;
    messages of another type are converted one by one.
    """
    if type_name not in _MOVES:
        yield from _one_by_one(messages, type_name, to_cdr)
        return
    left = np.arange(len(messages))
    while len(left):
        first = messages[left[0]].tobytes()
        example = np.frombuffer(to_cdr(first, type_name), np.uint8)
        moves = _MOVES[type_name](first)
        shared = np.ones(len(first), bool)
        for source, _, length in moves:
            shared[source : source + length] = False
        if type_name == JOINT_STATE:
            shared[:4] = False  # the sequence number, which ROS 2 does not have
        rest = messages[left]
        alike = (rest[:, shared] == rest[0, shared]).all(axis=1)
        encoded = np.empty((int(alike.sum()), len(example)), np.uint8)
        encoded[:] = example
        for source, target, length in moves:
            encoded[:, target : target + length] = rest[alike, source : source + length]
        yield left[alike], encoded
        left = left[~alike]


def _one_by_one(
    messages: Bytes, type_name: str, to_cdr: Callable[[bytes, str], bytes]
) -> Iterator[tuple[Integers, Bytes]]:
    """Convert messages of any type, and yield those that have the same size in CDR together."""
    groups: dict[int, list[tuple[int, bytes]]] = {}
    for i, message in enumerate(messages):
        data = to_cdr(message.tobytes(), type_name)
        groups.setdefault(len(data), []).append((i, data))
    for size, group in groups.items():
        rows, encoded = zip(*group, strict=True)
        joined = np.frombuffer(b"".join(encoded), np.uint8).reshape(len(rows), size)
        yield np.array(rows, np.int64), joined


def _joint_state_moves(data: bytes) -> list[tuple[int, int, int]]:
    """Return positions of numbers in ROS 1 and in CDR, and how many bytes they have."""
    moves = [(4, 4, 8)]  # the stamp
    source = target = _STAMP

    def count() -> int:
        nonlocal source, target
        [length] = _UINT32.unpack_from(data, source)
        source, target = source + 4, target + -target % 4 + 4
        return int(length)

    def string() -> None:
        nonlocal source, target
        length = count()
        source, target = source + length, target + length + 1  # CDR adds a zero

    string()
    for _ in range(count()):
        string()
    for _ in ("position", "velocity", "effort"):
        length = 8 * count()
        if length:
            target += -(target - 4) % 8
        moves.append((source, target, length))
        source, target = source + length, target + length
    return moves


_MOVES: dict[str, Callable[[bytes], list[tuple[int, int, int]]]] = {
    JOINT_STATE: _joint_state_moves,
    FLOAT64: lambda _: [(0, 4, 8)],
}
