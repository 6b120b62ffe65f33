# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes ``can_msgs/Frame``, one by one for the node and thousands together for bags.

A key is the identifier of a frame with the flags that SocketCAN stores beside it in 32 bits, so
that one comparison dismisses other frames, remote frames and error frames.
"""

import struct
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.numbers import CdrError
from linkage_vibration.bags.streams import Block, Bytes, Integers

EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
FLAGS = EXTENDED | REMOTE | ERROR
"""The flags of a key."""
PAYLOAD = 8
"""Bytes of data in a message, however many of them the frame has."""

_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes, by the encapsulation
_LENGTHS = {order: struct.Struct(f"{order}I") for order in "<>"}
_IDENTIFIERS = {order: struct.Struct(f"{order}I3B") for order in "<>"}
_STRING = 16  # where the frame's name begins: after the encapsulation, the stamp and its length
_TAIL = 8 + PAYLOAD  # bytes from the identifier to the end: flags, length and data follow it


class Frame(NamedTuple):
    """One frame of a CAN bus.

    Attributes
    ----------
    sec, nanosec, frame_id : int, int and str
        Stamp and frame of its header.
    key, dlc, payload : int, int and bytes
        Its identifier with flags, the number of its bytes, and its data, padded to 8 bytes.
    """

    sec: int
    nanosec: int
    frame_id: str
    key: int
    dlc: int
    payload: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames of a CAN bus that have the same frame in their headers, as columns.

    Attributes
    ----------
    rows, data : ndarray, (n,), and ndarray of uint8, (n, n_bytes)
        Which messages of the block they are, and their bytes.
    sec, nanosec, frame_id : ndarray, (n,), ndarray, (n,), and str
        As those of `Frame`.
    key, dlc, payload : ndarray, (n,), ndarray, (n,), and ndarray of uint8, (n, 8)
        As those of `Frame`.
    """

    rows: Integers
    data: Bytes
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str
    key: NDArray[np.uint32]
    dlc: Bytes
    payload: Bytes


def read_key(data: bytes) -> int:
    """Return the key of a message, which is enough to dismiss most frames of a bus.

    Raises
    ------
    CdrError
        If the bytes are not a ``can_msgs/Frame`` in plain CDR.
    """
    order, _, at = _layout(data)
    identifier, remote, extended, error = _IDENTIFIERS[order].unpack_from(data, at)
    key: int = identifier & 0x1FFFFFFF
    if extended:
        key |= EXTENDED
    if remote:
        key |= REMOTE
    return key | ERROR if error else key


def read_frame(data: bytes) -> Frame:
    """Decode one message.

    Raises
    ------
    CdrError
        If the bytes are not a ``can_msgs/Frame`` in plain CDR.
    """
    order, length, at = _layout(data)
    sec, nanosec = struct.unpack_from(f"{order}iI", data, 4)
    name = data[_STRING : _STRING + length].rstrip(b"\0").decode(errors="replace")
    payload = data[at + 8 : at + _TAIL]
    return Frame(sec, nanosec, name, read_key(data), data[at + 7], payload)


def read_frames(block: Block, rows: Integers) -> tuple[list[Frames], Integers]:
    """Decode many messages; those with the same layout together.

    Parameters
    ----------
    block, rows : Block and ndarray, (n,)
        Part of a bag, and which of its messages to decode.

    Returns
    -------
    frames, unreadable : list of Frames, and ndarray, (m,)
        The decoded messages, and which ones are not a ``can_msgs/Frame`` in plain CDR.
    """
    found: list[Frames] = []
    unreadable: list[Integers] = [np.zeros(0, np.int64)]
    sizes = block.sizes[rows]
    for size in np.unique(sizes).tolist():
        left = rows[sizes == size]
        while len(left):
            messages = sliding_window_view(block.buffer, size)[block.starts[left]]
            first, fixed = messages[0], np.r_[: min(size, 4), min(size, 12) : min(size, _STRING)]
            try:
                order, length, at = _layout(first.tobytes())
                fixed = np.r_[fixed, _STRING : _STRING + length]
            except CdrError:
                at = 0
            same = (messages[:, fixed] == first[fixed]).all(axis=1)
            if at:
                found.append(_columns(messages[same], left[same], order, at))
            else:
                unreadable.append(left[same])
            left = left[~same]
    return found, np.concatenate(unreadable)


def _columns(messages: Bytes, rows: Integers, order: str, at: int) -> Frames:
    def words(position: int, code: str) -> NDArray[np.int64]:
        column = np.ascontiguousarray(messages[:, position : position + 4])
        return column.view(f"{order}{code}")[:, 0]

    flags = messages[:, at + 4 : at + 7] != 0
    key = words(at, "u4") & np.uint32(0x1FFFFFFF)
    for column, flag in enumerate((REMOTE, EXTENDED, ERROR)):
        key = np.where(flags[:, column], key | np.uint32(flag), key)
    name = messages[0, _STRING:at].tobytes().split(b"\0")[0].decode(errors="replace")
    return Frames(
        rows,
        messages,
        words(4, "i4").astype(np.int32),
        words(8, "u4").astype(np.uint32),
        name,
        key.astype(np.uint32),
        messages[:, at + 7],
        messages[:, at + 8 : at + _TAIL],
    )


def _layout(data: bytes) -> tuple[str, int, int]:
    """Return the order of the bytes, the length of the name, and where the identifier begins."""
    order = _ORDERS.get(data[:2])
    if order is None or len(data) < _STRING + _TAIL:
        raise CdrError(f"{len(data)} bytes are not a can_msgs/Frame in plain CDR")
    [length] = _LENGTHS[order].unpack_from(data, 12)
    at = _STRING + (length + 3 & ~3)
    if at + _TAIL > len(data):
        raise CdrError(f"{len(data)} bytes are not a can_msgs/Frame, whose name is too long")
    return order, length, at
