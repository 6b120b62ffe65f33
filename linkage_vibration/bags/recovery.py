# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves the readable part of an incomplete or damaged MCAP file.

Own code because the reader of mcap stops at the first damaged record (`python -m
benchmark.libraries`). Behind damage, reading continues at the next record that nothing else looks
like: a chunk, its index, the end of the data, or the beginning of another file.
"""

import errno
import io
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from linkage_vibration.bags.mcap_file import KNOWN_COMPRESSIONS, McapFile, decompressed
from linkage_vibration.bags.mcap_records import (
    CHUNK,
    FOOTER,
    LONGEST_RECORD,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    RECORD,
    split_records,
)
from linkage_vibration.bags.writing import ROSBAG2_METADATA, rosbag2_metadata
from linkage_vibration.errors import LinkageVibrationError, printable
from linkage_vibration.support.atomic_files import refuse_pipe, replacement
from linkage_vibration.support.progress import shown_bar

RECOVERY_METADATA = "linkage_vibration.recovery"  # the name of a record

_DAMAGES_SHOWN = 20
_BLOCK = 2**20  # bytes read at a time
_Definition = records.Schema | records.Channel
_Key = tuple[type, int]
_RECORDS: dict[int, Any] = {
    opcode: getattr(records, opcode.name.title().replace("_", ""))
    for opcode in Opcode
    if opcode not in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
}
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
_DATA_END = RECORD.pack(Opcode.DATA_END, 4)  # a CRC and the summary follow
_TAIL = 2**24  # bytes at the end in which the summary is sought
_MOST_UNKNOWN = 64  # bytes at the end of a record, of fields of a later version of MCAP
_LIKELY_RECORD = re.compile(rb"[\x01-\x0f].{4}\0{4}", re.DOTALL)  # with a length below 4 GiB
# Schemas, channels and statistics.
_SUMMARISED = re.compile(rb"(?=[\x03\x04\x0b].{4}\0{4})", re.DOTALL)
_BEGINNING = MAGIC + bytes([Opcode.HEADER])
# A lookahead, as a false match may overlap the next one.
_RESUMES = re.compile(
    rb"(?=[\x06\x07].{4}\0{4}|" + re.escape(_DATA_END) + b"|" + re.escape(_BEGINNING) + b")",
    re.DOTALL,
)


class RecoveryError(LinkageVibrationError):
    """A file cannot be recovered."""


# What saves the rest of an incomplete file of another kind.
_REPAIR = {
    ".bag": "try `rosbag reindex {name}`",
    # A page that is cut off would be filled with zeros.
    ".db3": "try `head -c {pages} {name} > cut.db3; sqlite3 cut.db3 .dump "
    "| sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 whole.db3`",
}


def repair(path: Path) -> str:
    """Return what saves the rest of an incomplete bag that is no MCAP file; empty for others."""
    remedy = _REPAIR.get(Path(path.name.removesuffix(".active")).suffix, "")
    pages = path.stat().st_size // 4096 * 4096 if path.exists() else 0
    return remedy.format(name=quote(str(path)), pages=pages)


class JoinedError(ValueError):
    """Another file begins in a file at a byte."""

    def __init__(self, path: Path, at: int) -> None:
        name, end = quote(str(path)), path.suffix
        super().__init__(
            f"another file begins at byte {at}; split them with `head -c {at} {name} > first{end}` "
            f"and `tail -c +{at + 1} {name} > second{end}`"
        )


@dataclass(frozen=True, slots=True)
class Recovery:
    """The saved and the lost part of a file."""

    path: Path  # the new file
    saved: dict[str, int]  # messages of each topic
    lost: dict[str, int]  # known number of lost messages
    damages: tuple[str, ...]  # places, in the order of the file
    rest: int = 0  # byte at which another file begins that is not read; 0 without one


def recover(source: Path, output: Path) -> Recovery:
    """Write the readable part of an MCAP file to a new one, or raise a `RecoveryError`.

    A chunk with a wrong CRC is lost. A bar on a terminal shows the progress.
    """
    try:
        refuse_pipe(source)
        file = source.open("rb", buffering=0)
    except OSError as error:
        raise RecoveryError(f"{source} cannot be read: {error.strerror}; give a file.") from None
    bar = shown_bar(source, source.stat().st_size)
    with (
        file,
        bar as shown,
        replacement(output, RecoveryError, new_only=True) as new,
        new.open("wb") as stream,
    ):
        rescue = _Rescue(_Source(source, file), output, stream, shown.update)
        rescue.scan()
        return rescue.finish()


def recovery_text(recovery: Recovery) -> str:
    """Return a text with the saved and lost messages of each topic, and the damaged places."""
    topics = sorted(recovery.saved.keys() | recovery.lost.keys())
    lines = [f"{recovery.path}: {sum(recovery.saved.values())} messages saved."]
    for topic in topics:
        lost = recovery.lost.get(topic, 0)
        lines.append(
            f"  {printable(topic)}: {recovery.saved.get(topic, 0)}"
            + (f", {lost} lost" if lost else "")
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
    """Reads any part of the damaged file, with one block in memory at a time.

    Its records begin at ``start`` and end at ``end``, without the magic numbers that are intact.
    """

    def __init__(self, path: Path, file: io.FileIO) -> None:
        self.path = path
        self._file = file
        self._block = b""
        self._offset = 0
        size = os.fstat(file.fileno()).st_size
        if size == 0:
            raise RecoveryError(
                f"{path} is empty, as its recording ended before anything was written."
            )
        begun = self.read(0, len(MAGIC)) == MAGIC
        self.start = len(MAGIC) if begun else 0
        self.complete = size > self.start and self.read(size - len(MAGIC), len(MAGIC)) == MAGIC
        self.end = size - len(MAGIC) if self.complete else size

    def next_data(self, offset: int) -> int:
        """Return the next offset behind a hole, whose zeros a file system need not store."""
        try:
            return (
                os.lseek(self._file.fileno(), offset, os.SEEK_DATA) if offset < self.end else offset
            )
        except OSError as error:
            return self.end if error.errno == errno.ENXIO else offset

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
        self.source = source
        # The definitions that were read, and whether a CRC confirms each.
        self.definitions: dict[_Key, tuple[bool, _Definition]] = {}
        # What the output defines: topics by channels, and schemas.
        self._topics: dict[int, str] = {}
        self._schemas: set[int] = set()
        self._output = output
        self._stream = stream
        self._progress = progress
        self._file: McapFile | None = None
        self._profile = ""
        # Records of messages that are not yet in a chunk of the output.
        self._loose: list[bytes] = []
        self._loose_bytes = 0
        self._lost: Counter[int] = Counter()
        self._statistics: records.Statistics | None = None
        self._chunked = False
        # Messages of the last chunk that no index has counted yet.
        self._chunk: Counter[int] = Counter()
        self._damages: list[str] = []
        self._rest = 0

    def scan(self) -> None:
        """Save everything that is readable."""
        self._read_summary()  # first, as it may have the only intact definitions
        self._read_records()
        if not (self._file or self.definitions):
            remedy = repair(self.source.path) or "give an MCAP file"
            raise RecoveryError(f"{self.source.path} has no readable record; {remedy}.")

    def _read_summary(self) -> None:
        """Take the definitions of the summary of a complete file, and its statistics with a CRC."""
        source, end = self.source, self.source.end - RECORD.size - FOOTER.size
        tail = max(end - _TAIL, 0)
        found = source.read(tail, max(end - tail, 0)).rfind(_DATA_END)
        if not source.complete or found < 0:
            return
        begin, footer = tail + found + len(_DATA_END) + 4, source.read(end, source.end - end)
        # Behind the beginning of another file, the summary is that of this other one.
        ahead = begin - int.from_bytes(footer[RECORD.size : RECORD.size + 8], "little")
        if ahead > 0 and source.read(ahead, len(_BEGINNING)) == _BEGINNING:
            return
        summary = source.read(begin, end - begin)
        # The CRC covers the footer as well, up to the CRC itself.
        crc = zlib.crc32(footer[:-4], zlib.crc32(summary))
        confirmed = crc == int.from_bytes(footer[-4:], "little")
        for match in _SUMMARISED.finditer(summary):
            opcode, length = RECORD.unpack_from(summary, match.start())
            body = summary[match.start() + RECORD.size :][:length]
            if len(body) == length and (confirmed or opcode != Opcode.STATISTICS):
                self._take_other(_parse(opcode, body), confirmed)

    def _read_records(self) -> None:
        """Save the intact records, and resume behind damage."""
        source, offset = self.source, self.source.start
        if not offset:
            self._damages.append("byte 0: the magic number")
        while offset < source.end:
            for at in (offset, offset + len(MAGIC)):  # the file before it may have an end
                if source.read(at, len(_BEGINNING)) == _BEGINNING:
                    # Its definitions may have the numbers of other ones.
                    self._damages.append(str(JoinedError(source.path, at)))
                    self._rest = at
                    return
            end, damage = self._take(offset)
            if damage:
                if self._chunk and not self._chunked:
                    damage += " (messages outside of chunks are saved up to the first damage)"
                end = self._resume_at(offset + 1)
                lost = "and the rest of the file" if end == source.end else f"{end - offset} bytes"
                self._damages.append(f"byte {offset}: {damage}, {lost}")
            end = min(end, source.end)
            self._progress(end - offset)
            offset = end
        if not source.complete:
            self._damages.append(f"byte {source.end}: the end is missing")

    def _resume_at(self, offset: int) -> int:
        """Return the offset at which reading resumes behind damage, or the end of the file."""
        source = self.source
        lengths = {
            int(Opcode.CHUNK): self._chunk_length,
            int(Opcode.MESSAGE_INDEX): self._index_length,
        }
        while (offset := source.next_data(offset)) < source.end:
            block = source.read(offset, _BLOCK)
            for match in _RESUMES.finditer(block):
                opcode, length = self._head(at := offset + match.start())
                own_length = lengths.get(opcode)
                if own_length is None or own_length(at) == length:
                    return at
            if len(block) < _BLOCK:
                break
            offset += len(block) - len(_DATA_END) + 1
        return source.end

    def _head(self, offset: int) -> tuple[int, int]:
        """Return the opcode and the length of a record; 0 and 0 if the file ends before them."""
        header = self.source.read(offset, RECORD.size)
        opcode, length = RECORD.unpack(header.ljust(RECORD.size, b"\0"))
        return opcode, length

    def _chunk_length(self, offset: int) -> int:
        """Return the length of a chunk's content that its own fields give."""
        head = self.source.read(offset + RECORD.size, CHUNK.size + 16).ljust(CHUNK.size, b"\0")
        before = CHUNK.size + CHUNK.unpack_from(head)[-1] + 8
        return int(before + int.from_bytes(head[before - 8 : before], "little"))

    def _index_length(self, offset: int) -> int:
        """Return the length of an index that its own fields give."""
        content = self.source.read(offset + RECORD.size, MESSAGE_INDEX.size)
        return int(MESSAGE_INDEX.size + MESSAGE_INDEX.unpack(content.ljust(6, b"\0"))[1])

    def _take(self, offset: int) -> tuple[int, str]:
        """Save the record at an offset; return its end and, if it is damaged, what it is.

        Only a chunk may end behind the end of the file, if that is missing.
        """
        source, (opcode, length) = self.source, self._head(offset)
        end = offset + RECORD.size + length
        beyond = end > source.end and (source.complete or opcode != Opcode.CHUNK)
        if beyond or length > LONGEST_RECORD:
            return end, "a record"
        if opcode == Opcode.CHUNK:
            sound = self._chunk_length(offset) == length
            return end, self._take_chunk(offset, end) if sound else "a chunk"
        # Only the next record confirms the length of one without a CRC.
        head = source.read(end, min(RECORD.size, source.end - end))
        if head and not _LIKELY_RECORD.match(head.ljust(RECORD.size, b"\0")):
            return end, "a record"
        body = source.read(offset + RECORD.size, length)
        if opcode == Opcode.MESSAGE_INDEX:
            if self._index_length(offset) != length:
                return end, "an index"
            channel, size = MESSAGE_INDEX.unpack_from(body)
            # An index without its chunk still counts the messages of the chunk.
            if self._chunk.pop(channel, None) != size // 16:
                self._lost[channel] += size // 16
        elif opcode == Opcode.MESSAGE:
            # If there are chunks, all messages are in them, and this is a damaged index.
            if self._chunked or length < MESSAGE.size:
                return end, "a record"
            self._take_message(RECORD.pack(opcode, length) + body)
        else:
            record = _parse(opcode, body)
            if record is None:
                return end, "a record"
            if opcode != Opcode.STATISTICS:
                self._take_other(record, False)
        return end, ""

    def _take_chunk(self, offset: int, end: int) -> str:
        """Save what is in a chunk; return what is damaged."""
        self._chunked = True
        self._chunk.clear()
        body = self.source.read(offset + RECORD.size, end - offset - RECORD.size)
        *_, size, crc, name_length = CHUNK.unpack_from(body)
        stored = CHUNK.size + name_length + 8
        name = body[CHUNK.size : stored - 8]
        if name not in KNOWN_COMPRESSIONS:
            return f"a chunk of the unknown compression {name.decode(errors='replace')!r}"
        content = decompressed(name, body[stored:], min(size, LONGEST_RECORD))
        parts = list(split_records(content))
        # Without a CRC, the records have to end where the chunk does.
        last = parts[-1][-1] if parts else 0
        intact = len(content) == size == (size if crc else last)
        intact = intact and (not crc or crc == zlib.crc32(content))
        if not intact:
            # The end of the file may cut it off; or its bytes are missing, and others are in it.
            if end <= self.source.end or self._resume_at(offset + 1) < self.source.end:
                return "a chunk"
            self._damages.append(f"byte {offset}: a chunk that the end of the file cuts off")
        messages = []
        for opcode, start, stop in parts:
            if opcode == Opcode.MESSAGE and stop - start >= MESSAGE.size:
                messages.append(content[start - RECORD.size : stop])
            elif opcode in _DEFINITIONS:
                self._take_other(_parse(opcode, content[start:stop]), intact and crc > 0)
        for message in messages:
            self._take_message(message)
        return ""

    def _take_message(self, record: bytes) -> None:
        """Keep a message for the next chunk of the output."""
        channel = int.from_bytes(record[RECORD.size : RECORD.size + 2], "little")
        self._chunk[channel] += 1
        if (records.Channel, channel) not in self.definitions:
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

    def _take_other(self, record: records.McapRecord | None, confirmed: bool) -> None:
        if isinstance(record, records.Header):
            self._profile = record.profile
        elif isinstance(record, records.Statistics):
            self._statistics = record
        elif isinstance(record, _Definition):
            # The first one that a CRC confirms, or else the first one.
            key = type(record), record.id
            if key not in self.definitions or confirmed > self.definitions[key][0]:
                self.definitions[key] = confirmed, record
        elif isinstance(record, records.Attachment):
            self._output_file().attach(record)
        elif isinstance(record, records.Metadata):
            self._output_file().add_metadata(record.name, record.metadata)

    def _register(self, channel: int) -> None:
        """Define a channel and its schema in the output, unless it has them."""
        if channel in self._topics:
            return
        _, record = self.definitions[records.Channel, channel]
        assert isinstance(record, records.Channel)
        self._topics[channel] = record.topic
        schema = self.definitions.get((records.Schema, record.schema_id))
        if schema is None and record.schema_id:
            self._damages.append(f"the type of {record.topic}: its definition is missing")
            record = replace(record, schema_id=0)
        elif schema is not None and record.schema_id not in self._schemas:
            self._schemas.add(record.schema_id)
            self._output_file().define(schema[1])
        self._output_file().define(record)

    def _output_file(self) -> McapFile:
        """Return the output, which begins with the profile."""
        if self._file is None:
            # If the header is lost, the definitions tell its profile.
            encodings = {getattr(each, "encoding", "") for _, each in self.definitions.values()}
            of_types = "ros2" if encodings & {"ros2msg", "ros2idl"} else ""
            self._file = McapFile(self._stream, self._profile or of_types)
        return self._file

    def finish(self) -> Recovery:
        """Complete the output."""
        for kind, number in self.definitions:
            if kind is records.Channel:
                self._register(number)
        self._write_loose()
        file = self._output_file()
        if self._statistics is not None:
            counts = Counter(self._statistics.channel_message_counts)
            self._lost = counts - file.counts
        topics = self._topics
        saved, lost = dict.fromkeys(topics.values(), 0), Counter[str]()
        for number, count in file.counts.items():
            saved[topics[number]] += count
        for number, count in self._lost.items():
            lost[topics.get(number, f"unknown channel {number}")] += count
        if file.profile == "ros2" and ROSBAG2_METADATA not in file.metadata:
            file.add_metadata(ROSBAG2_METADATA, rosbag2_metadata())
        file.add_metadata(
            RECOVERY_METADATA,
            {
                "source": self.source.path.name,
                "messages_saved": str(sum(saved.values())),
                "messages_known_lost": str(sum(lost.values())),
                "damages": "\n".join(self._damages),
            },
        )
        file.close()
        return Recovery(self._output, saved, dict(lost), tuple(self._damages), self._rest)


def _parse(opcode: int, body: bytes) -> records.McapRecord | None:
    """Return a record, or None unless it gives the same bytes when it is written again.

    A few unknown bytes may follow. If there are many, its length is damaged, or it is a record of
    another kind whose opcode is damaged.
    """
    try:
        record: records.McapRecord = _RECORDS[opcode].read(ReadDataStream(io.BytesIO(body)))
        builder = RecordBuilder()
        record.write(builder)
        written = builder.end()[RECORD.size :]  # type: ignore[no-untyped-call]
    except (KeyError, ValueError, struct.error, McapError):
        return None
    if opcode == Opcode.ATTACHMENT and body.endswith(bytes(4)):  # it has no CRC
        written = written[:-4] + bytes(4)
    same = body.startswith(written) and len(body) - len(written) <= _MOST_UNKNOWN
    return record if same else None
