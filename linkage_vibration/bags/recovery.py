# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves the readable part of an incomplete or damaged MCAP file.

Own code because the reader of mcap stops at the first damaged record, and so loses half of a file
of which this saves 87 % (`python -m benchmark.libraries`). An MCAP file is a magic number and
records, each with an opcode, a length and a content. Most messages are in chunk records, which have
a CRC. Every record is checked before its length is used; after a damaged one, reading continues at
the next intact one. An intact chunk is copied as it is stored, and only its indexes are written
again.
"""

import io
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from linkage_vibration.bags.mcap_file import Compressed, McapFile, decompressed, message_heads
from linkage_vibration.bags.mcap_records import CHUNK, MAGIC, MESSAGE, MESSAGE_INDEX, RECORD
from linkage_vibration.bags.writing import ROSBAG2_METADATA
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
    """Write the readable part of an MCAP file to a new and complete one, which must not exist.

    Messages keep their times and their order; schemas, channels, attachments and metadata are kept
    too. A chunk with a wrong CRC is lost. Of a chunk that the end of the file cuts off, everything
    that can be decompressed is kept. ``progress`` is called with the number of bytes that were read
    since its last call. A `RecoveryError` is raised if there is nothing to save or no place for it.
    """
    if os.path.lexists(output):
        raise RecoveryError(f"{output} exists already; choose another name.")
    try:
        file = source.open("rb")
    except OSError as error:
        raise RecoveryError(f"{source} cannot be read: {error.strerror}; check it.") from None
    with file, replacement(output, RecoveryError) as new, new.open("wb") as stream:
        return _Rescue(_Source(source, file), output, stream, progress).run()


def recovery_text(recovery: Recovery) -> str:
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
        self._stream = stream
        self._progress = progress
        self._file: McapFile | None = None
        self._profile: str | None = None
        # By their ids: the definition, and whether a CRC confirms it.
        self._schemas: dict[int, tuple[records.Schema, bool]] = {}
        self._channels: dict[int, tuple[records.Channel, bool]] = {}
        # The definitions in the output, by kind and id.
        self._defined: dict[tuple[type, int], records.Schema | records.Channel] = {}
        # Records of messages that are not yet in a chunk of the output.
        self._loose: list[bytes] = []
        self._loose_bytes = 0
        self._lost: Counter[int] = Counter()
        self._statistics: records.Statistics | None = None
        self._chunked = False
        # Messages of the last chunk that no index has counted yet.
        self._chunk: Counter[int] = Counter()
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
        if self._file is None and not self._channels:
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
        closing = _parse(Opcode.FOOTER, footer[RECORD.size : -len(MAGIC)])
        end = size - _FOOTER_BYTES
        if not isinstance(closing, records.Footer) or not 0 < closing.summary_start <= end:
            return
        if end - closing.summary_start > LONGEST_RECORD:
            return
        # The CRC covers the footer as well, up to the CRC itself.
        summary = self._source.read(closing.summary_start, end - closing.summary_start)
        if zlib.crc32(footer[: RECORD.size + 16], zlib.crc32(summary)) != closing.summary_crc:
            return
        for opcode, body in _split(summary):
            wanted = opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS)
            record = _parse(opcode, body) if wanted else None
            if isinstance(record, records.Schema | records.Channel):
                self._define(record, verified=True)
            elif isinstance(record, records.Statistics):
                self._statistics = record

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
            self._take_message(RECORD.pack(opcode, len(body)) + body)
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
        name, stored = body[CHUNK.size :][:name_length], body[CHUNK.size + name_length + 8 :]
        whole = None if cut else _whole(name, stored, size)
        content = decompressed(name, stored, LONGEST_RECORD) if whole is None else whole
        checksum = zlib.crc32(content)
        if not cut and (len(content) != size if crc == 0 else checksum != crc):
            self._damages.append(f"byte {offset}: a chunk of {len(body)} bytes")
            return
        if cut:
            self._damages.append(f"byte {offset}: a chunk that the end of the file cuts off")
        begins, others, end = _messages_and_others(content)
        definitions = [_parse(opcode, other, longer=True) for opcode, other in others]
        for record in definitions:
            if isinstance(record, records.Schema | records.Channel):
                self._define(record, verified=not cut and crc != 0)
        if not begins:
            return
        places = np.array(begins)
        numbers = Counter(message_heads(content, places)["channel"].tolist())
        readable = whole is not None and end == len(content)
        if readable and self._agrees(numbers, definitions):
            self._write_loose()
            self._output_file().add_chunk(content, places, Compressed(name, stored, checksum))
            self._chunk.update(numbers)
            return
        for begin in begins:
            _, length = RECORD.unpack_from(content, begin)
            self._take_message(content[begin : begin + RECORD.size + length])

    def _agrees(
        self, channels: Iterable[int], definitions: Iterable[records.McapRecord | None]
    ) -> bool:
        """Return whether the output can define what a chunk with these channels needs."""
        if not self._channels.keys() >= set(channels):
            return False
        for channel in channels:
            self._register(channel)
        return all(self._is_defined(record) for record in definitions)

    def _is_defined(self, record: records.McapRecord | None) -> bool:
        """Return whether a record is a definition that the output has; it gets a new one."""
        if isinstance(record, records.Channel):
            self._register(record.id)
        elif isinstance(record, records.Schema) and record.id:
            self._register_schema(record.id)
        else:
            return False
        return self._defined[type(record), record.id] == record

    def _take_message(self, record: bytes) -> None:
        """Keep a message for the next chunk of the output."""
        channel = int.from_bytes(record[RECORD.size : RECORD.size + 2], "little")
        self._chunk[channel] += 1
        if channel not in self._channels:
            self._lost[channel] += 1
            return
        self._register(channel)
        self._loose.append(record)
        self._loose_bytes += len(record)
        if self._loose_bytes >= _BLOCK:
            self._write_loose()

    def _write_loose(self) -> None:
        """Write the messages that are kept to a chunk of their own."""
        if self._loose:
            lengths = np.array([len(record) for record in self._loose])
            begins = np.cumsum(lengths) - lengths
            self._output_file().add_chunk(b"".join(self._loose), begins)
            self._loose, self._loose_bytes = [], 0

    def _take_other(self, offset: int, record: records.McapRecord | None) -> None:
        if isinstance(record, records.Header):
            self._profile = record.profile
        elif isinstance(record, records.Schema | records.Channel):
            self._define(record, verified=False)
        elif isinstance(record, records.Attachment):
            self._output_file().attach(record)
        # The metadata of rosbag2 are written again, as their counts change.
        elif isinstance(record, records.Metadata) and record.name != ROSBAG2_METADATA:
            self._output_file().add_metadata(record.name, record.metadata)

    def _define(self, record: records.Schema | records.Channel, verified: bool) -> None:
        """Keep a schema or channel; one that a CRC confirms replaces another one."""
        is_schema = isinstance(record, records.Schema)
        definitions: dict[int, Any] = self._schemas if is_schema else self._channels
        if record.id not in definitions or (verified and not definitions[record.id][1]):
            definitions[record.id] = record, verified

    def _register(self, channel: int) -> None:
        """Define a channel and its schema in the output, unless it has them."""
        if (records.Channel, channel) in self._defined:
            return
        record = self._channels[channel][0]
        if record.schema_id and record.schema_id in self._schemas:
            self._register_schema(record.schema_id)
        elif record.schema_id:
            self._damages.append(f"the type of {record.topic}: its definition is missing")
            record = replace(record, schema_id=0)
        self._defined[records.Channel, channel] = record
        self._output_file().define(record)

    def _register_schema(self, number: int) -> None:
        if (records.Schema, number) not in self._defined:
            schema = self._schemas[number][0]
            self._defined[records.Schema, number] = schema
            self._output_file().define(schema)

    def _output_file(self) -> McapFile:
        """Return the output, which begins with the profile."""
        if self._file is None:
            if not self._profile:
                ros = any(schema.encoding == "ros2msg" for schema, _ in self._schemas.values())
                self._profile = "ros2" if ros else ""
            self._file = McapFile(self._stream, self._profile)
        return self._file

    def _finish(self) -> Recovery:
        for channel in self._channels:
            self._register(channel)
        self._write_loose()
        file = self._output_file()
        if self._statistics is not None:
            counts = Counter(self._statistics.channel_message_counts)
            self._lost = counts - file.counts
        topics = {
            number: record.topic
            for (_, number), record in self._defined.items()
            if isinstance(record, records.Channel)
        }
        saved, lost = dict.fromkeys(topics.values(), 0), Counter[str]()
        for number, count in file.counts.items():
            saved[topics[number]] += count
        for number, count in self._lost.items():
            lost[topics.get(number, f"unknown channel {number}")] += count
        if self._profile == "ros2":
            file.add_rosbag2_metadata(self._output)
        file.add_metadata(
            RECOVERY_METADATA,
            {
                "source": self._source.path.name,
                "messages_saved": str(sum(saved.values())),
                "messages_known_lost": str(sum(lost.values())),
                "damages": "\n".join(self._damages),
            },
        )
        file.close()
        return Recovery(self._output, saved, dict(lost), tuple(self._damages))


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


def _messages_and_others(content: bytes) -> tuple[list[int], list[tuple[int, bytes]], int]:
    """Return the positions of the messages of a chunk, its other records, and the end of all.

    The end is that of the last complete record.
    """
    begins, others, position = [], [], 0
    # Names within the function are faster, and a chunk may have thousands of messages.
    size, head, message, shortest = len(content), RECORD.size, int(Opcode.MESSAGE), MESSAGE.size
    unpack = RECORD.unpack_from
    while position + head <= size:
        opcode, length = unpack(content, position)
        after = position + head + length
        if after > size:
            break
        if opcode == message and length >= shortest:
            begins.append(position)
        else:
            others.append((opcode, content[position + head : after]))
        position = after
    return begins, others, position


def _whole(compression: bytes, data: bytes, size: int) -> bytes | None:
    """Return the records of a chunk that every reader decompresses to this size, or None."""
    if size > LONGEST_RECORD:
        return None
    content, used = data, len(data)
    try:
        if compression == b"zstd":
            if zstandard.frame_content_size(data) not in (-1, size):
                return None
            reader = zstandard.ZstdDecompressor()
            content = reader.decompress(data, max_output_size=size, allow_extra_data=False)
        elif compression == b"lz4":
            if lz4.frame.get_frame_info(data)["content_size"] not in (0, size):
                return None
            content, used = lz4.frame.decompress(data, return_bytes_read=True)
    except (zstandard.ZstdError, RuntimeError):
        return None
    supported = compression in (b"", b"lz4", b"zstd")
    return content if supported and len(content) == size and used == len(data) else None
