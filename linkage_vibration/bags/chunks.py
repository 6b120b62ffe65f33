# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes logs by the chunk, thousands of messages at a time.

Own code because the writer of mcap takes 4 times as long for a message, and a replay writes 800,000
of them in a second (`python -m benchmark.libraries`). The node records with `LogWriter`, which
writes smaller chunks, so that a crash loses little.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.mcap_records import (
    CHUNK,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_RECORD,
    RECORD,
)
from linkage_vibration.bags.writing import (
    LIBRARY,
    ROSBAG2_METADATA,
    Attachment,
    Topic,
    rosbag2_metadata,
)

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Messages of one topic of the log and one size.

    Attributes
    ----------
    data : ndarray of uint8, (n, n_bytes)
        In CDR, with encapsulation headers.
    place : ndarray, (n,)
        Position of each message among those of the chunk.
    log_times, publish_times : ndarray, (n,)
        Times of receiving and of sending, ns, not negative.
    """

    topic: str
    data: Bytes
    place: Integers
    log_times: Integers
    publish_times: Integers


class ChunkLog:
    """An MCAP log that is written by the chunk, with compression on another thread.

    Parameters
    ----------
    path : Path
        The file to create.
    topics : sequence of Topic
        Topics of the log.
    attachments : sequence of Attachment
        Files to store in the log.
    metadata : mapping of str to (mapping of str to str)
        Facts to store in it, by name.

    Raises
    ------
    OSError
        From any method, if the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        attachments: Sequence[Attachment],
        metadata: Mapping[str, Mapping[str, str]],
    ) -> None:
        self._path = path
        self._topics = tuple(topics)
        self._counts = dict.fromkeys((topic.name for topic in topics), 0)
        self._first, self._last = 2**63 - 1, 0
        self._chunks: list[mcap.ChunkIndex] = []
        self._attachments: list[mcap.AttachmentIndex] = []
        self._metadata: list[mcap.MetadataIndex] = []
        self._file = path.open("xb")
        self._pool = ThreadPoolExecutor(1)
        self._under_way = self._pool.submit(lambda: None)
        self._file.write(MAGIC)
        self._write(mcap.Header("ros2", LIBRARY))
        self._definitions = _definitions(self._topics)
        for definition in self._definitions:
            self._write(definition)
        for stored in attachments:
            name, kind, data = stored.name, stored.media_type, stored.data
            position = self._write(mcap.Attachment(0, 0, name, kind, data))
            self._attachments.append(mcap.AttachmentIndex(*position, 0, 0, len(data), name, kind))
        for name, facts in metadata.items():
            self._add_metadata(name, facts)

    def write(self, messages: Sequence[Messages]) -> None:
        """Add a chunk of messages in the order of their places."""
        messages = [group for group in messages if len(group.place)]
        if not messages:
            return
        records, offsets = self._records(messages)
        self._under_way.result()
        self._under_way = self._pool.submit(self._write_chunk, messages, records, offsets)

    def close(self) -> None:
        """Write the summary, and close the file."""
        self._under_way.result()
        counts = list(self._counts.values())
        first = self._first if sum(counts) else 0
        self._add_metadata(
            ROSBAG2_METADATA, rosbag2_metadata(self._path, self._topics, counts, first, self._last)
        )
        self._write(mcap.DataEnd(0))
        statistics = mcap.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._topics),
            channel_message_counts=dict(enumerate(counts, 1)),
            chunk_count=len(self._chunks),
            message_count=sum(counts),
            message_end_time=self._last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=sum(isinstance(record, mcap.Schema) for record in self._definitions),
        )
        self._write_summary(
            [*self._definitions, statistics, *self._chunks, *self._attachments, *self._metadata]
        )
        self._file.close()

    def __enter__(self) -> "ChunkLog":
        """Return the log itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Complete the log, unless an error occurred."""
        try:
            if kind is None:
                self.close()
        finally:
            self._pool.shutdown()
            self._file.close()

    def _records(self, messages: Sequence[Messages]) -> tuple[bytes, list[Integers]]:
        """Return the records of a chunk, and the positions of those of each topic and size."""
        places = np.concatenate([group.place for group in messages])
        sizes = [group.data.shape[1] + MESSAGE_RECORD.itemsize for group in messages]
        lengths = np.repeat(sizes, [len(group.place) for group in messages])
        order = np.argsort(places, kind="stable")
        begins = np.empty(len(order), np.int64)
        begins[order] = np.cumsum(lengths[order]) - lengths[order]
        buffer = np.empty(int(lengths.sum()), np.uint8)
        offsets, done = [], 0
        for group in messages:
            n, size = group.data.shape
            header = np.empty(n, MESSAGE_RECORD)
            header["opcode"] = Opcode.MESSAGE
            header["length"] = MESSAGE.size + size
            header["channel"] = self._channel(group.topic)
            header["sequence"] = self._counts[group.topic] + np.arange(n)
            header["log_time"], header["publish_time"] = group.log_times, group.publish_times
            self._counts[group.topic] += n
            self._first = min(self._first, int(group.log_times.min()))
            self._last = max(self._last, int(group.log_times.max()))
            rows = np.hstack([header.view(np.uint8).reshape(n, -1), group.data])
            begin = begins[done : done + n]
            sliding_window_view(buffer, rows.shape[1], writeable=True)[begin] = rows
            offsets.append(begin)
            done += n
        return buffer.tobytes(), offsets

    def _write_chunk(
        self, messages: Sequence[Messages], records: bytes, offsets: Sequence[Integers]
    ) -> None:
        compressed = zstandard.compress(records)
        first = min(int(group.log_times.min()) for group in messages)
        last = max(int(group.log_times.max()) for group in messages)
        begin = self._file.tell()
        head = CHUNK.pack(first, last, len(records), zlib.crc32(records), 4)
        head += struct.pack("<4sQ", b"zstd", len(compressed))
        self._file.write(RECORD.pack(Opcode.CHUNK, len(head) + len(compressed)))
        self._file.write(head)
        self._file.write(compressed)
        indexes = begin + RECORD.size + len(head) + len(compressed)
        self._chunks.append(
            mcap.ChunkIndex(
                chunk_length=indexes - begin,
                chunk_start_offset=begin,
                compression="zstd",
                compressed_size=len(compressed),
                message_end_time=last,
                message_index_length=0,
                message_index_offsets={},
                message_start_time=first,
                uncompressed_size=len(records),
            )
        )
        for topic in dict.fromkeys(group.topic for group in messages):
            channel = self._channel(topic)
            self._chunks[-1].message_index_offsets[channel] = self._file.tell()
            groups = zip(messages, offsets, strict=True)
            mine = [(group.log_times, at) for group, at in groups if group.topic == topic]
            pairs = np.hstack(mine).T.astype("<u8")
            pairs = pairs[np.argsort(pairs[:, 1])]
            head = MESSAGE_INDEX.pack(channel, pairs.nbytes)
            self._file.write(RECORD.pack(Opcode.MESSAGE_INDEX, len(head) + pairs.nbytes) + head)
            self._file.write(pairs.tobytes())
        self._chunks[-1].message_index_length = self._file.tell() - indexes

    def _channel(self, topic: str) -> int:
        return 1 + list(self._counts).index(topic)

    def _write(self, record: mcap.McapRecord) -> tuple[int, int]:
        """Write a record; return its position and its number of bytes."""
        begin = self._file.tell()
        self._file.write(_encoded(record))
        return begin, self._file.tell() - begin

    def _add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        position = self._write(mcap.Metadata(name, dict(facts)))
        self._metadata.append(mcap.MetadataIndex(*position, name))

    def _write_summary(self, records: Sequence[mcap.McapRecord]) -> None:
        """Write the summary of these records, grouped by kind, and the footer."""
        start = self._file.tell()
        summary, groups = b"", []
        for kind in dict.fromkeys(type(record) for record in records):
            group = b"".join(_encoded(record) for record in records if type(record) is kind)
            groups.append(mcap.SummaryOffset(group[0], start + len(summary), len(group)))
            summary += group
        offsets = start + len(summary)
        summary += b"".join(map(_encoded, groups))
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets)
        self._file.write(summary)
        self._write(mcap.Footer(start, offsets, zlib.crc32(footer, zlib.crc32(summary))))
        self._file.write(MAGIC)


def _definitions(topics: Sequence[Topic]) -> list[mcap.McapRecord]:
    """Return the schemas and the channels, both numbered from 1."""
    types = dict.fromkeys((topic.type, topic.definition) for topic in topics)
    numbers = {key: number for number, key in enumerate(types, 1)}
    records: list[mcap.McapRecord] = [
        mcap.Schema(number, text.encode(), "ros2msg", name)
        for (name, text), number in numbers.items()
    ]
    for number, topic in enumerate(topics, 1):
        schema = numbers[topic.type, topic.definition]
        records.append(mcap.Channel(number, topic.name, "cdr", topic.metadata(), schema))
    return records


def _encoded(record: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
