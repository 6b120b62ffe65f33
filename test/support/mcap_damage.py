# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Damages MCAP files in six ways, and finds what stayed intact from the file as it was.

Whoever knows the file as it was knows which of its bytes are preserved, and so which records. The
records are read by mcap, so that nothing here depends on the recovery.
"""

import io
import random
import struct
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.writing import Attachment, Topic

TEXT, FLOAT, COUNT, PER_CHUNK = "float64 data\n", "std_msgs/msg/Float64", 240, 40
TOPICS = [Topic(name, FLOAT, TEXT, "", "") for name in ("/a", "/b")]
Spans = list[tuple[int, int]]
Stored = tuple[str, int, int, bytes]
"""Topic, sequence, log time and data of a message."""
Damage = Callable[[bytes, random.Random], tuple[bytes, Spans]]
"""From a content to the damaged one, and to the spans of the content that are preserved."""


def head_missing(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Delete up to two thirds of a file at its beginning."""
    at = rng.randrange(1, 2 * len(content) // 3)
    return content[at:], [(at, len(content))]


def end_missing(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Delete the end of a file."""
    at = rng.randrange(len(content) // 10, len(content))
    return content[:at], [(0, at)]


def bits_flipped(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Flip one to three bits, often in the head of a record."""
    heads = [offset + k for offset, _, _ in _parts(content) for k in range(9)]
    places = sorted({rng.choice([rng.randrange(len(content)), rng.choice(heads)]) for _ in "12"})
    damaged = bytearray(content)
    for place in places:
        damaged[place] ^= 1 << rng.randrange(8)
    return bytes(damaged), [
        (a + 1, b) for a, b in pairwise([-1, *places, len(content)]) if b > a + 1
    ]


def overwritten(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Replace bytes by zeros or by noise."""
    at, size = rng.randrange(len(content)), rng.choice([1, 9, 100, 2000])
    end = min(at + size, len(content))
    new = rng.choice([bytes(end - at), rng.randbytes(end - at)])
    return content[:at] + new + content[end:], [(0, at), (end, len(content))]


def bytes_missing(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Delete bytes within a file."""
    at, size = rng.randrange(8, len(content)), rng.choice([1, 9, 100, 2000])
    return content[:at] + content[at + size :], [(0, at), (at + size, len(content))]


def bytes_inserted(content: bytes, rng: random.Random) -> tuple[bytes, Spans]:
    """Insert zeros, noise, or bytes from elsewhere in the file."""
    at, size = rng.randrange(8, len(content)), rng.choice([1, 9, 100, 2000])
    other = rng.randrange(len(content))
    new = rng.choice([bytes(size), rng.randbytes(size), content[other : other + size]])
    return content[:at] + new + content[at:], [(0, at), (at, len(content))]


DAMAGES: dict[str, Damage] = {
    "head missing": head_missing,
    "end missing": end_missing,
    "bits flipped": bits_flipped,
    "bytes overwritten": overwritten,
    "bytes missing": bytes_missing,
    "bytes inserted": bytes_inserted,
}


def intact(content: bytes, spans: Spans) -> set[Stored]:
    """Return the messages that are intact, with the definition of their channel.

    A chunk is intact as a whole. A message outside of chunks needs the head of the record behind
    it, which alone confirms its length.
    """
    messages: list[Message] = []
    topics: dict[int, str] = {}
    for offset, end, records in _parts(content):
        loose = isinstance(records[0], Message) if records else False
        if not any(a <= offset and end + 9 * loose <= b for a, b in spans):
            continue
        topics |= {record.id: record.topic for record in records if isinstance(record, Channel)}
        messages += [record for record in records if isinstance(record, Message)]
    return {
        (topics[m.channel_id], m.sequence, m.log_time, m.data)
        for m in messages
        if m.channel_id in topics
    }


def read_messages(path: Path) -> list[Stored]:
    """Return the messages of a complete file in its order."""
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, m.sequence, m.log_time, m.data) for _, channel, m in messages]


def example_logs(folder: Path) -> dict[str, bytes]:
    """Write logs with the package and with mcap, and return their contents by their names."""
    logs = {f"node, {kind}": _by_node(folder, kind, True) for kind in ("zstd", "lz4", "none")}
    logs["node, killed"] = _by_node(folder, "zstd", False)
    for kind in CompressionType:
        logs[f"mcap, {kind.name.lower()}"] = _by_mcap(compression=kind)
    logs["mcap, without CRCs"] = _by_mcap(enable_crcs=False, enable_data_crcs=False)
    logs["mcap, without chunks"] = _by_mcap(use_chunking=False)
    return logs


def _payload(k: int) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", k**0.5)


def _by_node(folder: Path, compression: str, closed: bool) -> bytes:
    path = folder / f"{compression}_{closed}.mcap"
    log = LogWriter(path, TOPICS, [Attachment("x.bin", "x", bytes(range(256)))], compression)
    for k in range(COUNT):
        log.write(TOPICS[k % 2].name, _payload(k), k, k)
        if k % PER_CHUNK == PER_CHUNK - 1:
            log.flush()
    content = path.read_bytes()
    log.close()
    return path.read_bytes() if closed else content


def _by_mcap(**options: object) -> bytes:
    file = io.BytesIO()
    writer = Writer(file, chunk_size=1500, **options)  # type: ignore[arg-type]
    writer.start("ros2")
    schema = writer.register_schema(FLOAT, "ros2msg", TEXT.encode())
    channels = [writer.register_channel(topic.name, "cdr", schema) for topic in TOPICS]
    for k in range(COUNT):
        writer.add_message(channels[k % 2], k, _payload(k), k, k)
    writer.finish()
    return file.getvalue()


def _parts(content: bytes) -> Iterator[tuple[int, int, list[McapRecord]]]:
    """Yield begin and end of each record of a file, and the records that it is or contains."""
    offset = 8
    while offset < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, offset)
        stream = ReadDataStream(io.BytesIO(content[offset + 9 : offset + 9 + length]))
        records: list[McapRecord] = []
        if opcode == Opcode.CHUNK:
            records = breakup_chunk(Chunk.read(stream))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            if opcode == Opcode.MESSAGE:
                records = [Message.read(stream, length)]
            else:
                records = [(Schema if opcode == Opcode.SCHEMA else Channel).read(stream)]
        yield offset, offset + 9 + length, records
        offset += 9 + length
