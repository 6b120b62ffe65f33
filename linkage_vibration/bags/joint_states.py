# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes ``sensor_msgs/JointState``, one by one for the node and thousands together for bags.

Own code because rosbags takes 12 times as long to read and decode one (`python -m
benchmark.libraries`), and rclpy 30 us, a third of a live prediction. Messages of one publisher
differ only in their stamps and numbers. So the first one is parsed, and all others with the same
bytes elsewhere are decoded at the same positions.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.numbers import CdrError
from linkage_vibration.bags.streams import Block, Bytes, Integers

_KEPT = 256  # layouts; a publisher has one for each order of its joints
_ORIGIN = 4  # bytes of the encapsulation header, after which CDR aligns numbers to their sizes


class JointState(NamedTuple):
    """One joint state, with the stamp and the frame of its header."""

    sec: int
    nanosec: int
    frame_id: str
    name: list[str]
    position: tuple[float, ...]
    velocity: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class JointStates:
    """Joint states with the same joints in the same order, as columns.

    Attributes
    ----------
    rows : ndarray, (n,)
        Indices of the messages in the block.
    data : ndarray of uint8, (n, n_bytes)
        Their bytes.
    sec, nanosec : ndarray, (n,)
        Stamps of their headers, s and ns.
    frame_id : str
        Frame of their headers.
    name : list of str, (n_joints,)
        Joint names.
    position, velocity : ndarray, (n_joints, n) or (0, n)
        rad or m, and rad/s or m/s; empty if the messages omit them.
    """

    rows: Integers
    data: Bytes
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str
    name: list[str]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Layout:
    """Positions of the numbers of a message, and the bytes that similar messages share."""

    order: str  # "<" or ">"
    frame_id: str
    name: list[str]
    position: tuple[int, int]  # byte, count
    velocity: tuple[int, int]
    shared: NDArray[np.uint64]  # the message, padded
    mask: NDArray[np.uint64]  # ones where the bytes are shared

    @cached_property
    def bits(self) -> tuple[int, int]:
        """The shared bytes and the mask as numbers, for one message."""
        return _bits(self.shared.tobytes()), _bits(self.mask.tobytes())


class JointStateReader:
    """Decodes the joint states of blocks, and keeps their layouts.

    Attributes
    ----------
    unreadable : int
        Number of messages that were not valid CDR and were skipped.
    fault : str
        What was wrong with the first of them.
    """

    def __init__(self) -> None:
        self.unreadable = 0
        self.fault = ""
        self._layouts: dict[int, list[_Layout]] = {}

    def read_one(self, data: bytes) -> JointState:
        """Decode one joint state.

        Raises
        ------
        CdrError
            If the bytes are not a joint state in plain CDR.
        """
        bits = _bits(data)
        for layout in self._layouts.get(len(data), ()):
            shared, mask = layout.bits
            if not (bits ^ shared) & mask:
                break
        else:
            layout = _layout(data, _padded(len(data)))
            self._remember(layout, len(data))
        order = layout.order
        sec, nanosec = struct.unpack_from(f"{order}iI", data, _ORIGIN)
        position, velocity = (
            struct.unpack_from(f"{order}{count}d", data, at)
            for at, count in (layout.position, layout.velocity)
        )
        return JointState(sec, nanosec, layout.frame_id, layout.name, position, velocity)

    def read(self, block: Block, rows: Integers) -> Iterator[JointStates]:
        """Yield the joint states of a block, with equal layouts together.

        Parameters
        ----------
        block : Block
            The messages.
        rows : ndarray, (n,)
            Indices of those to decode.
        """
        sizes = block.sizes[rows]
        for size in np.unique(sizes):
            alike = rows[sizes == size]
            messages = _gathered(block, alike, int(size))
            yield from self._read(messages, alike, int(size))

    def _read(self, messages: Bytes, rows: Integers, size: int) -> Iterator[JointStates]:
        words = messages.view(np.uint64)
        left = np.arange(len(rows))
        for layout in self._layouts.get(size, ()):
            fits = ~((words[left] ^ layout.shared) & layout.mask).any(axis=1)
            if fits.any():
                found = left[fits]
                yield _columns(messages[found], rows[found], size, layout)
                left = left[~fits]
            if not len(left):
                return
        while len(left):
            try:
                layout = _layout(messages[left[0], :size].tobytes(), messages.shape[1])
            except CdrError as error:
                self.fault = (
                    self.fault or f"a message of {size} bytes is not a joint state: {error}"
                )
                self.unreadable += 1
                left = left[1:]
                continue
            self._remember(layout, size)
            fits = ~((words[left] ^ layout.shared) & layout.mask).any(axis=1)
            found = left[fits]
            yield _columns(messages[found], rows[found], size, layout)
            left = left[~fits]

    def _remember(self, layout: _Layout, size: int) -> None:
        if sum(map(len, self._layouts.values())) >= _KEPT:
            self._layouts = {}
        self._layouts.setdefault(size, []).append(layout)


def _bits(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _padded(size: int) -> int:
    return -(-max(size, 1) // 8) * 8


def _gathered(block: Block, rows: Integers, size: int) -> Bytes:
    """Return messages of one size as rows that are padded to multiples of 8 bytes."""
    padded = np.zeros((len(rows), _padded(size)), np.uint8)
    if size:
        padded[:, :size] = sliding_window_view(block.buffer, size)[block.starts[rows]]
    return padded


def _columns(messages: Bytes, rows: Integers, size: int, layout: _Layout) -> JointStates:
    def doubles(at: int, count: int) -> NDArray[np.float64]:
        values = np.ascontiguousarray(messages[:, at : at + 8 * count])
        values = values.view(f"{layout.order}f8").reshape(len(rows), count)
        return values.T.astype(np.float64)

    stamps = np.ascontiguousarray(messages[:, _ORIGIN : _ORIGIN + 8])
    return JointStates(
        rows,
        messages[:, :size],
        stamps.view(f"{layout.order}i4")[:, 0].astype(np.int32),
        stamps.view(f"{layout.order}u4")[:, 1].astype(np.uint32),
        layout.frame_id,
        layout.name,
        doubles(*layout.position),
        doubles(*layout.velocity),
    )


def _layout(data: bytes, padded: int) -> _Layout:
    """Return the layout of a message."""
    try:
        return _parsed(data, padded)
    except (struct.error, UnicodeDecodeError) as error:
        raise CdrError(str(error)) from None


def _parsed(data: bytes, padded: int) -> _Layout:
    if len(data) < _ORIGIN + 12 or data[0] != 0 or data[1] > 1:
        raise CdrError("its encapsulation header is not that of plain CDR")
    order = "<" if data[1] else ">"
    mask = np.zeros(padded, np.uint8)
    mask[:2] = 0xFF
    position = _ORIGIN + 8

    def count() -> int:
        nonlocal position
        position += -position % 4
        mask[position : position + 4] = 0xFF
        [found] = struct.unpack_from(f"{order}I", data, position)
        position += 4
        return int(found)

    def string() -> str:
        nonlocal position
        length = count()
        if position + length > len(data):
            raise CdrError("a string is longer than the message")
        mask[position : position + length] = 0xFF
        text = data[position : position + length].rstrip(b"\x00").decode()
        position += length
        return text

    def doubles() -> tuple[int, int]:
        nonlocal position
        n = count()
        if n:
            position += -(position - _ORIGIN) % 8
        at = position
        position += 8 * n
        if position > len(data):
            raise CdrError("a sequence is longer than the message")
        return at, n

    frame_id = string()
    n_names = count()
    if 4 * n_names > len(data):
        raise CdrError("a sequence is longer than the message")
    name = [string() for _ in range(n_names)]
    positions, velocities, _ = doubles(), doubles(), doubles()
    shared = np.frombuffer(data.ljust(padded, b"\x00"), np.uint64)
    return _Layout(order, frame_id, name, positions, velocities, shared, mask.view(np.uint64))
