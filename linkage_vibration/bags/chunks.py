# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes logs by the chunk, thousands of messages at a time.

A replay writes 800,000 messages in a second (`python -m benchmark.libraries`). The node records
with `LogWriter`, which writes smaller chunks, so that a crash loses little.
"""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from numpy.lib.stride_tricks import sliding_window_view

from linkage_vibration.bags.blocks import Bytes, Integers
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.mcap_records import MESSAGE, MESSAGE_RECORD
from linkage_vibration.bags.writing import Attachment, Topic


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Messages of one topic of the log and one size."""

    topic: str
    data: Bytes  # (n, n_bytes): CDR with encapsulation headers
    place: Integers  # (n,), among those of the chunk
    log_times: Integers  # (n,), of receiving, ns, not negative
    publish_times: Integers  # (n,), of sending, likewise


class ChunkLog(LogWriter):
    """A log that is written by the chunk, with compression on another thread.

    Any method raises an OSError if the file cannot be written.
    """

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

    @contextmanager
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
