# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of any reader in one plain form, for comparisons."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import ASSESSED


def resonance(**values: Any) -> MessageColumns:
    """Return an assessment with these values, and one excitation; nothing else is known."""
    fields: dict[str, Any] = {"unknown_factors": ""}
    for field in (field for kind in ASSESSED for field in message_fields(kind)):
        kind = field.dtype
        unknown = np.nan if kind.kind == "f" else 0
        number = np.full(1, unknown, kind) if field.is_sequence else unknown
        fields[field.name] = "" if field.type == "string" else number
    return MessageColumns(**fields | values)


def changed(columns: MessageColumns, **values: Any) -> MessageColumns:
    """Return the same with other values."""
    return MessageColumns(**vars(columns) | values)


def raw_messages(log: Path, *topics: str) -> list[tuple[str, int, bytes]]:
    """Return topic, log time and bytes of each message of some topics of an MCAP file."""
    with log.open("rb") as file:
        actual = make_reader(file, validate_crcs=True).iter_messages(topics)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in actual]


def read_messages(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the log times, ns, and the messages of a topic of an MCAP file, as mcap reads them."""
    # Only a few tests need mcap-ros2-support.
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, _, message, decoded in reader.iter_decoded_messages([topic]):
            yield message.log_time, decoded


def read_stamped(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the stamps, ns, and the messages of a topic of an MCAP file."""
    for _, message in read_messages(path, topic):
        stamp = message.header.stamp
        yield stamp.sec * 10**9 + stamp.nanosec, message


def plain(value: Any) -> Any:
    """Return a decoded message of any reader as dicts, lists and numbers; NaN as a string."""
    # Constants have capital letters; additions of a reader begin with an underscore.
    for names in (getattr(value, "__slots__", ()), getattr(value, "__dataclass_fields__", ())):
        if fields := [name for name in names if name.islower() and name[0] != "_"]:
            return {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    return "NaN" if value != value else value
