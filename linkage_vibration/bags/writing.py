# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes serialized ROS 2 messages to MCAP files that rosbag2, Foxglove and rosbags open."""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from linkage_vibration.errors import LinkageVibrationError

# A chunk is compressed and written at once, so its size limits how long `write` can take.
CHUNK_BYTES = 64 * 1024
# Queue of the node's topics, also in the QoS of a log: a second of joint states at 1 kHz, so that a
# short stall of the machine loses none. A queue of 100 lost 0.6 % in an hour on a machine whose
# load was three times its number of cores.
QUEUE_DEPTH = 1000
# The newest version of rosbag2 metadata with integer policies, see offered_qos_profiles.
ROSBAG2_METADATA_VERSION = 7
LIBRARY = f"linkage_vibration {LIBRARY_IDENTIFIER}"  # what the header of a log names
ROSBAG2_METADATA = "rosbag2"  # the name of its record
COMPRESSIONS = tuple(kind.name.lower() for kind in CompressionType)

# Greatest number of bytes that MCAP adds for a message with its index; for a chunk with its two
# indexes, and for each channel in it; for an attachment or metadata in the summary, without its
# name; and for the summary.
_PER_MESSAGE = 47
_PER_CHUNK, _PER_CHUNK_CHANNEL = 160, 25
_PER_INDEX = 64
_PER_SUMMARY = 1024


class LogError(LinkageVibrationError):
    """A log cannot be created or written."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log.

    Attributes
    ----------
    name, type : str
        Its absolute name, and the full name of its message type, such as ``std_msgs/msg/Float64``.
    definition : str
        The ``ros2msg`` text of the type with its dependencies, see `message_definition`.
    type_hash, offered_qos_profiles : str
        Hash of the type and QoS of the publishers, see the functions of these names.
    """

    name: str
    type: str
    definition: str
    type_hash: str
    offered_qos_profiles: str

    def metadata(self) -> dict[str, str]:
        """Return what rosbag2 stores with the channel."""
        qos = self.offered_qos_profiles
        return {"offered_qos_profiles": qos, "topic_type_hash": self.type_hash}


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file that is stored in a log.

    Attributes
    ----------
    name, media_type : str
        Name and media type of the file, such as ``application/yaml``.
    data : bytes
        Its content.
    """

    name: str
    media_type: str
    data: bytes


def offered_qos_profiles(*, reliable: bool, depth: int, latched: bool = False) -> str:
    """Return the QoS of one keep-last publisher as the YAML list that rosbag2 stores.

    The policies are the integers of ``rmw/types.h``, as rosbag2 wrote them up to Iron. Humble and
    Iron read only these; Jazzy and later read both these and names.

    Parameters
    ----------
    reliable : bool
        Whether the publisher is reliable or best effort.
    depth : int
        Number of messages that it keeps.
    latched : bool
        Whether it is transient local or volatile.
    """
    infinite = dict(zip(("sec", "nsec"), divmod(2**63 - 1, 10**9), strict=True))
    profile = {
        "history": 1,
        "depth": depth,
        "reliability": 1 if reliable else 2,
        "durability": 1 if latched else 2,
        "deadline": infinite.copy(),  # a copy, as YAML would refer to an object that it has already
        "lifespan": infinite.copy(),
        "liveliness": 1,
        "liveliness_lease_duration": infinite,
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


def rosbag2_metadata(
    path: Path, topics: Sequence[Topic], counts: Sequence[int], first_time: int, last_time: int
) -> dict[str, str]:
    """Return the content of the record `ROSBAG2_METADATA` that rosbag2 stores in its MCAP files.

    Parameters
    ----------
    path : Path
        The log, of which the name is stored.
    topics, counts : sequence
        Its topics, and the number of messages of each.
    first_time, last_time : int
        Least and greatest log time, ns; 0 if there are no messages.
    """
    metadata = {
        "version": ROSBAG2_METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": last_time - first_time},
        "starting_time": {"nanoseconds_since_epoch": first_time},
        "message_count": sum(counts),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.offered_qos_profiles,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": count,
            }
            for topic, count in zip(topics, counts, strict=True)
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [path.name],
        "files": [],
        "custom_data": {},
    }
    return {"serialized_metadata": yaml.safe_dump(metadata, sort_keys=False)}


class LogWriter:
    """An MCAP log that is being written; only opening it raises, so that predictions continue.

    Messages are gathered in chunks of 64 KiB. zstd compresses joint states and predictions to a
    third, in 0.4 ms for each chunk, and every reader of MCAP supports it. The owner of the log
    calls `flush` once a second, so that a killed process loses one second of messages or less. Not
    thread-safe.

    Parameters
    ----------
    path : Path
        The file to create; its folder must exist.
    topics, attachments : sequence of Topic, of Attachment
        Topics of the log, and files to store in it.
    compression : str
        Compression of chunks, one of `COMPRESSIONS`.

    Attributes
    ----------
    error : LogError or None
        The first failure, after which nothing is written.
    written, dropped : int
        Numbers of messages that the operating system has received, and that the failure lost.

    Raises
    ------
    LogError
        If the compression is unknown, or the file exists or cannot be created.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        attachments: Sequence[Attachment] = (),
        compression: str = "zstd",
    ) -> None:
        self.path = path
        self.error: LogError | None = None
        self.written = self.dropped = 0
        self._topics: list[Topic] = []
        self._counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._first_time = self._last_time = 0
        self._held = self._held_bytes = 0
        self._definition_bytes = self._index_bytes = self._chunks = 0
        if compression not in COMPRESSIONS:
            raise LogError(
                f"Logs have no compression {compression!r}; use one of {', '.join(COMPRESSIONS)}."
            )
        try:
            self._stream = path.open("xb")
        except FileExistsError:
            raise LogError(
                f"{path} exists already; choose another name, as a log never replaces a file."
            ) from None
        except OSError as error:
            raise LogError(
                f"{path} cannot be created: {error.strerror}; choose a writable folder."
            ) from None
        # Only `flush` ends a chunk, so that the messages that a failure loses can be counted.
        kind = CompressionType[compression.upper()]
        self._writer = Writer(self._stream, chunk_size=2**63, compression=kind)
        self._begin(topics, attachments)
        if self.error is not None:
            self.close()
            with contextlib.suppress(OSError):
                path.unlink()
            raise self.error

    @property
    def messages(self) -> int:
        """Number of messages that are in the file or in its next chunk."""
        return self.written + self._held

    @property
    def size(self) -> int:
        """Greatest number of bytes that the file would have if it were closed now."""
        closing = self._index_bytes + _PER_SUMMARY
        # Definitions occur in the first chunk, in the summary, and in part in a rosbag2 record.
        closing += 3 * self._definition_bytes
        chunk = _PER_CHUNK + _PER_CHUNK_CHANNEL * len(self._topics)
        held = self._held_bytes + self._held * _PER_MESSAGE
        # Data that cannot be compressed grow by less than 1 %.
        return self._stream.tell() + held + held // 100 + closing + (self._chunks + 1) * chunk

    def add_topic(self, topic: Topic) -> None:
        """Add a topic, unless the log has it already."""
        if topic.name in self._channels or self.error is not None:
            return
        definition = (topic.type, topic.definition)
        records = RecordBuilder()
        if definition not in self._schemas:
            data = topic.definition.encode()
            self._schemas[definition] = self._writer.register_schema(topic.type, "ros2msg", data)
            Schema(self._schemas[definition], data, "ros2msg", topic.type).write(records)
        schema = self._schemas[definition]
        metadata = topic.metadata()
        channel = self._writer.register_channel(topic.name, "cdr", schema, metadata)
        Channel(channel, topic.name, "cdr", metadata, schema).write(records)
        self._topics.append(topic)
        self._channels[topic.name] = channel
        self._counts[topic.name] = 0
        # The writer puts the definitions into one chunk. They are written outside of it as well,
        # so that the other chunks can be read without that one.
        data = records.end()  # type: ignore[no-untyped-call]
        self._definition_bytes += len(data)
        with self._failures():
            self._stream.write(data)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record; it does not replace an earlier one of the same name.

        Parameters
        ----------
        name : str
            Name of the record.
        data : mapping of str to str
            Its content.
        """
        if self.error is None:
            with self._failures():
                self._writer.add_metadata(name, dict(data))
                self._index_bytes += _PER_INDEX + len(name.encode())

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add a message, or count it as dropped after a failure.

        Parameters
        ----------
        topic : str
            Name of a topic of the log.
        data : bytes
            The message in CDR, with its encapsulation header.
        log_time, publish_time : int
            Times of receiving and of sending, ns.
        """
        if self.error is not None:
            self.dropped += 1
            return
        # MCAP has unsigned times, but the seconds of a ROS stamp are signed.
        log_time, publish_time = max(log_time, 0), max(publish_time, 0)
        empty = self.messages == 0
        self._first_time = log_time if empty else min(self._first_time, log_time)
        self._last_time = max(self._last_time, log_time)
        self._writer.add_message(
            self._channels[topic], log_time, data, publish_time, self._counts[topic] % 2**32
        )
        self._counts[topic] += 1
        self._held += 1
        self._held_bytes += len(data)
        if self._held_bytes >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the operating system; a killed process then loses none of them."""
        if self.error is None:
            with self._failures():
                self._writer.flush()  # type: ignore[no-untyped-call]
                if os.fstat(self._stream.fileno()).st_nlink == 0:
                    self._fail(FileNotFoundError())
                    return
                self._chunks += self._held > 0
                self.written += self._held
                self._held = self._held_bytes = 0

    def sync(self) -> None:
        """Wait until the disk has all flushed messages; a power failure then loses none of them."""
        if self.error is None:
            with self._failures():
                os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Write the indexes and close the file; a failure is stored in `error`, not raised."""
        if self._stream.closed:
            return
        self.flush()
        with self._failures():
            # After a failure the file ends in an incomplete chunk, to which no index may point.
            if self.error is None:
                self._add_rosbag2_metadata()
                self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.close()

    def __enter__(self) -> "LogWriter":
        """Return the log itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the log."""
        self.close()

    def _begin(self, topics: Sequence[Topic], attachments: Sequence[Attachment]) -> None:
        with self._failures():
            self._writer.start(profile="ros2", library=LIBRARY)
            for topic in topics:
                self.add_topic(topic)
            for attachment in attachments:
                name, kind = attachment.name, attachment.media_type
                self._writer.add_attachment(0, 0, name, kind, attachment.data)
                self._index_bytes += _PER_INDEX + len((name + kind).encode())
            self._writer.flush()  # type: ignore[no-untyped-call]

    def _add_rosbag2_metadata(self) -> None:
        counts = [self._counts[topic.name] for topic in self._topics]
        self._writer.add_metadata(
            ROSBAG2_METADATA,
            rosbag2_metadata(self.path, self._topics, counts, self._first_time, self._last_time),
        )

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        """Store a failure inside of this context as the log's error."""
        try:
            yield
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.dropped += self._held
        self._held = self._held_bytes = 0
        if self.error is not None:
            return
        if isinstance(error, FileNotFoundError):
            self.error = LogError(
                f"{self.path} was removed during the recording; keep the log until it is complete."
            )
        else:
            repair = f", and complete this log with `linkage-vibration recover {self.path}`"
            self.error = LogError(
                f"{self.path} could not be written any further: {error.strerror}; make room on its "
                f"disk{repair if self.written else ''}."
            )
