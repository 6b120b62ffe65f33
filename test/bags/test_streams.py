# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Topics are read from bags in the order of times, whatever their order in the file."""

import math
import random
import struct
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.streams import open_bags

FLOAT64 = "std_msgs/msg/Float64"
STORE = get_typestore(Stores.LATEST)

Found = list[tuple[int, str, float]]


def cdr(value: float) -> bytes:
    """Return a Float64 in CDR."""
    return bytes(STORE.serialize_cdr(STORE.types[FLOAT64](data=value), FLOAT64))


def write_mcap(
    path: Path,
    entries: list[tuple[str, int, float]],
    compression: CompressionType = CompressionType.ZSTD,
    chunk: int = 400,
    **options: Any,
) -> Path:
    """Write messages (topic, time in ns, value) of type Float64 in this order; NaN has no bytes."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk, compression=compression, **options)
        writer.start("ros2", "test")
        text = STORE.generate_msgdef(FLOAT64, ros_version=2)[0].encode()
        schema = writer.register_schema(FLOAT64, "ros2msg", text)
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": ""})
            for topic in dict.fromkeys(topic for topic, *_ in entries)
        }
        for topic, time, value in entries:
            data = b"" if math.isnan(value) else cdr(value)
            writer.add_message(channels[topic], time, data, max(time - 7, 0))
        writer.finish()
    return path


def read(paths: list[Path], topics: list[str]) -> Found:
    """Return time, topic and value of each message."""
    actual: Found = []
    with open_bags(paths) as bags:
        for block in bags.blocks(topics):
            for row in range(len(block)):
                value = STORE.deserialize_cdr(block.message(row), FLOAT64).data  # type: ignore[attr-defined]
                actual.append((int(block.log_times[row]), topics[block.topics[row]], value))
    return actual


@pytest.mark.parametrize(
    "options",
    [
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.MESSAGE},
        {"use_summary_offsets": False, "repeat_channels": False, "repeat_schemas": False},
    ],
    ids=str,
)
def test_file_without_an_index(tmp_path: Path, options: dict[str, Any]) -> None:
    """A file without an index, or without channels in its summary, is read as one with them."""
    entries = [(topic, 10 * k, float(k)) for k in range(300) for topic in ("/a", "/b")]
    blocks = []
    for name, more in (("with.mcap", {}), ("without.mcap", options)):
        with open_bags([write_mcap(tmp_path / name, entries, **more)]) as bags:
            blocks += [
                (int(log), int(sent), block.message(k))
                for block in bags.blocks(["/b"])
                for k, (log, sent) in enumerate(
                    zip(block.log_times, block.publish_times, strict=True)
                )
            ]
    assert len(blocks) == 600
    assert blocks[:300] == blocks[300:]
    assert blocks[299][:2] == (2990, 2983)


def test_order_is_that_of_time(tmp_path: Path) -> None:
    """Overlapping chunks are sorted by log time; messages with equal times keep their order."""
    rng = random.Random(1)
    entries = [
        (rng.choice(["/a", "/b", "/other"]), max(0, 10 * k + rng.randrange(-3000, 3000)), float(k))
        for k in range(20_000)
    ]
    path = write_mcap(tmp_path / "bag.mcap", entries)
    expected = sorted(
        [(time, topic, value) for topic, time, value in entries if topic != "/other"],
        key=lambda entry: entry[0],
    )
    assert read([path], ["/a", "/b"]) == expected


def test_a_message_without_bytes(tmp_path: Path) -> None:
    """It has no value, and the messages of its chunk are read."""
    path = write_mcap(tmp_path / "empty.mcap", [("/a", 1, math.nan), ("/a", 2, 5.0)])
    with open_bags([path]) as bags:
        found = [block.message(k) for block in bags.blocks(["/a"]) for k in range(len(block))]
    assert found == [b"", cdr(5.0)]


def test_several_bags_are_one(tmp_path: Path) -> None:
    """Simultaneous recordings are merged; at equal times, the first bag comes first."""
    first = write_mcap(tmp_path / "1.mcap", [("/a", 2 * k, 1.0) for k in range(6000)])
    other = write_mcap(tmp_path / "2.mcap", [("/b", k, 2.0) for k in range(12_000)])
    content = read([first, other], ["/a", "/b"])
    expected = [(2 * k, "/a", 1.0) for k in range(6000)] + [(k, "/b", 2.0) for k in range(12_000)]
    assert content == sorted(expected, key=lambda entry: entry[0])
    assert read([other, first], ["/a", "/b"])[:2] == [(0, "/b", 2.0), (0, "/a", 1.0)]


def test_chunks_that_were_compressed_as_streams(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The `mcap` command and other Go programs do not write how large a chunk of zstd becomes."""

    def compress(data: bytes) -> bytes:
        stream = zstandard.ZstdCompressor().compressobj()
        return stream.compress(data) + stream.flush()

    monkeypatch.setattr(zstandard, "compress", compress)
    path = write_mcap(tmp_path / "bag.mcap", [("/a", k, 1.0) for k in range(100)])
    assert zstandard.frame_content_size(compress(b"1")) == -1
    assert read([path], ["/a"]) == [(k, "/a", 1.0) for k in range(100)]


def test_chunks_of_several_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk may consist of frames of zstd, as parallel compressors write them."""

    def compress(data: bytes) -> bytes:
        third = len(data) // 3
        parts = (data[:third], data[third : 2 * third], data[2 * third :])
        return b"".join(zstandard.ZstdCompressor().compress(part) for part in parts)

    monkeypatch.setattr(zstandard, "compress", compress)
    path = write_mcap(tmp_path / "bag.mcap", [("/a", k, 1.0) for k in range(100)])
    monkeypatch.undo()
    assert read([path], ["/a"]) == [(k, "/a", 1.0) for k in range(100)]
    recover(path, tmp_path / "again.mcap")
    assert read([tmp_path / "again.mcap"], ["/a"]) == read([path], ["/a"])


def test_mcap_without_index(tmp_path: Path) -> None:
    """A file without chunks is read too."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2", "test")
        schema = writer.register_schema(FLOAT64, "ros2msg", b"float64 data")
        channel = writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": ""})
        for k in range(10):
            writer.add_message(channel, k, cdr(k), k)
        writer.finish()
    assert read([path], ["/a"]) == [(k, "/a", float(k)) for k in range(10)]


def test_damage_names_the_file(tmp_path: Path) -> None:
    """The error names the damaged one of several bags, when the damage is reached."""
    good = write_mcap(tmp_path / "good.mcap", [("/a", k, 1.0) for k in range(2000)])
    bad = write_mcap(tmp_path / "bad.mcap", [("/a", k, 1.0) for k in range(2000)])
    data = bytearray(bad.read_bytes())
    with bad.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    data[summary.chunk_indexes[5].chunk_start_offset + 60] ^= 0xFF
    bad.write_bytes(data)
    with pytest.raises(BagError, match=r"bad\.mcap is damaged or incomplete .*; try"):
        read([good, bad], ["/a"])


@pytest.mark.parametrize("length", [21, 2**62])
@pytest.mark.parametrize("which", [0, 1])
def test_wrong_lengths(tmp_path: Path, length: int, which: int) -> None:
    """A message with an impossible length is damage, also without a checksum."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "test")
        schema = writer.register_schema(FLOAT64, "ros2msg", b"float64 data")
        channel = writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": ""})
        for k in range(2):
            writer.add_message(channel, k, cdr(k), k)
        writer.finish()
    true, wrong = (struct.pack("<BQ", Opcode.MESSAGE, n) for n in (22 + 12, length))
    parts = path.read_bytes().split(true)
    path.write_bytes(
        parts[0] + (wrong + parts[1] + true if which == 0 else true + parts[1] + wrong) + parts[2]
    )
    with pytest.raises(BagError, match="is damaged"):
        read([path], ["/a"])


def test_chunk_without_messages(tmp_path: Path) -> None:
    """A chunk without messages is valid, and so are times beyond the year 2262."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1, index_types=IndexType.CHUNK)
        writer.start("ros2", "test")
        schema = writer.register_schema(FLOAT64, "ros2msg", b"float64 data")
        channel = writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": ""})
        for time in (5, 2**64 - 1):
            writer.add_message(channel, time, cdr(time), time)
        writer.finish()
    assert [time for time, *_ in read([path], ["/a"])] == [5, 2**63 - 1]


def test_incomplete_file(tmp_path: Path) -> None:
    """An incomplete file is an error before anything is read."""
    path = write_mcap(tmp_path / "bag.mcap", [("/a", k, 1.0) for k in range(2000)])
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(BagError, match="incomplete"), open_bags([path]):
        pass
