# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes valid but unusual files of random content, record by record, as specifications permit."""

import random
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore

FLOAT = "std_msgs/msg/Float64"
Entry = tuple[str, int, float]


def entries(rng: random.Random) -> list[Entry]:
    """Return messages of some topics, of which times may be equal, in the order of times."""
    topics = [f"/topic_{k}" for k in range(rng.randrange(1, 4))]
    times = sorted(rng.randrange(2000) * 10**6 for _ in range(rng.randrange(1, 120)))
    return [(rng.choice(topics), time, rng.uniform(-1e3, 1e3)) for time in times]


def text(words: str) -> bytes:
    """Return a string of MCAP."""
    return struct.pack("<I", len(words.encode())) + words.encode()


def mapping(pairs: list[tuple[bytes, bytes]]) -> bytes:
    """Return a map or a list of pairs of MCAP."""
    content = b"".join(key + value for key, value in pairs)
    return struct.pack("<I", len(content)) + content


def record(opcode: int, content: bytes, rng: random.Random) -> bytes:
    """Return a record; a header may have fields of a later version.

    The reader of mcap, which is the judge, misreads such fields of a definition in a chunk.
    """
    if rng.random() < 0.2 and opcode == Opcode.HEADER:
        content += rng.randbytes(rng.randrange(1, 9))
    return struct.pack("<BQ", opcode, len(content)) + content


class OddMcap:
    """An MCAP file that is written record by record."""

    def __init__(self, rng: random.Random, messages: list[Entry]) -> None:
        self._rng, self._messages = rng, messages
        topics = sorted({topic for topic, *_ in messages})
        numbers = rng.sample(range(1, 2**16), len(topics))
        self._channels = dict(zip(topics, numbers, strict=True))
        self._schema = rng.randrange(1, 2**16)
        self._out = b"\x89MCAP0\r\n"
        self._chunks: list[bytes] = []  # chunk indexes
        self._indexed = rng.random() < 0.7

    def _definitions(self) -> list[bytes]:
        line = self._rng.choice(["\n", "\r\n"])
        name = self._rng.choice([FLOAT, "std_msgs/Float64"])
        kind = struct.pack("<H", self._schema) + text(name) + text("ros2msg")
        made = [record(Opcode.SCHEMA, kind + text(f"float64 data{line}"), self._rng)]
        for topic, number in self._channels.items():
            about = struct.pack("<HH", number, self._schema) + text(topic) + text("cdr")
            made.append(record(Opcode.CHANNEL, about + mapping([]), self._rng))
        return made

    def _chunk(self, messages: list[Entry], definitions: list[bytes]) -> None:
        """Add messages as a chunk, with the index of each channel."""
        rng, content, places = self._rng, b"".join(definitions), dict[int, list[tuple[int, int]]]()
        for topic, time, value in messages:
            number = self._channels[topic]
            places.setdefault(number, []).append((time, len(content)))
            content += self._message(topic, time, value)
            if rng.random() < 0.1:  # an opcode that is free for private use
                content += record(0x80 + rng.randrange(100), rng.randbytes(7), rng)
        packed, name = content, rng.choice(["", "lz4", "zstd"])
        if name:
            packed = lz4.frame.compress(content) if name == "lz4" else zstandard.compress(content)
        times = [time for _, time, _ in messages]
        crc = rng.choice([0, zlib.crc32(content)])
        head = struct.pack("<QQQI", min(times), max(times), len(content), crc) + text(name)
        begin = len(self._out)
        self._out += record(Opcode.CHUNK, head + struct.pack("<Q", len(packed)) + packed, rng)
        end, offsets = len(self._out), list[tuple[bytes, bytes]]()
        for number, pairs in rng.sample(sorted(places.items()), len(places)):
            if self._indexed:
                offsets.append((struct.pack("<H", number), struct.pack("<Q", len(self._out))))
                index = mapping([(struct.pack("<Q", a), struct.pack("<Q", b)) for a, b in pairs])
                index = struct.pack("<H", number) + index
                self._out += record(Opcode.MESSAGE_INDEX, index, rng)
        about = struct.pack("<QQQQ", min(times), max(times), begin, end - begin) + mapping(offsets)
        about += struct.pack("<Q", len(self._out) - end) + text(name)
        about += struct.pack("<QQ", len(packed), len(content))
        self._chunks.append(record(Opcode.CHUNK_INDEX, about, rng))

    def _message(self, topic: str, time: int, value: float) -> bytes:
        order = self._rng.choice("<>")
        data = bytes([0, order == "<", 0, 0]) + struct.pack(f"{order}d", value)
        head = struct.pack("<HIQQ", self._channels[topic], self._rng.randrange(9), time, time)
        return struct.pack("<BQ", Opcode.MESSAGE, len(head + data)) + head + data

    def content(self) -> bytes:
        """Return the file."""
        rng, messages = self._rng, list(self._messages)
        self._out += record(Opcode.HEADER, text(rng.choice(["ros2", "", "x"])) + text("odd"), rng)
        repeated, inside = self._definitions(), rng.random() < 0.5
        if not inside:
            self._out += b"".join(repeated)
        while messages:
            n = rng.randrange(1, 40)
            part, messages = messages[:n], messages[n:]
            # Messages outside of chunks come before all chunks. Behind one, recovery takes them for
            # a damaged index, so that such a file is refused.
            if rng.random() < 0.3 and not inside and not self._chunks:
                self._out += b"".join(self._message(*each) for each in part)
            else:
                self._chunk(part, repeated if inside else [])
            if rng.random() < 0.2:
                facts = text("notes") + mapping([(text("who"), text("a person"))])
                self._out += record(Opcode.METADATA, facts, rng)
        crc = rng.choice([0, zlib.crc32(self._out)])
        self._out += record(Opcode.DATA_END, struct.pack("<I", crc), rng)
        return self._out + self._summary(repeated) + b"\x89MCAP0\r\n"

    def _summary(self, definitions: list[bytes]) -> bytes:
        """Return the summary and the footer; each group, and the summary itself, may be missing."""
        rng, parts = self._rng, list[bytes]()
        if rng.random() < 0.8:
            parts = [b"".join(definitions)] if rng.random() < 0.8 else []
            parts += [b"".join(each * rng.choice([1, 1, 2]) for each in self._chunks)]
            if rng.random() < 0.8:
                parts.append(self._statistics())
            rng.shuffle(parts) if len(parts) < 3 else None
        summary = b"".join(parts)
        start = len(self._out) if summary else 0
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
        crc = rng.choice([0, zlib.crc32(footer, zlib.crc32(summary))])
        return summary + footer + struct.pack("<I", crc)

    def _statistics(self) -> bytes:
        times = [time for _, time, _ in self._messages]
        counts = dict.fromkeys(self._channels.values(), 0)
        for topic, *_ in self._messages:
            counts[self._channels[topic]] += 1
        pairs = [(struct.pack("<H", n), struct.pack("<Q", count)) for n, count in counts.items()]
        number = len(self._messages), 1, len(counts), 0, 0, len(self._chunks)
        about = struct.pack("<QHIIIIQQ", *number, min(times), max(times))
        return record(Opcode.STATISTICS, about + mapping(self._rng.choice([pairs, []])), self._rng)


def odd_mcap(path: Path, messages: list[Entry], rng: random.Random) -> Path:
    """Write an MCAP file."""
    path.write_bytes(OddMcap(rng, messages).content())
    return path


def odd_database(path: Path, messages: list[Entry], rng: random.Random) -> Path:
    """Write a database of rosbag2, in the layout of one of its versions and settings of SQLite."""
    version = rng.randrange(1, 4)
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA page_size={rng.choice([512, 4096, 65536])}")
        database.execute(f"PRAGMA auto_vacuum={rng.randrange(3)}")
        more = ", offered_qos_profiles TEXT NOT NULL" if version > 1 else ""
        columns = "(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT"
        database.execute(f"CREATE TABLE topics{columns}{more})")
        columns = "(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        database.execute(f"CREATE TABLE messages{columns}")
        numbers = {topic: k for k, topic in enumerate(sorted({t for t, *_ in messages}), 7)}
        kind = rng.choice([FLOAT, "std_msgs/Float64"])
        for topic, number in numbers.items():
            row = [number, topic, kind, "cdr", *([""] if more else [])]
            marks = ",".join("?" * len(row))
            database.execute(f"INSERT INTO topics VALUES ({marks})", row)
        for topic, time, value in messages:
            data = b"\0\1\0\0" + struct.pack("<d", value)
            row = [numbers[topic], time, data]
            database.execute("INSERT INTO messages (topic_id,timestamp,data) VALUES (?,?,?)", row)
        database.commit()
    return path


def odd_ros1(path: Path, messages: list[Entry], rng: random.Random) -> Path:
    """Write a bag of ROS 1 with small chunks of a random compression, and several connections."""
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer1(path)
    if (packing := rng.choice([None, *Writer1.CompressionFormat])) is not None:
        writer.set_compression(packing)
    writer.chunk_threshold = rng.choice([10, 200, 10**6])
    with writer as bag:
        topics = sorted({topic for topic, *_ in messages})
        senders = {
            topic: [
                bag.add_connection(topic, FLOAT, typestore=store, callerid=f"/node_{k}")
                for k in range(rng.randrange(1, 3))
            ]
            for topic in topics
        }
        for topic, time, value in messages:
            bag.write(rng.choice(senders[topic]), time, struct.pack("<d", value))
    return path


def odd_candump(
    path: Path, messages: list[Entry], rng: random.Random
) -> list[tuple[float, int, bytes]]:
    """Write a log of candump with unusual but valid lines; return time, identifier and data."""
    frames, lines = list[tuple[float, int, bytes]](), ["\ufeff"] * rng.randrange(2)
    for k, _ in enumerate(messages):
        number = rng.randrange(2**11) if rng.random() < 0.5 else rng.randrange(2**29)
        width = 3 if number < 2**11 and rng.random() < 0.7 else 8
        data = rng.randbytes(rng.randrange(9))
        time = 1_700_000_000 + 0.01 * k
        digits = data.hex() if rng.random() < 0.5 else data.hex().upper()
        end = rng.choice(["", " R", " T"]) + rng.choice(["\n", "\r\n", "\n\n", "  \n"])
        lines.append(f"({time:.6f}) can0 {number:0{width}X}#{digits}{end}")
        frames.append((time, number, data))
    path.write_text("".join(lines), encoding="utf-8", newline="")
    return frames
