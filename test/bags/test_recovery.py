# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Recovery of incomplete and damaged logs saves all intact messages, and only those."""

import random
import resource
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Schema
from mcap.records import Message as McapMessage
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.recovery import (
    RECOVERY_METADATA,
    Recovery,
    RecoveryError,
    recover,
    recovery_text,
)
from linkage_vibration.bags.writing import Attachment, Topic, offered_qos_profiles
from linkage_vibration.cli.main import main
from linkage_vibration.messages.definitions import message_definition, type_hash
from test.support.mcap_damage import DAMAGES, example_logs, intact, read_messages

FLOAT = "std_msgs/msg/Float64"
TOPICS = [
    Topic(name, FLOAT, message_definition(FLOAT), type_hash(FLOAT), offered_qos_profiles())
    for name in ("/a", "/b")
]
COUNT = 400
PER_CHUNK = 50
CASES = [("none", False), ("lz4", True), ("zstd", False)]  # compression, and whether it was closed
Message = tuple[str, int, int, int, bytes]


def messages() -> list[Message]:
    """Return the messages of each log: topic, sequence, log time, publish time, CDR."""
    return [
        (TOPICS[k % 2].name, k // 2, k * 10, k * 10 + 1, b"\0\1\0\0" + struct.pack("<d", k**0.5))
        for k in range(COUNT)
    ]


def write(path: Path, compression: str = "zstd", closed: bool = True) -> bytes:
    """Write a log of several chunks with an attachment, and return its bytes."""
    attachments = [Attachment("x.bin", "application/x", bytes(range(256)))]
    log = LogWriter(path, TOPICS, attachments, compression)
    log.add_metadata("made", {"by": "a test"})
    for k, (topic, _, log_time, publish_time, data) in enumerate(messages(), 1):
        log.write(topic, data, log_time, publish_time)
        if k % PER_CHUNK == 0:
            log.flush()
    if closed:
        log.close()
        return path.read_bytes()
    content = path.read_bytes()
    log.close()
    return content


def read(path: Path) -> list[Message]:
    """Return the messages of a complete log, and check every CRC."""
    with path.open("rb") as file:
        return [
            (channel.topic, m.sequence, m.log_time, m.publish_time, m.data)
            for _, channel, m in make_reader(file, validate_crcs=True).iter_messages(
                log_time_order=False
            )
        ]


def records(content: bytes) -> list[tuple[int, int]]:
    """Return the opcode and offset of every record."""
    actual, offset = [], 8
    while offset < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, offset)
        actual.append((opcode, offset))
        offset += 9 + length
    return actual


def chunk_ends(content: bytes) -> list[int]:
    """Return the end of each chunk."""
    ends = []
    for opcode, offset in records(content):
        if opcode == 6:
            ends.append(offset + 9 + struct.unpack_from("<Q", content, offset + 1)[0])
    return ends


def saved(content: bytes, folder: Path) -> list[Message]:
    """Return the messages that are recovered from a file with this content."""
    (folder / "damaged.mcap").write_bytes(content)
    output = folder / "whole.mcap"
    output.unlink(missing_ok=True)
    result = recover(folder / "damaged.mcap", output)
    actual = read(output)
    assert sum(result.saved.values()) == len(actual)
    for topic, count in result.saved.items():
        assert count == sum(message[0] == topic for message in actual)
    assert (folder / "damaged.mcap").read_bytes() == content
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []
    return actual


def test_intact_log_is_kept(tmp_path: Path) -> None:
    """Messages, definitions, attachments, metadata and profile are the same."""
    write(tmp_path / "log.mcap")
    result = recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    assert (result.lost, result.damages) == ({}, ())
    assert result.saved == {"/a": COUNT // 2, "/b": COUNT // 2}
    assert read(tmp_path / "whole.mcap") == messages()
    contents = []
    for name in ("log.mcap", "whole.mcap"):
        with (tmp_path / name).open("rb") as file:
            reader = make_reader(file)
            actual = reader.get_summary()
            assert actual is not None
            metadata = {m.name: m.metadata for m in reader.iter_metadata()}
            recovered = metadata.pop(RECOVERY_METADATA, {})
            attachments = list(reader.iter_attachments())
            contents.append(
                (
                    reader.get_header().profile,
                    actual.schemas,
                    actual.channels,
                    metadata,
                    attachments,
                )
            )
    assert contents[0] == contents[1]
    assert recovered["messages_saved"] == str(COUNT)
    assert recovered["damages"] == ""


@pytest.mark.parametrize(("compression", "closed"), CASES)
def test_cut_at_every_record_boundary(tmp_path: Path, compression: str, closed: bool) -> None:
    """A log that ends at or near the end of any record keeps every complete chunk."""
    content = write(tmp_path / "log.mcap", compression, closed)
    ends = chunk_ends(content)
    assert len(ends) == COUNT // PER_CHUNK
    first_metadata = next(offset for opcode, offset in records(content) if opcode == 12)
    for cut in sorted({o + d for _, o in records(content) for d in (-1, 0, 1, 9)} | {len(content)}):
        if cut < first_metadata:
            continue  # nothing can be saved before the definitions
        actual = saved(content[:cut], tmp_path)
        whole = PER_CHUNK * sum(end <= cut for end in ends)
        assert actual == messages()[: len(actual)]
        assert whole <= len(actual) <= whole + PER_CHUNK


def test_messages_before_the_cut_of_an_uncompressed_chunk(tmp_path: Path) -> None:
    """The messages of an incomplete chunk are kept."""
    content = write(tmp_path / "log.mcap", "none")
    ends = chunk_ends(content)
    each = 9 + 22 + 12
    actual = saved(content[: ends[2] - 10 * each], tmp_path)
    assert actual == messages()[: 3 * PER_CHUNK - 10]


@pytest.mark.parametrize(("compression", "closed"), CASES)
def test_damaged_bytes(tmp_path: Path, compression: str, closed: bool) -> None:
    """A wrong byte costs one chunk or less, and no message is wrong."""
    content = write(tmp_path / "log.mcap", compression, closed)
    after_definitions = chunk_ends(content)[0]
    draw = random.Random(11)
    headers = [offset + d for _, offset in records(content) for d in range(10)]
    true = set(messages())
    places = [*draw.sample(headers, 40), *draw.sample(range(len(content)), 60)]
    for place in places:
        spoilt = bytearray(content)
        spoilt[place] ^= 1 << draw.randrange(8)
        actual = saved(bytes(spoilt), tmp_path)
        # Definitions outside of chunks have no CRC, so that a name of a topic may be wrong.
        if place >= after_definitions or closed:
            assert set(actual) <= true, place
        assert len(actual) >= COUNT - PER_CHUNK, place


def test_lost_messages_are_counted(tmp_path: Path) -> None:
    """Indexes count the lost messages of an incomplete log, statistics those of a complete one."""
    for closed in (True, False):
        content = bytearray(write(tmp_path / f"{closed}.mcap", closed=closed))
        for end in chunk_ends(bytes(content))[1:3]:
            content[end - 5] ^= 1
        (tmp_path / "spoilt.mcap").write_bytes(content)
        result = recover(tmp_path / "spoilt.mcap", tmp_path / f"whole_{closed}.mcap")
        assert result.saved == {"/a": (COUNT - 2 * PER_CHUNK) // 2, "/b": COUNT // 2 - PER_CHUNK}
        assert result.lost == {"/a": PER_CHUNK, "/b": PER_CHUNK}
        assert f"/a: {COUNT // 2 - PER_CHUNK}, {PER_CHUNK} lost" in recovery_text(result)
        with (tmp_path / f"whole_{closed}.mcap").open("rb") as file:
            [record] = [
                m.metadata for m in make_reader(file).iter_metadata() if m.name == RECOVERY_METADATA
            ]
        assert record["messages_known_lost"] == str(2 * PER_CHUNK)
        assert record["source"] == "spoilt.mcap"


@pytest.mark.parametrize(("count", "last"), [(20, "  at byte 19"), (21, "  and 1 more")])
def test_the_first_twenty_damages_are_listed(count: int, last: str) -> None:
    """The text lists twenty damaged places, and counts the others if there are any."""
    damages = tuple(f"at byte {k}" for k in range(count))
    lines = recovery_text(Recovery(Path("a.mcap"), {"/a": 3}, {}, damages)).splitlines()
    assert (lines[1], lines[-1]) == ("  /a: 3", last)


def test_recovered_log_opens_everywhere(tmp_path: Path) -> None:
    """Rosbags and mcap-ros2-support read the recovered log with the same numbers."""
    content = write(tmp_path / "log.mcap", closed=False)
    (tmp_path / "cut.mcap").write_bytes(content[:-300])
    recover(tmp_path / "cut.mcap", tmp_path / "whole.mcap")
    with AnyReader([tmp_path / "whole.mcap"]) as reader:
        by_rosbags = [
            (c.topic, time, reader.deserialize(data, c.msgtype).data)  # type: ignore[attr-defined]
            for c, time, data in reader.messages()
        ]
        assert reader.message_count == len(by_rosbags)
    with (tmp_path / "whole.mcap").open("rb") as file:
        by_mcap = [
            (channel.topic, m.log_time, decoded.data)
            for _, channel, m, decoded in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        ]
    expected = [(t, time, struct.unpack("<d", d[4:])[0]) for t, _, time, _, d in messages()]
    assert by_rosbags == by_mcap == expected[: len(by_mcap)]
    assert len(by_mcap) >= COUNT - PER_CHUNK


def other_writer(path: Path, chunked: bool) -> bytes:
    """Write a log like other programs: larger or no chunks, JSON, no rosbag2 metadata."""
    with path.open("wb") as file:
        writer = Writer(
            file,
            chunk_size=1024,
            compression=CompressionType.LZ4,
            index_types=IndexType.ALL,
            use_chunking=chunked,
        )
        writer.start("mine", "another program")
        channels = [
            writer.register_channel(
                name, "json", writer.register_schema("T", "jsonschema", b"{}"), {"key": "value"}
            )
            for name in ("/a", "/b")
        ]
        writer.register_channel("/without_schema", "json", 0)
        for k in range(COUNT):
            writer.add_message(channels[k % 2], k, b'{"k": %d}' % k, k + 1, k)
        writer.finish()
    return path.read_bytes()


@pytest.mark.parametrize("chunked", [True, False])
def test_files_of_other_programs(tmp_path: Path, chunked: bool) -> None:
    """Profile, encodings and metadata are kept, and damage costs only what it covers."""
    content = other_writer(tmp_path / "log.mcap", chunked)
    actual = saved(content, tmp_path)
    expected = [(f"/{'ab'[k % 2]}", k, k, k + 1, b'{"k": %d}' % k) for k in range(COUNT)]
    assert actual == expected
    with (tmp_path / "whole.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "mine"
        assert {m.name for m in reader.iter_metadata()} == {RECOVERY_METADATA}
        found_summary = reader.get_summary()
    assert found_summary is not None
    assert [c.metadata for c in found_summary.channels.values()] == [{"key": "value"}] * 2 + [{}]
    middle = [offset for opcode, offset in records(content) if opcode == (6 if chunked else 5)][5]
    spoilt = content[: middle + 1] + b"\xff" * 8 + content[middle + 9 :]
    kept = saved(spoilt, tmp_path)
    if chunked:
        assert all(message in expected for message in kept)
        assert len(kept) >= COUNT - 40
    else:  # nothing but its place tells a message from damage
        assert kept == expected[:4]


def test_messages_without_data(tmp_path: Path) -> None:
    """A message may have no data, and is kept outside of chunks, too."""
    path = tmp_path / "empty.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        channel = writer.register_channel("/trigger", "json", writer.register_schema("S", "", b""))
        for k in range(3):
            writer.add_message(channel, k, b"", k, k)
        writer.finish()
    assert saved(path.read_bytes(), tmp_path) == [("/trigger", k, k, k, b"") for k in range(3)]


@pytest.mark.parametrize(("more", "damages"), [(64, 0), (65, 1)])
def test_fields_of_a_later_version(tmp_path: Path, more: int, damages: int) -> None:
    """A record may have 64 bytes of fields that are not known at its end; more are damage."""
    path, content = tmp_path / "log.mcap", write(tmp_path / "log.mcap")
    at = content.index(b"\4\0\0\0made") - 9  # metadata
    [length] = struct.unpack_from("<Q", content, at + 1)
    end = at + 9 + length
    longer = struct.pack("<BQ", 0x0C, length + more) + content[at + 9 : end] + bytes(more)
    path.write_bytes(content[:at] + longer + content[end:])
    result = recover(path, tmp_path / "whole.mcap")
    assert (len(result.damages), result.lost) == (damages, {})
    with (tmp_path / "whole.mcap").open("rb") as file:
        found = {metadata.name for metadata in make_reader(file).iter_metadata()}
    assert ("made" in found) == (damages == 0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\x89MCAP0\r\n", "has no readable record"),
        (b"precious" * 1000, "has no readable record; give an MCAP file"),
    ],
)
def test_files_without_records(tmp_path: Path, content: bytes, words: str) -> None:
    """Without anything to save, nothing is written."""
    (tmp_path / "log.mcap").write_bytes(content)
    with pytest.raises(RecoveryError, match=words):
        recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_unusable_paths(tmp_path: Path) -> None:
    """No file is replaced, and the error names a missing one."""
    write(tmp_path / "log.mcap")
    with pytest.raises(RecoveryError, match=r"log.mcap exists already"):
        recover(tmp_path / "log.mcap", tmp_path / "log.mcap")
    with pytest.raises(RecoveryError, match=r"none.mcap cannot be read: No such file"):
        recover(tmp_path / "none.mcap", tmp_path / "whole.mcap")
    with pytest.raises(RecoveryError, match=r"nowhere/whole.mcap: cannot be writ.*No such file"):
        recover(tmp_path / "log.mcap", tmp_path / "nowhere" / "whole.mcap")
    with pytest.raises(RecoveryError, match=r"whole.mcap: cannot be written \(Not a directory"):
        recover(tmp_path / "log.mcap", tmp_path / "log.mcap" / "whole.mcap")
    with pytest.raises(RecoveryError, match="cannot be read: Is a directory"):
        recover(tmp_path, tmp_path / "whole.mcap")


def test_output_that_cannot_grow(tmp_path: Path) -> None:
    """A full disk is an error, and no incomplete file is left."""
    write(tmp_path / "log.mcap")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
        with pytest.raises(RecoveryError, match=r"whole.mcap: cannot be written \(File too large"):
            recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_memory_is_bounded(tmp_path: Path) -> None:
    """A file of 200 MB, with a record that claims to have 2 GB, needs less than 40 MB."""
    path = tmp_path / "log.mcap"
    with LogWriter(path, TOPICS, compression="none") as log:
        for k in range(3000):
            log.write("/a", b"\0\1\0\0" + bytes(2**16), k, k)
    content = path.read_bytes()
    middle = [offset for opcode, offset in records(content) if opcode == 6][1000]
    with path.open("r+b") as file:
        file.seek(middle + 1)
        file.write(struct.pack("<Q", 2**31))
    script = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from linkage_vibration.bags.recovery import recover\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "result = recover(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        "after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "print(result.saved['/a'], after - before)\n"
    )
    command = [sys.executable, "-c", script, str(path), str(tmp_path / "whole.mcap")]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    count, kibibytes = map(int, run.stdout.split())
    assert count >= 2999
    assert kibibytes < 40_000


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`linkage-vibration recover` writes a file beside the log and reports what it saved."""
    content = write(tmp_path / "log.mcap", closed=False)
    (tmp_path / "cut.mcap").write_bytes(content[:-200])
    assert main(["recover", str(tmp_path / "cut.mcap")]) == 0
    output = capsys.readouterr().out
    assert f"{tmp_path / 'cut_recovered.mcap'}: " in output
    assert "the end is missing" in output
    assert len(read(tmp_path / "cut_recovered.mcap")) >= COUNT - PER_CHUNK
    assert main(["recover", str(tmp_path / "cut.mcap")]) == 1
    assert "cut_recovered.mcap exists already" in capsys.readouterr().err
    assert main(["recover", str(tmp_path / "none.mcap")]) == 1
    assert main(["recover", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "x.mcap")]) == 0
    assert (tmp_path / "x.mcap").exists()


def chunk(first: int, names: dict[int, str], channels: list[int]) -> bytes:
    """Return a chunk with definitions of channels, and one message of each of some channels."""
    text = message_definition(FLOAT).encode()
    builder = RecordBuilder()
    Schema(1, text, "ros2msg", FLOAT).write(builder)
    for number, name in names.items():
        Channel(number, name, "cdr", {}, 1).write(builder)
    for k, channel in enumerate(channels):
        data = b"\0\1\0\0" + struct.pack("<d", first + k)
        McapMessage(channel, first + k, data, first + k, 0).write(builder)
    content = builder.end()
    last = first + len(channels) - 1
    Chunk("", content, last, first, zlib.crc32(content), len(content)).write(builder)
    return bytes(builder.end())


def test_chunks_that_disagree(tmp_path: Path) -> None:
    """A channel keeps its first definition, and messages of an undefined channel are lost."""
    content = b"\x89MCAP0\r\n" + b"".join(
        [
            chunk(0, {1: "/a", 3: "/c"}, [1, 1]),
            chunk(10, {1: "/renamed", 3: "/other"}, [1, 3]),
            chunk(20, {2: "/b"}, [2, 7, 1]),
            chunk(30, {2: "/b"}, [2]),
        ]
    )
    (tmp_path / "log.mcap").write_bytes(content)
    result = recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    assert result.saved == {"/a": 4, "/b": 2, "/c": 1}
    assert result.lost == {"unknown channel 7": 1}
    assert [(topic, time) for topic, _, time, *_ in read(tmp_path / "whole.mcap")] == [
        *[("/a", time) for time in (0, 1, 10)],
        *[("/c", 11), ("/b", 20), ("/a", 22), ("/b", 30)],
    ]
    with AnyReader([tmp_path / "whole.mcap"]) as reader:
        assert reader.message_count == 7


@pytest.mark.parametrize("seeds", [2, pytest.param(20, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("kind", DAMAGES)
def test_nothing_intact_is_lost(tmp_path: Path, kind: str, seeds: int) -> None:
    """Of damaged logs of the node and of mcap, what a scan knows to be intact is saved.

    Without chunks, that is what lies before the first damage.
    """
    for k, (name, content) in enumerate(example_logs(tmp_path).items()):
        for number in range(seeds):
            spoilt, spans = DAMAGES[kind](content, random.Random(f"{k} {number}"))
            (tmp_path / "log.mcap").write_bytes(spoilt)
            if name == "mcap, without chunks":
                spans = [span for span in spans if span[0] == 0]
            expected = intact(content, spans)
            try:
                recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
            except RecoveryError:
                assert not expected
                continue
            assert expected <= set(read_messages(tmp_path / "whole.mcap"))
            (tmp_path / "whole.mcap").unlink()


@pytest.mark.parametrize("log", ["node, zstd", "mcap, zstd"])
def test_lost_head(tmp_path: Path, log: str) -> None:
    """Definitions behind the data give the saved messages their types, which rosbags decodes."""
    content = example_logs(tmp_path)[log]
    head = chunk_ends(content)[0] + 1
    (tmp_path / "log.mcap").write_bytes(content[head:])
    result = recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    expected = intact(content, [(head, len(content))])
    assert sum(result.saved.values()) == len(expected) > 0
    assert sum(result.saved.values()) + sum(result.lost.values()) == 240
    with AnyReader([tmp_path / "whole.mcap"]) as reader:
        numbers = {reader.deserialize(data, c.msgtype).data for c, _, data in reader.messages()}  # type: ignore[attr-defined]
    assert numbers == {time**0.5 for _, _, time, _ in expected}


def test_output_that_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that appears during the recovery stays."""
    write(tmp_path / "log.mcap")
    output = tmp_path / "whole.mcap"

    @contextmanager
    def bar(path: Path, size: int) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(update=lambda count: output.write_text("mine"))

    with monkeypatch.context() as patch:
        patch.setattr("linkage_vibration.bags.recovery.shown_bar", bar)
        with pytest.raises(RecoveryError, match=r"whole.mcap exists already"):
            recover(tmp_path / "log.mcap", output)
    assert output.read_text() == "mine"
    output.unlink()
    recover(tmp_path / "log.mcap", output)
    assert read(output) == messages()
    output.unlink()
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_recovery_of_a_pipe(tmp_path: Path) -> None:
    """The content of a pipe is not called empty; in a file, it is recovered."""
    content = write(tmp_path / "log.mcap")
    command = [sys.executable, "-m", "linkage_vibration.cli", "recover"]
    whole = str(tmp_path / "whole.mcap")
    ran = subprocess.run(
        [*command, "/dev/stdin", "-o", whole], input=content, capture_output=True, check=False
    )
    assert ran.returncode == 1
    assert b"/dev/stdin cannot be read: stdin is a pipe, not a file; give a file." in ran.stderr
    with (tmp_path / "log.mcap").open("rb") as file:
        subprocess.run([*command, "/dev/stdin", "-o", whole], stdin=file, check=True)
    assert read(tmp_path / "whole.mcap") == messages()


def test_zeros_before_a_log(tmp_path: Path) -> None:
    """The error of a file that begins behind others says how to split them."""
    content = write(tmp_path / "log.mcap")
    (tmp_path / "behind.mcap").write_bytes(bytes(1000) + content)
    with pytest.raises(RecoveryError, match=r"another file begins at byte 1000; split .*tail") as e:
        recover(tmp_path / "behind.mcap", tmp_path / "whole.mcap")
    command = str(e.value).split("`")[3]
    subprocess.run(command, shell=True, check=True, cwd=tmp_path)
    assert read(tmp_path / "second.mcap") == messages()


@pytest.mark.parametrize(
    ("name", "content", "tool"),
    [
        ("a.bag", b"#ROSBAG V2.0\n" + bytes(5000), "rosbag reindex"),
        ("a.bag.active", b"#ROSBAG V2.0\n" + bytes(5000), "rosbag reindex"),
        ("a.db3", b"SQLite format 3\0" + bytes(5000), "sqlite3 cut.db3 .dump"),
        ("a.mcap", bytes(5000), "give an MCAP file"),
    ],
)
def test_recovery_of_other_bags(tmp_path: Path, name: str, content: bytes, tool: str) -> None:
    """The error names the tool that saves the rest of a bag of another kind."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecoveryError, match=f"has no readable record; .*{tool}"):
        recover(tmp_path / name, tmp_path / "whole.mcap")


def test_ten_gigabytes_of_zeros(tmp_path: Path) -> None:
    """A file of holes takes less than a second; what lies behind a hole is saved."""
    path = tmp_path / "zeros.mcap"
    with path.open("wb") as file:
        file.truncate(10 * 10**9)
    begin = time.process_time()
    with pytest.raises(RecoveryError, match="has no readable record"):
        recover(path, tmp_path / "whole.mcap")
    assert time.process_time() - begin < 1.0
    content = write(tmp_path / "log.mcap")
    half = chunk_ends(content)[1]
    with path.open("r+b") as file:
        file.write(content[:half])
        file.seek(5 * 10**9)
        file.write(content[half:])
        file.truncate()
    begin = time.process_time()
    recover(path, tmp_path / "whole.mcap")
    assert time.process_time() - begin < 1.0
    assert read(tmp_path / "whole.mcap") == messages()


def test_progress_from_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar shows all bytes of the file."""
    bars = []

    @contextmanager
    def bar(path: Path, size: int) -> Iterator[SimpleNamespace]:
        bars.append([path, size])
        yield SimpleNamespace(update=bars[-1].append)

    monkeypatch.setattr("linkage_vibration.bags.recovery.shown_bar", bar)
    size = len(write(tmp_path / "log.mcap"))
    recover(tmp_path / "log.mcap", tmp_path / "whole.mcap")
    [[path, total, *steps]] = bars
    assert (path, total) == (tmp_path / "log.mcap", size)
    assert size - 16 <= sum(steps) <= size
