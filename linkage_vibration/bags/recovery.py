# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Saves what is readable of an MCAP file that was cut short or damaged.

An MCAP file is a magic number and records, each with an opcode, its length and its content. Most
messages stand inside chunk records, which carry a CRC. Here every record is checked before its
length is believed, and where one is damaged, reading goes on at the next one that is sound.
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

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER, Writer

from linkage_vibration.bags.mcap_records import CHUNK, MAGIC, MESSAGE, MESSAGE_INDEX, RECORD
from linkage_vibration.bags.writing import ROSBAG2_METADATA, Topic, rosbag2_metadata
from linkage_vibration.errors import LinkageVibrationError

RECOVERY_METADATA = "linkage_vibration.recovery"  # the name of a record
# What says that it is longer is taken for damaged, so that memory stays bounded.
LONGEST_RECORD = 2**28

_DAMAGES_TOLD = 20
_BLOCK = 2**20  # bytes read at a time
_INDEX_ENTRY_BYTES = 16
_FOOTER_BYTES = RECORD.size + 20 + len(MAGIC)
# An opcode and a length below 4 GiB; a lookahead, as what looks like one may overlap the true one.
_LIKELY_RECORD = re.compile(rb"(?=[\x01-\x0f].{4}\0{4})", re.DOTALL)
_RECORDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}
_AFTER_DATA = (
    DataEnd,
    Footer,
    Statistics,
    ChunkIndex,
    AttachmentIndex,
    MetadataIndex,
    SummaryOffset,
)


class RecoveryError(LinkageVibrationError):
    """A file could not be recovered."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was saved of a file, and what was not.

    Attributes
    ----------
    path : Path
        The new file.
    saved : dict of str to int
        How many messages it has of each topic.
    lost : dict of str to int
        How many are known to be lost, of the topics that lost any.
    damages : tuple of str
        What is damaged and where, in the order of the file; empty for a file without fault.
    """

    path: Path
    saved: dict[str, int]
    lost: dict[str, int]
    damages: tuple[str, ...]


def recover(
    source: Path, output: Path, progress: Callable[[int], object] = lambda count: None
) -> Recovery:
    """Write what is readable of an MCAP file into a new and complete one.

    Messages are kept with their times and in their order, with schemas, channels, attachments and
    metadata. A chunk whose CRC does not agree is lost; of one that the end of the file cuts off,
    what can be decompressed is kept. The input is only read.

    Parameters
    ----------
    source : Path
        The file to read.
    output : Path
        The file to write; it must not exist.
    progress : callable
        Called with the number of bytes that were read since the last call.

    Returns
    -------
    Recovery
        What was saved.

    Raises
    ------
    RecoveryError
        If the input cannot be read or has nothing to save, or the output cannot be written.
    """
    if os.path.lexists(output):
        raise RecoveryError(f"{output} exists already; choose another name.")
    beside = output.with_name(f".{output.name}.{os.getpid()}.tmp")
    try:
        file = source.open("rb")
    except OSError as error:
        raise RecoveryError(f"{source} cannot be read: {error.strerror}.") from None
    with file:
        try:
            with beside.open("wb") as stream:
                rescue = _Rescue(_Source(source, file), output, stream, progress)
                result = rescue.run()
            beside.replace(output)
        except OSError as error:
            raise RecoveryError(
                f"{output} cannot be written: {error.strerror}; choose another folder."
            ) from None
        finally:
            with contextlib.suppress(OSError):
                beside.unlink()
    return result


def summary(recovery: Recovery) -> str:
    """Return a recovery in words, for a person: what was saved of each topic, and what was not."""
    topics = sorted(recovery.saved.keys() | recovery.lost.keys())
    lines = [f"{recovery.path}: {sum(recovery.saved.values())} messages saved."]
    for topic in topics:
        lost = recovery.lost.get(topic, 0)
        lines.append(
            f"  {topic}: {recovery.saved.get(topic, 0)}" + (f", and {lost} lost" if lost else "")
        )
    if recovery.damages:
        lines.append("Not readable in the old file:")
        lines += [f"  {damage}" for damage in recovery.damages[:_DAMAGES_TOLD]]
        if (more := len(recovery.damages) - _DAMAGES_TOLD) > 0:
            lines.append(f"  and {more} other places")
    else:
        lines.append("The old file is complete and undamaged.")
    return "\n".join(lines)


class _Source:
    """The damaged file: any part of it by its offset, a block in memory at a time."""

    def __init__(self, path: Path, file: io.BufferedReader) -> None:
        self.path = path
        self.size = os.fstat(file.fileno()).st_size
        self._file = file
        self._block = b""
        self._offset = 0

    def read(self, offset: int, count: int) -> bytes:
        """Return so many bytes; fewer at the end of the file."""
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
                f"{self.path} cannot be read at byte {offset}: {error.strerror}; if its disk "
                "fails, copy it with `ddrescue` first."
            ) from None


class _Rescue:
    """One recovery under way."""

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
        # By the input's ids: the definition, and whether a CRC vouches for it.
        self._schemas: dict[int, tuple[Schema, bool]] = {}
        self._channels: dict[int, tuple[Channel, bool]] = {}
        # From the input's ids to the output's.
        self._schema_ids: dict[int, int] = {0: 0}
        self._channel_ids: dict[int, int] = {}
        self._saved: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()
        self._statistics: Statistics | None = None
        self._chunked = False
        self._chunk: Counter[int] = Counter()  # messages of the last chunk that no index told yet
        self._first_time, self._last_time = 2**64, 0
        self._damages: list[str] = []

    def run(self) -> Recovery:
        """Save everything and tell what it was."""
        if self._source.size == 0:
            raise RecoveryError(
                f"{self._source.path} is empty; it was cut off before anything was written."
            )
        self._read_summary()
        for offset, opcode, body, cut in self._records():
            self._take(offset, opcode, body, cut)
        if not self._begun and not self._channels:
            raise RecoveryError(
                f"{self._source.path} has nothing that can be saved; give an MCAP file."
            )
        return self._finish()

    def _read_summary(self) -> None:
        """Take definitions and statistics from the end of the file, where that is intact."""
        size = self._source.size
        if size < _FOOTER_BYTES:
            return
        footer = self._source.read(size - _FOOTER_BYTES, _FOOTER_BYTES)
        if not footer.endswith(MAGIC):
            return
        record = _parse(Opcode.FOOTER, footer[RECORD.size : -len(MAGIC)])
        end = size - _FOOTER_BYTES
        if not isinstance(record, Footer) or not 0 < record.summary_start <= end:
            return
        if end - record.summary_start > LONGEST_RECORD:
            return
        # The CRC covers the footer too, up to itself.
        summary = self._source.read(record.summary_start, end - record.summary_start)
        if zlib.crc32(footer[: RECORD.size + 16], zlib.crc32(summary)) != record.summary_crc:
            return
        for opcode, body in _split(summary):
            found = _parse(opcode, body)
            if isinstance(found, Schema | Channel):
                self._define(found, verified=True)
            elif isinstance(found, Statistics):
                self._statistics = found

    def _records(self) -> Iterator[tuple[int, int, bytes, bool]]:
        """Yield the sound records of the data section: offset, opcode, content, whether cut off."""
        source, offset = self._source, len(MAGIC)
        if source.read(0, offset) != MAGIC:
            self._damages.append("byte 0: the magic number")
            offset = self._resume_at(0)
        while offset < source.size:
            start = offset + RECORD.size
            if (end := self._end_of_sound(offset)) is not None:
                opcode, _ = RECORD.unpack(source.read(offset, RECORD.size))
                if issubclass(_RECORDS.get(opcode, object), _AFTER_DATA):
                    break
                yield offset, opcode, source.read(start, end - start), False
            elif self._is_cut_chunk(offset):
                end = source.size
                yield offset, Opcode.CHUNK, source.read(start, end - start), True
            else:
                end = self._resume_at(offset + 1)
                what = "the rest of the file" if end == source.size else f"{end - offset} bytes"
                self._damages.append(f"byte {offset}: {what}, not readable")
            self._progress(end - offset)
            offset = end
        else:
            self._damages.append(f"byte {source.size}: the end, which is missing")
        self._progress(source.size - offset)

    def _resume_at(self, offset: int) -> int:
        """Return where the next sound record begins, or the file's size."""
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
        """Return where a record ends whose content agrees with its length, or nothing."""
        source = self._source
        header = source.read(offset, RECORD.size)
        if len(header) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(header)
        start = offset + RECORD.size
        end: int = start + length
        if length > LONGEST_RECORD or end > source.size:
            return None
        if opcode == Opcode.CHUNK:
            sound = self._chunk_length(start) == length
        elif opcode == Opcode.MESSAGE:
            # Nothing inside it tells its length; what comes after it does. Where there are chunks,
            # messages stand in them alone, and what looks like another is an index gone wrong.
            sound = not self._chunked and length >= MESSAGE.size and self._is_likely(end)
        elif opcode == Opcode.MESSAGE_INDEX:
            content = source.read(start, MESSAGE_INDEX.size)
            entries = length - MESSAGE_INDEX.size
            sound = entries >= 0 and MESSAGE_INDEX.unpack(content)[1] == entries
        else:
            sound = opcode in _RECORDS and _parse(opcode, source.read(start, length)) is not None
        return end if sound else None

    def _is_likely(self, offset: int) -> bool:
        """Tell whether something like a record, or the file's end, is at an offset."""
        return offset == self._source.size or (
            _LIKELY_RECORD.match(self._source.read(offset, RECORD.size)) is not None
        )

    def _is_cut_chunk(self, offset: int) -> bool:
        header = self._source.read(offset, RECORD.size)
        if len(header) < RECORD.size:
            return False
        opcode, length = RECORD.unpack(header)
        start = offset + RECORD.size
        cut = start + length > self._source.size
        return bool(opcode == Opcode.CHUNK and cut and self._chunk_length(start) == length)

    def _chunk_length(self, start: int) -> int | None:
        """Return how long a chunk's content is by what it says itself."""
        head = self._source.read(start, CHUNK.size + 16)
        if len(head) < CHUNK.size:
            return None
        name_length = CHUNK.unpack_from(head)[-1]
        before = CHUNK.size + name_length + 8
        if len(head) < before:
            return None
        return int(before + int.from_bytes(head[before - 8 : before], "little"))

    def _take(self, offset: int, opcode: int, body: bytes, cut: bool) -> None:
        """Keep what a record has."""
        if opcode == Opcode.CHUNK:
            self._take_chunk(offset, body, cut)
        elif opcode == Opcode.MESSAGE:
            self._take_message(body)
        elif opcode == Opcode.MESSAGE_INDEX:
            channel, size = MESSAGE_INDEX.unpack_from(body)
            count = size // _INDEX_ENTRY_BYTES
            # An index without its chunk still counts what the chunk had.
            if self._chunk.pop(channel, None) != count:
                self._lost[channel] += count
        else:
            self._take_other(offset, _parse(opcode, body))

    def _take_chunk(self, offset: int, body: bytes, cut: bool) -> None:
        self._chunked = True
        self._chunk.clear()
        *_, size, crc, name_length = CHUNK.unpack_from(body)
        compression = body[CHUNK.size : CHUNK.size + name_length]
        data = _decompressed(compression, memoryview(body)[CHUNK.size + name_length + 8 :])
        sound = len(data) == size if crc == 0 else zlib.crc32(data) == crc
        if not sound and not cut:
            self._damages.append(f"byte {offset}: a chunk of {len(body)} bytes, damaged")
            return
        if cut:
            self._damages.append(f"byte {offset}: a chunk, cut off")
        for opcode, content in _split(data):
            if opcode == Opcode.MESSAGE and len(content) >= MESSAGE.size:
                self._take_message(content)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                found = _parse(opcode, content)
                if isinstance(found, Schema | Channel):
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

    def _take_other(self, offset: int, record: McapRecord | None) -> None:
        if isinstance(record, Header):
            self._profile = record.profile
        elif isinstance(record, Schema | Channel):
            self._define(record, verified=False)
        elif isinstance(record, Attachment):
            self._begin()
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        # rosbag2's is made anew: what it counts has changed.
        elif isinstance(record, Metadata) and record.name != ROSBAG2_METADATA:
            self._begin()
            self._writer.add_metadata(record.name, record.metadata)

    def _define(self, record: Schema | Channel, verified: bool) -> None:
        """Learn a schema or channel; one that a CRC vouches for is believed rather than another."""
        known: dict[int, Any] = self._schemas if isinstance(record, Schema) else self._channels
        if record.id not in known or (verified and not known[record.id][1]):
            known[record.id] = record, verified

    def _register(self, channel: int) -> None:
        """Let the output have a channel, and its schema."""
        found = self._channels[channel][0]
        if found.schema_id not in self._schema_ids:
            if found.schema_id in self._schemas:
                schema = self._schemas[found.schema_id][0]
                self._schema_ids[found.schema_id] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            else:
                self._damages.append(f"the definition of what {found.topic} has")
                self._schema_ids[found.schema_id] = 0
        self._channel_ids[channel] = self._writer.register_channel(
            found.topic,
            found.message_encoding,
            self._schema_ids[found.schema_id],
            found.metadata,
        )

    def _begin(self) -> None:
        """Begin the output, once; its first record needs the profile."""
        if not self._begun:
            self._begun = True
            if self._profile is None:
                ros = any(schema.encoding == "ros2msg" for schema, _ in self._schemas.values())
                self._profile = "ros2" if ros else ""
            self._writer.start(self._profile, f"linkage_vibration {LIBRARY_IDENTIFIER}")

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
            lost[self._channels[id_][0].topic if known else f"channel {id_}, unknown"] += count
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
                    schema[0].data.decode(errors="replace") if schema else "",
                    channel.metadata.get("topic_type_hash", ""),
                    channel.metadata.get("offered_qos_profiles", ""),
                )
            )
        counts = [self._saved[id_] for id_ in self._channels]
        first = min(self._first_time, self._last_time)
        return rosbag2_metadata(self._output, topics, counts, first, self._last_time)


def _split(records: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the opcode and content of each record, up to the first that is incomplete."""
    offset = 0
    while offset + RECORD.size <= len(records):
        opcode, length = RECORD.unpack_from(records, offset)
        start = offset + RECORD.size
        offset = start + length
        if offset > len(records):
            return
        yield opcode, records[start:offset]


def _parse(opcode: int, body: bytes) -> McapRecord | None:
    """Return a record, or nothing if it says anything else than its bytes do."""
    try:
        record: McapRecord = _RECORDS[opcode].read(ReadDataStream(io.BytesIO(body)))
        builder = RecordBuilder()
        record.write(builder)
        written = builder.end()[RECORD.size :]  # type: ignore[no-untyped-call]
    except (KeyError, ValueError, struct.error, McapError):
        return None
    # The CRC of an attachment may be left out.
    if opcode == Opcode.ATTACHMENT and body.endswith(bytes(4)):
        written = written[:-4] + bytes(4)
    return record if written == body else None


def _decompressed(compression: bytes, data: memoryview) -> bytes:
    """Return the records of a chunk, as far as they can be decompressed."""
    try:
        if compression == b"zstd":
            return _unpacked_zstd(data)
        if compression == b"lz4":
            return _unpacked_lz4(data)
    except ImportError:
        wheel = "lz4" if compression == b"lz4" else "zstandard"
        raise RecoveryError(
            f"Chunks of this file need {wheel} to be decompressed; `pip install {wheel}`."
        ) from None
    return b"" if compression else bytes(data)


def _unpacked_zstd(data: memoryview) -> bytes:
    import zstandard

    pieces: list[bytes] = []
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            while len(pieces) < LONGEST_RECORD // _BLOCK and (piece := reader.read(_BLOCK)):
                pieces.append(piece)
    except zstandard.ZstdError:
        pass
    return b"".join(pieces)


def _unpacked_lz4(data: memoryview) -> bytes:
    import lz4.frame

    try:
        unpacked = lz4.frame.LZ4FrameDecompressor().decompress(data, LONGEST_RECORD)
    except RuntimeError:
        return b""
    return bytes(unpacked)
