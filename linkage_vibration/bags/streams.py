# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads topics of bags as columns, thousands of messages at a time, in the order of log times.

Own code because rosbags takes 3 times and mcap 13 times as long for a message, and 12 and 25 times
for a decoded joint state, and a replay reads hours (`python -m benchmark.libraries`). Chunks of
MCAP are parsed as a whole; other bags are read by rosbags. One chunk of each bag, and the chunks
that overlap it, are in memory at a time.
"""

import heapq
import itertools
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.summary import Summary
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Integers
from linkage_vibration.bags.can_logs import CanLog
from linkage_vibration.bags.mcap_file import decompressed, message_heads
from linkage_vibration.bags.mcap_records import MESSAGE, MESSAGE_INDEX, MESSAGE_RECORD, RECORD
from linkage_vibration.bags.reading import BagError, bag_errors, bag_reader, mcap_files
from linkage_vibration.bags.recorder import PROVENANCE_METADATA
from linkage_vibration.bags.schemas import Schema, schema_of_store

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

    from linkage_vibration.bags.reading import BagReader

BLOCK = 4096
"""The least number of messages in a block, so that calls of NumPy cost little for each."""

_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
_GATHERED = 1024  # messages in a part that rosbags reads one by one


_LATEST = 2**63 - 1  # ns, the year 2262; MCAP has unsigned times, whose upper half is meaningless
_Message: TypeAlias = tuple[str, int, int, bytes]
"""Topic, log time and publish time, ns, and data in CDR."""
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
    """A topic of a bag."""

    name: str
    type: str  # such as ``sensor_msgs/msg/JointState``
    count: int  # of its messages


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

    @property
    def is_own_log(self) -> bool:
        """Whether they are one log that this package has written, in the order of arrival."""
        path = self.paths[0]
        if len(self.paths) > 1 or mcap_files(path) != [path]:
            return False
        with bag_errors(path), path.open("rb") as file:
            summary = make_reader(file).get_summary() or Summary()
            return any(each.name == PROVENANCE_METADATA for each in summary.metadata_indexes)

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
            return _ordered(itertools.chain.from_iterable(parts), as_written)
        merged = heapq.merge(*parts, key=lambda part: (part.first, part.rank))
        return _ordered(merged, as_written)


@contextmanager
def open_bags(paths: Sequence[Path]) -> Iterator[Bags]:
    """Open bags that are read as one, such as the parts of a recording, or raise a `BagError`."""
    bags: list[BagReader] = []
    with ExitStack() as stack:
        for path in paths:
            with bag_errors(path):
                bag = bag_reader(path)
                bags.append(bag)
                if not isinstance(bag, CanLog):
                    stack.enter_context(bag)
                    # rosbags would skip messages whose topics are not known.
                    if bag.message_count and not bag.connections:
                        raise ValueError("its summary has no channels")
        yield Bags(paths, bags)


def _ordered(parts: Iterable[_Part], as_written: bool) -> Iterator[Block]:
    """Turn parts in the order of their first times, or as written, into blocks in that order."""
    held: list[tuple[_Rank, Block]] = []
    upcoming = iter(parts)
    part = next(upcoming, None)
    while part is not None:
        held.append((part.rank, _compact(part.load())))
        part = next(upcoming, None)
        if part is not None and sum(len(block) for _, block in held) < BLOCK:
            continue
        # A later message waits, as a part that is not loaded yet may have earlier ones.
        all_ready = part is None or as_written
        complete = _LATEST if part is None else part.first
        ready, waiting = [], []
        for rank, block in sorted(held, key=lambda entry: entry[0]):
            early = np.ones(len(block), bool) if all_ready else block.log_times < complete
            ready.append(block.rows(np.flatnonzero(early)))
            if not early.all():
                waiting.append((rank, _compact(block.rows(np.flatnonzero(~early)))))
        held = waiting
        block = _joined(ready)
        if len(block):
            order = np.argsort(block.log_times, kind="stable")
            yield block if as_written else block.rows(order)


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
    with bag_errors(path), ExitStack() as stack:
        files = [stack.enter_context(file.open("rb")) for file in mcap_files(path)]
        if not files:
            yield from _gathered_parts(_by_rosbags(bag, names), number, names)
            return
        summaries = [make_reader(file).get_summary() or Summary() for file in files]
        if all(map(_is_indexed, summaries)):
            pairs = list(zip(files, summaries, strict=True))
            yield from _mcap_parts(path, pairs, number, names, as_written)
        else:
            yield from _gathered_parts(_by_mcap(files, names, as_written), number, names)


def _is_indexed(summary: Summary) -> bool:
    """Return whether an MCAP file has an index of its messages."""
    indexed = any(chunk.message_index_offsets for chunk in summary.chunk_indexes)
    return indexed and bool(summary.channels)


def _by_rosbags(bag: "BagReader", names: Sequence[str]) -> Iterator[_Message]:
    """Yield the messages of ROS 2 and of a CAN bus, and those of ROS 1 converted to CDR."""
    from rosbags.rosbag1 import Reader as Reader1

    connections = [connection for connection in bag.connections if connection.topic in names]
    store = _store(connections) if isinstance(bag, Reader1) else None
    for connection, time, data in bag.messages(connections) if connections else ():
        if store is not None:
            data = bytes(store.ros1_to_cdr(data, connection.msgtype))
        yield connection.topic, time, time, data


def _by_mcap(
    files: Sequence[BinaryIO], names: Sequence[str], as_written: bool
) -> Iterator[_Message]:
    """Yield the messages of MCAP files that have no index; mcap keeps a whole file in memory."""
    for file in files:
        file.seek(0)
        reader = NonSeekingReader(file, validate_crcs=True)
        for _, channel, each in reader.iter_messages(names, log_time_order=not as_written):
            yield channel.topic, each.log_time, each.publish_time, each.data


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
            if channels.keys() & chunk.message_index_offsets:
                chunks.append((file, chunk, channels))
    ordered = list(enumerate(chunks))
    if not as_written:
        ordered.sort(key=lambda entry: entry[1][1].message_start_time)
    for place, (file, chunk, channels) in ordered:
        load = partial(_mcap_block, path, file, chunk, channels)
        yield _Part(min(chunk.message_start_time, _LATEST), (number, place), load)


def _mcap_block(path: Path, file: BinaryIO, chunk: ChunkIndex, channels: dict[int, int]) -> Block:
    with bag_errors(path):
        begins = _indexed(file, chunk, channels)
        return _chunk_block(_uncompressed(file, chunk), channels, begins)


def _uncompressed(file: BinaryIO, chunk: ChunkIndex) -> bytes:
    """Return the records of a chunk after checking their size and checksum."""
    file.seek(chunk.chunk_start_offset + RECORD.size)
    record = Chunk.read(ReadDataStream(file))
    size, crc = record.uncompressed_size, record.uncompressed_crc
    data = decompressed(record.compression.encode(), record.data, size)
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("the size or the checksum of a chunk is wrong")
    return data


def _indexed(file: BinaryIO, chunk: ChunkIndex, channels: dict[int, int]) -> Integers:
    """Return the positions of the messages of these channels in a chunk, in its order."""
    positions = [np.zeros(0, np.int64)]
    for channel, position in chunk.message_index_offsets.items():
        if channel in channels:
            file.seek(position)
            head = file.read(RECORD.size + MESSAGE_INDEX.size)
            if head[0] != Opcode.MESSAGE_INDEX:
                raise ValueError("an index is wrong")
            size = MESSAGE_INDEX.unpack_from(head, RECORD.size)[1]
            pairs = np.frombuffer(file.read(size), "<u8").reshape(-1, 2)
            positions.append(pairs[:, 1].astype(np.int64))
    return np.sort(np.concatenate(positions))


def _chunk_block(data: bytes, channels: dict[int, int], begins: Integers) -> Block:
    """Return the messages of these channels (with their topics) that begin there in a chunk."""
    buffer = np.frombuffer(data, np.uint8)
    if not len(begins):
        return Block(buffer, *np.zeros((5, 0), np.int64))
    if begins[0] < 0 or begins[-1] + MESSAGE_RECORD.itemsize > len(data):
        raise ValueError("an index is wrong")
    heads = message_heads(data, begins)
    sizes = heads["length"].astype(np.int64) - MESSAGE.size
    starts = begins + MESSAGE_RECORD.itemsize
    sound = (heads["opcode"] == Opcode.MESSAGE) & (sizes >= 0) & (sizes <= len(data) - starts)
    if not sound.all():
        raise ValueError("the record of a message is wrong")
    topics = np.full(2**16, -1)
    topics[list(channels)] = list(channels.values())
    topic = topics[heads["channel"]]
    times = _time(heads["log_time"]), _time(heads["publish_time"])
    block = Block(buffer, starts, sizes, topic, *times)
    return block if (topic >= 0).all() else block.rows(np.flatnonzero(topic >= 0))


def _time(column: NDArray[np.uint64]) -> Integers:
    return np.minimum(column, _LATEST).astype(np.int64)


def _gathered_parts(
    messages: Iterator[_Message], number: int, names: Sequence[str]
) -> Iterator[_Part]:
    """Yield the parts of a bag whose messages are read one by one."""
    for place in itertools.count():
        gathered = list(itertools.islice(messages, _GATHERED))
        if not gathered:
            return
        topics, log_times, publish_times, data = zip(*gathered, strict=True)
        sizes = np.array([len(each) for each in data])
        block = Block(
            np.frombuffer(b"".join(data), np.uint8),
            np.cumsum(sizes) - sizes,
            sizes,
            np.array([names.index(topic) for topic in topics]),
            np.array([min(max(time, 0), _LATEST) for time in log_times]),
            np.array([min(max(time, 0), _LATEST) for time in publish_times]),
        )
        yield _Part(int(block.log_times.min()), (number, place), partial(block.rows, slice(None)))


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
