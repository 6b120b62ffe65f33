# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads one number from each message of any type, one by one or thousands together.

A message is parsed only as far as the number.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.cdr import ORIGIN, STAMP, CdrMessage, Layouts
from linkage_vibration.bags.scalar_reader import (
    MAX_NAMES,
    CdrError,
    Integers,
    NumberReader,
    ReadingError,
    Scalar,
    ScalarBatch,
    SkippedMessages,
)
from linkage_vibration.bags.schemas import NUMBERS, Schema, SchemaField, Step, find_path, has_header

_STRUCT = {"f8": "d", "f4": "f", "i1": "b", "i2": "h", "i4": "i", "i8": "q"}
_STRUCT |= {"u1": "B", "u2": "H", "u4": "I", "u8": "Q"}
_NOT_VALID = "Its publisher says that it is not valid."
_SIZES = {name: int(code[1]) for name, code in NUMBERS.items()} | {"bool": 1}


@dataclass(frozen=True, slots=True)
class _Places:
    """Where the numbers of a message are; -1 for none, with a fault or the names that there are."""

    frame_id: str
    value: int = -1
    rate: int = -1
    fault: str = ""
    names: Sequence[str] = ()


class FieldReader(NumberReader):
    """Reads a number by a path, its rate from a list ``rates``, and a flag behind it."""

    def __init__(
        self, schema: Schema, type_name: str, path: str, rates: str = "", flagged: bool = False
    ) -> None:
        self._flagged = flagged
        self.has_header = has_header(schema, type_name)
        self._schema, self._type, self._path = schema, type_name, path
        self.what = f"field {path}"
        self._steps = find_path(schema, type_name, path)
        self._code = NUMBERS[self._steps[-1].field.type]
        self._rate_steps: tuple[Step, ...] = ()
        if rates:
            last = replace(self._steps[-1], field=SchemaField(rates, "float64", 0))
            self._rate_steps = (*self._steps[:-1], last)
        self._layouts = Layouts(type_name, self._places)

    def read_one(self, data: bytes) -> Scalar | None:
        """Return the number of a message; see `NumberReader.read_one`."""
        layout = self._layouts.find(data)
        places, order = layout.places, layout.order
        if places.fault:
            raise ReadingError(places.fault)
        if places.value < 0:
            return None
        [value] = struct.unpack_from(order + _STRUCT[self._code], data, places.value)
        if self._flagged:
            self.note = "" if data[places.value + int(self._code[1])] else _NOT_VALID
            value = math.nan if self.note else value
        rate = math.nan
        if places.rate >= 0:
            [rate] = struct.unpack_from(f"{order}d", data, places.rate)
        if not self.has_header:
            return Scalar(float(value), rate)
        sec, nanosec = struct.unpack_from(f"{order}iI", data, ORIGIN)
        return Scalar(float(value), rate, sec, nanosec, places.frame_id)

    def read(
        self, block: Block, rows: Integers, left_out: SkippedMessages
    ) -> Iterator[ScalarBatch]:
        """Read many messages, those of the same layout together; see `NumberReader.read`."""
        for layout, alike, messages in self._layouts.groups(block, rows, left_out):
            places, n = layout.places, len(alike)
            if places.fault:
                left_out.refused += n
                left_out.fault = left_out.fault or places.fault
                continue
            if places.value < 0:
                left_out.others += n
                left_out.names.update(places.names)
                continue
            value = layout.column(messages, places.value, self._code)[:, 0].astype(np.float64)
            if self._flagged:
                flags = layout.column(messages, places.value + int(self._code[1]), "u1")[:, 0]
                value[flags == 0] = math.nan
                self.note = "" if flags.all() else _NOT_VALID
            rate = np.full(n, math.nan)
            if places.rate >= 0:
                rate = layout.column(messages, places.rate, "f8")[:, 0]
            sec, nanosec = np.zeros(n, np.int32), np.zeros(n, np.uint32)
            if self.has_header:
                sec, nanosec = layout.stamps(messages)
            yield ScalarBatch(alike, value, rate, sec, nanosec, places.frame_id)

    def other_names(self, data: bytes) -> Sequence[str]:
        """Return the names in a message without a fault, at most `MAX_NAMES`."""
        places = self._layouts.find(data).places
        return () if places.fault else places.names

    def _places(self, message: CdrMessage) -> _Places:
        """Return where the numbers of a message are."""
        frame_id = ""
        if self.has_header:
            message.skip(STAMP)
            frame_id = message.text()
        value, names, fault = self._place(message, self._steps)
        if self._flagged:
            message.skip(1)
        rate = -1
        if self._rate_steps and value >= 0:
            rate, _, _ = self._place(message, self._rate_steps)
        return _Places(frame_id, value, rate, fault, names[:MAX_NAMES])

    def _place(self, message: CdrMessage, steps: Sequence[Step]) -> tuple[int, Sequence[str], str]:
        """Return where the number of a path is (-1 for none), the names beside it, and a fault."""
        message.position, inside, names = ORIGIN, self._type, list[str]()
        for step in steps:
            count, names = self._enter(message, inside, step)
            index = step.index or 0
            if step.name:
                if step.name not in names and (names or not count):
                    return -1, names, ""
                if fault := _name_fault(step, names, count):
                    return -1, names, fault
                index = names.index(step.name)
            if index >= count:
                fault = f"A message has {count} elements in {step.field.name}"
                hint = f"so {self._path} is missing; choose another element."
                return -1, names, f"{fault}, {hint}"
            self._skip_elements(message, step.field.type, index)
            inside = step.field.type
        size = _SIZES[inside]
        message.align(size)
        return message.skip(size), names, ""

    def _enter(self, message: CdrMessage, inside: str, step: Step) -> tuple[int, list[str]]:
        """Go to the first element of a step; return the number of elements, and their names."""
        names: list[str] | None = None if step.name else []
        begin = -1
        for field in self._schema[inside]:
            if field.name == step.field.name:
                begin = message.position
            if begin >= 0 and names is not None:
                break
            if names is None and field.name == step.names:
                names = [message.text() for _ in range(field.length or message.count())]
            else:
                self._skip_field(message, field)
        message.position = begin
        if step.field.length is None:
            return 1, names or []
        return step.field.length or message.count(), names or []

    def _skip_field(self, message: CdrMessage, field: SchemaField) -> None:
        count = 1 if field.length is None else field.length or message.count()
        self._skip_elements(message, field.type, count)

    def _skip_elements(self, message: CdrMessage, type_name: str, count: int) -> None:
        """Go behind elements of a type."""
        size = _SIZES.get(type_name)
        if size is not None:
            if count:
                message.align(size)
                message.skip(size * count)
            return
        for _ in range(count):
            if type_name == "string":
                message.skip(message.count())
            elif type_name in self._schema:
                for field in self._schema[type_name]:
                    self._skip_field(message, field)
            else:
                what = f"{type_name.rpartition('/')[2]}, whose size is not known"
                raise CdrError(f"{self._path} lies behind a {what}; choose a field before it")


def _name_fault(step: Step, names: Sequence[str], count: int) -> str:
    """Return why the element of a step is not known by its name; empty if it is."""
    times = names.count(step.name)
    if times > 1:
        return f"A message contains the name {step.name} {times} times; publish each name once."
    if len(names) != count:
        counts = f"{len(names)} names but {count} elements in {step.field.name}"
        problem = f"A message has {counts}, so the one of {step.name} is unknown"
        return f"{problem}; publish one element for each name."
    return ""
