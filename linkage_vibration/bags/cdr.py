# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds values in messages in plain CDR, in one of them or in thousands together.

One message is parsed, and its layout is kept: where its values are, and the bytes (lengths and
texts) on which that depends. Every other message with these bytes has its values at the same
places. Own code because rosbags takes 12 times as long (`python -m benchmark.libraries`).
"""

import struct
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Bytes
from linkage_vibration.bags.scalar_reader import CdrError, Integers, SkippedMessages

ORIGIN = 4  # bytes of the encapsulation header, after which CDR aligns numbers to their sizes
STAMP = 8  # bytes of the stamp of a header, which comes first
_KEPT = 64  # layouts; most publishers have one

Places = TypeVar("Places")


class CdrMessage:
    """A message that is being parsed; ``spans`` are the bytes on which positions depend."""

    def __init__(self, data: bytes, type_name: str) -> None:
        if len(data) < ORIGIN:
            raise CdrError(f"{len(data)} bytes are not a {type_name} in plain CDR")
        if data[0] != 0 or data[1] > 1:
            problem = f"begins with 0x{data[:2].hex().upper()}, but 0x0000 or 0x0001 is plain CDR"
            hint = "let its publisher use the encoding XCDR1 for a final type"
            raise CdrError(f"a {type_name} {problem}; {hint}")
        self._data, self._type = data, type_name
        self.order = "<" if data[1] else ">"
        self.position = ORIGIN
        self.spans = [(0, 2)]

    def align(self, size: int) -> None:
        """Go to the next multiple of a size."""
        self.position += -(self.position - ORIGIN) % size

    def skip(self, count: int) -> int:
        """Go behind a number of bytes, and return where they begin."""
        begin = self.position
        self.position += count
        if self.position > len(self._data):
            raise CdrError(f"{len(self._data)} bytes are too short for a {self._type}")
        return begin

    def count(self) -> int:
        """Return the length at the position, and go behind it."""
        self.align(4)
        begin = self.skip(4)
        self.spans.append((begin, self.position))
        [count] = struct.unpack_from(f"{self.order}I", self._data, begin)
        if count > len(self._data):  # each element has at least one byte
            problem = f"{len(self._data)} bytes are not a {self._type}: a list or text is longer"
            raise CdrError(problem)
        return int(count)

    def text(self) -> str:
        """Return the text at the position, on which the layout depends, and go behind it."""
        begin = self.skip(self.count())
        self.spans.append((begin, self.position))
        return self._data[begin : self.position].rstrip(b"\x00").decode()


class Layout(Generic[Places]):
    """Where the values of similar messages are, and the bytes that these messages share."""

    def __init__(self, data: bytes, message: CdrMessage, places: Places) -> None:
        self.places, self.order = places, message.order
        self.needed = max(message.position, *(end for _, end in message.spans))
        mask = np.zeros(_padded(self.needed), np.uint8)
        for begin, end in message.spans:
            mask[begin:end] = 0xFF
        shared = np.frombuffer(data[: self.needed].ljust(len(mask), b"\0"), np.uint8) & mask
        self.mask, self.shared = mask.view(np.uint64), shared.view(np.uint64)
        self._mask = int.from_bytes(mask.tobytes(), "little")
        self._shared = int.from_bytes(shared.tobytes(), "little")

    def fits(self, data: bytes) -> bool:
        """Return whether a message has its values here."""
        if len(data) < self.needed:
            return False
        return int.from_bytes(data[: self.needed], "little") & self._mask == self._shared

    def column(self, messages: Bytes, at: int, code: str, count: int = 1) -> NDArray[Any]:
        """Return the values at a place of messages, (n, count), of a code such as "f8"."""
        values = np.ascontiguousarray(messages[:, at : at + count * int(code[1])])
        return values.view(self.order + code).astype(code, copy=False).reshape(len(messages), count)

    def stamps(self, messages: Bytes) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
        """Return the seconds and nanoseconds of the headers of messages, each (n,)."""
        sec = self.column(messages, ORIGIN, "i4")[:, 0]
        return sec, self.column(messages, ORIGIN + 4, "u4")[:, 0]


class Layouts(Generic[Places]):
    """The layouts of the messages of a type; ``parse`` returns the places in one of them."""

    def __init__(self, type_name: str, parse: Callable[[CdrMessage], Places]) -> None:
        self._type, self._parse = type_name, parse
        self._kept: list[Layout[Places]] = []

    def find(self, data: bytes) -> Layout[Places]:
        """Return the layout of a message, or raise a `CdrError`."""
        for layout in self._kept:
            if layout.fits(data):
                return layout
        return self._parsed(data)

    def groups(
        self, block: Block, rows: Integers, left_out: SkippedMessages | None = None
    ) -> Iterator[tuple[Layout[Places], Integers, Bytes]]:
        """Yield the messages of each layout: it, their rows, and their bytes up to what it needs.

        Messages that are not of the type are counted, or raise a `CdrError`.
        """
        kept = iter(list(self._kept))
        while len(rows):
            layout = next(kept, None)
            if layout is None:
                try:
                    layout = self._parsed(block.message(int(rows[0])))
                except CdrError as error:
                    if left_out is None:
                        raise
                    left_out.unreadable += 1
                    left_out.fault = left_out.fault or str(error)
                    rows = rows[1:]
                    continue
            enough = block.sizes[rows] >= layout.needed
            if not enough.any():
                continue
            messages = _gathered(block, rows[enough], layout.needed)
            fits = ~((messages.view(np.uint64) & layout.mask) != layout.shared).any(axis=1)
            if fits.all() and enough.all():
                yield layout, rows, messages
                return
            if fits.any():
                yield layout, rows[enough][fits], messages[fits]
            enough[enough] = fits
            rows = rows[~enough]

    def _parsed(self, data: bytes) -> Layout[Places]:
        """Parse a message, and keep its layout."""
        try:
            message = CdrMessage(data, self._type)
            layout = Layout(data, message, self._parse(message))
        except UnicodeDecodeError as error:
            raise CdrError(f"{len(data)} bytes are not a {self._type}: {error}") from None
        self._kept = [*self._kept[1 - _KEPT :], layout]
        return layout


def _padded(size: int) -> int:
    return -(-size // 8) * 8


def _gathered(block: Block, rows: Integers, size: int) -> Bytes:
    """Return the first bytes of messages as rows that are padded to multiples of 8 bytes."""
    padded = np.zeros((len(rows), _padded(size)), np.uint8)
    padded[:, :size] = sliding_window_view(block.buffer, size)[block.starts[rows]]
    return padded
