# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes ``can_msgs/Frame``.

A key is the identifier of a frame with the flags that SocketCAN stores beside it in 32 bits, so
that one comparison dismisses other frames, remote frames and error frames.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.cdr import STAMP, CdrMessage, Layout, Layouts
from linkage_vibration.bags.message_types import CAN_FRAME
from linkage_vibration.bags.numbers import LeftOut
from linkage_vibration.bags.streams import Block, Bytes, Integers

EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
FLAGS = EXTENDED | REMOTE | ERROR
"""The flags of a key."""
PAYLOAD = 8
"""Bytes of data in a message, however many of them the frame has."""

_IDENTIFIER = 0x1FFFFFFF
_FIRST = np.zeros(1, np.int64)
_KEYS = {order: struct.Struct(f"{order}I3B") for order in "<>"}  # identifier and flags
_Places = tuple[str, int]  # frame of the header, and where the identifier begins


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames of a CAN bus that have the same frame in their headers, as columns.

    Attributes
    ----------
    rows : ndarray, (n,)
        Which messages of the block they are.
    sec, nanosec, frame_id : ndarray, (n,), ndarray, (n,), and str
        Stamps and frame of the headers.
    key, dlc, payload : ndarray, (n,), ndarray, (n,), and ndarray of uint8, (n, 8)
        Identifiers with flags, numbers of bytes, and data, padded to 8 bytes.
    """

    rows: Integers
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str
    key: NDArray[np.uint32]
    dlc: Bytes
    payload: Bytes

    def of(self, which: NDArray[np.bool_]) -> "Frames":
        """Return some of the frames."""
        return Frames(
            self.rows[which],
            self.sec[which],
            self.nanosec[which],
            self.frame_id,
            self.key[which],
            self.dlc[which],
            self.payload[which],
        )


class FrameReader:
    """Decodes frames, one by one for the node and thousands together for bags."""

    def __init__(self) -> None:
        self._layouts = Layouts(CAN_FRAME, _places)

    def key(self, data: bytes) -> int:
        """Return the key of a message; raise a `CdrError` if it is not a frame in plain CDR."""
        layout = self._layouts.find(data)
        _, at = layout.places
        identifier, remote, extended, error = _KEYS[layout.order].unpack_from(data, at)
        flags = (extended and EXTENDED) | (remote and REMOTE) | (error and ERROR)
        return int(identifier & _IDENTIFIER | flags)

    def read_one(self, data: bytes, wanted: Callable[[int], bool]) -> Frames | None:
        """Return a message as the only one of columns; None if its key is not wanted."""
        key = self.key(data)
        if not wanted(key):
            return None
        layout = self._layouts.find(data)
        frame_id, at = layout.places
        message = np.frombuffer(data, np.uint8)[np.newaxis]
        sec, nanosec = layout.stamps(message)
        keys, payload = np.array([key], np.uint32), message[:, at + 8 : at + 8 + PAYLOAD]
        return Frames(_FIRST, sec, nanosec, frame_id, keys, message[:, at + 7], payload)

    def read(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Frames]:
        """Yield messages of a block, those of one layout together; count those without a frame."""
        for layout, alike, messages in self._layouts.groups(block, rows, left_out):
            yield _columns(layout, alike, messages)


def _places(message: CdrMessage) -> _Places:
    message.skip(STAMP)
    frame_id = message.text()
    message.align(4)
    return frame_id, message.skip(8 + PAYLOAD)  # identifier, three flags, length and data


def _columns(layout: Layout[_Places], rows: Integers, messages: Bytes) -> Frames:
    frame_id, at = layout.places
    flags = messages[:, at + 4 : at + 7] != 0
    key = layout.column(messages, at, "u4")[:, 0] & np.uint32(_IDENTIFIER)
    for column, flag in enumerate((REMOTE, EXTENDED, ERROR)):
        key |= np.where(flags[:, column], np.uint32(flag), np.uint32(0))
    dlc, payload = messages[:, at + 7], messages[:, at + 8 : at + 8 + PAYLOAD]
    return Frames(rows, *layout.stamps(messages), frame_id, key, dlc, payload)
