# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Streams topics out of bags as columns: thousands of messages at a time, in order of log time.

Chunks of MCAP and of ROS 1 are taken apart as a whole, as that is where a long bag's time goes;
everything else comes message by message from rosbags. What is in memory is a chunk of each bag,
and what overlaps.
"""

import heapq
import io
import itertools
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeAlias

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.summary import Summary
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.mcap_records import CHUNK, MESSAGE, MESSAGE_RECORD, RECORD
from linkage_vibration.bags.reading import bag_errors, bag_reader, mcap_files

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    from linkage_vibration.bags.ros1 import ChunkReader

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

BLOCK = 4096
"""Messages that are handed out at a time, at least; NumPy's calls cost little beside so many."""

_GATHERED = 1024  # messages that rosbags hands over one by one, until they are a part of a stream
_DECOMPRESS: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda data, size: data,
    "lz4": lambda data, size: lz4.frame.decompress(data),
    "zstd": zstandard.decompress,  # needs the size where the writer did not know it in advance
}
_LATEST = 2**63 - 1  # ns; MCAP's times are unsigned, but those beyond the year 2262 are no times


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Messages of several topics, by columns.

    Attributes
    ----------
    buffer : ndarray of uint8
        Holds the messages' bytes somewhere.
    starts, sizes : ndarray, (n,)
        Where, bytes.
    topics : ndarray, (n,)
        Of which topic, as an index into the names that were asked for.
    log_times, publish_times : ndarray, (n,)
        When they were received and sent, ns. Only MCAP tells the latter.
    """

    buffer: Bytes
    starts: Integers
    sizes: Integers
    topics: Integers
    log_times: Integers
    publish_times: Integers

    def __len__(self) -> int:
        """Return how many messages there are."""
        return len(self.starts)

    def message(self, row: int) -> bytes:
        """Return the bytes of a message."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.sizes[row])].tobytes()

    def rows(self, which: Integers) -> "Block":
        """Return some of the messages, in another order."""
        return Block(
            self.buffer,
            self.starts[which],
            self.sizes[which],
            self.topics[which],
            self.log_times[which],
            self.publish_times[which],
        )


_Rank: TypeAlias = tuple[int, int]  # of messages with one time: number of the bag, place in it


@dataclass(frozen=True, slots=True)
class _Part:
    """Some messages of a bag."""

    first: int  # the first log time, ns
    rank: _Rank
    load: Callable[[], Block]


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag.

    Attributes
    ----------
    name, type : str
        As in ``/joint_states`` and ``sensor_msgs/msg/JointState``.
    count : int
        How many messages it has.
    """

    name: str
    type: str
    count: int


class Bags:
    """Bags that are open, to be read as one.

    Attributes
    ----------
    paths : tuple of Path
        The bags.
    topics : tuple of BagTopic
        Their topics, each once for each type that it has.
    """

    def __init__(self, paths: Sequence[Path], bags: "Sequence[Reader1 | Reader2]") -> None:
        self.paths = tuple(paths)
        self._bags = tuple(bags)
        counts: dict[tuple[str, str], int] = {}
        for bag in bags:
            for connection in bag.connections:
                key = connection.topic, connection.msgtype
                counts[key] = counts.get(key, 0) + connection.msgcount
        self.topics = tuple(BagTopic(*key, count) for key, count in sorted(counts.items()))

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the messages of some topics, in order of log time.

        Of messages with the same time, that of the first bag comes first. Messages of ROS 1 are
        turned into those of ROS 2.

        Raises
        ------
        BagError
            If a bag turns out to be damaged.
        """
        parts = [
            _parts(path, bag, number, names)
            for number, (path, bag) in enumerate(zip(self.paths, self._bags, strict=True))
        ]
        return _ordered(heapq.merge(*parts, key=lambda part: (part.first, part.rank)))


@contextmanager
def open_bags(paths: Sequence[Path]) -> Iterator[Bags]:
    """Open bags, to be read as one: parts of a recording, or recordings of the same time.

    Raises
    ------
    BagError
        If one of them is missing, empty, cut short, damaged or no bag.
    """
    bags: list[Reader1 | Reader2] = []
    with ExitStack() as stack:
        for path in paths:
            with bag_errors(path):
                bags.append(bag_reader(path, by_chunks=True))
                stack.enter_context(bags[-1])
        yield Bags(paths, bags)


def _ordered(parts: Iterable[_Part]) -> Iterator[Block]:
    """Put parts, that come in order of their first times, into blocks in order of time."""
    held: list[tuple[_Rank, Block]] = []
    upcoming = iter(parts)
    part = next(upcoming, None)
    while part is not None:
        held.append((part.rank, _compact(part.load())))
        part = next(upcoming, None)
        if part is not None and sum(len(block) for _, block in held) < BLOCK:
            continue
        # What is later may have to wait for messages of parts that are still to come.
        known = _LATEST if part is None else part.first
        ready, waiting = [], []
        for rank, block in sorted(held, key=lambda entry: entry[0]):
            early = block.log_times < known if part is not None else np.ones(len(block), bool)
            ready.append(block.rows(np.flatnonzero(early)))
            if not early.all():
                waiting.append((rank, _compact(block.rows(np.flatnonzero(~early)))))
        held = waiting
        block = _joined(ready)
        if len(block):
            yield block.rows(np.argsort(block.log_times, kind="stable"))


def _joined(blocks: Sequence[Block]) -> Block:
    """Put blocks one behind the other."""
    if len(blocks) == 1:
        return blocks[0]
    offsets = itertools.accumulate([len(block.buffer) for block in blocks[:-1]], initial=0)
    return Block(
        np.concatenate([block.buffer for block in blocks]),
        np.concatenate([b.starts + offset for b, offset in zip(blocks, offsets, strict=True)]),
        np.concatenate([block.sizes for block in blocks]),
        np.concatenate([block.topics for block in blocks]),
        np.concatenate([block.log_times for block in blocks]),
        np.concatenate([block.publish_times for block in blocks]),
    )


def _compact(block: Block) -> Block:
    """Return the same block without the bytes of other messages, unless they are few."""
    if 2 * block.sizes.sum() > len(block.buffer):
        return block
    data = b"".join(map(block.message, range(len(block))))
    starts = np.cumsum(block.sizes) - block.sizes
    buffer = np.frombuffer(data, np.uint8)
    times = block.log_times, block.publish_times
    return Block(buffer, starts, block.sizes, block.topics, *times)


def _parts(
    path: Path, bag: "Reader1 | Reader2", number: int, names: Sequence[str]
) -> Iterator[_Part]:
    """Yield the parts of a bag in order of their first times."""
    from linkage_vibration.bags.ros1 import ChunkReader

    with bag_errors(path), ExitStack() as stack:
        if isinstance(bag, ChunkReader):
            yield from _ros1_parts(path, bag, number, names)
            return
        files = [stack.enter_context(file.open("rb")) for file in mcap_files(path)]
        summaries = [make_reader(file).get_summary() or Summary() for file in files]
        if files and all(summary.chunk_indexes and summary.channels for summary in summaries):
            yield from _mcap_parts(path, list(zip(files, summaries, strict=True)), number, names)
        else:
            yield from _other_parts(bag, number, names)


def _mcap_parts(
    path: Path, files: Sequence[tuple[BinaryIO, Summary]], number: int, names: Sequence[str]
) -> Iterator[_Part]:
    chunks: list[tuple[BinaryIO, ChunkIndex, dict[int, int]]] = []
    for file, summary in files:
        found = summary.channels.values()
        channels = {c.id: names.index(c.topic) for c in found if c.topic in names}
        for chunk in summary.chunk_indexes:
            # A chunk without message indexes may hold anything.
            if not chunk.message_index_offsets or channels.keys() & chunk.message_index_offsets:
                chunks.append((file, chunk, channels))
    in_time = sorted(enumerate(chunks), key=lambda entry: entry[1][1].message_start_time)
    for place, (file, chunk, channels) in in_time:

        def load(
            file: BinaryIO = file, chunk: ChunkIndex = chunk, channels: dict[int, int] = channels
        ) -> Block:
            with bag_errors(path):
                return _chunk_block(_uncompressed(file, chunk), channels)

        yield _Part(min(chunk.message_start_time, _LATEST), (number, place), load)


def _uncompressed(file: BinaryIO, chunk: ChunkIndex) -> bytes:
    """Return the records of a chunk after checking their size and checksum."""
    file.seek(chunk.chunk_start_offset + RECORD.size)
    *_, size, crc, name = CHUNK.unpack(file.read(CHUNK.size))
    file.seek(name + 8, io.SEEK_CUR)
    data = _DECOMPRESS[chunk.compression](file.read(chunk.compressed_size), size)
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("the size or the checksum of a chunk is wrong")
    return data


def _chunk_block(data: bytes, channels: dict[int, int]) -> Block:
    """Find the messages of these channels among a chunk's records."""
    begins: list[int] = []
    position, end = 0, len(data)
    while position < end:
        kind, length = RECORD.unpack_from(data, position)
        if kind == Opcode.MESSAGE:
            begins.append(position)
        position += RECORD.size + length
    if position > end:
        raise ValueError("a record reaches beyond its chunk")
    buffer = np.frombuffer(data, np.uint8)
    if not begins:
        return _block(buffer, [])
    topics = np.full(2**16, -1)
    topics[list(channels)] = list(channels.values())
    starts = np.array(begins)
    heads = sliding_window_view(buffer, MESSAGE_RECORD.itemsize)[starts].view(MESSAGE_RECORD)[:, 0]
    if (heads["length"] < MESSAGE.size).any():
        raise ValueError("a message is shorter than its own head")
    wanted = topics[heads["channel"]] >= 0
    heads, starts = heads[wanted], starts[wanted] + MESSAGE_RECORD.itemsize
    sizes = heads["length"].astype(np.int64) - MESSAGE.size
    topic = topics[heads["channel"]]
    return Block(
        buffer, starts, sizes, topic, _time(heads["log_time"]), _time(heads["publish_time"])
    )


def _time(column: NDArray[np.uint64]) -> Integers:
    return np.minimum(column, _LATEST).astype(np.int64)


def _block(buffer: Bytes, columns: Sequence[tuple[int, ...]]) -> Block:
    return Block(buffer, *np.array(columns, np.int64).reshape(-1, 5).T.copy())


def _ros1_parts(
    path: Path, bag: "ChunkReader", number: int, names: Sequence[str]
) -> Iterator[_Part]:
    connections = [connection for connection in bag.connections if connection.topic in names]
    wanted = {connection.id for connection in connections}
    to_cdr = _to_cdr(connections)
    chunks = [chunk for chunk in bag.chunk_infos if wanted & chunk.connection_counts.keys()]
    for place, chunk in enumerate(sorted(chunks, key=lambda chunk: chunk.start_time)):

        def load(position: int = chunk.pos) -> Block:
            with bag_errors(path):
                return _ros1_block(bag.uncompressed(position), connections, names, to_cdr)

        yield _Part(chunk.start_time, (number, place), load)


def _ros1_block(
    data: bytes,
    connections: "Sequence[Connection]",
    names: Sequence[str],
    to_cdr: Callable[[bytes, str], bytes],
) -> Block:
    """Find the messages of these connections in a chunk, and turn them into CDR."""
    from linkage_vibration.bags.ros1 import find_messages, many_to_cdr

    found, starts, sizes, times = find_messages(data)
    buffer = np.frombuffer(data, np.uint8)
    blocks, order = [_block(buffer[:0], [])], [np.zeros(0, np.int64)]
    for connection in connections:
        mine = found == connection.id
        for size in np.unique(sizes[mine]):
            rows = np.flatnonzero(mine & (sizes == size))
            messages = sliding_window_view(buffer, size)[starts[rows]]
            for which, encoded in many_to_cdr(messages, connection.msgtype, to_cdr):
                n, length = encoded.shape
                topics = np.full(n, names.index(connection.topic))
                at = times[rows[which]]
                each = np.full(n, length)
                blocks.append(Block(encoded.ravel(), length * np.arange(n), each, topics, at, at))
                order.append(rows[which])
    return _joined(blocks).rows(np.argsort(np.concatenate(order)))


def _other_parts(bag: "Reader1 | Reader2", number: int, names: Sequence[str]) -> Iterator[_Part]:
    connections = [connection for connection in bag.connections if connection.topic in names]
    if not connections:
        return
    data, columns, position, place = [], [], 0, 0
    for connection, time, raw in bag.messages(connections):
        topic = names.index(connection.topic)
        at = min(max(time, 0), _LATEST)
        columns.append((position, len(raw), topic, at, at))
        data.append(raw)
        position += len(raw)
        if len(columns) == _GATHERED:
            yield _gathered(data, columns, (number, place))
            data, columns, position = [], [], 0
            place += 1
    if columns:
        yield _gathered(data, columns, (number, place))


def _gathered(data: Collection[bytes], columns: Sequence[tuple[int, ...]], rank: _Rank) -> _Part:
    block = _block(np.frombuffer(b"".join(data), np.uint8), columns)
    return _Part(columns[0][3], rank, lambda: block)


def _to_cdr(connections: "Sequence[Connection]") -> Callable[[bytes, str], bytes]:
    """Return what makes CDR of a message of ROS 1."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    for type_name, text in sorted({(c.msgtype, c.msgdef.data) for c in connections}):
        if type_name not in store.fielddefs:
            types = get_types_from_msg(text, type_name)
            types.pop("std_msgs/msg/Header", None)  # ROS 2's has no number
            store.register(types)
    return lambda raw, type_name: bytes(store.ros1_to_cdr(raw, type_name))
