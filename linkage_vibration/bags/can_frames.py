# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes ``can_msgs/Frame``, and ``IsobusFrame`` of ROS2ISOBUS, which has no header.

A key is the identifier of a frame with the flags that SocketCAN stores beside it in 32 bits, so
that one comparison dismisses other frames, remote frames and error frames.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Bytes
from linkage_vibration.bags.cdr import STAMP, CdrMessage, Layout
from linkage_vibration.bags.message_types import CAN_FRAME, ISOBUS_FRAME

EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
FLAGS = EXTENDED | REMOTE | ERROR
"""The flags of a key."""
PAYLOAD = 8
"""Bytes of data in a message, however many of them the frame has."""

_IDENTIFIER = 0x1FFFFFFF
_KEYS = {order: struct.Struct(f"{order}I3B") for order in "<>"}  # identifier and flags
FramePlaces: TypeAlias = tuple[str, int]
"""Frame of the header, and where the identifier begins."""
FrameColumns: TypeAlias = tuple[NDArray[np.uint32], Bytes, Bytes]
"""Keys, (n,), numbers of bytes, (n,), and data, padded to 8 bytes, (n, 8)."""


def frame_places(message: CdrMessage) -> FramePlaces:
    """Return where the values of a message are."""
    message.skip(STAMP)
    frame_id = message.text()
    message.align(4)
    return frame_id, message.skip(8 + PAYLOAD)  # identifier, three flags, length and data


def frame_key(layout: Layout[FramePlaces], data: bytes) -> int:
    """Return the key of a message."""
    return int(_key(*_KEYS[layout.order].unpack_from(data, layout.places[1])))


def frame_columns(layout: Layout[FramePlaces], messages: Bytes) -> FrameColumns:
    """Return the frames of many messages."""
    _, at = layout.places
    key = _key(layout.column(messages, at, "u4")[:, 0], *messages[:, at + 4 : at + 7].T)
    return key.astype(np.uint32), messages[:, at + 7], messages[:, at + 8 : at + 8 + PAYLOAD]


def _key(identifier: Any, remote: Any, extended: Any, error: Any) -> Any:
    """Return the key of a frame, or of many; the last three are numbers that are 0 or not."""
    flags = (remote != 0) * REMOTE | (extended != 0) * EXTENDED | (error != 0) * ERROR
    return identifier & _IDENTIFIER | flags


def _isobus_places(message: CdrMessage) -> FramePlaces:
    # Priority, data page, three bytes of alignment and the parameter group, the source address,
    # and the second and third byte of the identifier, which repeat the group.
    return "", message.skip(11 + PAYLOAD)


def _isobus_key(layout: Layout[FramePlaces], data: bytes) -> int:
    _, at = layout.places
    return int(_joined_key(data[at + 1], *data[at + 8 : at + 11]))


def _isobus_columns(layout: Layout[FramePlaces], messages: Bytes) -> FrameColumns:
    _, at = layout.places
    key = _joined_key(*messages[:, [at + 1, at + 8, at + 9, at + 10]].T.astype(np.int64))
    length = np.full(len(messages), PAYLOAD, np.uint8)
    return key.astype(np.uint32), length, messages[:, at + 11 : at + 11 + PAYLOAD]


def _joined_key(page: Any, source: Any, high: Any, low: Any) -> Any:
    """Return the key of a frame, or of many, from the parts of the identifier."""
    return EXTENDED | (page != 0) * (1 << 24) | high << 16 | low << 8 | source


@dataclass(frozen=True, slots=True)
class FrameType:
    """How messages of a type contain frames; without a header, every frame has 8 bytes."""

    fields: list[str]
    places: Callable[[CdrMessage], FramePlaces]
    key: Callable[[Layout[FramePlaces], bytes], int]
    columns: Callable[[Layout[FramePlaces], Bytes], FrameColumns]


FRAME_TYPES = {
    CAN_FRAME: FrameType(
        ["header", "id", "is_rtr", "is_extended", "is_error", "dlc", "data"],
        frame_places,
        frame_key,
        frame_columns,
    ),
    ISOBUS_FRAME: FrameType(
        ["priority", "page", "pgn", "sa", "pf", "ps", "data"],
        _isobus_places,
        _isobus_key,
        _isobus_columns,
    ),
}
"""The types of messages whose frames can be read."""
