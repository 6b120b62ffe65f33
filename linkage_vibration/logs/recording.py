# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes serialized ROS 2 messages to an MCAP file that rosbag2, Foxglove and rosbags open."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import yaml
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from linkage_vibration.errors import LinkageVibrationError

# A chunk is compressed and written in one go, so its size bounds how long `write` can stall.
CHUNK_BYTES = 64 * 1024
# The newest version of rosbag2's metadata whose policies are integers, see offered_qos_profiles.
ROSBAG2_METADATA_VERSION = 7


class LogError(LinkageVibrationError):
    """A log could not be created or written."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log.

    Attributes
    ----------
    name : str
        Absolute name, such as ``/joint_states``.
    type : str
        Full name of its message type, such as ``sensor_msgs/msg/JointState``.
    definition : str
        The type's ``ros2msg`` text with its dependencies, see `message_definition`.
    type_hash : str
        The type's hash, see `type_hash`.
    offered_qos_profiles : str
        What its publishers offer, see `offered_qos_profiles`.
    """

    name: str
    type: str
    definition: str
    type_hash: str
    offered_qos_profiles: str


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file kept inside a log.

    Attributes
    ----------
    name : str
        File name.
    media_type : str
        Media type, such as ``application/yaml``.
    data : bytes
        The file's content.
    """

    name: str
    media_type: str
    data: bytes


def offered_qos_profiles(*, reliable: bool, depth: int) -> str:
    """Return the QoS of one volatile keep-last publisher as rosbag2 keeps it in a log.

    The policies are written as the integers of ``rmw/types.h``, as rosbag2 did up to Iron. Humble
    and Iron read nothing else; Jazzy and later read both these and the names that they write.

    Parameters
    ----------
    reliable : bool
        Whether the publisher is reliable, rather than best effort.
    depth : int
        How many messages it keeps.

    Returns
    -------
    str
        A YAML list of one profile.
    """
    infinite = 2**63 - 1
    profile = {
        "history": 1,
        "depth": depth,
        "reliability": 1 if reliable else 2,
        "durability": 2,
        "deadline": _duration(infinite),
        "lifespan": _duration(infinite),
        "liveliness": 1,
        "liveliness_lease_duration": _duration(infinite),
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


def _duration(nanoseconds: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(nanoseconds, 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


class LogWriter:
    """An MCAP log under way; predictions must go on when it fails, so only opening it raises.

    Messages are gathered in chunks of 64 KiB, compressed by zstd (it shrinks joint states and
    predictions to a third in 0.4 ms a chunk, and every reader of MCAP knows it). Whoever owns the
    log calls `flush` once a second: a killed process then loses that second at most. The file grows
    under its own name, so that what was flushed can be found. Not thread-safe.

    Parameters
    ----------
    path : Path
        The file to create; its folder must exist.
    topics : sequence of Topic
        The topics that will be written.
    attachments : sequence of Attachment
        Files to keep inside the log.

    Attributes
    ----------
    error : LogError or None
        The first failure; nothing is written after it.
    dropped : int
        How many messages are not in the file because of it.

    Raises
    ------
    LogError
        If the file exists, or cannot be created or begun.
    """

    def __init__(
        self, path: Path, topics: Sequence[Topic], attachments: Sequence[Attachment] = ()
    ) -> None:
        self.path = path
        self.error: LogError | None = None
        self.dropped = 0
        self._topics = tuple(topics)
        self._counts = dict.fromkeys((topic.name for topic in topics), 0)
        self._first_time = self._last_time = 0
        self._held = self._held_bytes = 0
        try:
            self._stream = path.open("xb")
        except FileExistsError:
            raise LogError(f"{path} exists already; a log never replaces a file.") from None
        except OSError as error:
            raise LogError(
                f"{path} could not be created: {error.strerror}; give a folder that can be written."
            ) from None
        # Chunks end in `flush` alone, so that what a failure loses can be counted.
        self._writer = Writer(self._stream, chunk_size=2**63, compression=CompressionType.ZSTD)
        try:
            self._begin(attachments)
        except OSError as error:
            raise self._failure(error) from None
        self._channels = {topic.name: self._register(topic) for topic in topics}

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add a message; after a failure, count it as dropped.

        Parameters
        ----------
        topic : str
            Name of one of the log's topics.
        data : bytes
            The message in CDR, with its encapsulation header.
        log_time, publish_time : int
            When it was received and when it was sent, ns.
        """
        if self.error is not None:
            self.dropped += 1
            return
        # MCAP's times are unsigned, a ROS stamp's seconds are not.
        log_time, publish_time = max(log_time, 0), max(publish_time, 0)
        empty = not any(self._counts.values())
        self._first_time = log_time if empty else min(self._first_time, log_time)
        self._last_time = max(self._last_time, log_time)
        self._writer.add_message(
            self._channels[topic], log_time, data, publish_time, self._counts[topic]
        )
        self._counts[topic] += 1
        self._held += 1
        self._held_bytes += len(data)
        if self._held_bytes >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand every message to the operating system: a killed process then loses none of them."""
        if self.error is None:
            try:
                self._writer.flush()  # type: ignore[no-untyped-call]
                self._held = self._held_bytes = 0
            except OSError as error:
                self._fail(error)

    def close(self) -> None:
        """Write the indexes and close the file; a failure is kept in `error`, never raised."""
        if self._stream.closed:
            return
        self.flush()
        try:
            # After a failure the file ends in a broken chunk, and an index would point past it.
            if self.error is None:
                self._add_rosbag2_metadata()
                self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.close()
        except OSError as error:
            self._fail(error)

    def __enter__(self) -> "LogWriter":
        """Return the log itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the log."""
        self.close()

    def _begin(self, attachments: Sequence[Attachment]) -> None:
        self._writer.start(profile="ros2", library=f"linkage_vibration {LIBRARY_IDENTIFIER}")
        # Again in `close`, with the counts: as rosbag2 does, for logs that are never closed.
        self._add_rosbag2_metadata()
        for attachment in attachments:
            self._writer.add_attachment(
                create_time=0,
                log_time=0,
                name=attachment.name,
                media_type=attachment.media_type,
                data=attachment.data,
            )
        self._writer.flush()  # type: ignore[no-untyped-call]

    def _register(self, topic: Topic) -> int:
        schema = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
        return self._writer.register_channel(
            topic.name,
            "cdr",
            schema,
            {
                "offered_qos_profiles": topic.offered_qos_profiles,
                "topic_type_hash": topic.type_hash,
            },
        )

    def _add_rosbag2_metadata(self) -> None:
        metadata = {
            "version": ROSBAG2_METADATA_VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": self._last_time - self._first_time},
            "starting_time": {"nanoseconds_since_epoch": self._first_time},
            "message_count": sum(self._counts.values()),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": topic.offered_qos_profiles,
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": self._counts[topic.name],
                }
                for topic in self._topics
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.path.name],
            "files": [],
            "custom_data": {},
        }
        serialized = yaml.safe_dump(metadata, sort_keys=False)
        self._writer.add_metadata("rosbag2", {"serialized_metadata": serialized})

    def _fail(self, error: OSError) -> None:
        self.dropped += self._held
        self._held = self._held_bytes = 0
        if self.error is None:
            self.error = self._failure(error)

    def _failure(self, error: OSError) -> LogError:
        return LogError(
            f"{self.path} could not be written any further: {error.strerror}; make room on its "
            "disk and start a new log, and mend this one with `mcap recover`."
        )
