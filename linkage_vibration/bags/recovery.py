# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves the readable part of an incomplete or damaged MCAP file.

Own code because the reader of mcap stops at the first damaged record, and so loses half of a file
of which this saves 87 % (`python -m benchmark.libraries`). An MCAP file is a magic number and
records, each with an opcode, a length and a content. Most messages are in chunk records, which have
a CRC. Every record is checked before its length is used; after a damaged one, reading continues at
the next intact one.
"""

import contextlib
import io
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import Writer

from linkage_vibration.bags.mcap_records import CHUNK, MAGIC, MESSAGE, MESSAGE_INDEX, RECORD
from linkage_vibration.bags.writing import LIBRARY, ROSBAG2_METADATA, Topic, rosbag2_metadata
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.atomic_files import replacement

RECOVERY_METADATA = "linkage_vibration.recovery"  # the name of a record
# A record with a greater length counts as damaged, so that memory is bounded.
LONGEST_RECORD = 2**28

_DAMAGES_SHOWN = 20
_BLOCK = 2**20  # bytes read at a time
_INDEX_ENTRY_BYTES = 16
_FOOTER_BYTES = RECORD.size + 20 + len(MAGIC)
# An opcode and a length below 4 GiB; a lookahead, as a false match may overlap a record.
_LIKELY_RECORD = re.compile(rb"(?=[\x01-\x0f].{4}\0{4})", re.DOTALL)
_RECORDS: dict[int, Any] = {
    opcode: getattr(records, opcode.name.title().replace("_", ""))
    for opcode in Opcode
    if opcode not in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
}
_MOST_UNKNOWN = 64  # bytes at the end of a record, of fields of a later version of MCAP
_AFTER_DATA = {
    Opcode.DATA_END,
    Opcode.FOOTER,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
}


class RecoveryError(LinkageVibrationError):
    """A file cannot be recovered."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """The saved and the lost part of a file.

    Attributes
    ----------
    path : Path
        The new file.
    saved, lost : dict of str to int
        Number of its messages for each topic; known number of lost messages, if any.
    damages : tuple of str
        Damaged places, in the order of the file.
    """

    path: Path
    saved: dict[str, int]
    lost: dict[str, int]
    damages: tuple[str, ...]


def recover(
    source: Path, output: Path, progress: Callable[[int], object] = lambda count: None
) -> Recovery:
    """Write the readable part of an MCAP file to a new and complete one.

    Messages keep their times and their order; schemas, channels, attachments and metadata are kept
    too. A chunk with a wrong CRC is lost. Of a chunk that the end of the file cuts off, everything
    that can be decompressed is kept. The input is not changed.

    Parameters
    ----------
    source, output : Path
        The file to read, and the file to write, which must not exist.
    progress : callable
        It is called with the number of bytes that were read since the last call.

    Raises
    ------
    RecoveryError
        If the input cannot be read or has nothing to save, or the output exists already or cannot
        be written.
    """
    if os.path.lexists(output):
        raise RecoveryError(f"{output} exists already; choose another name.")
    try:
        file = source.open("rb")
    except OSError as error:
        raise RecoveryError(f"{source} cannot be read: {error.strerror}; check it.") from None
    with file, replacement(output, RecoveryError) as new, new.open("wb") as stream:
        return _Rescue(_Source(source, file), output, stream, progress).run()


def summary(recovery: Recovery) -> str:
    """Return a text with the saved and lost messages of each topic, and the damaged places."""
    topics = sorted(recovery.saved.keys() | recovery.lost.keys())
    lines = [f"{recovery.path}: {sum(recovery.saved.values())} messages saved."]
    for topic in topics:
        lost = recovery.lost.get(topic, 0)
        lines.append(
            f"  {topic}: {recovery.saved.get(topic, 0)}" + (f", {lost} lost" if lost else "")
        )
    if recovery.damages:
        lines.append("Damaged places of the old file:")
        lines += [f"  {damage}" for damage in recovery.damages[:_DAMAGES_SHOWN]]
        if (more := len(recovery.damages) - _DAMAGES_SHOWN) > 0:
            lines.append(f"  and {more} others")
    else:
        lines.append("The old file is complete and undamaged.")
    return "\n".join(lines)


class _Source:
    """Reads any part of the damaged file, with one block in memory at a time."""

    def __init__(self, path: Path, file: io.BufferedReader) -> None:
        self.path = path
        self.size = os.fstat(file.fileno()).st_size
        self._file = file
        self._block = b""
        self._offset = 0

    def read(self, offset: int, count: int) -> bytes:
        """Return bytes from an offset, fewer at the end of the file."""
        start = offset - self._offset
        if start < 0 or start + count > len(self._block):
            self._offset, start = offset, 0
            self._block = self._pread(offset, max(count, _BLOCK))
        return self._block[start : start + count]

    def _pread(self, offset: int, count: int) -> bytes:
        try:
            self._file.seek(offset)
            return self._file.read(count)
        except OSError as error:
            raise RecoveryError(
                f"{self.path} cannot be read at byte {offset}: {error.strerror}; copy it with "
                "`ddrescue` first if its disk fails."
            ) from None


class _Rescue:
    """A recovery in progress."""

    def __init__(
        self,
        source: _Source,
        output: Path,
        stream: io.BufferedWriter,
        progress: Callable[[int], object],
    ) -> None:
        self._source = source
        self._output = output
        self._progress = progress
        self._writer = Writer(stream)
        self._begun = False
        self._profile: str | None = None
        # By the ids of the input: the definition, and whether a CRC confirms it.
        self._schemas: dict[int, tuple[records.Schema, bool]] = {}
        self._channels: dict[int, tuple[records.Channel, bool]] = {}
        # From the ids of the input to those of the output.
        self._schema_ids: dict[int, int] = {0: 0}
        self._channel_ids: dict[int, int] = {}
        self._saved: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()
        self._statistics: records.Statistics | None = None
        self._chunked = False
        # Messages of the last chunk that no index has counted yet.
        self._chunk: Counter[int] = Counter()
        self._first_time, self._last_time = 2**64, 0
        self._damages: list[str] = []

    def run(self) -> Recovery:
        """Save everything that is readable."""
        if self._source.size == 0:
            raise RecoveryError(
                f"{self._source.path} is empty, as its recording ended before anything was written."
            )
        self._read_summary()
        for offset, opcode, body, cut in self._records():
            self._take(offset, opcode, body, cut)
        if not self._begun and not self._channels:
            raise RecoveryError(f"{self._source.path} has no readable record; give an MCAP file.")
        return self._finish()

    def _read_summary(self) -> None:
        """Read definitions and statistics from the end of the file, if it is intact."""
        size = self._source.size
        if size < _FOOTER_BYTES:
            return
        footer = self._source.read(size - _FOOTER_BYTES, _FOOTER_BYTES)
        if not footer.endswith(MAGIC):
            return
        record = _parse(Opcode.FOOTER, footer[RECORD.size : -len(MAGIC)])
        end = size - _FOOTER_BYTES
        if not isinstance(record, records.Footer) or not 0 < record.summary_start <= end:
            return
        if end - record.summary_start > LONGEST_RECORD:
            return
        # The CRC covers the footer as well, up to the CRC itself.
        summary = self._source.read(record.summary_start, end - record.summary_start)
        if zlib.crc32(footer[: RECORD.size + 16], zlib.crc32(summary)) != record.summary_crc:
            return
        for opcode, body in _split(summary):
            found = _parse(opcode, body)
            if isinstance(found, records.Schema | records.Channel):
                self._define(found, verified=True)
            elif isinstance(found, records.Statistics):
                self._statistics = found

    def _records(self) -> Iterator[tuple[int, int, bytes, bool]]:
        """Yield offset, opcode, content and incompleteness of the readable records of data."""
        source, offset = self._source, len(MAGIC)
        if source.read(0, offset) != MAGIC:
            self._damages.append("byte 0: the magic number")
            offset = self._resume_at(0)
        while offset < source.size:
            start = offset + RECORD.size
            if (end := self._end_of_sound(offset)) is not None:
                opcode, _ = RECORD.unpack(source.read(offset, RECORD.size))
                if opcode in _AFTER_DATA:
                    if source.read(source.size - len(MAGIC), len(MAGIC)) != MAGIC:
                        self._damages.append(f"byte {source.size}: the end is missing")
                    break
                yield offset, opcode, source.read(start, end - start), False
            elif self._is_cut_chunk(offset):
                end = source.size
                yield offset, Opcode.CHUNK, source.read(start, end - start), True
            else:
                end = self._resume_at(offset + 1)
                what = "the rest of the file" if end == source.size else f"{end - offset} bytes"
                self._damages.append(f"byte {offset}: {what}")
            self._progress(end - offset)
            offset = end
        else:
            self._damages.append(f"byte {source.size}: the end is missing")
        self._progress(source.size - offset)

    def _resume_at(self, offset: int) -> int:
        """Return the offset of the next intact record, or the size of the file."""
        source = self._source
        while offset < source.size:
            block = source.read(offset, _BLOCK)
            for match in _LIKELY_RECORD.finditer(block):
                if self._end_of_sound(offset + match.start()) is not None:
                    return offset + match.start()
            if offset + len(block) >= source.size:
                break
            offset += len(block) - RECORD.size + 1
        return source.size

    def _end_of_sound(self, offset: int) -> int | None:
        """Return the end of a record if its content agrees with its length."""
        source = self._source
        opcode, length = self._head(offset)
        start = offset + RECORD.size
        end = start + length
        if length > LONGEST_RECORD or end > source.size:
            return None
        if opcode == Opcode.CHUNK:
            sound = self._chunk_length(start) == length
        elif opcode == Opcode.MESSAGE:
            # Only the record after it confirms its length. If there are chunks, all messages are
            # in them, and what looks like another one is a damaged index.
            sound = not self._chunked and length >= MESSAGE.size and self._is_likely(end)
        elif opcode == Opcode.MESSAGE_INDEX:
            content = source.read(start, MESSAGE_INDEX.size)
            entries = length - MESSAGE_INDEX.size
            sound = entries >= 0 and MESSAGE_INDEX.unpack(content)[1] == entries
        else:
            # A record of the data may have more fields than are known; the next record confirms it.
            longer = opcode not in _AFTER_DATA and self._is_likely(end)
            body = source.read(start, length)
            sound = opcode in _RECORDS and _parse(opcode, body, longer) is not None
        return end if sound else None

    def _head(self, offset: int) -> tuple[int, int]:
        """Return the opcode and the length of a record; 0 and 0 if the file ends before them."""
        header = self._source.read(offset, RECORD.size)
        opcode, length = RECORD.unpack(header.ljust(RECORD.size, b"\0"))
        return opcode, length

    def _is_likely(self, offset: int) -> bool:
        """Return whether the end of the file, or what looks like a record, is at an offset."""
        return offset == self._source.size or (
            _LIKELY_RECORD.match(self._source.read(offset, RECORD.size)) is not None
        )

    def _is_cut_chunk(self, offset: int) -> bool:
        opcode, length = self._head(offset)
        start = offset + RECORD.size
        cut = start + length > self._source.size
        return opcode == Opcode.CHUNK and cut and self._chunk_length(start) == length

    def _chunk_length(self, start: int) -> int | None:
        """Return the length of a chunk's content that its own fields give."""
        head = self._source.read(start, CHUNK.size + 16)
        if len(head) < CHUNK.size:
            return None
        name_length = CHUNK.unpack_from(head)[-1]
        before = CHUNK.size + name_length + 8
        if len(head) < before:
            return None
        return int(before + int.from_bytes(head[before - 8 : before], "little"))

    def _take(self, offset: int, opcode: int, body: bytes, cut: bool) -> None:
        """Save the content of a record."""
        if opcode == Opcode.CHUNK:
            self._take_chunk(offset, body, cut)
        elif opcode == Opcode.MESSAGE:
            self._take_message(body)
        elif opcode == Opcode.MESSAGE_INDEX:
            channel, size = MESSAGE_INDEX.unpack_from(body)
            count = size // _INDEX_ENTRY_BYTES
            # An index without its chunk still counts the messages of the chunk.
            if self._chunk.pop(channel, None) != count:
                self._lost[channel] += count
        else:
            self._take_other(offset, _parse(opcode, body, longer=True))

    def _take_chunk(self, offset: int, body: bytes, cut: bool) -> None:
        self._chunked = True
        self._chunk.clear()
        *_, size, crc, name_length = CHUNK.unpack_from(body)
        compression = body[CHUNK.size : CHUNK.size + name_length]
        data = _decompressed(compression, memoryview(body)[CHUNK.size + name_length + 8 :])
        sound = len(data) == size if crc == 0 else zlib.crc32(data) == crc
        if not sound and not cut:
            self._damages.append(f"byte {offset}: a chunk of {len(body)} bytes")
            return
        if cut:
            self._damages.append(f"byte {offset}: a chunk that the end of the file cuts off")
        for opcode, content in _split(data):
            if opcode == Opcode.MESSAGE and len(content) >= MESSAGE.size:
                self._take_message(content)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                found = _parse(opcode, content, longer=True)
                if isinstance(found, records.Schema | records.Channel):
                    self._define(found, verified=not cut and crc != 0)

    def _take_message(self, body: bytes) -> None:
        channel, sequence, log_time, publish_time = MESSAGE.unpack_from(body)
        self._chunk[channel] += 1
        if channel not in self._channels:
            self._lost[channel] += 1
            return
        self._begin()
        if channel not in self._channel_ids:
            self._register(channel)
        data = body[MESSAGE.size :]
        self._writer.add_message(self._channel_ids[channel], log_time, data, publish_time, sequence)
        self._saved[channel] += 1
        self._first_time = min(self._first_time, log_time)
        self._last_time = max(self._last_time, log_time)

    def _take_other(self, offset: int, record: records.McapRecord | None) -> None:
        if isinstance(record, records.Header):
            self._profile = record.profile
        elif isinstance(record, records.Schema | records.Channel):
            self._define(record, verified=False)
        elif isinstance(record, records.Attachment):
            self._begin()
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        # The metadata of rosbag2 are written again, as their counts change.
        elif isinstance(record, records.Metadata) and record.name != ROSBAG2_METADATA:
            self._begin()
            self._writer.add_metadata(record.name, record.metadata)

    def _define(self, record: records.Schema | records.Channel, verified: bool) -> None:
        """Keep a schema or channel; one that a CRC confirms replaces another one."""
        is_schema = isinstance(record, records.Schema)
        known: dict[int, Any] = self._schemas if is_schema else self._channels
        if record.id not in known or (verified and not known[record.id][1]):
            known[record.id] = record, verified

    def _register(self, channel: int) -> None:
        """Add a channel and its schema to the output."""
        found = self._channels[channel][0]
        if found.schema_id not in self._schema_ids:
            if found.schema_id in self._schemas:
                schema = self._schemas[found.schema_id][0]
                self._schema_ids[found.schema_id] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            else:
                self._damages.append(f"the type of {found.topic}: its definition is missing")
                self._schema_ids[found.schema_id] = 0
        self._channel_ids[channel] = self._writer.register_channel(
            found.topic, found.message_encoding, self._schema_ids[found.schema_id], found.metadata
        )

    def _begin(self) -> None:
        """Begin the output once; its first record needs the profile."""
        if not self._begun:
            self._begun = True
            if not self._profile:
                ros = any(schema.encoding == "ros2msg" for schema, _ in self._schemas.values())
                self._profile = "ros2" if ros else ""
            self._writer.start(self._profile, LIBRARY)

    def _finish(self) -> Recovery:
        self._begin()
        for channel in self._channels:
            if channel not in self._channel_ids:
                self._register(channel)
        if self._statistics is not None:
            counts = Counter(self._statistics.channel_message_counts)
            self._lost = counts - self._saved
        saved = {channel.topic: 0 for channel, _ in self._channels.values()}
        for id_, count in self._saved.items():
            saved[self._channels[id_][0].topic] += count
        lost: Counter[str] = Counter()
        for id_, count in self._lost.items():
            known = id_ in self._channels
            lost[self._channels[id_][0].topic if known else f"unknown channel {id_}"] += count
        if self._profile == "ros2":
            self._writer.add_metadata(ROSBAG2_METADATA, self._rosbag2_metadata())
        self._writer.add_metadata(
            RECOVERY_METADATA,
            {
                "source": self._source.path.name,
                "messages_saved": str(sum(saved.values())),
                "messages_known_lost": str(sum(lost.values())),
                "damages": "\n".join(self._damages),
            },
        )
        self._writer.finish()  # type: ignore[no-untyped-call]
        return Recovery(self._output, saved, dict(lost), tuple(self._damages))

    def _rosbag2_metadata(self) -> dict[str, str]:
        topics = []
        for channel, _ in self._channels.values():
            schema = self._schemas.get(channel.schema_id)
            topics.append(
                Topic(
                    channel.topic,
                    schema[0].name if schema else "",
                    "",  # the metadata have no definitions
                    channel.metadata.get("topic_type_hash", ""),
                    channel.metadata.get("offered_qos_profiles", ""),
                )
            )
        counts = [self._saved[id_] for id_ in self._channels]
        first = min(self._first_time, self._last_time)
        return rosbag2_metadata(self._output, topics, counts, first, self._last_time)


def _split(records: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the opcode and content of each record up to the first incomplete one."""
    offset = 0
    while offset + RECORD.size <= len(records):
        opcode, length = RECORD.unpack_from(records, offset)
        start = offset + RECORD.size
        offset = start + length
        if offset > len(records):
            return
        yield opcode, records[start:offset]


def _parse(opcode: int, body: bytes, longer: bool = False) -> records.McapRecord | None:
    """Return a record, or None unless it gives the same bytes when it is written again.

    With ``longer``, a few unknown bytes may follow. If there are many, its length is damaged, or it
    is a record of another kind whose opcode is damaged.
    """
    try:
        record: records.McapRecord = _RECORDS[opcode].read(ReadDataStream(io.BytesIO(body)))
        builder = RecordBuilder()
        record.write(builder)
        written = builder.end()[RECORD.size :]  # type: ignore[no-untyped-call]
    except (KeyError, ValueError, struct.error, McapError):
        return None
    # The CRC of an attachment is optional.
    if opcode == Opcode.ATTACHMENT and body.endswith(bytes(4)):
        written = written[:-4] + bytes(4)
    unknown = len(body) - len(written)
    same = body.startswith(written) and unknown <= (_MOST_UNKNOWN if longer else 0)
    return record if same else None


def _decompressed(compression: bytes, data: memoryview) -> bytes:
    """Return the records of a chunk, as far as they can be decompressed."""
    if compression == b"zstd":
        pieces: list[bytes] = []
        with (
            contextlib.suppress(zstandard.ZstdError),
            zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader,
        ):
            while len(pieces) < LONGEST_RECORD // _BLOCK and (piece := reader.read(_BLOCK)):
                pieces.append(piece)
        return b"".join(pieces)
    if compression == b"lz4":
        found = b""
        with contextlib.suppress(RuntimeError):
            while data and len(found) < LONGEST_RECORD:
                frame = lz4.frame.LZ4FrameDecompressor()
                found += frame.decompress(data, LONGEST_RECORD - len(found))
                data = memoryview(frame.unused_data or b"")
        return found
    return b"" if compression else bytes(data)
