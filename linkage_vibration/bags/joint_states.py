# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads ``sensor_msgs/JointState`` by the thousand.

One publisher's messages differ in their stamps and numbers alone. So the first is parsed, and all
that have the same bytes elsewhere are taken apart together.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.streams import Block, Bytes, Integers

_KEPT = 256  # layouts; a publisher has one, or as many as it has orders of its joints
_ORIGIN = 4  # CDR aligns numbers to their sizes, counted from behind its encapsulation header


class CdrError(ValueError):
    """Bytes are not a joint state in plain CDR."""


@dataclass(frozen=True, slots=True, eq=False)
class JointStates:
    """Joint states that tell of the same joints in the same order, by columns.

    Attributes
    ----------
    rows : ndarray, (n,)
        Which messages of the block they are.
    data : ndarray of uint8, (n, n_bytes)
        Their bytes.
    sec, nanosec : ndarray, (n,)
        Stamps of their headers, s and ns.
    frame_id : str
        Frame of their headers.
    name : list of str, (n_joints,)
        Joint names.
    position, velocity : ndarray, (n_joints, n) or (0, n)
        rad or m, and the same per second; empty where the messages leave them out.
    """

    rows: Integers
    data: Bytes
    sec: NDArray[np.int32]
    nanosec: NDArray[np.uint32]
    frame_id: str
    name: list[str]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """Where the numbers of a message are, and which bytes others like it share with it."""

    order: str  # "<" or ">"
    frame_id: str
    name: list[str]
    position: tuple[int, int]  # at which byte, how many
    velocity: tuple[int, int]
    shared: NDArray[np.uint64]  # the message, padded
    mask: NDArray[np.uint64]  # ones where the bytes are shared


class JointStateReader:
    """Reads the joint states of blocks, and remembers what they look like.

    Attributes
    ----------
    unreadable : int
        How many messages were not valid CDR; they were left out.
    fault : str
        What is wrong with the first of them.
    """

    def __init__(self) -> None:
        self.unreadable = 0
        self.fault = ""
        self._layouts: dict[int, list[_Layout]] = {}

    def read(self, block: Block, rows: Integers) -> Iterator[JointStates]:
        """Yield the joint states among these messages of a block, alike ones together."""
        sizes = block.sizes[rows]
        for size in np.unique(sizes):
            alike = rows[sizes == size]
            messages = _gathered(block, alike, int(size))
            yield from self._read(messages, alike, int(size))

    def _read(self, messages: Bytes, rows: Integers, size: int) -> Iterator[JointStates]:
        words = messages.view(np.uint64)
        known = self._layouts.setdefault(size, [])
        left = np.arange(len(rows))
        for layout in known:
            fits = ~((words[left] ^ layout.shared) & layout.mask).any(axis=1)
            if fits.any():
                some = left[fits]
                yield _columns(messages[some], rows[some], size, layout)
                left = left[~fits]
            if not len(left):
                return
        while len(left):
            try:
                layout = _layout(messages[left[0], :size].tobytes(), messages.shape[1])
            except (CdrError, struct.error, UnicodeDecodeError) as error:
                self.fault = self.fault or f"{size} bytes that are no joint state: {error}"
                self.unreadable += 1
                left = left[1:]
                continue
            if sum(map(len, self._layouts.values())) >= _KEPT:
                self._layouts = {size: (known := [])}
            known.append(layout)
            fits = ~((words[left] ^ layout.shared) & layout.mask).any(axis=1)
            some = left[fits]
            yield _columns(messages[some], rows[some], size, layout)
            left = left[~fits]


def _gathered(block: Block, rows: Integers, size: int) -> Bytes:
    """Return messages of one size, (n, padded size); there is at least one."""
    padded = np.zeros((len(rows), -(-max(size, 1) // 8) * 8), np.uint8)
    if size:
        padded[:, :size] = sliding_window_view(block.buffer, size)[block.starts[rows]]
    return padded


def _columns(messages: Bytes, rows: Integers, size: int, layout: _Layout) -> JointStates:
    def doubles(at: int, count: int) -> NDArray[np.float64]:
        some = np.ascontiguousarray(messages[:, at : at + 8 * count])
        found = some.view(f"{layout.order}f8").reshape(len(rows), count)
        return found.T.astype(np.float64)

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
    """Parse a message."""
    if len(data) < _ORIGIN + 12 or data[0] != 0 or data[1] > 1:
        raise CdrError("its encapsulation is not that of plain CDR")
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
            raise CdrError("a string reaches beyond its end")
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
            raise CdrError("a sequence reaches beyond its end")
        return at, n

    frame_id = string()
    n_names = count()
    if 4 * n_names > len(data):
        raise CdrError("a sequence reaches beyond its end")
    name = [string() for _ in range(n_names)]
    positions, velocities, _ = doubles(), doubles(), doubles()
    shared = np.frombuffer(data.ljust(padded, b"\x00"), np.uint64)
    return _Layout(order, frame_id, name, positions, velocities, shared, mask.view(np.uint64))
