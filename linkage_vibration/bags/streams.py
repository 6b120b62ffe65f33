# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads topics of bags as columns, thousands of messages at a time, in the order of log times.

Chunks of MCAP are parsed as a whole, because rosbags takes 3 times and mcap 13 times as long
(`python -m benchmark.libraries`); other bags are read by rosbags. One chunk of each file, and the
chunks that overlap it, are in memory at a time.
"""

import heapq
import itertools
import re
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Integers
from linkage_vibration.bags.can_logs import CanLog
from linkage_vibration.bags.mcap_bag import McapBag
from linkage_vibration.bags.mcap_file import KNOWN_COMPRESSIONS, decompressed, message_heads
from linkage_vibration.bags.mcap_records import (
    LONGEST_RECORD,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_RECORD,
    RECORD,
)
from linkage_vibration.bags.reading import BagError, BagFile, bag_errors, open_files
from linkage_vibration.bags.recorder import PROVENANCE_METADATA
from linkage_vibration.bags.schemas import Schema, schema_of_store

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

BLOCK = 4096
"""The least number of messages in a block, so that calls of NumPy cost little for each."""

_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
_GATHERED = 1024  # messages in a part that rosbags reads one by one
_ZSTD = b"\x28\xb5\x2f\xfd"
_CONVERT = "write them as messages of ROS 2 in CDR"

_LATEST = 2**63 - 1  # ns, the year 2262; MCAP has unsigned times, whose upper half is meaningless
_Channels: TypeAlias = Mapping[int, tuple[int, "Connection"]]
"""The topic, an index in the requested names, and the connection of each channel."""
_Convert: TypeAlias = Callable[["Connection", bytes], bytes]
"""It turns a message into plain CDR of ROS 2."""
# Order of messages with the same time: number of the file, place in it.
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
    """Open bags that are read as one; a topic with several types occurs once for each.

    So many ``bad_lines`` of logs of a CAN bus were left out, the first for a ``fault``.
    """

    def __init__(self, paths: Sequence[Path], files: Sequence[BagFile]) -> None:
        self.paths = tuple(paths)
        self._files = tuple(files)
        counts: Counter[tuple[str, str]] = Counter()
        for file in files:
            for connection in file.reader.connections:
                counts[connection.topic, _type(connection)] += connection.msgcount
        readers = [file.reader for file in files]
        logs = [each for each in readers if isinstance(each, CanLog) and each.bad]
        self.bad_lines, self.fault = sum(log.bad for log in logs), logs[0].fault if logs else ""
        self.topics = tuple(BagTopic(*key, count) for key, count in sorted(counts.items()))

    def defined(self, name: str) -> tuple[str, str, Schema] | None:
        """Return the definition of a topic's type as an MCAP schema, its hash, and its fields.

        The hash is that of RIHS01 (REP 2016). The result is None if the bags do not define the
        type. A `BagError` is raised if they define it in several ways.
        """
        definitions: list[tuple[str, str, Schema]] = []
        files: list[Path] = []
        for file in self._files:
            with bag_errors(file.path):
                for connection in file.reader.connections:
                    if connection.topic == name and _is_foreign(connection):
                        problem = f"topic {name} holds {_type(connection)}, which cannot be read"
                        raise BagError(f"{file.path}: {problem}; {_CONVERT}.")
                    if connection.topic == name and connection.msgdef.data:
                        store, kind = _store([connection]), _type(connection)
                        text = _definition(store, connection)
                        definitions.append((*text, schema_of_store(store, kind)))
                        files.append(file.path)
        others = [n for n, each in enumerate(definitions) if each[2] != definitions[0][2]]
        if others:
            remedy = "read each recording by itself"
            if files[others[0]] == files[0]:
                remedy = "write the messages of each channel to a file of their own"
            problem = f"define the type of topic {name} in different ways"
            raise BagError(f"{files[0]} and {files[others[0]]} {problem}; {remedy}.")
        return definitions[0] if definitions else None

    @property
    def is_own_log(self) -> bool:
        """Whether they are one log that this package has written, in the order of arrival."""
        reader = self._files[0].reader
        if [file.path for file in self._files] != [*self.paths] or not isinstance(reader, McapBag):
            return False
        return any(each.name == PROVENANCE_METADATA for each in reader.summary.metadata_indexes)

    def blocks(self, names: Sequence[str], as_written: bool = False) -> Iterator[Block]:
        """Yield the messages of topics with these names, in the order of log times.

        Messages with the same time come in the order of the bags. Those of an MCAP file come as
        they were written if ``as_written``. Those of ROS 1 are converted to ROS 2.
        """
        parts = [_parts(file, number, names, as_written) for number, file in enumerate(self._files)]
        if as_written:
            return _ordered(itertools.chain.from_iterable(parts), as_written)
        merged = heapq.merge(*parts, key=lambda part: (part.first, part.rank))
        return _ordered(merged, as_written)


@contextmanager
def open_bags(paths: Sequence[Path]) -> Iterator[Bags]:
    """Open bags that are read as one, such as the parts of a recording, or raise a `BagError`."""
    with ExitStack() as stack:
        files = [file for path in paths for file in open_files(path, stack)]
        connections = [each for file in files for each in file.reader.connections]
        foreign = [each for each in connections if _is_foreign(each)]
        if foreign and len(foreign) == len(connections):
            problem = f"{', '.join(map(str, paths))} holds no messages of ROS"
            reason = f"{foreign[0].topic} holds {_type(foreign[0])}"
            raise BagError(f"{problem}: {reason}; {_CONVERT}.")
        yield Bags(paths, files)


def _is_foreign(connection: "Connection") -> bool:
    """Return whether the messages of a connection have an encoding that is not read here."""
    return getattr(connection.ext, "serialization_format", "cdr") != "cdr"


def _type(connection: "Connection") -> str:
    """Return the full name of a type, as of a bag that names it in the way of ROS 1."""
    if _is_foreign(connection):
        return f"{getattr(connection.ext, 'serialization_format', '') or 'unknown'} messages"
    package, *parts = connection.msgtype.split("/")
    return "/".join([package, *(["msg"] if len(parts) == 1 else []), *parts])


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
            yield block if as_written else block.rows(np.argsort(block.log_times, kind="stable"))


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


def _parts(file: BagFile, number: int, names: Sequence[str], as_written: bool) -> Iterator[_Part]:
    """Yield the parts of a file in the order of their first times, or as MCAP has them."""
    with bag_errors(file.path), ExitStack() as stack:
        every = [each for each in file.reader.connections if each.topic in names]
        connections = [each for each in every if not _is_foreign(each)]
        convert = _converter(connections)
        if not isinstance(file.reader, McapBag):
            messages = file.reader.messages(connections) if connections else ()
            yield from _gathered_parts(messages, number, names, convert)
            return
        stream = stack.enter_context(file.reader.path.open("rb"))
        channels = {each.id: (names.index(each.topic), each) for each in connections}
        chunks = list(enumerate(file.reader.chunks))
        if not as_written:
            chunks.sort(key=lambda entry: entry[1].message_start_time)
        for place, chunk in chunks:
            if channels.keys() & chunk.message_index_offsets:
                load = partial(_mcap_block, file.path, stream, chunk, channels, convert)
                yield _Part(min(chunk.message_start_time, _LATEST), (number, place), load)


def _unpacked(connection: "Connection", data: bytes) -> bytes:
    """Return a message that rosbag2 may have compressed; nothing in CDR begins like zstd."""
    return decompressed(b"zstd", data, LONGEST_RECORD) if data.startswith(_ZSTD) else data


def _converter(connections: "Sequence[Connection]") -> _Convert:
    """Return what turns messages into plain CDR of ROS 2."""
    from rosbags.interfaces import ConnectionExtRosbag1

    old = [each for each in connections if isinstance(each.ext, ConnectionExtRosbag1)]
    store = _store(old)

    def convert(connection: "Connection", data: bytes) -> bytes:
        return bytes(store.ros1_to_cdr(data, _type(connection))) if connection in old else data

    return convert if old else _unpacked


def _mcap_block(
    path: Path, stream: BinaryIO, chunk: ChunkIndex, channels: _Channels, convert: _Convert
) -> Block:
    with bag_errors(path):
        begins = _indexed(stream, chunk, channels)
        content = _uncompressed(stream, chunk)
        block = _chunk_block(content, channels, begins)
        if convert is _unpacked and not (len(block) and block.message(0).startswith(_ZSTD)):
            return block
        heads = message_heads(content, block.starts - MESSAGE_RECORD.itemsize)
        data = [
            convert(channels[channel][1], block.message(row))
            for row, channel in enumerate(heads["channel"].tolist())
        ]
        return replace(block, **_laid_out(data))


def _uncompressed(file: BinaryIO, chunk: ChunkIndex) -> bytes:
    """Return the records of a chunk after checking their size and checksum."""
    file.seek(chunk.chunk_start_offset + RECORD.size)
    record = Chunk.read(ReadDataStream(file))
    if record.compression.encode() not in KNOWN_COMPRESSIONS:
        problem = f"A chunk is compressed with {record.compression}, which no reader here knows"
        hint = "compress the file with zstd or lz4, such as with `mcap compress`"
        raise BagError(f"{problem}; {hint}.")
    size, crc = record.uncompressed_size, record.uncompressed_crc
    data = decompressed(record.compression.encode(), record.data, size)
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise ValueError("the size or the checksum of a chunk is wrong")
    return data


def _indexed(file: BinaryIO, chunk: ChunkIndex, channels: Collection[int]) -> Integers:
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
    return np.unique(np.concatenate(positions))


def _chunk_block(data: bytes, channels: _Channels, begins: Integers) -> Block:
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
    topics[list(channels)] = [topic for topic, _ in channels.values()]
    topic = topics[heads["channel"]]
    times = _time(heads["log_time"]), _time(heads["publish_time"])
    block = Block(buffer, starts, sizes, topic, *times)
    return block if (topic >= 0).all() else block.rows(np.flatnonzero(topic >= 0))


def _time(column: NDArray[np.uint64]) -> Integers:
    return np.minimum(column, _LATEST).astype(np.int64)


def _gathered_parts(
    messages: "Iterable[tuple[Connection, int, bytes]]",
    number: int,
    names: Sequence[str],
    convert: _Convert,
) -> Iterator[_Part]:
    """Yield the parts of a bag whose messages are read one by one."""
    upcoming = iter(messages)
    for place in itertools.count():
        gathered = list(itertools.islice(upcoming, _GATHERED))
        if not gathered:
            return
        connections, log_times, data = zip(*gathered, strict=True)
        data = tuple(map(convert, connections, data))
        times = np.array([min(max(time, 0), _LATEST) for time in log_times])
        topics = np.array([names.index(connection.topic) for connection in connections])
        block = Block(**_laid_out(data), topics=topics, log_times=times, publish_times=times)
        yield _Part(int(times.min()), (number, place), partial(block.rows, slice(None)))


def _laid_out(messages: Sequence[bytes]) -> dict[str, Any]:
    """Return a buffer with messages, and where they are in it, as a `Block` has them."""
    sizes = np.array([len(each) for each in messages], np.int64)
    buffer = np.frombuffer(b"".join(messages), np.uint8)
    return {"buffer": buffer, "starts": np.cumsum(sizes) - sizes, "sizes": sizes}


def _store(connections: "Sequence[Connection]") -> Any:
    """Return a type store that knows the types of connections, as ROS 2 has them."""
    from rosbags.interfaces import ConnectionExtRosbag1, MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    for connection in connections:
        text, msgtype = connection.msgdef.data, _type(connection)
        is_idl = connection.msgdef.format == MessageDefinitionFormat.IDL
        # Before 2011 the header of ROS 1 had the name of another package.
        text = text.replace("roslib/Header", "std_msgs/Header").replace("\r\n", "\n")
        if isinstance(connection.ext, ConnectionExtRosbag1):
            text = re.sub(r"^(\s*)byte\b", r"\1int8", text, flags=re.MULTILINE)  # as in ROS 1
        types = get_types_from_idl(text) if is_idl else get_types_from_msg(text, msgtype)
        if _HEADER in types:  # that of ROS 2 has no sequence number
            types |= get_types_from_msg("int32 sec\nuint32 nanosec", _TIME)
            types |= get_types_from_msg(f"{_TIME} stamp\nstring frame_id", _HEADER)
        store.register({name: kind for name, kind in types.items() if name not in store.fielddefs})
    return store


def _definition(store: Any, connection: "Connection") -> tuple[str, str]:
    """Return the definition of a type as ROS 2 has it, and its hash; empty if a part is missing."""
    from rosbags.typesys import TypesysError

    try:
        text, _ = store.generate_msgdef(_type(connection), ros_version=2)
        return text, store.hash_rihs01(_type(connection))
    except (TypesysError, KeyError):
        return connection.msgdef.data, ""
