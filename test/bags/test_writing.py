# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The MCAP log: its content, its readers, and its failures."""

import resource
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.writing import (
    COMPRESSIONS,
    Attachment,
    LogError,
    Topic,
    offered_qos_profiles,
)
from linkage_vibration.messages.definitions import message_definition, type_hash
from test.support.messages import plain

JOINT_STATE = "sensor_msgs/msg/JointState"
PREDICTION = "linkage_vibration_interfaces/msg/VibrationPrediction"
START = 1_767_225_600 * 10**9  # ns


def topic(name: str, type_name: str) -> Topic:
    """Return a topic as in the logs of the node."""
    return Topic(
        name=name,
        type=type_name,
        definition=message_definition(type_name),
        type_hash=type_hash(type_name),
        offered_qos_profiles=offered_qos_profiles(),
    )


TOPICS = [topic("/joint_states", JOINT_STATE), topic("/linkage_vibration/prediction", PREDICTION)]


def messages(count: int) -> list[tuple[str, Any, bytes, int]]:
    """Return alternating joint states and predictions: (topic, message, CDR, log time)."""
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(message_definition(PREDICTION), PREDICTION))
    random = np.random.default_rng(5)
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    result = []
    for k in range(count):
        at = header(stamp=stamp(sec=1_767_225_600 + k // 100, nanosec=k % 100 * 10**7), frame_id="")
        joint_state = store.types[JOINT_STATE](
            header=at,
            name=["steering", "hitch"][: 1 + k % 2],
            position=random.normal(size=1 + k % 2),
            velocity=np.array([]),
            effort=np.full(1 + k % 2, np.nan),
        )
        prediction = store.types[PREDICTION](
            header=at,
            crank_angle=2.0 + k,
            status=k % 3,
            natural_frequencies=random.normal(size=3),
            frequency_stddevs=random.normal(size=3),
            damping_ratios=random.normal(size=3),
            damping_ratio_stddevs=random.normal(size=3),
            frf_peak_frequency=random.normal(),
            frf_peak_magnitude=np.nan,
            interpolation_error=random.normal(),
            table_id=f"table {k}",
        )
        time = START + k * 10**7
        for topic_, message, type_name in zip(
            TOPICS, (joint_state, prediction), (JOINT_STATE, PREDICTION), strict=True
        ):
            cdr = bytes(store.serialize_cdr(message, type_name))
            result.append((topic_.name, message, cdr, time + len(result)))
    return result


def write(path: Path, count: int, attachments: tuple[Attachment, ...] = ()) -> list[Any]:
    """Write a log and return its messages."""
    written = messages(count)
    with LogWriter(path, TOPICS, attachments) as log:
        for name, _, cdr, time in written:
            log.write(name, cdr, time, time - 1000)
    assert log.written == len(written)
    return written


def read_with_mcap_ros2(path: Path) -> list[tuple[str, int, int, Any]]:
    """Return the messages that mcap-ros2-support reads."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, raw.log_time, raw.publish_time, message)
            for _, channel, raw, message in reader.iter_decoded_messages()
        ]


def test_mcap_ros2_support_reads_every_message(tmp_path: Path) -> None:
    """mcap-ros2-support reads each message with its values and times, in order."""
    written = write(tmp_path / "log.mcap", 500)
    read = read_with_mcap_ros2(tmp_path / "log.mcap")
    assert len(read) == 1000
    assert [(name, log_time, sent, plain(message)) for name, log_time, sent, message in read] == [
        (name, time, time - 1000, plain(message)) for name, message, _, time in written
    ]


def test_rosbags_reads_every_message(tmp_path: Path) -> None:
    """Rosbags reads each message with the definitions in the file."""
    written = write(tmp_path / "log.mcap", 500)
    with AnyReader([tmp_path / "log.mcap"]) as reader:
        read = [
            (c.topic, time, bytes(data), plain(reader.deserialize(data, c.msgtype)))
            for c, time, data in reader.messages()
        ]
    assert len(read) == 1000
    assert read == [(name, time, cdr, plain(message)) for name, message, cdr, time in written]


def test_ros2_profile(tmp_path: Path) -> None:
    """The log has profile, schemas, channel metadata, statistics and indexes."""
    written = write(tmp_path / "log.mcap", 2000)
    with (tmp_path / "log.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(written)
        assert summary.statistics.message_start_time == START
        assert summary.statistics.message_end_time == written[-1][3]
        assert [(s.name, s.encoding) for s in summary.schemas.values()] == [
            (t.type, "ros2msg") for t in TOPICS
        ]
        assert [s.data.decode() for s in summary.schemas.values()] == [t.definition for t in TOPICS]
        for channel, topic_ in zip(summary.channels.values(), TOPICS, strict=True):
            assert (channel.topic, channel.message_encoding) == (topic_.name, "cdr")
            assert channel.metadata == {
                "offered_qos_profiles": topic_.offered_qos_profiles,
                "topic_type_hash": topic_.type_hash,
            }
        assert len(summary.chunk_indexes) > 1
        for chunk in summary.chunk_indexes:
            assert chunk.uncompressed_size < 128 * 1024
            assert set(chunk.message_index_offsets) == set(summary.channels)


def test_rosbag2_metadata(tmp_path: Path) -> None:
    """The record of rosbag2 has the keys that it requires, and the version of integer policies.

    By its source (`mcap_storage.cpp`), rosbag2 takes all else from the summary.
    """
    write(tmp_path / "log.mcap", 30)
    with (tmp_path / "log.mcap").open("rb") as file:
        [record] = [m for m in make_reader(file).iter_metadata() if m.name == "rosbag2"]
    metadata = yaml.safe_load(record.metadata["serialized_metadata"])
    assert metadata["version"] == 7
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["topics_with_message_count"] == []


@pytest.mark.parametrize("latched", [True, False])
def test_offered_qos(tmp_path: Path, latched: bool) -> None:
    """An independent reader understands the QoS, and its policies are integers."""
    text = offered_qos_profiles(latched=latched)
    assert {type(yaml.safe_load(text)[0][key]) for key in ("history", "reliability")} == {int}
    first = Topic("/a", JOINT_STATE, message_definition(JOINT_STATE), "", text)
    LogWriter(tmp_path / "log.mcap", [first]).close()
    with Reader(tmp_path / "log.mcap") as reader:
        [qos] = reader.connections[0].ext.offered_qos_profiles  # type: ignore[union-attr]
    assert qos.history is QosHistory.KEEP_LAST
    assert qos.depth == 1000
    assert qos.reliability is QosReliability.RELIABLE
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    assert qos.durability is durability
    assert qos.liveliness is QosLiveliness.AUTOMATIC
    # RMW_DURATION_INFINITE of rmw/time.h
    assert (qos.deadline.sec, qos.deadline.nsec) == (9223372036, 854775807)


def test_attachments(tmp_path: Path) -> None:
    """Attachments are read byte for byte."""
    table = Attachment("table.npz", "application/x-npz", bytes(range(256)) * 1000)
    mechanism = Attachment("linkage.yaml", "application/yaml", b"name: linkage\n")
    write(tmp_path / "log.mcap", 3, (table, mechanism))
    with (tmp_path / "log.mcap").open("rb") as file:
        actual = list(make_reader(file).iter_attachments())
    assert [Attachment(a.name, a.media_type, a.data) for a in actual] == [table, mechanism]


def test_log_without_messages_opens(tmp_path: Path) -> None:
    """A node that received nothing leaves a valid empty log."""
    write(tmp_path / "log.mcap", 0)
    with AnyReader([tmp_path / "log.mcap"]) as reader:
        assert [c.topic for c in reader.connections] == [t.name for t in TOPICS]
        assert list(reader.messages()) == []


def test_times_before_1970_are_logged_as_zero(tmp_path: Path) -> None:
    """A negative stamp, which MCAP cannot store, does not stop the log."""
    [(name, _, cdr, _), *_] = messages(1)
    with LogWriter(tmp_path / "log.mcap", TOPICS) as log:
        log.write(name, cdr, log_time=5, publish_time=-3)
    [(_, log_time, publish_time, _)] = read_with_mcap_ros2(tmp_path / "log.mcap")
    assert (log_time, publish_time) == (5, 0)


def test_full_disk(tmp_path: Path) -> None:
    """If the file cannot grow, the error names the remedy, and what was written is readable."""
    path = tmp_path / "log.mcap"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
    try:
        with (
            pytest.raises(LogError, match=f"linkage-vibration recover {path}"),
            LogWriter(path, TOPICS) as log,
        ):
            for name, _, cdr, time in messages(3000):
                log.write(name, cdr, time, time)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    readable = 0
    with path.open("rb") as file, pytest.raises(EndOfFile):
        for record in StreamReader(file).records:
            readable += isinstance(record, Message)
    assert 0 < readable == log.written


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("per_chunk", [1, 40])
def test_size_is_a_close_bound(tmp_path: Path, compression: str, per_chunk: int) -> None:
    """The file is never larger than `size`, whatever its chunks contain."""
    random = np.random.default_rng(2)
    with LogWriter(tmp_path / "log.mcap", TOPICS, compression=compression) as log:
        for k in range(400):
            log.write(TOPICS[k % 2].name, random.bytes(int(random.integers(4, 500))), k, k)
            if k % per_chunk == 0:
                log.flush()
                log.add_metadata(f"record {k}", {"key": "value"})
        bound = log.size
    size = (tmp_path / "log.mcap").stat().st_size
    assert size <= bound
    # The bound counts definitions, whose length depends on the distribution of ROS 2, for a chunk
    # and two records that are complete here. It is loose if every message has indexes of its own.
    definitions = 3 * sum(len(topic.definition) for topic in TOPICS)
    assert bound - size - definitions < (68_000 if per_chunk == 1 else 18_000)


def test_removed_file(tmp_path: Path) -> None:
    """Deleting a log during its recording is an error."""
    [(name, _, cdr, time), *_] = messages(1)
    with (
        pytest.raises(LogError, match=r"log\.mcap was removed"),
        LogWriter(tmp_path / "log.mcap", TOPICS) as log,
    ):
        log.write(name, cdr, time, time)
        (tmp_path / "log.mcap").unlink()
        log.flush()
    assert (log.written, log.held) == (0, 1)


def test_full_disk_at_the_beginning(tmp_path: Path) -> None:
    """A disk without room for the beginning of a log has no incomplete file."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(LogError, match=r"File too large; make room on its disk\."):
            LogWriter(tmp_path / "log.mcap", TOPICS)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_existing_file_is_kept(tmp_path: Path) -> None:
    """A log never replaces a file."""
    (tmp_path / "log.mcap").write_text("precious")
    with pytest.raises(LogError, match="exists already"):
        LogWriter(tmp_path / "log.mcap", TOPICS)
    assert (tmp_path / "log.mcap").read_text() == "precious"


def test_missing_folder(tmp_path: Path) -> None:
    """The error names the file and the fix."""
    with pytest.raises(
        LogError, match=r"nowhere/log\.mcap cannot be created.*choose a writable folder"
    ):
        LogWriter(tmp_path / "nowhere" / "log.mcap", TOPICS)
