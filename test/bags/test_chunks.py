# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Logs written by the chunk equal those written message by message."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from linkage_vibration.bags.log_writer import ChunkLog, LogWriter, Messages
from linkage_vibration.bags.writing import Attachment, Topic, offered_qos_profiles

QOS = offered_qos_profiles()
TOPICS = [
    Topic(name, "std_msgs/msg/Float64", "float64 data\n", "RIHS01_0", QOS) for name in ("/a", "/b")
]
TOPICS.append(Topic("/c", "std_msgs/msg/String", "string data\n", "RIHS01_1", QOS))
ATTACHMENTS = [Attachment("model.yaml", "application/yaml", b"name: one\n" * 100)]


def chunks(count: int) -> list[list[Messages]]:
    """Return messages of three topics and several sizes with their places."""
    rng = np.random.default_rng(1)
    actual = []
    for number in range(count):
        chunk = []
        places = rng.permutation(300)
        for name, size, some in (
            ("/a", 12, places[:100]),
            ("/b", 12, places[100:150]),
            ("/c", 9, places[150:250]),
            ("/c", 30, places[250:]),
        ):
            data = rng.integers(0, 256, (len(some), size)).astype(np.uint8)
            times = 1000 * number + some
            chunk.append(Messages(name, data, some, times, times + 5))
        actual.append(chunk)
    return actual


def written(path: Path) -> Path:
    """Write a log by the chunk."""
    with ChunkLog(path, TOPICS, ATTACHMENTS, {"about": {"key": "value"}}) as log:
        for chunk in chunks(5):
            log.write(chunk)
    return path


def one_by_one(path: Path) -> Path:
    """Write the same with the writer of mcap."""
    with LogWriter(path, TOPICS, ATTACHMENTS) as log:
        log.add_metadata("about", {"key": "value"})
        for chunk in chunks(5):
            entries = [
                (int(some.place[i]), some.topic, some.data[i].tobytes(), int(some.log_times[i]))
                for some in chunk
                for i in range(len(some.place))
            ]
            for _, topic, data, time in sorted(entries):
                log.write(topic, data, time, time + 5)
    return path


def test_as_mcaps_own_writer(tmp_path: Path) -> None:
    """Messages, times, definitions and counts are those of the writer of mcap."""
    contents = []
    for path in (written(tmp_path / "ours.mcap"), one_by_one(tmp_path / "theirs.mcap")):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            messages = [
                (channel.topic, message.data, message.log_time, message.publish_time)
                for _, channel, message in reader.iter_messages()
            ]
            in_file = [m.data for *_, m in reader.iter_messages(log_time_order=False)]
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            counts = summary.statistics.channel_message_counts
            channels = {c.topic: (c.metadata, counts[c.id]) for c in summary.channels.values()}
            schemas = {(s.name, s.data, s.encoding) for s in summary.schemas.values()}
            attachments = list(reader.iter_attachments())
            names = {record.name for record in reader.iter_metadata()}
        contents.append((messages, in_file, channels, schemas, attachments, names))
    assert contents[0] == contents[1]


def test_rosbags_reads_it(tmp_path: Path) -> None:
    """Rosbags reads every message, and its checksums are correct."""
    with Reader(written(tmp_path / "log.mcap")) as bag:
        actual = {
            topic: sum(1 for _ in bag.messages([c for c in bag.connections if c.topic == topic]))
            for topic in ("/a", "/b", "/c")
        }
        assert (bag.start_time, bag.end_time) == (0, 4300)
    assert actual == {"/a": 500, "/b": 250, "/c": 750}


def test_empty_log(tmp_path: Path) -> None:
    """A log without messages is valid."""
    with ChunkLog(tmp_path / "log.mcap", TOPICS, [], {}) as log:
        log.write([])
    with Reader(tmp_path / "log.mcap") as bag:
        assert (len(bag.connections), bag.message_count) == (3, 0)


def test_a_full_disk_is_an_error(tmp_path: Path) -> None:
    """A failure is raised at the next write or at the end."""
    log = ChunkLog(tmp_path / "log.mcap", TOPICS, [], {})
    log._file.stream.close()
    log._file.stream = open("/dev/full", "wb", buffering=0)  # noqa: SIM115
    with pytest.raises(OSError, match="No space left"), log:
        for chunk in chunks(3):
            log.write(chunk)
