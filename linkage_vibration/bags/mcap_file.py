# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes an MCAP file of whole chunks, with the indexes and the summary that find them.

The log of the node, a replay and a recovery are all written by it. Own code because the writer of
mcap takes messages one by one, 4 times as long for each, and compresses each chunk itself.
"""

import contextlib
import itertools
import os
import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import LIBRARY_IDENTIFIER
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Integers
from linkage_vibration.bags.mcap_records import CHUNK, MAGIC, MESSAGE_INDEX, MESSAGE_RECORD, RECORD
from linkage_vibration.bags.writing import Topic

KNOWN_COMPRESSIONS = (b"", b"lz4", b"zstd")  # as chunks name them
_PIECE = 2**20  # bytes that are decompressed at a time


def message_heads(content: bytes, begins: Integers) -> NDArray[np.void]:
    """Return the heads of messages, (n,), see `MESSAGE_RECORD`, that begin at these positions."""
    # One head begins at each byte; the view costs nothing.
    count = len(content) - MESSAGE_RECORD.itemsize + 1
    return np.ndarray((count,), MESSAGE_RECORD, content, strides=(1,))[begins]


class McapFile:
    """An MCAP file that is being written to an empty stream, which remains open after `close`."""

    def __init__(self, stream: BinaryIO, profile: str, compression: str = "zstd") -> None:
        self.stream = stream
        self.profile = profile
        self.channels: dict[str, int] = {}  # by topic
        self.counts: Counter[int] = Counter()  # of messages, by channel
        self.first = self.last = 0  # least and greatest log time, ns
        self.metadata: set[str] = set()
        self._compression = compression
        self._types: dict[tuple[str, str], int] = {}
        # The records of the summary as bytes, and their numbers, by their opcodes.
        self._summary: defaultdict[int, bytearray] = defaultdict(bytearray)
        self._numbers: Counter[int] = Counter()
        stream.write(MAGIC)
        self._write(mcap.Header(profile, f"linkage_vibration {LIBRARY_IDENTIFIER}"))

    @property
    def summary_size(self) -> int:
        """Number of bytes of the records that are in the summary so far."""
        return sum(map(len, self._summary.values()))

    def add_topics(self, topics: Sequence[Topic]) -> bytes:
        """Define channels for topics, after the schemas that are missing; return these records."""
        definitions = b""
        for topic in topics:
            key = topic.type, topic.definition
            if key not in self._types:
                self._types[key] = len(self._types) + 1
                data = topic.definition.encode()
                schema = mcap.Schema(self._types[key], data, "ros2msg", topic.type)
                definitions += self.define(schema)
        for topic in topics:
            self.channels[topic.name] = number = len(self.channels) + 1
            kind = self._types[topic.type, topic.definition]
            channel = mcap.Channel(number, topic.name, "cdr", topic.metadata(), kind)
            definitions += self.define(channel)
        return definitions

    def define(self, record: mcap.Schema | mcap.Channel) -> bytes:
        """Add a schema, or a channel whose schema was added before it; return its bytes."""
        if isinstance(record, mcap.Channel):
            self.counts.setdefault(record.id, 0)
        data = self._summarise(record)
        self.stream.write(data)
        return data

    def attach(self, record: mcap.Attachment) -> None:
        """Add an attachment."""
        about = record.log_time, record.create_time, len(record.data)
        position = self._write(record)
        self._summarise(mcap.AttachmentIndex(*position, *about, record.name, record.media_type))

    def add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        """Add a metadata record."""
        # A text may contain the name of a file, which need not be UTF-8.
        texts = {key: os.fsencode(text).decode(errors="replace") for key, text in facts.items()}
        position = self._write(mcap.Metadata(name, texts))
        self._summarise(mcap.MetadataIndex(*position, name))
        self.metadata.add(name)

    def add_chunk(self, content: bytes, begins: Integers) -> None:
        """Add a chunk, whose messages begin at ``begins``, (n,), ascending, and its indexes."""
        heads = message_heads(content, begins)
        times, order = heads["log_time"], np.argsort(heads["channel"], kind="stable")
        channels = heads["channel"][order]
        starts = [0, *(np.flatnonzero(np.diff(channels)) + 1).tolist()]
        first, last = int(times.min()), int(times.max())
        self.first = min(self.first, first) if self._numbers[Opcode.CHUNK_INDEX] else first
        self.last = max(self.last, last)
        name, data = _compressed(self._compression, content)
        head = CHUNK.pack(first, last, len(content), zlib.crc32(content), len(name))
        head += name + struct.pack("<Q", len(data))
        begin = self.stream.tell()
        self.stream.write(RECORD.pack(Opcode.CHUNK, len(head) + len(data)) + head)
        self.stream.write(data)
        end = begin + RECORD.size + len(head) + len(data)
        pairs = np.empty((len(order), 2), "<u8")
        pairs[:, 0], pairs[:, 1] = times[order], begins[order]
        indexes, offsets = b"", {}
        for start, stop in itertools.pairwise([*starts, len(order)]):
            channel, entries = int(channels[start]), pairs[start:stop].tobytes()
            offsets[channel] = end + len(indexes)
            about = MESSAGE_INDEX.pack(channel, len(entries))
            indexes += RECORD.pack(Opcode.MESSAGE_INDEX, len(about) + len(entries)) + about
            indexes += entries
            self.counts[channel] += stop - start
        self.stream.write(indexes)
        self._summarise(
            mcap.ChunkIndex(
                chunk_length=end - begin,
                chunk_start_offset=begin,
                compression=name.decode(),
                compressed_size=len(data),
                message_end_time=last,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(content),
            )
        )

    def close(self) -> None:
        """Write the summary and the footer."""
        self._write(mcap.DataEnd(0))
        self._summarise(
            mcap.Statistics(
                attachment_count=self._numbers[Opcode.ATTACHMENT_INDEX],
                channel_count=self._numbers[Opcode.CHANNEL],
                channel_message_counts=dict(self.counts),
                chunk_count=self._numbers[Opcode.CHUNK_INDEX],
                message_count=self.counts.total(),
                message_end_time=self.last,
                message_start_time=self.first,
                metadata_count=self._numbers[Opcode.METADATA_INDEX],
                schema_count=self._numbers[Opcode.SCHEMA],
            )
        )
        start = self.stream.tell()
        summary, groups = b"", b""
        for opcode, group in sorted(self._summary.items()):
            groups += _encoded(mcap.SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offsets = start + len(summary)
        summary += groups
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets)
        self.stream.write(summary)
        self._write(mcap.Footer(start, offsets, zlib.crc32(footer, zlib.crc32(summary))))
        self.stream.write(MAGIC)

    def _write(self, record: mcap.McapRecord) -> tuple[int, int]:
        """Write a record; return its position and its number of bytes."""
        return self.stream.tell(), self.stream.write(_encoded(record))

    def _summarise(self, record: mcap.McapRecord) -> bytes:
        """Add a record to the summary; return its bytes."""
        data = _encoded(record)
        self._summary[data[0]] += data
        self._numbers[data[0]] += 1
        return data


def _compressed(compression: str, content: bytes) -> tuple[bytes, bytes]:
    """Return the name of a compression as a chunk stores it, and the compressed content."""
    if compression == "zstd":
        try:
            return b"zstd", zstandard.compress(content)
        except zstandard.ZstdError:
            raise MemoryError from None
    if compression == "lz4":
        return b"lz4", lz4.frame.compress(content)
    return b"", content


def decompressed(compression: bytes, data: bytes, most: int) -> bytes:
    """Return what can be decompressed of the frames of a chunk, up to so many bytes."""
    if not compression:
        return data
    pieces, size = [], 0
    with contextlib.suppress(zstandard.ZstdError, RuntimeError):
        if compression == b"zstd":
            reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
            while size < most and (piece := reader.read(min(most - size, _PIECE))):
                pieces.append(piece)
                size += len(piece)
        else:
            while data and size < most:
                frame = lz4.frame.LZ4FrameDecompressor()
                pieces.append(frame.decompress(data, most - size))
                size += len(pieces[-1])
                data = frame.unused_data or b""
    return b"".join(pieces)


def _encoded(record: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
