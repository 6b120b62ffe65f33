# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads one number from each message of any type, one by one or thousands together.

A message is parsed only as far as the number. All others that have the same lengths before it have
the number at the same place, so they are not parsed.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.numbers import (
    CdrError,
    Integers,
    LeftOut,
    Number,
    NumberReader,
    Numbers,
    ReadingError,
)
from linkage_vibration.bags.schemas import (
    NUMBERS,
    Field,
    FieldError,
    Schema,
    Step,
    find_path,
    has_header,
)
from linkage_vibration.bags.streams import Block

_KEPT = 64  # layouts; most types have one
_ORIGIN = 4  # bytes of the encapsulation header, after which CDR aligns numbers to their sizes
_MAX_NAMES = 20
_STRUCT = {"f8": "d", "f4": "f", "i1": "b", "i2": "h", "i4": "i", "i8": "q"}
_STRUCT |= {"u1": "B", "u2": "H", "u4": "I", "u8": "Q"}
_SIZES = {name: int(code[1]) for name, code in NUMBERS.items()} | {"bool": 1}


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where the number of a message is, and the bytes on which this depends.

    A layout without a number has a fault, or the names that the message contains instead.
    """

    order: str  # "<" or ">"
    at: int
    needed: int  # bytes of a message up to the end of its number
    frame_id: str
    fault: str
    names: Sequence[str]
    places: Integers  # of the bytes that similar messages share
    shared: NDArray[np.uint8]
    mask: int = field(init=False)
    bits: int = field(init=False)

    def __post_init__(self) -> None:
        """Prepare the comparison with one message."""
        every = np.zeros((2, self.needed), np.uint8)
        every[0, self.places], every[1, self.places] = 0xFF, self.shared
        for name, row in zip(("mask", "bits"), every, strict=True):
            object.__setattr__(self, name, int.from_bytes(row.tobytes(), "little"))

    def fits(self, data: bytes) -> bool:
        """Return whether a message has its number here."""
        if len(data) < self.needed:
            return False
        bits = int.from_bytes(data[: self.needed], "little")
        return not (bits ^ self.bits) & self.mask


def _unknown_size(schema: Schema, type_name: str) -> str:
    """Return the first type in a type whose size is not known; empty if there is none."""
    if type_name in _SIZES or type_name == "string":
        return ""
    if type_name not in schema:
        return type_name
    found = (_unknown_size(schema, one.type) for one in schema[type_name])
    return next(filter(None, found), "")


class FieldReader(NumberReader):
    """Reads a field of messages of any type.

    Parameters
    ----------
    schema, type_name : Schema, str
        Fields of the type, and its name.
    path : str
        Path to a number; see `find_path`, which raises a `FieldError` for another one.

    Raises
    ------
    FieldError
        If the number lies behind a field whose size is not known.
    """

    def __init__(self, schema: Schema, type_name: str, path: str) -> None:
        self.has_header = has_header(schema, type_name)
        self._schema, self._type, self._path = schema, type_name, path
        self._steps = find_path(schema, type_name, path)
        self._check_sizes()
        self._code = NUMBERS[self._steps[-1].field.type]
        self._width = int(self._code[1])
        self._layouts: list[_Layout] = []

    def describe(self) -> str:
        """Return the path of the field, in words."""
        return f"field {self._path}"

    def read_one(self, data: bytes) -> Number | None:
        """Return the number of a message; see `NumberReader.read_one`.

        Raises
        ------
        ReadingError
            If the message has no such element.
        """
        layout = self._layout(data)
        if layout.fault:
            raise ReadingError(layout.fault)
        if layout.at < 0:
            return None
        [value] = struct.unpack_from(layout.order + _STRUCT[self._code], data, layout.at)
        if not self.has_header:
            return Number(float(value))
        sec, nanosec = struct.unpack_from(f"{layout.order}iI", data, _ORIGIN)
        return Number(float(value), math.nan, sec, nanosec, layout.frame_id)

    def read(self, block: Block, rows: Integers, left_out: LeftOut) -> Iterator[Numbers]:
        """Read many messages; those of the same layout together.

        Parameters
        ----------
        block, rows, left_out : Block, ndarray and LeftOut
            As in `NumberReader.read`.
        """
        known, left = iter(list(self._layouts)), rows
        while len(left):
            layout = next(known, None)
            if layout is None:
                try:
                    layout = self._parsed(block.message(int(left[0])))
                except CdrError as error:
                    left_out.unreadable += 1
                    left_out.fault = left_out.fault or str(error)
                    left = left[1:]
                    continue
            same = block.sizes[left] >= layout.needed
            places = block.starts[left[same], np.newaxis] + layout.places
            same[same] = (block.buffer[places] == layout.shared).all(axis=1)
            found, left = left[same], left[~same]
            if not len(found):
                continue
            if layout.fault:
                left_out.refused += len(found)
                left_out.fault = left_out.fault or layout.fault
            elif layout.at < 0:
                left_out.others += len(found)
                left_out.names.update(layout.names)
            else:
                yield self._numbers(block, found, layout)

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return the names in a message, at most 20."""
        return self._layout(data).names

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return that the name is missing, which names are there, and the remedy.

        Parameters
        ----------
        topic, names : str and sequence of str
            The topic that was read, and the names that its messages contain.
        """
        if not names:
            return ""
        listing = ", ".join(sorted(names)[:_MAX_NAMES])
        return f"{topic} has no {self._path}; it has {listing}. Choose one of them."

    def _check_sizes(self) -> None:
        """Refuse a path behind a field whose size is not known, such as a ``wstring``."""
        inside = self._type
        for step in self._steps:
            for one in self._schema[inside]:
                if one == step.field:
                    break
                if unknown := _unknown_size(self._schema, one.type):
                    raise FieldError(
                        f"{self._type}: {self._path} lies behind {one.name}, and the size of a "
                        f"{unknown.rpartition('/')[2]} is not known; choose a field before it, or "
                        "another message."
                    )
            inside = step.field.type

    def _numbers(self, block: Block, rows: Integers, layout: _Layout) -> Numbers:
        """Return the numbers of messages of a layout."""
        starts = block.starts[rows, np.newaxis]

        def column(at: int, code: str) -> NDArray[Any]:
            values = block.buffer[starts + np.arange(at, at + int(code[1]))]
            return np.asarray(values.view(layout.order + code)[:, 0])

        sec = nanosec = np.zeros(len(rows), np.uint32)
        if self.has_header:
            sec, nanosec = column(_ORIGIN, "i4"), column(_ORIGIN + 4, "u4")
        return Numbers(
            rows,
            column(layout.at, self._code).astype(np.float64),
            np.full(len(rows), math.nan),
            sec.astype(np.int32),
            nanosec.astype(np.uint32),
            layout.frame_id,
        )

    def _layout(self, data: bytes) -> _Layout:
        """Return the layout of a message."""
        for layout in self._layouts:
            if layout.fits(data):
                return layout
        return self._parsed(data)

    def _parsed(self, data: bytes) -> _Layout:
        """Parse a message, and keep its layout."""
        try:
            layout = self._parse(data)
        except (struct.error, UnicodeDecodeError) as error:
            raise CdrError(f"{len(data)} bytes are not a {self._type}: {error}") from None
        self._layouts = [*self._layouts[1 - _KEPT :], layout]
        return layout

    def _parse(self, data: bytes) -> _Layout:
        message = _Message(data, self._type, self._schema)
        frame_id, fault, names = "", "", list[str]()
        if self.has_header:
            message.position += 8
            frame_id = message.text()
            message.position = _ORIGIN
        inside, found = self._type, True
        for step in self._steps:
            index, names = message.enter(inside, step)
            inside = step.field.type
            if index < 0:
                found = False
                if not step.name:
                    fault = (
                        f"A message has {-1 - index} elements in {step.field.name}, so "
                        f"{self._path} is missing; choose another element."
                    )
                elif step.name in names:
                    fault = (
                        f"A message has no single element of {step.field.name} for {step.name}; "
                        "publish each name once, and one element for each name."
                    )
                break
        at = -1
        if found:
            message.align(self._width)
            at = message.position
            message.skip_bytes(self._width)
        places = np.unique(np.concatenate([np.arange(*span) for span in message.spans]))
        needed = max(message.position if found else 0, int(places[-1]) + 1)
        shared = np.frombuffer(data, np.uint8)[places]
        return _Layout(
            message.order, at, needed, frame_id, fault, names[:_MAX_NAMES], places, shared
        )


class _Message:
    """A message that is being parsed.

    Attributes
    ----------
    order : str
        "<" or ">".
    position : int
        The next byte.
    spans : list of (int, int)
        The bytes on which positions depend so far.
    """

    def __init__(self, data: bytes, type_name: str, schema: Schema) -> None:
        if len(data) < _ORIGIN:
            raise CdrError(f"{len(data)} bytes are not a {type_name} in plain CDR")
        if data[0] != 0 or data[1] > 1:
            raise CdrError(
                f"a {type_name} begins with 0x{data[:2].hex().upper()}, but 0x0000 or 0x0001 is "
                "plain CDR; let its publisher use the encoding XCDR1 for a final type"
            )
        self._data, self._type, self._schema = data, type_name, schema
        self.order = "<" if data[1] else ">"
        self.position = _ORIGIN
        self.spans = [(0, 2)]

    def align(self, size: int) -> None:
        """Go to the next multiple of a size."""
        self.position += -(self.position - _ORIGIN) % size

    def skip_bytes(self, count: int) -> None:
        """Go on by a number of bytes."""
        self.position += count
        if self.position > len(self._data):
            raise CdrError(f"a message of {len(self._data)} bytes is too short for a {self._type}")

    def count(self) -> int:
        """Return the length at the position, and go behind it."""
        self.align(4)
        [found] = struct.unpack_from(f"{self.order}I", self._data, self.position)
        self.spans.append((self.position, self.position + 4))
        self.position += 4
        if found > len(self._data):  # each element has at least one byte
            raise CdrError(f"a list or text is longer than the message of {len(self._data)} bytes")
        return int(found)

    def text(self) -> str:
        """Return the text at the position, on which the layout depends."""
        length = self.count()
        begin = self.position
        self.skip_bytes(length)
        self.spans.append((begin, self.position))
        return self._data[begin : self.position].rstrip(b"\x00").decode()

    def skip(self, one: Field) -> None:
        """Go behind a field."""
        count = 1 if one.length is None else one.length or self.count()
        self._skip_elements(one.type, count)

    def enter(self, inside: str, step: Step) -> tuple[int, list[str]]:
        """Go to the element of a step, and return its place and the names beside it.

        The place is negative if there is no such element: -1 less the number of elements, or any
        number if the element has a name.
        """
        names: list[str] | None = None
        begin = -1
        for one in self._schema[inside]:
            if one == step.field:
                begin = self.position
                if not step.name or names is not None:
                    break
                self.skip(one)
            elif one.name == step.names:
                names = [self.text() for _ in range(one.length or self.count())]
                if begin >= 0:
                    break
            else:
                self.skip(one)
        self.position = begin
        if step.field.length is None:
            return 0, []
        count = step.field.length or self.count()
        index, names = step.index, names or []
        if step.name:
            single = names.count(step.name) == 1 and len(names) == count
            index = names.index(step.name) if single else -1
        assert index is not None
        if not 0 <= index < count:
            return -1 - count, names
        self._skip_elements(step.field.type, index)
        return index, names

    def _skip_elements(self, type_name: str, count: int) -> None:
        """Go behind elements of a type."""
        size = _SIZES.get(type_name)
        if size is not None:
            if count:
                self.align(size)
                self.skip_bytes(size * count)
            return
        for _ in range(count):
            if type_name == "string":
                self.skip_bytes(self.count())
            elif type_name in self._schema:
                for one in self._schema[type_name]:
                    self.skip(one)
            else:
                raise CdrError(f"the size of a {type_name} is not known")
