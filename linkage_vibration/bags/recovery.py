# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves the readable part of an incomplete or damaged MCAP file.

Own code because the reader of mcap stops at the first damaged record, and so loses half of a file
of which this saves 87 % (`python -m benchmark.libraries`). An MCAP file is a magic number and
records, each with an opcode, a length and a content. Most messages are in chunk records, which have
a CRC. Every record is checked before its length is used; after a damaged one, reading continues at
the next intact one.
"""

import io
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from linkage_vibration.bags.mcap_file import McapFile, decompressed
from linkage_vibration.bags.mcap_records import (
    CHUNK,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    RECORD,
    split_records,
)
from linkage_vibration.bags.writing import ROSBAG2_METADATA
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.atomic_files import replacement

RECOVERY_METADATA = "linkage_vibration.recovery"  # the name of a record
# A record with a greater length counts as damaged, so that memory is bounded.
LONGEST_RECORD = 2**28

_DAMAGES_SHOWN = 20
_BLOCK = 2**20  # bytes read at a time
_Definition = records.Schema | records.Channel
_FOOTER = struct.Struct("<QQI")  # begins of the summary and of its offsets, CRC
_FOOTER_BYTES = RECORD.size + _FOOTER.size + len(MAGIC)
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
            try:
                self._file.seek(offset)
                self._block = self._file.read(max(count, _BLOCK))
            except OSError as error:
                raise RecoveryError(
                    f"{self.path} cannot be read at byte {offset}: {error.strerror}; copy it with "
                    "`ddrescue` first if its disk fails."
                ) from None
        return self._block[start : start + count]


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
        # The definitions that were read, those of the intact summary, and those in the output.
        self._definitions: dict[tuple[type, int], _Definition] = {}
        self._summarized: set[tuple[type, int]] = set()
        self._written: dict[tuple[type, int], _Definition] = {}
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
        if self._file is None and not self._definitions:
            raise RecoveryError(f"{self._source.path} has no readable record; give an MCAP file.")
        return self._finish()

    def _read_summary(self) -> None:
        """Read definitions and statistics from the end of the file, if it is intact."""
        source, end = self._source, self._source.size - _FOOTER_BYTES
        footer = source.read(max(end, 0), _FOOTER_BYTES)
        if end < 0 or not footer.endswith(MAGIC):
            return
        start, _, checksum = _FOOTER.unpack(footer[RECORD.size : -len(MAGIC)])
        if not max(end - LONGEST_RECORD, 1) <= start <= end:
            return
        # The CRC covers the footer as well, up to the CRC itself.
        summary = source.read(start, end - start)
        if zlib.crc32(footer[: RECORD.size + 16], zlib.crc32(summary)) != checksum:
            return
        for opcode, start, end in split_records(summary):
            wanted = opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS)
            record = _parse(opcode, summary[start:end]) if wanted else None
            if isinstance(record, records.Statistics):
                self._statistics = record
            elif isinstance(record, _Definition):
                self._define(record)
        self._summarized = set(self._definitions)

    def _records(self) -> Iterator[tuple[int, int, bytes, bool]]:
        """Yield offset, opcode, content and incompleteness of the readable records of data."""
        source, offset = self._source, len(MAGIC)
        if source.read(0, offset) != MAGIC:
            self._damages.append("byte 0: the magic number")
            offset = self._resume_at(0)
        while offset < source.size:
            end = self._end_of_sound(offset)
            if end is None:
                end = self._resume_at(offset + 1)
                what = "the rest of the file" if end == source.size else f"{end - offset} bytes"
                self._damages.append(f"byte {offset}: {what}")
            else:
                opcode, _ = self._head(offset)
                if opcode in _AFTER_DATA:
                    if source.read(source.size - len(MAGIC), len(MAGIC)) != MAGIC:
                        self._damages.append(f"byte {source.size}: the end is missing")
                    break
                start, cut = offset + RECORD.size, end > source.size
                end = min(end, source.size)
                yield offset, opcode, source.read(start, end - start), cut
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
        """Return the end of a record if its content agrees with its length.

        Only a chunk may end behind the end of the file.
        """
        source = self._source
        opcode, length = self._head(offset)
        start = offset + RECORD.size
        end = start + length
        if length > LONGEST_RECORD:
            return None
        if opcode == Opcode.CHUNK:
            sound = self._chunk_length(start) == length
        elif end > source.size:
            sound = False
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
            # An index without its chunk still counts the messages of the chunk.
            if self._chunk.pop(channel, None) != size // 16:
                self._lost[channel] += size // 16
        else:
            self._take_other(_parse(opcode, body, longer=True))

    def _take_chunk(self, offset: int, body: bytes, cut: bool) -> None:
        self._chunked = True
        self._chunk.clear()
        *_, size, crc, name_length = CHUNK.unpack_from(body)
        name, stored = body[CHUNK.size :][:name_length], body[CHUNK.size + name_length + 8 :]
        content = decompressed(name, stored, min(size, LONGEST_RECORD))
        if cut:
            self._damages.append(f"byte {offset}: a chunk that the end of the file cuts off")
        elif len(content) != size or crc not in (0, zlib.crc32(content)):
            self._damages.append(f"byte {offset}: a chunk of {len(body)} bytes")
            return
        messages = []
        for opcode, start, end in split_records(content):
            if opcode == Opcode.MESSAGE and end - start >= MESSAGE.size:
                messages.append(content[start - RECORD.size : end])
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take_other(_parse(opcode, content[start:end], longer=True))
        for message in messages:
            self._take_message(message)

    def _take_message(self, record: bytes) -> None:
        """Keep a message for the next chunk of the output."""
        channel = int.from_bytes(record[RECORD.size : RECORD.size + 2], "little")
        self._chunk[channel] += 1
        if (records.Channel, channel) not in self._definitions:
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

    def _take_other(self, record: records.McapRecord | None) -> None:
        if isinstance(record, records.Header):
            self._profile = record.profile
        elif isinstance(record, _Definition):
            self._define(record)
        elif isinstance(record, records.Attachment):
            self._output_file().attach(record)
        # The metadata of rosbag2 are written again, as their counts change.
        elif isinstance(record, records.Metadata) and record.name != ROSBAG2_METADATA:
            self._output_file().add_metadata(record.name, record.metadata)

    def _define(self, record: _Definition) -> None:
        """Keep a schema or channel; the last one before its first use counts.

        It is mostly in a chunk, whose CRC confirms it, as that of the summary does.
        """
        key = type(record), record.id
        if key not in self._written and key not in self._summarized:
            self._definitions[key] = record

    def _register(self, channel: int) -> None:
        """Define a channel and its schema in the output, unless it has them."""
        if (records.Channel, channel) in self._written:
            return
        record = self._definitions[records.Channel, channel]
        assert isinstance(record, records.Channel)
        schema = self._definitions.get((records.Schema, record.schema_id))
        if schema is not None:
            self._write(schema)
        elif record.schema_id:
            self._damages.append(f"the type of {record.topic}: its definition is missing")
            record = replace(record, schema_id=0)
        self._write(record)

    def _write(self, record: _Definition) -> None:
        """Write a definition to the output, unless it has it."""
        if (type(record), record.id) not in self._written:
            self._written[type(record), record.id] = record
            self._output_file().define(record)

    def _output_file(self) -> McapFile:
        """Return the output, which begins with the profile."""
        if self._file is None:
            if not self._profile:
                schemas = [
                    each for each in self._definitions.values() if type(each) is records.Schema
                ]
                ros = any(schema.encoding == "ros2msg" for schema in schemas)
                self._profile = "ros2" if ros else ""
            self._file = McapFile(self._stream, self._profile)
        return self._file

    def _finish(self) -> Recovery:
        for kind, number in list(self._definitions):
            if kind is records.Channel:
                self._register(number)
        self._write_loose()
        file = self._output_file()
        if self._statistics is not None:
            counts = Counter(self._statistics.channel_message_counts)
            self._lost = counts - file.counts
        topics = {
            number: record.topic
            for (_, number), record in self._written.items()
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
