# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes ``can_msgs/Frame``.

A key is the identifier of a frame with the flags that SocketCAN stores beside it in 32 bits, so
that one comparison dismisses other frames, remote frames and error frames.
"""

import struct
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.cdr import STAMP, CdrMessage, Layout
from linkage_vibration.bags.streams import Bytes

EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
FLAGS = EXTENDED | REMOTE | ERROR
"""The flags of a key."""
PAYLOAD = 8
"""Bytes of data in a message, however many of them the frame has."""

_IDENTIFIER = 0x1FFFFFFF
_KEYS = {order: struct.Struct(f"{order}I3B") for order in "<>"}  # identifier and flags
FramePlaces: TypeAlias = tuple[str, int]
"""Frame of the header, and where the identifier begins."""


def frame_places(message: CdrMessage) -> FramePlaces:
    """Return where the values of a message are."""
    message.skip(STAMP)
    frame_id = message.text()
    message.align(4)
    return frame_id, message.skip(8 + PAYLOAD)  # identifier, three flags, length and data


def frame_key(layout: Layout[FramePlaces], data: bytes) -> int:
    """Return the key of a message."""
    _, at = layout.places
    identifier, remote, extended, error = _KEYS[layout.order].unpack_from(data, at)
    flags = (extended and EXTENDED) | (remote and REMOTE) | (error and ERROR)
    return int(identifier & _IDENTIFIER | flags)


def frame_columns(
    layout: Layout[FramePlaces], messages: Bytes
) -> tuple[NDArray[np.uint32], Bytes, Bytes]:
    """Return keys, (n,), numbers of bytes, (n,), and data, padded to 8 bytes, (n, 8)."""
    _, at = layout.places
    flags = messages[:, at + 4 : at + 7] != 0
    key = layout.column(messages, at, "u4")[:, 0] & np.uint32(_IDENTIFIER)
    for column, flag in enumerate((REMOTE, EXTENDED, ERROR)):
        key |= np.where(flags[:, column], np.uint32(flag), np.uint32(0))
    return key, messages[:, at + 7], messages[:, at + 8 : at + 8 + PAYLOAD]
