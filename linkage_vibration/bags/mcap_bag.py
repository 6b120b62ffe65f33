# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds what an MCAP file contains in its summary, which lists all messages.

A file whose summary does not is copied by `recover`, as the readers of mcap and rosbags believe a
summary of another file before it, and keep a file without an index in memory.
"""

import os
from collections import Counter
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Schema
from mcap.summary import Summary

from linkage_vibration.bags.mcap_records import LONGEST_RECORD, MAGIC, MESSAGE_INDEX, RECORD
from linkage_vibration.bags.recovery import JoinedError, recover

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

# Encodings of messages and of their types; rosbag2 leaves that of an unknown type empty.
_ROS2 = [("cdr", each) for each in ("ros2msg", "ros2idl", "omgidl", "")]
_ROS1 = ("ros1", "ros1msg")


@dataclass(frozen=True)
class McapBag:
    """What an MCAP file contains."""

    path: Path
    summary: Summary

    @cached_property
    def chunks(self) -> list[ChunkIndex]:
        """Its chunks in their order, each once, however often the summary lists it."""
        chunks = {each.chunk_start_offset: each for each in self.summary.chunk_indexes}
        return [chunks[offset] for offset in sorted(chunks)]

    @cached_property
    def counts(self) -> Counter[int]:
        """The number of messages of each channel, by the sizes of their indexes."""
        counts: Counter[int] = Counter()
        for chunk in self.chunks:
            end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
            offsets = chunk.message_index_offsets.items()
            for channel, offset in sorted(offsets, key=lambda entry: -entry[1]):
                counts[channel] += (end - offset - RECORD.size - MESSAGE_INDEX.size) // 16
                end = offset
        return counts

    @property
    def is_complete(self) -> bool:
        """Whether the summary lists all messages, and defines their channels."""
        listed, used = self.summary, {each.schema_id for each in self.summary.channels.values()}
        defined = {0, *listed.schemas} >= used and listed.channels.keys() >= self.counts.keys()
        if listed.statistics is None:  # so that messages outside of chunks may be missing
            return False
        return defined and self.counts.total() >= listed.statistics.message_count

    @property
    def connections(self) -> "list[Connection]":
        """The channels as rosbags describes them."""
        return [self._connection(channel) for channel in self.summary.channels.values()]

    def _connection(self, channel: Channel) -> "Connection":
        import rosbags.interfaces as ros

        schema = self.summary.schemas.get(channel.schema_id, Schema(0, b"", "no type", ""))
        encodings = channel.message_encoding, schema.encoding
        name = encodings[encodings[0] in ("cdr", "ros1")] if encodings not in _ROS2 else "cdr"
        ext: Any = ros.ConnectionExtRosbag2(name, [])
        if encodings == _ROS1:
            ext = ros.ConnectionExtRosbag1(None, None)
        kind = "IDL" if schema.encoding.endswith("idl") else "MSG"
        text = schema.data.decode(errors="replace")
        definition = ros.MessageDefinition(ros.MessageDefinitionFormat[kind], text)
        about = definition, "", self.counts[channel.id], ext, None
        return ros.Connection(channel.id, channel.topic, schema.name, *about)


def read_mcap(path: Path, stack: ExitStack) -> McapBag:
    """Return what a file contains, or a copy that the stack deletes; damage may raise any error."""
    summary = None
    with path.open("rb") as file:
        end = file.seek(-len(MAGIC), os.SEEK_END)
        if file.read() != MAGIC:
            raise ValueError("its end is missing")
        file.seek(0)
        # Without a summary that ends where the file does, the copy says what is damaged.
        with suppress(Exception):
            summary = SeekingReader(file, record_size_limit=LONGEST_RECORD).get_summary()
        if summary is not None and file.tell() == end and McapBag(path, summary).is_complete:
            return McapBag(path, summary)
    result = recover(path, Path(stack.enter_context(TemporaryDirectory()), path.name))
    if result.rest:
        raise JoinedError(path, result.rest)
    if result.damages or result.lost:
        raise ValueError("; ".join(result.damages) or "messages without a definition")
    with result.path.open("rb") as file:
        return McapBag(result.path, SeekingReader(file).get_summary() or Summary())
