# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves the readable part of an incomplete or damaged MCAP file.

Own code because the reader of mcap stops at the first damaged record (`python -m
benchmark.libraries`). Behind damage, reading continues at the next chunk or index of one, so that
messages outside of chunks are saved up to the first damage.
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
from typing import Any, BinaryIO

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
_DATA_END = RECORD.pack(Opcode.DATA_END, 4)  # a CRC and the summary follow
_TAIL = 2**24  # bytes at the end in which the summary is sought
_MOST_UNKNOWN = 64  # bytes at the end of a record, of fields of a later version of MCAP
# With a length below 4 GiB; or the end of a file.
_LIKELY_RECORD = re.compile(rb"[\x01-\x0f].{4}\0{4}|" + re.escape(MAGIC), re.DOTALL)
# Schemas, channels and statistics; a lookahead, as a false match may overlap the next one.
_SUMMARISED = re.compile(rb"(?=[\x03\x04\x0b].{4}\0{4})", re.DOTALL)
_BEGINNING = MAGIC + bytes([Opcode.HEADER])
_RESUMES = re.compile(rb"(?=[\x06\x07].{4}\0{4}|" + re.escape(_BEGINNING) + b")", re.DOTALL)


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
    """Write the readable part of an MCAP file to a new one, or raise a `RecoveryError`."""
    try:
        refuse_pipe(source)
        file = source.open("rb", buffering=_BLOCK)
    except OSError as error:
        raise RecoveryError(f"{source} cannot be read: {error.strerror}; give a file.") from None
    bar = shown_bar(source, source.stat().st_size)
    whole = replacement(output, RecoveryError, new_only=True)
    with file, bar as shown, whole as new, new.open("wb") as stream:
        rescue = _Rescue(source, file, stream)
        rescue.scan(shown.update)
        return rescue.finish(output)


def recovery_text(recovery: Recovery) -> str:
    """Return a text with the saved and lost messages of each topic, and the damaged places."""
    topics = sorted(recovery.saved.keys() | recovery.lost.keys())
    lines = [f"{recovery.path}: {sum(recovery.saved.values())} messages saved."]
    for topic in topics:
        lost = f", {recovery.lost[topic]} lost" if topic in recovery.lost else ""
        lines.append(f"  {printable(topic)}: {recovery.saved.get(topic, 0)}{lost}")
    if recovery.damages:
        lines.append("Damaged places of the old file:")
        lines += [f"  {damage}" for damage in recovery.damages[:_DAMAGES_SHOWN]]
        if (more := len(recovery.damages) - _DAMAGES_SHOWN) > 0:
            lines.append(f"  and {more} more")
    else:
        lines.append("The old file is complete and undamaged.")
    return "\n".join(lines)


class _Rescue:
    """A recovery in progress, of the records between the magic numbers that are intact."""

    def __init__(self, path: Path, file: BinaryIO, stream: BinaryIO) -> None:
        self._path, self._file, self._stream = path, file, stream
        size = file.seek(0, os.SEEK_END)
        if size == 0:
            problem = f"{path} is empty, as its recording ended before anything was written."
            raise RecoveryError(problem)
        self._start = len(MAGIC) if self._read(0, len(MAGIC)) == MAGIC else 0
        ends = size > self._start and self._read(size - len(MAGIC), len(MAGIC)) == MAGIC
        self._complete, self._end = ends, size - len(MAGIC) * ends
        # The definitions that were read, and whether a CRC confirms each.
        self._definitions: dict[tuple[type, int], tuple[bool, _Definition]] = {}
        # What the output defines: topics by channels, and schemas.
        self._topics: dict[int, str] = {}
        self._schemas: set[int] = set()
        self._output: McapFile | None = None
        self._profile = ""
        # Records of messages that are not yet in a chunk of the output.
        self._loose: list[bytes] = []
        self._loose_bytes = 0
        # Messages of channels: that the file states, and that no definition describes.
        self._stated, self._undefined = Counter[int](), Counter[int]()
        self._statistics: records.Statistics | None = None
        self._chunked = False
        self._damages: list[str] = []
        self._rest = 0

    def _read(self, offset: int, count: int) -> bytes:
        """Return bytes from an offset, fewer at the end of the file."""
        try:
            self._file.seek(offset)
            return self._file.read(count)
        except OSError as error:
            problem = f"{self._path} cannot be read at byte {offset}: {error.strerror}"
            hint = "copy it with `ddrescue` first if its disk fails"
            raise RecoveryError(f"{problem}; {hint}.") from None

    def scan(self, progress: Callable[[int], object]) -> None:
        """Save the intact records, and resume behind damage."""
        self._read_summary()  # first, as it may have the only intact definitions
        if not self._start:
            self._damages.append("byte 0: the magic number")
        offset = self._start
        while offset < self._end:
            # The file before another one may have an end.
            other = self._read(offset, len(MAGIC + _BEGINNING)).find(_BEGINNING)
            if other >= 0:  # Its definitions may have the numbers of other ones.
                self._rest = offset + other
                self._damages.append(str(JoinedError(self._path, self._rest)))
                break
            end, damage = self._take(offset)
            if damage:
                end = self._resume_at(offset + 1)
                lost = "and the rest of the file" if end == self._end else f"{end - offset} bytes"
                self._damages.append(f"byte {offset}: {damage}, {lost}")
            end = min(end, self._end)
            progress(end - offset)
            offset = end
        if not (self._complete or self._rest):
            self._damages.append(f"byte {self._end}: the end is missing")
        if not (self._output or self._definitions):
            remedy = self._damages[-1] if self._rest else "give an MCAP file"
            remedy = repair(self._path) or remedy
            raise RecoveryError(f"{self._path} has no readable record; {remedy}.")

    def _read_summary(self) -> None:
        """Take the definitions of the summary of a complete file, and its statistics with a CRC."""
        end = self._end - RECORD.size - FOOTER.size
        tail = max(end - _TAIL, 0)
        found = self._read(tail, max(end - tail, 0)).rfind(_DATA_END)
        if not self._complete or found < 0:
            return
        begin, footer = tail + found + len(_DATA_END) + 4, self._read(end, self._end - end)
        # Behind the beginning of another file, the summary is that of this other one.
        ahead = begin - int.from_bytes(footer[RECORD.size : RECORD.size + 8], "little")
        if ahead > 0 and self._read(ahead, len(_BEGINNING)) == _BEGINNING:
            return
        summary = self._read(begin, end - begin)
        # The CRC covers the footer as well, up to the CRC itself.
        crc = zlib.crc32(footer[:-4], zlib.crc32(summary))
        confirmed = crc == int.from_bytes(footer[-4:], "little")
        for match in _SUMMARISED.finditer(summary):
            opcode, length = RECORD.unpack_from(summary, match.start())
            body = summary[match.start() + RECORD.size :][:length]
            if len(body) == length and (confirmed or opcode != Opcode.STATISTICS):
                self._take_other(_parse(opcode, body), confirmed)

    def _resume_at(self, offset: int) -> int:
        """Return the offset at which reading resumes behind damage, or the end of the file."""
        while offset < self._end:
            try:  # A file system need not store the zeros of a hole.
                offset = self._file.seek(offset, os.SEEK_DATA)
            except OSError as error:
                if error.errno == errno.ENXIO:
                    break
            block = self._read(offset, _BLOCK)
            for match in _RESUMES.finditer(block):
                if self._is_sound(offset + match.start()):
                    return offset + match.start()
            offset += max(len(block) - len(_BEGINNING) + 1, 1)
        return self._end

    def _is_sound(self, offset: int) -> bool:
        """Return whether the fields of a chunk or an index give the length that its head has."""
        head = self._read(offset, RECORD.size + CHUNK.size + 16)
        opcode, length = RECORD.unpack(head[: RECORD.size].ljust(RECORD.size, b"\0"))
        fields = head[RECORD.size :].ljust(CHUNK.size, b"\0")
        if opcode == Opcode.MESSAGE_INDEX:
            return bool(length == MESSAGE_INDEX.size + MESSAGE_INDEX.unpack_from(fields)[1])
        before = CHUNK.size + CHUNK.unpack_from(fields)[-1] + 8
        data = int.from_bytes(fields[before - 8 : before], "little")
        return bool(opcode != Opcode.CHUNK or length == before + data)

    def _take(self, offset: int) -> tuple[int, str]:
        """Save the record at an offset; return its end and its damage; a last chunk may be cut."""
        head = self._read(offset, RECORD.size).ljust(RECORD.size, b"\0")
        opcode, length = RECORD.unpack(head)
        end = offset + RECORD.size + length
        beyond = end > self._end and (self._complete or opcode != Opcode.CHUNK)
        if beyond or length > LONGEST_RECORD or not self._is_sound(offset):
            return end, "a record"
        body = self._read(offset + RECORD.size, length)
        if opcode == Opcode.CHUNK:
            return end, self._take_chunk(body, offset, end > self._end)
        # Only the next record confirms the length of one without a CRC.
        behind = self._read(end, min(RECORD.size, self._end - end))
        if behind and not _LIKELY_RECORD.match(behind.ljust(RECORD.size, b"\0")):
            return end, "a record"
        if opcode == Opcode.MESSAGE_INDEX:
            channel, size = MESSAGE_INDEX.unpack_from(body)
            self._stated[channel] += size // 16
        elif opcode == Opcode.MESSAGE and not self._chunked and length >= MESSAGE.size:
            self._take_message(head + body)
        elif (record := _parse(opcode, body)) is None:
            # If there are chunks, all messages are in them, and another one is a damaged index.
            return end, "a record"
        elif opcode != Opcode.STATISTICS:
            self._take_other(record, False)
        return end, ""

    def _take_chunk(self, body: bytes, offset: int, cut: bool) -> str:
        """Save what is in a chunk, whose end may be cut; return what is damaged."""
        self._chunked = True
        *_, size, crc, name_length = CHUNK.unpack_from(body)
        stored = CHUNK.size + name_length + 8
        name = body[CHUNK.size : stored - 8]
        if name not in KNOWN_COMPRESSIONS:
            return f"a chunk of the unknown compression {name.decode(errors='replace')!r}"
        content = decompressed(name, body[stored:], min(size, LONGEST_RECORD))
        parts = list(split_records(content))
        # Without a CRC, the records have to end where the chunk does.
        last = parts[-1][-1] if parts else 0
        intact = len(content) == size and (zlib.crc32(content) == crc if crc else last == size)
        if not intact:
            # The end of the file may cut it off; or its bytes are missing, and others are in it.
            if not cut or self._resume_at(offset + 1) < self._end:
                return "a chunk"
            self._damages.append(f"byte {offset}: a chunk that the end of the file cuts off")
        for opcode, start, stop in parts:
            if opcode == Opcode.MESSAGE and stop - start >= MESSAGE.size:
                self._take_message(content[start - RECORD.size : stop])
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take_other(_parse(opcode, content[start:stop]), intact and crc > 0)
        return ""

    def _take_message(self, record: bytes) -> None:
        """Keep a message for the next chunk of the output."""
        channel = int.from_bytes(record[RECORD.size : RECORD.size + 2], "little")
        if (records.Channel, channel) not in self._definitions:
            self._undefined[channel] += 1
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
            if key not in self._definitions or confirmed > self._definitions[key][0]:
                self._definitions[key] = confirmed, record
        elif isinstance(record, records.Attachment):
            self._output_file().attach(record)
        elif isinstance(record, records.Metadata):
            self._output_file().add_metadata(record.name, record.metadata)

    def _register(self, channel: int) -> None:
        """Define a channel and its schema in the output, unless it has them."""
        if channel in self._topics:
            return
        _, record = self._definitions[records.Channel, channel]
        assert isinstance(record, records.Channel)
        self._topics[channel] = record.topic
        schema = self._definitions.get((records.Schema, record.schema_id))
        if schema is None and record.schema_id:
            self._damages.append(f"the type of {record.topic}: its definition is missing")
            record = replace(record, schema_id=0)
        elif schema is not None and record.schema_id not in self._schemas:
            self._schemas.add(record.schema_id)
            self._output_file().define(schema[1])
        self._output_file().define(record)

    def _output_file(self) -> McapFile:
        """Return the output, which begins with the profile."""
        if self._output is None:
            # If the header is lost, the definitions tell its profile.
            encodings = {getattr(each, "encoding", "") for _, each in self._definitions.values()}
            of_types = "ros2" if encodings & {"ros2msg", "ros2idl"} else ""
            self._output = McapFile(self._stream, self._profile or of_types)
        return self._output

    def finish(self, path: Path) -> Recovery:
        """Complete the output, which will have this path."""
        for kind, number in self._definitions:
            if kind is records.Channel:
                self._register(number)
        self._write_loose()
        file, topics = self._output_file(), self._topics
        if self._statistics is not None:
            self._stated = Counter(self._statistics.channel_message_counts)
        saved, lost = dict.fromkeys(topics.values(), 0), Counter[str]()
        for number, count in file.counts.items():
            saved[topics[number]] += count
        for number, count in ((self._stated - file.counts) | self._undefined).items():
            lost[topics.get(number, f"unknown channel {number}")] += count
        if file.profile == "ros2" and ROSBAG2_METADATA not in file.metadata:
            file.add_metadata(ROSBAG2_METADATA, rosbag2_metadata())
        file.add_metadata(
            RECOVERY_METADATA,
            {
                "source": self._path.name,
                "messages_saved": str(sum(saved.values())),
                "messages_known_lost": str(sum(lost.values())),
                "damages": "\n".join(self._damages),
            },
        )
        file.close()
        return Recovery(path, saved, dict(lost), tuple(self._damages), self._rest)


def _parse(opcode: int, body: bytes) -> records.McapRecord | None:
    """Return a record, or None if writing it again gives other bytes, except a few at its end."""
    try:
        kind: Any = getattr(records, Opcode(opcode).name.title().replace("_", ""))
        record: records.McapRecord = kind.read(ReadDataStream(io.BytesIO(body)))
        builder = RecordBuilder()
        record.write(builder)
        written = builder.end()[RECORD.size :]  # type: ignore[no-untyped-call]
    except (TypeError, ValueError, struct.error, McapError):  # or it is a message
        return None
    if opcode == Opcode.ATTACHMENT and body.endswith(bytes(4)):  # it has no CRC
        written = written[:-4] + bytes(4)
    same = body.startswith(written) and len(body) - len(written) <= _MOST_UNKNOWN
    return record if same else None
