# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files as people have them are read wholly, or refused with the right reason and a remedy."""

import gzip
import re
import shutil
import sqlite3
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.dbc import dbc_signal
from linkage_vibration.bags.message_columns import read_columns, topic_types
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.recovery import Recovery, recover
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.readers.frfs import read_frfs
from linkage_vibration.readers.matrices import read_matrices
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.readers.recordings import read_recording
from test.support.programs import require

FLOAT = "std_msgs/msg/Float64"
TEXT = b"float64 data\n"
Entry = tuple[str, int, float]


def cdr(value: float) -> bytes:
    """Return a Float64 in CDR, by hand."""
    return b"\0\1\0\0" + struct.pack("<d", value)


def write_mcap(path: Path, entries: list[Entry], **options: object) -> Path:
    """Write messages (topic, time in ns, value) with the writer of mcap."""
    with path.open("wb") as file:
        writer = Writer(file, **{"chunk_size": 300, **options})  # type: ignore[arg-type]
        writer.start("ros2", "another program")
        schema = writer.register_schema(FLOAT, "ros2msg", TEXT)
        topics = dict.fromkeys(topic for topic, *_ in entries)
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in topics}
        for topic, time, value in entries:
            writer.add_message(channels[topic], time, cdr(value), time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def write_folder(path: Path, entries: list[Entry], plugin: StoragePlugin, **packed: object) -> Path:
    """Write messages with the writer of rosbags, and return the folder."""
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(**packed)  # type: ignore[arg-type]
    with writer as bag:
        store = get_typestore(Stores.ROS2_JAZZY)
        topics = dict.fromkeys(topic for topic, *_ in entries)
        added = {topic: bag.add_connection(topic, FLOAT, typestore=store) for topic in topics}
        for topic, time, value in entries:
            bag.write(added[topic], time, cdr(value))
    return path


def read(path: Path, *topics: str) -> list[Entry]:
    """Return the messages of topics in the order in which the package reads them."""
    found: list[Entry] = []
    with open_bags([path]) as bags:
        assert {topic.name for topic in bags.topics} >= {*topics}
        counted = sum(topic.count for topic in bags.topics if topic.name in topics)
        for block in bags.blocks(topics):
            for row in range(len(block)):
                [value] = struct.unpack_from("<d", block.message(row), 4)
                name = topics[block.topics[row]]
                found.append((name, int(block.log_times[row]), value))
    assert counted == len(found)
    return found


def refused(path: Path, words: str) -> list[str]:
    """Check that a bag is refused with these words, and return the commands of the remedy."""
    with pytest.raises(BagError, match=words) as error:
        read(path)
    return re.findall("`([^`]+)`", str(error.value))


def run(commands: list[str], folder: Path) -> None:
    """Run the commands that an error names, as a user would."""
    for each in commands:
        name = "linkage-vibration "
        each = each.replace(name, f"{sys.executable} -m linkage_vibration.cli ")
        subprocess.run(each, shell=True, cwd=folder, check=False, capture_output=True)


def drive(count: int = 200, first: int = 0, topic: str = "/a") -> list[Entry]:
    """Return messages of a topic."""
    return [(topic, 10 * k, float(k)) for k in range(first, first + count)]


# Nothing is lost in silence.


def test_write_ahead_log(tmp_path: Path) -> None:
    """A database is read with the log beside it, and neither of both files is changed."""
    [file] = write_folder(tmp_path / "bag", drive(), StoragePlugin.SQLITE3).glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        rows = [(1, time, cdr(value)) for _, time, value in drive(300, 200)]
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?,?,?)", rows
        )
        database.commit()
        crashed = tmp_path / "crashed.db3"  # as both files are at this moment
        for end in ("", "-wal"):
            shutil.copy(f"{file}{end}", f"{crashed}{end}")
    before = {path: path.read_bytes() for path in tmp_path.glob("crashed*")}
    assert len(before) == 2
    assert read(crashed, "/a") == drive(500)
    assert {path: path.read_bytes() for path in tmp_path.glob("crashed*")} == before
    Path(f"{crashed}-wal").write_bytes(b"")
    assert read(crashed, "/a") == drive(200)


def test_rollback_journal(tmp_path: Path) -> None:
    """A transaction that a crash interrupted is undone, as SQLite does it."""
    [file] = write_folder(tmp_path / "bag", drive(3000), StoragePlugin.SQLITE3).glob("*.db3")
    with closing(sqlite3.connect(file, isolation_level=None)) as database:
        database.execute("PRAGMA cache_size=1")
        database.execute("BEGIN")
        database.execute("UPDATE messages SET timestamp = 7, data = ?", (cdr(-1.0),))
        crashed = tmp_path / "crashed.db3"
        for end in ("", "-journal"):
            shutil.copy(f"{file}{end}", f"{crashed}{end}")
        database.execute("ROLLBACK")
    assert crashed.read_bytes() != file.read_bytes()
    assert read(crashed, "/a") == drive(3000)


def with_summary(content: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """Return an MCAP file with another summary, whose checksum is left out."""
    footer = len(content) - 8 - 29
    start, _, _ = struct.unpack("<QQI", content[footer + 9 : footer + 29])
    changed = content[:start] + change(content[start:footer])
    return changed + struct.pack("<BQQQI", Opcode.FOOTER, 20, start, 0, 0) + content[-8:]


def split(records: bytes) -> list[bytes]:
    """Return the records, each with its head."""
    parts = []
    while records:
        size = 9 + int.from_bytes(records[1:9], "little")
        parts.append(records[:size])
        records = records[size:]
    return parts


def test_chunk_index_that_is_repeated(tmp_path: Path) -> None:
    """A chunk that the summary lists twice is read once."""
    path = write_mcap(tmp_path / "a.mcap", drive())

    def twice(summary: bytes) -> bytes:
        return b"".join(each * (1 + (each[0] == Opcode.CHUNK_INDEX)) for each in split(summary))

    changed = with_summary(path.read_bytes(), twice)
    assert len(changed) > len(path.read_bytes())
    path.write_bytes(changed)
    with path.open("rb") as file:
        doubled = len(list(make_reader(file).iter_messages()))
    assert doubled == 400  # what mcap itself makes of it
    assert read(path, "/a") == drive()


@pytest.mark.parametrize("kind", ["mcap", "without an index", "db3", "bag"])
def test_joined_files(tmp_path: Path, kind: str) -> None:
    """Files that were joined are named; the commands of the error split them."""
    parts = [drive(200), drive(300, 500, "/b")]
    paths = []
    for k, entries in enumerate(parts):
        path = tmp_path / f"part{k}"
        if kind == "db3":
            [path] = write_folder(path, entries, StoragePlugin.SQLITE3).glob("*.db3")
        elif kind == "bag":
            path = write_ros1(path.with_suffix(".bag"), entries)
        else:
            index = IndexType.NONE if kind == "without an index" else IndexType.ALL
            path = write_mcap(path.with_suffix(".mcap"), entries, index_types=index)
        paths.append(path)
    joined = tmp_path / f"the joined{paths[0].suffix}"
    joined.write_bytes(b"".join(path.read_bytes() for path in paths))
    words = f"another file begins at byte {paths[0].stat().st_size};"
    run(refused(joined, words), tmp_path)
    for name, path in zip(("first", "second"), paths, strict=True):
        assert (tmp_path / f"{name}{path.suffix}").read_bytes() == path.read_bytes()
    assert read(tmp_path / f"second{path.suffix}", "/b") == parts[1]


def test_joined_blf(tmp_path: Path) -> None:
    """A cut log of BLF is named; so are joined ones, and the commands of the error split them."""
    can = pytest.importorskip("can")
    contents = []
    for k in range(2):
        with can.BLFWriter(tmp_path / "part.blf") as writer:
            for n in range(200):
                data = bytes([k, n])
                writer(can.Message(1.7e9 + n, 0x123, is_extended_id=False, data=data))
        contents.append((tmp_path / "part.blf").read_bytes())
    path = tmp_path / "cut.blf"
    for missing, bad in ((0, 0), (1, 1), (100, 1)):
        path.write_bytes(contents[0][: len(contents[0]) - missing])
        with open_bags([path]) as bags:
            assert (bags.bad_lines, bags.fault == "the end of the file is missing") == (bad, bad)
    path = tmp_path / "the joined.blf"
    packed = tmp_path / "the joined.blf.gz"
    packed.write_bytes(gzip.compress(b"".join(contents)))
    words = f"another log from byte {len(contents[0])} of its content on; unpack it"
    [unpack] = refused(packed, words)
    subprocess.run([unpack, packed], check=True)
    run(refused(path, f"another file begins at byte {len(contents[0])};"), tmp_path)
    for k, name in enumerate(("first", "second")):
        part = tmp_path / f"{name}.blf"
        assert part.read_bytes() == contents[k]
        with open_bags([part]) as bags:
            [topic] = bags.topics
            [block] = bags.blocks([topic.name])
        payloads = [block.message(row)[-8:-6] for row in range(len(block))]
        assert payloads == [bytes([k, n]) for n in range(200)]


@pytest.mark.parametrize("kept", [1.0, 0.7])
def test_recovery_of_joined_files(tmp_path: Path, kept: float) -> None:
    """Recovery saves the first of joined files, also if it is cut off, and names the second."""
    first = write_mcap(tmp_path / "first.mcap", drive(200)).read_bytes()
    first = first[: int(kept * len(first))]
    second = write_mcap(tmp_path / "b.mcap", drive(300, 500, "/b")).read_bytes()
    joined = tmp_path / "joined.mcap"
    joined.write_bytes(first + second)
    result = recover(joined, tmp_path / "whole.mcap")
    saved = read(tmp_path / "whole.mcap", "/a")
    assert result.saved == {"/a": len(saved)}
    assert saved == drive(len(saved))
    assert len(saved) == 200 if kept == 1.0 else len(saved) > 100
    run(re.findall("`([^`]+)`", result.damages[-1]), tmp_path)
    assert (tmp_path / "second.mcap").read_bytes() == second


def test_only_files_without_an_index_are_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file whose summary lists all messages is read in its place; another one is recovered."""
    copied: list[Path] = []

    def copy(source: Path, output: Path) -> Recovery:
        copied.append(source)
        return recover(source, output)

    monkeypatch.setattr("linkage_vibration.bags.mcap_bag.recover", copy)
    whole = write_mcap(tmp_path / "whole.mcap", drive())
    assert read(whole, "/a") == drive()
    assert copied == []
    without = write_mcap(tmp_path / "without.mcap", drive(), index_types=IndexType.NONE)
    assert read(without, "/a") == drive()
    assert copied == [without]


def test_loose_messages_behind_a_chunk(tmp_path: Path) -> None:
    """Messages behind a chunk that no index lists are not lost in silence."""
    content = write_mcap(tmp_path / "whole.mcap", drive(5)).read_bytes()
    records = split(content[8 : len(content) - 8])
    [chunk] = [each for each in records if each[0] == Opcode.CHUNK]
    body = struct.pack("<HIQQ", 1, 9, 60, 60) + cdr(6.0)
    loose = struct.pack("<BQ", Opcode.MESSAGE, len(body)) + body
    kept = [
        each for each in records if each[0] <= Opcode.MESSAGE_INDEX and each[0] != Opcode.FOOTER
    ]
    footer = struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0)
    end = struct.pack("<BQI", Opcode.DATA_END, 4, 0)
    for more, refusing in ((b"", False), (loose, True)):
        path = tmp_path / f"more_{len(more)}.mcap"
        path.write_bytes(content[:8] + b"".join(kept) + more + end + footer + content[-8:])
        assert chunk in path.read_bytes()
        if refusing:
            refused(path, "is damaged or incomplete")
        else:
            assert read(path, "/a") == drive(5)


def write_ros1(path: Path, entries: list[Entry]) -> Path:
    """Write messages as a bag of ROS 1 with the writer of rosbags."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as bag:
        topics = dict.fromkeys(topic for topic, *_ in entries)
        added = {topic: bag.add_connection(topic, FLOAT, typestore=store) for topic in topics}
        for topic, time, value in entries:
            bag.write(added[topic], time, struct.pack("<d", value))
    return path


def test_chunks_beside_loose_messages(tmp_path: Path) -> None:
    """A file with an index whose first messages are in no chunk is read whole."""
    loose = write_mcap(tmp_path / "loose.mcap", drive(5), use_chunking=False).read_bytes()
    head = split(loose[8:])
    start = b"".join(each for each in head[:8] if each[0] != Opcode.DATA_END)
    whole = write_mcap(tmp_path / "a.mcap", drive(200, 5), use_chunking=True).read_bytes()
    records = split(whole[8 : len(whole) - 8])
    assert [each[0] for each in head[:8]] == [1, 3, 4, 5, 5, 5, 5, 5]
    moved = len(start) - len(records[0])
    changed = []
    for each in records[1:]:
        if each[0] == Opcode.CHUNK_INDEX:
            offset = 9 + 16
            place = int.from_bytes(each[offset : offset + 8], "little") + moved
            size = int.from_bytes(each[offset + 16 : offset + 20], "little")
            entries = each[offset + 20 : offset + 20 + size]
            pairs = struct.iter_unpack("<HQ", entries)
            new = b"".join(struct.pack("<HQ", channel, at + moved) for channel, at in pairs)
            each = (
                each[:offset]
                + struct.pack("<Q", place)
                + each[offset + 8 : offset + 20]
                + new
                + each[offset + 20 + size :]
            )
        if each[0] == Opcode.STATISTICS:
            each = each[:9] + struct.pack("<Q", 205) + each[17:]
        if each[0] == Opcode.FOOTER:
            at = int.from_bytes(each[9:17], "little") + moved
            each = each[:9] + struct.pack("<QQI", at, 0, 0)
        if each[0] == Opcode.DATA_END:
            each = each[:9] + bytes(4)
        changed.append(each)
    path = tmp_path / "mixed.mcap"
    path.write_bytes(whole[:8] + start + b"".join(changed) + whole[-8:])
    assert read(path, "/a") == drive(205)


# The reason is the right one, and its remedy helps.


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize(
    "change",
    [
        lambda about: about.update(storage_identifier=""),
        lambda about: about.update(version=99, topics_with_message_count=["new"]),
        lambda about: about.pop("topics_with_message_count"),
        None,
    ],
    ids=["no identifier", "newer", "without topics", "without metadata"],
)
def test_folders_are_their_files(
    tmp_path: Path, plugin: StoragePlugin, change: Callable[[dict[str, object]], object] | None
) -> None:
    """A bag is read by the suffixes of its files, whatever its metadata.yaml says about them."""
    folder = write_folder(tmp_path / "bag", drive(), plugin)
    metadata = folder / "metadata.yaml"
    if change is None:
        metadata.unlink()
    else:
        content = yaml.safe_load(metadata.read_text())
        change(content["rosbag2_bagfile_information"])
        metadata.write_text(yaml.safe_dump(content))
    assert read(folder, "/a") == drive()


def test_folder_of_several_files(tmp_path: Path) -> None:
    """Without metadata.yaml all files of a folder are read; with it, those that it names."""
    for k in (10, 2, 1):
        write_mcap(tmp_path / f"bag_{k}.mcap", drive(10, 10 * k))
    (tmp_path / "notes.txt").write_text("beside it")
    assert read(tmp_path, "/a") == [*drive(20, 10), *drive(10, 100)]
    about = {"relative_file_paths": ["bag_2.mcap", "bag_10.mcap"], "version": 9}
    text = yaml.safe_dump({"rosbag2_bagfile_information": about})
    (tmp_path / "metadata.yaml").write_text(text)
    assert read(tmp_path, "/a") == [*drive(10, 20), *drive(10, 100)]


@pytest.mark.parametrize("text", ["", "a: [", "\xff", "- b.txt\n"])
def test_metadata_that_is_damaged(tmp_path: Path, text: str) -> None:
    """A bag whose metadata.yaml lists none of its files is read without it."""
    folder = write_folder(tmp_path / "bag", drive(), StoragePlugin.MCAP)
    (folder / "metadata.yaml").write_text(text, encoding="latin-1")
    assert read(folder, "/a") == drive()


def test_file_that_is_missing(tmp_path: Path) -> None:
    """A file that metadata.yaml lists, but that is not in the folder, is named."""
    folder = write_folder(tmp_path / "bag", drive(), StoragePlugin.MCAP)
    (folder / "bag.mcap").rename(folder / "other.mcap")
    refused(folder, r"There is no bag .*bag/bag\.mcap; check the path")
    (folder / "other.mcap").rename(folder / "bag.mcap")
    assert read(folder, "/a") == drive()


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compression_of_rosbag2(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
) -> None:
    """Bags whose files or messages rosbag2 has compressed are read; a file also by itself."""
    packed = {"mode": mode, "fmt": CompressionFormat.ZSTD}
    folder = write_folder(tmp_path / "bag", drive(), plugin, **packed)
    assert read(folder, "/a") == drive()
    if mode == CompressionMode.FILE:
        [file] = folder.glob("*.zstd")
        assert read(file, "/a") == drive()


def test_file_of_zstd(tmp_path: Path) -> None:
    """A file that was compressed by hand is read; one that is cut off is damaged."""
    content = write_mcap(tmp_path / "a.mcap", drive()).read_bytes()
    path = tmp_path / "b.mcap.zstd"
    path.write_bytes(zstandard.compress(content))
    assert read(path, "/a") == drive()
    path.write_bytes(zstandard.compress(content)[:-50])
    refused(path, "b.mcap.zstd is damaged or incomplete")


def foreign(path: Path, channels: list[tuple[str, str, str, bytes, bytes]], name: str) -> Path:
    """Write one message on each channel: topic, its encoding, that of its type, type, message."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("", "another program")
        for k, (topic, encoding, kind, text, data) in enumerate(channels):
            schema = writer.register_schema(name, kind, text) if kind else 0
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, k + 1, data, k + 1)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize(
    ("encoding", "kind"),
    [("json", "jsonschema"), ("json", ""), ("wrong_format", "ros2msg"), ("cdr", "protobuf")],
)
def test_foreign_topic_beside_ros(tmp_path: Path, encoding: str, kind: str) -> None:
    """The other topics are read; the error of this one, and of it alone, says what it holds."""
    other = ("/other", encoding, kind, TEXT, b'{"data": 1.5}')
    path = foreign(tmp_path / "a.mcap", [other, ("/a", "cdr", "ros2msg", TEXT, cdr(2.0))], FLOAT)
    assert read(path, "/a") == [("/a", 2, 2.0)]
    what = kind if encoding == "cdr" else encoding
    assert topic_types(path)["/other"] == f"{what} messages"
    with pytest.raises(BagError, match=f"/other .* {what} messages"):
        read_columns(path, {"/other": FLOAT})
    alone = foreign(tmp_path / "b.mcap", [other], FLOAT)
    refused(alone, f"/other holds {what} messages; write them as messages of ROS 2 in CDR")
    foreign(alone, [("/other", "cdr", "ros2msg", TEXT, cdr(1.5))], FLOAT)
    assert read(alone, "/other") == [("/other", 1, 1.5)]


def test_another_serialization_in_a_database(tmp_path: Path) -> None:
    """The topic of a database with another serialization is named, and the other one is read."""
    entries = [*drive(5), *drive(5, 5, "/b")]
    [file] = write_folder(tmp_path / "bag", entries, StoragePlugin.SQLITE3).glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.execute("UPDATE topics SET serialization_format = 'protobuf' WHERE name = '/b'")
        database.commit()
    assert read(tmp_path / "bag", "/a") == drive(5)
    assert topic_types(file) == {"/a": FLOAT, "/b": "protobuf messages"}


@pytest.mark.parametrize("name", ["std_msgs/Float64", "std_msgs/msg/Float64"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_definitions_of_other_programs(tmp_path: Path, name: str, end: str) -> None:
    """Short names of types, and definitions with the ends of lines of Windows, are read."""
    text = f"# a number{end}{end}float64 data{end}".encode()
    path = foreign(tmp_path / "a.mcap", [("/a", "cdr", "ros2msg", text, cdr(2.0))], name)
    assert topic_types(path) == {"/a": FLOAT}
    np.testing.assert_array_equal(read_columns(path, {"/a": FLOAT})["/a"]["data"], [2.0])


def test_statistics_without_counts(tmp_path: Path) -> None:
    """Messages are counted by their index where the statistics do not count them by channels."""
    path = write_mcap(tmp_path / "a.mcap", [*drive(70), *drive(30, 70, "/b")])

    def uncounted(summary: bytes) -> bytes:
        parts = split(summary)
        for k, each in enumerate(parts):
            if each[0] == Opcode.STATISTICS:
                body = each[9 : 9 + 42] + bytes(4)
                parts[k] = struct.pack("<BQ", Opcode.STATISTICS, len(body)) + body
        return b"".join(parts)

    path.write_bytes(with_summary(path.read_bytes(), uncounted))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.channel_message_counts == {}
    with open_bags([path]) as bags:
        assert {topic.name: topic.count for topic in bags.topics} == {"/a": 70, "/b": 30}


def test_two_definitions_of_one_type(tmp_path: Path) -> None:
    """The error of one file says to separate its channels, and that of two files to read each."""
    new = b"float64 data\nfloat64 more\n"
    both = [("/a", "cdr", "ros2msg", text, cdr(2.0) + bytes(8)) for text in (TEXT, new)]
    path = foreign(tmp_path / "a.mcap", both, FLOAT)
    words = r"define the type of topic /a in different ways; write the messages of each channel"
    with open_bags([path]) as bags, pytest.raises(BagError, match=words):
        bags.defined("/a")
    apart = [foreign(tmp_path / f"{k}.mcap", [each], FLOAT) for k, each in enumerate(both)]
    for each in apart:
        np.testing.assert_array_equal(read_columns(each, {"/a": FLOAT})["/a"]["data"], [2.0])
    words = r"0\.mcap and .*1\.mcap define .* different ways; read each recording by itself"
    with open_bags(apart) as bags, pytest.raises(BagError, match=words):
        bags.defined("/a")


def test_ros_1_in_mcap(tmp_path: Path) -> None:
    """Messages of ROS 1 in an MCAP file are read as those of a bag of ROS 1 are."""
    store = get_typestore(Stores.ROS1_NOETIC)
    header = store.types["std_msgs/msg/Header"](
        seq=1, stamp=store.types["builtin_interfaces/msg/Time"](sec=3, nanosec=4), frame_id="x"
    )
    state = store.types[JOINT_STATE](
        header, ["hitch", "boom"], np.array([1.0, 2.0]), np.zeros(0), np.zeros(0)
    )
    text, digest = store.generate_msgdef(JOINT_STATE)
    data = bytes(store.serialize_ros1(state, JOINT_STATE))
    with Writer1(tmp_path / "a.bag") as bag:
        bag.write(bag.add_connection("/s", JOINT_STATE, msgdef=text, md5sum=digest), 1, data)
    message = ("/s", "ros1", "ros1msg", text.encode(), data)
    foreign(tmp_path / "a.mcap", [message], "sensor_msgs/JointState")
    found = []
    for path in (tmp_path / "a.bag", tmp_path / "a.mcap"):
        with open_bags([path]) as bags:
            [block] = bags.blocks(["/s"])
            found.append((bags.topics, bags.defined("/s"), block.message(0)))
    assert found[0] == found[1]
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    decoded = jazzy.deserialize_cdr(found[1][2], JOINT_STATE)
    assert (decoded.header.stamp.sec, decoded.name) == (3, ["hitch", "boom"])  # type: ignore[attr-defined]


def test_remedy_of_a_cut_database(tmp_path: Path) -> None:
    """The command of the error makes a database of the rest, which is read."""
    require("sqlite3")
    [file] = write_folder(tmp_path / "bag", drive(3000), StoragePlugin.SQLITE3).glob("*.db3")
    content = file.read_bytes()
    path = tmp_path / "a cut one.db3"
    path.write_bytes(content[: len(content) // 2])
    run(refused(path, "is damaged or incomplete"), tmp_path)
    saved = read(tmp_path / "whole.db3", "/a")
    assert {*saved} <= {*drive(3000)}
    assert 0.2 * 3000 < len(saved) < 3000


def test_remedy_of_a_cut_mcap(tmp_path: Path) -> None:
    """The command of the error makes a file of the rest, which is read."""
    path = tmp_path / "a cut one.mcap"
    path.write_bytes(write_mcap(tmp_path / "a.mcap", drive()).read_bytes()[:-5000])
    run(refused(path, "is damaged or incomplete"), tmp_path)
    saved = read(tmp_path / "a cut one_recovered.mcap", "/a")
    assert saved == drive(len(saved))
    assert 20 < len(saved) < 200


SPARSE: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys((".mcap", ".bag", ".db3", ".log", ".asc", ".trc", ".blf", ".mf4"), read),
    ".yaml": read_mechanism,
    ".csv": read_recording,
    ".npz": read_matrices,
    ".uff": read_frfs,
    ".dbc": lambda path: dbc_signal(path, "M.S"),
}


@pytest.mark.parametrize("suffix", SPARSE)
def test_holes_in_any_file(tmp_path: Path, suffix: str) -> None:
    """A file of zeros, which a file system need not store, is refused within a second."""
    for name in ("can", "cantools", "pyuff"):  # whose imports take longer
        pytest.importorskip(name)
    path = tmp_path / f"zeros{suffix}"
    with path.open("wb") as file:
        file.truncate(10 * 2**30)
    begin = time.process_time()
    with pytest.raises(LinkageVibrationError, match=rf"zeros\{suffix}.* (is|has|holds|does) "):
        SPARSE[suffix](path)
    assert time.process_time() - begin < 1.0


def test_active_bag(tmp_path: Path) -> None:
    """A bag of ROS 1 that was not closed is named as such, with the tool that completes it."""
    path = tmp_path / "a.bag.active"
    content = write_ros1(tmp_path / "a.bag", drive()).read_bytes()
    assert content.count(b"index_pos=") == 1
    at = content.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(content[:at] + bytes(8) + content[at + 8 :])
    assert refused(path, "is damaged or incomplete.*not indexed") == [f"rosbag reindex {path}"]
