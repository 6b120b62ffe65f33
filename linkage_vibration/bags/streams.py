# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads topics of bags as columns, thousands of messages at a time, in the order of log times.

Own code because rosbags takes 3 times and mcap 13 times as long for a message, and 12 and 25 times
for a decoded joint state, and a replay reads hours (`python -m benchmark.libraries`). Chunks of
MCAP and ROS 1 are parsed as a whole; other bags are read by rosbags. One chunk of each bag, and
the chunks that overlap it, are in memory at a time.
"""

import heapq
import io
import itertools
import re
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.can_logs import CanLogReader
from linkage_vibration.bags.mcap_file import decompressed
from linkage_vibration.bags.mcap_records import (
    CHUNK,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_RECORD,
    RECORD,
)
from linkage_vibration.bags.reading import (
    BagError,
    bag_errors,
    bag_reader,
    check_topics,
    mcap_files,
)
from linkage_vibration.bags.schemas import Schema, schema_of_store

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

    from linkage_vibration.bags.reading import BagReader
    from linkage_vibration.bags.ros1 import ChunkReader

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

BLOCK = 4096
"""The least number of messages in a block, so that calls of NumPy cost little for each."""

_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
_GATHERED = 1024  # messages in a part that rosbags reads one by one


_LATEST = 2**63 - 1  # ns, the year 2262; MCAP has unsigned times, whose upper half is meaningless


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Messages of several topics as columns.

    Attributes
    ----------
    buffer : ndarray of uint8
        Contains the bytes of the messages.
    starts, sizes : ndarray, (n,)
        Position and number of each message's bytes in it.
    topics : ndarray, (n,)
        Index of each message's topic in the requested names.
    log_times, publish_times : ndarray, (n,)
        Times of receiving and of sending, ns; they are equal except in MCAP.
    """

    buffer: Bytes
    starts: Integers
    sizes: Integers
    topics: Integers
    log_times: Integers
    publish_times: Integers

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.starts)

    def message(self, row: int) -> bytes:
        """Return the bytes of one message."""
        start = int(self.starts[row])
        return self.buffer[start : start + int(self.sizes[row])].tobytes()

    def rows(self, which: Integers) -> "Block":
        """Return the messages with these indices, in their order."""
        return Block(self.buffer, *(column[which] for column in self.columns()))

    def columns(self) -> tuple[Integers, ...]:
        """Return everything except the buffer."""
        return self.starts, self.sizes, self.topics, self.log_times, self.publish_times


# Order of messages with the same time: number of the bag, place in it.
_Rank: TypeAlias = tuple[int, int]


@dataclass(frozen=True, slots=True)
class _Part:
    """Messages of a bag that are read together."""

    first: int  # least log time, ns
    rank: _Rank
    load: Callable[[], Block]


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag.

    Attributes
    ----------
    name, type : str
        Such as ``/joint_states`` and ``sensor_msgs/msg/JointState``.
    count : int
        Number of its messages.
    """

    name: str
    type: str
    count: int


class Bags:
    """Open bags that are read as one.

    Attributes
    ----------
    paths : tuple of Path
        The bags.
    topics : tuple of BagTopic
        Their topics; one with several types occurs once for each.
    """

    def __init__(self, paths: Sequence[Path], bags: "Sequence[BagReader]") -> None:
        self.paths = tuple(paths)
        self._bags = tuple(bags)
        counts: Counter[tuple[str, str]] = Counter()
        for connection in itertools.chain.from_iterable(bag.connections for bag in bags):
            counts[connection.topic, connection.msgtype] += connection.msgcount
        self.topics = tuple(BagTopic(*key, count) for key, count in sorted(counts.items()))

    def defined(self, name: str) -> tuple[str, str, Schema] | None:
        """Return the definition of a topic's type as an MCAP schema, its hash, and its fields.

        The hash is that of RIHS01 (REP 2016). Types of ROS 1 are converted to ROS 2, as the
        messages are. The result is None if the bags do not define the type. A `BagError` is raised
        if they define it in several ways.
        """
        definitions: list[tuple[str, str, Schema]] = []
        for path, bag in zip(self.paths, self._bags, strict=True):
            with bag_errors(path):
                for connection in bag.connections:
                    if connection.topic == name and connection.msgdef.data:
                        store, kind = _store([connection]), connection.msgtype
                        text = _definition(store, connection)
                        definitions.append((*text, schema_of_store(store, kind)))
        if any(schema != definitions[0][2] for _, _, schema in definitions):
            raise BagError(
                f"{', '.join(map(str, self.paths))}: the type of topic {name} is defined in "
                "several ways; read each recording by itself."
            )
        return definitions[0] if definitions else None

    def blocks(self, names: Sequence[str], as_written: bool = False) -> Iterator[Block]:
        """Yield the messages of topics with these names, in the order of log times.

        Messages with the same time come in the order of the bags. Those of an MCAP file come as
        they were written if ``as_written``. Those of ROS 1 are converted to ROS 2.
        """
        parts = [
            _parts(path, bag, number, names, as_written)
            for number, (path, bag) in enumerate(zip(self.paths, self._bags, strict=True))
        ]
        if as_written:
            return (part.load() for part in itertools.chain.from_iterable(parts))
        return _ordered(heapq.merge(*parts, key=lambda part: (part.first, part.rank)))


@contextmanager
def open_bags(paths: Sequence[Path]) -> Iterator[Bags]:
    """Open bags that are read as one, such as the parts of a recording, or raise a `BagError`."""
    bags: list[BagReader] = []
    with ExitStack() as stack:
        for path in paths:
            with bag_errors(path):
                bags.append(bag_reader(path, by_chunks=True))
                stack.enter_context(bags[-1])
                check_topics(bags[-1])
        yield Bags(paths, bags)


def _ordered(parts: Iterable[_Part]) -> Iterator[Block]:
    """Turn parts in the order of their first times into blocks in the order of times."""
    held: list[tuple[_Rank, Block]] = []
    upcoming = iter(parts)
    part = next(upcoming, None)
    while part is not None:
        held.append((part.rank, _compact(part.load())))
        part = next(upcoming, None)
        if part is not None and sum(len(block) for _, block in held) < BLOCK:
            continue
        # A later message waits, as a part that is not loaded yet may have earlier ones.
        complete = _LATEST if part is None else part.first
        ready, waiting = [], []
        for rank, block in sorted(held, key=lambda entry: entry[0]):
            early = block.log_times < complete if part is not None else np.ones(len(block), bool)
            ready.append(block.rows(np.flatnonzero(early)))
            if not early.all():
                waiting.append((rank, _compact(block.rows(np.flatnonzero(~early)))))
        held = waiting
        block = _joined(ready)
        if len(block):
            yield block.rows(np.argsort(block.log_times, kind="stable"))


def _joined(blocks: Sequence[Block]) -> Block:
    """Return one block with the messages of all."""
    if len(blocks) == 1:
        return blocks[0]
    lengths = [len(block.buffer) for block in blocks]
    starts, *columns = map(np.concatenate, zip(*(block.columns() for block in blocks), strict=True))
    starts += np.repeat(np.cumsum(lengths) - lengths, [len(block) for block in blocks])
    return Block(np.concatenate([block.buffer for block in blocks]), starts, *columns)


def _compact(block: Block) -> Block:
    """Return a block without the bytes of other messages, unless they are few."""
    if 2 * block.sizes.sum() > len(block.buffer):
        return block
    starts = np.cumsum(block.sizes) - block.sizes
    places = np.repeat(block.starts - starts, block.sizes)
    places += np.arange(len(places))
    return replace(block, buffer=block.buffer[places], starts=starts)


def _parts(
    path: Path, bag: "BagReader", number: int, names: Sequence[str], as_written: bool
) -> Iterator[_Part]:
    """Yield the parts of a bag in the order of their first times, or as MCAP has them."""
    from linkage_vibration.bags.ros1 import ChunkReader

    with bag_errors(path), ExitStack() as stack:
        if isinstance(bag, ChunkReader):
            yield from _ros1_parts(path, bag, number, names)
            return
        if isinstance(bag, CanLogReader):
            yield from _can_parts(bag, number, names)
            return
        files = [stack.enter_context(file.open("rb")) for file in mcap_files(path)]
        summaries = [_summary(file) for file in files]
        if files and all(summary.chunk_indexes and summary.channels for summary in summaries):
            pairs = list(zip(files, summaries, strict=True))
            yield from _mcap_parts(path, pairs, number, names, as_written)
        else:
            yield from _other_parts(bag, number, names)


def _summary(file: BinaryIO) -> Summary:
    """Return the chunks and the channels of an MCAP file, found by a scan if it has no index."""
    summary = make_reader(file).get_summary() or Summary()
    if not summary.chunk_indexes:
        file.seek(0)
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                summary.chunk_indexes.append(_chunk_index(record, file.tell()))
    if summary.chunk_indexes and not summary.channels:
        file.seek(0)
        for record in StreamReader(file).records:
            if isinstance(record, Channel):
                summary.channels[record.id] = record
    return summary


def _chunk_index(chunk: Chunk, end: int) -> ChunkIndex:
    """Return the index of a chunk that ends at an offset of its file."""
    length = RECORD.size + CHUNK.size + len(chunk.compression) + 8 + len(chunk.data)
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=end - length,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def _mcap_parts(
    path: Path,
    files: Sequence[tuple[BinaryIO, Summary]],
    number: int,
    names: Sequence[str],
    as_written: bool,
) -> Iterator[_Part]:
    chunks: list[tuple[BinaryIO, ChunkIndex, dict[int, int]]] = []
    for file, summary in files:
        defined = summary.channels.values()
        channels = {c.id: names.index(c.topic) for c in defined if c.topic in names}
        for chunk in summary.chunk_indexes:
            # A chunk without message indexes may hold any topic.
            if not chunk.message_index_offsets or channels.keys() & chunk.message_index_offsets:
                chunks.append((file, chunk, channels))
    ordered = list(enumerate(chunks))
    if not as_written:
        ordered.sort(key=lambda entry: entry[1][1].message_start_time)
    for place, (file, chunk, channels) in ordered:

        def load(
            file: BinaryIO = file, chunk: ChunkIndex = chunk, channels: dict[int, int] = channels
        ) -> Block:
            with bag_errors(path):
                begins = _indexed(file, chunk, channels)
                return _chunk_block(_uncompressed(file, chunk), channels, begins)

        yield _Part(min(chunk.message_start_time, _LATEST), (number, place), load)


def _uncompressed(file: BinaryIO, chunk: ChunkIndex) -> bytes:
    """Return the records of a chunk after checking their size and checksum."""
    file.seek(chunk.chunk_start_offset + RECORD.size)
    *_, size, crc, name = CHUNK.unpack(file.read(CHUNK.size))
    file.seek(name + 8, io.SEEK_CUR)
    stored = file.read(chunk.compressed_size)
    data = decompressed(chunk.compression.encode(), stored, size)
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("the size or the checksum of a chunk is wrong")
    return data


def _indexed(file: BinaryIO, chunk: ChunkIndex, channels: dict[int, int]) -> Integers | None:
    """Return the positions in a chunk of the messages of these channels, as far as it has indexes.

    They are in the order of the chunk. None means that only a scan of the chunk finds them.
    """
    positions = [np.zeros(0, np.int64)]
    for channel, position in chunk.message_index_offsets.items():
        if channel in channels:
            file.seek(position)
            head = file.read(RECORD.size + MESSAGE_INDEX.size)
            size = MESSAGE_INDEX.unpack_from(head, RECORD.size)[1]
            entries = np.frombuffer(file.read(size), "<u8")
            if head[0] != Opcode.MESSAGE_INDEX or 8 * len(entries) != size or len(entries) % 2:
                return None
            positions.append(entries[1::2].astype(np.int64))
    return np.sort(np.concatenate(positions)) if chunk.message_index_offsets else None


def _chunk_block(data: bytes, channels: dict[int, int], begins: Integers | None) -> Block:
    """Return the messages of these channels (with their topics) among the records of a chunk.

    Where indexed positions are wrong or missing, all records are scanned.
    """
    buffer = np.frombuffer(data, np.uint8)
    heads = _heads(buffer, begins, channels)
    if begins is None or heads is None:
        begins = _scanned(data)
        heads = _heads(buffer, begins, None)
    if heads is None:
        return _block(buffer, [])
    topics = np.full(2**16, -1)
    topics[list(channels)] = list(channels.values())
    starts = begins
    if (heads["length"] < MESSAGE.size).any():
        raise ValueError("a message is shorter than its header")
    wanted = topics[heads["channel"]] >= 0
    heads, starts = heads[wanted], starts[wanted] + MESSAGE_RECORD.itemsize
    sizes = heads["length"].astype(np.int64) - MESSAGE.size
    topic = topics[heads["channel"]]
    return Block(
        buffer, starts, sizes, topic, _time(heads["log_time"]), _time(heads["publish_time"])
    )


def _scanned(data: bytes) -> Integers:
    """Return the positions of the messages among the records of a chunk."""
    begins: list[int] = []
    position, end = 0, len(data)
    while position < end:
        kind, length = RECORD.unpack_from(data, position)
        if kind == Opcode.MESSAGE:
            begins.append(position)
        position += RECORD.size + length
    if position > end:
        raise ValueError("a record is longer than the rest of its chunk")
    return np.array(begins, np.int64)


def _heads(
    buffer: Bytes, begins: Integers | None, channels: dict[int, int] | None
) -> NDArray[Any] | None:
    """Return the heads of messages at these positions; None if there is none at one of them."""
    last = len(buffer) - MESSAGE_RECORD.itemsize
    if begins is None or not len(begins) or begins[0] < 0 or begins[-1] > last:
        return None
    rows = sliding_window_view(buffer, MESSAGE_RECORD.itemsize)[begins]
    heads: NDArray[Any] = rows.view(MESSAGE_RECORD)[:, 0]
    if channels is not None:
        ends = begins.astype(np.uint64) + np.uint64(RECORD.size) + heads["length"]
        sound = (heads["opcode"] == Opcode.MESSAGE) & (ends <= len(buffer))
        sound &= np.isin(heads["channel"], list(channels)) & (heads["length"] < len(buffer))
        if not sound.all():
            return None
    return heads


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
    """Return the messages of these connections in a chunk, converted to CDR."""
    from linkage_vibration.bags.ros1 import find_messages, many_to_cdr

    owners, starts, sizes, times = find_messages(data)
    buffer = np.frombuffer(data, np.uint8)
    blocks, order = [_block(buffer[:0], [])], [np.zeros(0, np.int64)]
    for connection in connections:
        of_connection = owners == connection.id
        for size in np.unique(sizes[of_connection]):
            rows = np.flatnonzero(of_connection & (sizes == size))
            messages = sliding_window_view(buffer, size)[starts[rows]]
            for which, encoded in many_to_cdr(messages, connection.msgtype, to_cdr):
                n, length = encoded.shape
                topics = np.full(n, names.index(connection.topic))
                at = times[rows[which]]
                each = np.full(n, length)
                blocks.append(Block(encoded.ravel(), length * np.arange(n), each, topics, at, at))
                order.append(rows[which])
    return _joined(blocks).rows(np.argsort(np.concatenate(order)))


def _can_parts(bag: CanLogReader, number: int, names: Sequence[str]) -> Iterator[_Part]:
    topic = np.full(1 + max(c.id for c in bag.connections), -1)
    for connection in bag.connections:
        if connection.topic in names:
            topic[connection.id] = names.index(connection.topic)
    wanted = np.flatnonzero(topic[bag.channels] >= 0)
    for place, rows in enumerate(np.split(wanted, range(BLOCK, len(wanted), BLOCK))):

        def load(rows: Integers = rows) -> Block:
            messages, times = bag.encoded(rows), bag.times[rows]
            starts = messages.shape[1] * np.arange(len(rows))
            sizes = np.full(len(rows), messages.shape[1])
            topics = topic[bag.channels[rows]]
            return Block(messages.ravel(), starts, sizes, topics, times, times)

        if len(rows):
            yield _Part(int(bag.times[rows[0]]), (number, place), load)


def _other_parts(bag: "BagReader", number: int, names: Sequence[str]) -> Iterator[_Part]:
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


def _store(connections: "Sequence[Connection]") -> Any:
    """Return a type store that knows the types of connections, as ROS 2 has them."""
    from rosbags.interfaces import ConnectionExtRosbag1, MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    for connection in connections:
        text, msgtype = connection.msgdef.data, connection.msgtype
        is_idl = connection.msgdef.format == MessageDefinitionFormat.IDL
        # Before 2011 the header of ROS 1 had the name of another package.
        text = text.replace("roslib/Header", "std_msgs/Header")
        if isinstance(connection.ext, ConnectionExtRosbag1):
            text = re.sub(r"^(\s*)byte\b", r"\1int8", text, flags=re.MULTILINE)  # as in ROS 1
        types = get_types_from_idl(text) if is_idl else get_types_from_msg(text, msgtype)
        if _HEADER in types:  # that of ROS 2 has no sequence number
            latest = get_typestore(Stores.LATEST)
            types |= {name: latest.fielddefs[name] for name in (_TIME, _HEADER)}
        store.register({name: kind for name, kind in types.items() if name not in store.fielddefs})
    return store


def _definition(store: Any, connection: "Connection") -> tuple[str, str]:
    """Return the definition of a type as ROS 2 has it, and its hash; empty if a part is missing."""
    from rosbags.typesys import TypesysError

    try:
        text, _ = store.generate_msgdef(connection.msgtype, ros_version=2)
        return text, store.hash_rihs01(connection.msgtype)
    except (TypesysError, KeyError):
        return connection.msgdef.data, ""


def _to_cdr(connections: "Sequence[Connection]") -> Callable[[bytes, str], bytes]:
    """Return a function that converts a message of ROS 1 to CDR."""
    store = _store(connections)
    return lambda raw, type_name: bytes(store.ros1_to_cdr(raw, type_name))
