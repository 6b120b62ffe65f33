# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes messages to an MCAP log: one by one as they arrive, or thousands at a time."""

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment as AttachmentRecord
from numpy.lib.stride_tricks import sliding_window_view

from linkage_vibration.bags.blocks import Bytes, Integers
from linkage_vibration.bags.mcap_file import McapFile
from linkage_vibration.bags.mcap_records import MESSAGE, MESSAGE_HEAD, MESSAGE_RECORD
from linkage_vibration.bags.writing import (
    ROSBAG2_METADATA,
    Attachment,
    DiskError,
    LogError,
    LogExistsError,
    Topic,
    rosbag2_metadata,
)
from linkage_vibration.support.resources import command

# A chunk is compressed and written at once, so its size limits how long `write` can take.
CHUNK_BYTES = 64 * 1024

# Greatest number of bytes that MCAP adds for a message with its index; for a chunk with its two
# indexes, and for each channel in it; and for the footer and the record of rosbag2.
_PER_MESSAGE = 47
_PER_CHUNK, _PER_CHUNK_CHANNEL = 160, 25
_AT_THE_END = 2048


Log = TypeVar("Log", bound="LogWriter")


class LogWriter:
    """An MCAP log that is written in chunks; after a `LogError` only `abandon` may follow."""

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        attachments: Sequence[Attachment] = (),
        compression: str = "zstd",
    ) -> None:
        self.path = path
        self.written = 0
        self._sequences: dict[str, int] = {}
        # Definitions are written outside of chunks, so that each chunk can be read without others,
        # and again in the next chunk, whose CRC confirms them.
        self._definitions = b""
        self._held: list[bytes] = []  # messages of the next chunk
        self._begins: list[int] = []  # where each of them begins behind the definitions
        self._held_bytes = 0
        try:
            self._stream = path.open("xb")
        except FileExistsError:
            problem = f"{path} exists already; choose another name, as a log never replaces a file."
            raise LogExistsError(problem) from None
        except OSError as error:
            problem = f"{path} cannot be created: {error.strerror}; choose a writable folder."
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            raise (DiskError if full else LogError)(problem) from None
        # Other recorders see by this that they must not delete the file; some disks have no locks.
        with contextlib.suppress(OSError):
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._file = McapFile(self._stream, "ros2", compression)
        try:
            with self._failures():
                self._definitions += self._file.add_topics(topics)
                for attachment in attachments:
                    about = attachment.name, attachment.media_type
                    self._file.attach(AttachmentRecord(0, 0, *about, attachment.data))
                self._stream.flush()
        except LogError:
            self.abandon()
            with contextlib.suppress(OSError):
                path.unlink()
            raise

    @property
    def held(self) -> int:
        """Number of messages of the next chunk."""
        return len(self._held)

    @property
    def messages(self) -> int:
        """Number of messages that are in the file or in its next chunk."""
        return self.written + self.held

    @property
    def size(self) -> int:
        """Greatest number of bytes that the file would have if it were closed now."""
        chunk = len(self._definitions) + _PER_CHUNK + _PER_CHUNK_CHANNEL * len(self._file.channels)
        held = self._held_bytes + len(self._held) * _PER_MESSAGE
        # Data that cannot be compressed grow by less than 1 %.
        held += held // 100
        return self._stream.tell() + chunk + held + self._file.summary_size + _AT_THE_END

    def add_topic(self, topic: Topic) -> None:
        """Add a topic, unless the log has it already."""
        if topic.name not in self._file.channels:
            with self._failures():
                self._definitions += self._file.add_topics([topic])

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record; it does not replace an earlier one of the same name."""
        with self._failures():
            self._file.add_metadata(name, data)

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add a message in CDR; times are in ns."""
        channel = self._file.channels[topic]
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        head = MESSAGE_HEAD.pack(
            Opcode.MESSAGE,
            MESSAGE.size + len(data),
            channel,
            sequence % 2**32,
            # MCAP has unsigned times, but the seconds of a ROS stamp are signed.
            max(log_time, 0),
            max(publish_time, 0),
        )
        self._begins.append(self._held_bytes + len(self._held) * MESSAGE_HEAD.size)
        self._held.append(head + data)
        self._held_bytes += len(data)
        if self._held_bytes >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the operating system; a killed process then loses none of them."""
        with self._failures():
            if self._held:
                content = b"".join([self._definitions, *self._held])
                self._file.add_chunk(content, np.array(self._begins) + len(self._definitions))
                self._definitions = b""
            self._stream.flush()
            if os.fstat(self._stream.fileno()).st_nlink == 0:
                raise FileNotFoundError
            self.written += self.held
            self._held, self._begins, self._held_bytes = [], [], 0

    def sync(self) -> None:
        """Wait until the disk has all flushed messages; a power failure then loses none of them."""
        with self._failures():
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Write the messages and the indexes, and close the file."""
        self.flush()
        with self._failures():
            self._file.add_metadata(ROSBAG2_METADATA, rosbag2_metadata())
            self._file.close()
            self._stream.close()

    def abandon(self) -> None:
        """Close the file as it is; no index may point to the incomplete chunk at its end."""
        with contextlib.suppress(OSError):
            self._stream.close()

    def __enter__(self: Log) -> Log:
        """Return the log itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Complete the log, unless an error occurred."""
        if kind is None:
            self.close()
        else:
            self.abandon()

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        """Turn a failure of the disk into a `LogError`."""
        try:
            yield
        except FileNotFoundError:
            text = f"{self.path} was removed during the recording"
            raise LogError(f"{text}; keep the log until it is complete.") from None
        except (OSError, MemoryError) as error:
            problem = getattr(error, "strerror", "there is not enough memory")
            repair = f", and complete this log with `{command(f'recover {self.path}')}`"
            hint = "make room on its disk" + repair * bool(self.written)
            text = f"{self.path} could not be written any further: {problem}; {hint}."
            raise DiskError(text) from None


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Messages of one topic of the log and one size."""

    topic: str
    data: Bytes  # (n, n_bytes): CDR with encapsulation headers
    place: Integers  # (n,), among those of the chunk
    log_times: Integers  # (n,), of receiving, ns, not negative
    publish_times: Integers  # (n,), of sending, likewise


class ChunkLog(LogWriter):
    """A log that a replay writes by the chunk; it compresses on a thread, and raises OSErrors."""

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        attachments: Sequence[Attachment],
        metadata: Mapping[str, Mapping[str, str]],
    ) -> None:
        super().__init__(path, topics, attachments)
        self._sequences = {topic.name: 0 for topic in topics}
        self._pool = ThreadPoolExecutor(1)
        self._under_way = self._pool.submit(lambda: None)
        for name, facts in metadata.items():
            self.add_metadata(name, facts)

    def write(self, messages: Sequence[Messages]) -> None:  # type: ignore[override]
        """Add a chunk of messages in the order of their places."""
        messages = [group for group in messages if len(group.place)]
        if not messages:
            return
        content, begins = self._records(messages)
        self._under_way.result()
        self._under_way = self._pool.submit(self._file.add_chunk, content, begins)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record, as the base class does."""
        self._under_way.result()
        super().add_metadata(name, data)

    def close(self) -> None:
        """Write the summary, and close the file."""
        self._under_way.result()
        super().close()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Complete the log, unless an error occurred."""
        try:
            super().__exit__(kind)
        finally:
            self._pool.shutdown()
            self.abandon()

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        yield

    def _records(self, messages: Sequence[Messages]) -> tuple[bytes, Integers]:
        """Return the records of a chunk, and the position of each message in them."""
        places = np.concatenate([group.place for group in messages])
        sizes = [group.data.shape[1] + MESSAGE_RECORD.itemsize for group in messages]
        lengths = np.repeat(sizes, [len(group.place) for group in messages])
        order = np.argsort(places, kind="stable")
        begins = np.empty(len(order), np.int64)
        begins[order] = np.cumsum(lengths[order]) - lengths[order]
        buffer = np.empty(int(lengths.sum()), np.uint8)
        done = 0
        for group in messages:
            n, size = group.data.shape
            header = np.empty(n, MESSAGE_RECORD)
            header["opcode"] = Opcode.MESSAGE
            header["length"] = MESSAGE.size + size
            header["channel"] = self._file.channels[group.topic]
            header["sequence"] = self._sequences[group.topic] + np.arange(n)
            header["log_time"], header["publish_time"] = group.log_times, group.publish_times
            self._sequences[group.topic] += n
            rows = np.hstack([header.view(np.uint8).reshape(n, -1), group.data])
            begin = begins[done : done + n]
            sliding_window_view(buffer, rows.shape[1], writeable=True)[begin] = rows
            done += n
        return buffer.tobytes(), begins[order]
