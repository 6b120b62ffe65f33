# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads messages of numbers and strings as columns, one for each field.

Own code because rosbags takes 6 times as long (`python -m benchmark.libraries`). The log itself
defines the fields, so that logs of older types can be read.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block, Bytes, Integers
from linkage_vibration.bags.cdr import CdrMessage, Layouts
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.schemas import NUMBERS, Schema, SchemaField
from linkage_vibration.bags.streams import open_bags

Column: TypeAlias = NDArray[Any]
Columns: TypeAlias = dict[str, Column]

LOG_TIME = "log_time"  # a column of every topic, ns
PLACE = "place"  # a column of every topic: the number of messages that are read before each

_MOST_STATED = 2**22  # messages; a damaged log may state any number
_TEXT = "string"
_CODES = {**NUMBERS, "bool": "u1"}


def read_columns(
    path: Path, types: Mapping[str, str], as_written: bool = False, unused: Collection[str] = ()
) -> dict[str, Columns]:
    """Read topics of a log into memory; ``types`` are those that `topic_types` returns.

    Columns are fields such as ``header.stamp.sec``, (n,) or (n, longest) with NaN behind,
    ``log_time``, ns, and ``place`` among all messages, by log times or ``as_written``.
    """
    names, done = list(types), 0
    with open_bags([path]) as bags:
        tables = []
        for name, type_name in types.items():
            defined = bags.defined(name)
            if defined is None:
                raise BagError(f"{path} does not define the type of {name}; record it as .mcap.")
            fields = list(_flat(path, defined[2], type_name))
            count = sum(topic.count for topic in bags.topics if topic.name == name)
            tables.append(_Table(type_name, fields, unused, min(count, _MOST_STATED)))
        for block in bags.blocks(names, as_written):
            for i, table in enumerate(tables):
                rows = np.flatnonzero(block.topics == i)
                try:
                    table.add(block, rows, done)
                except ValueError as error:
                    problem = f"{path}: a message on {names[i]} does not match its type: {error}"
                    raise BagError(f"{problem}; record it again.") from None
            done += len(block)
    return {name: table.columns() for name, table in zip(names, tables, strict=True)}


def topic_types(path: Path) -> dict[str, str]:
    """Return the topics of a log with their types, in alphabetical order."""
    with open_bags([path]) as bags:
        return {topic.name: topic.type for topic in bags.topics}


def first_topic(types: Mapping[str, str], type_name: str) -> str:
    """Return the first topic of a type among those of `topic_types`, or "" if there is none."""
    return next((topic for topic, name in types.items() if name == type_name), "")


def header_stamps(columns: Columns) -> NDArray[np.int64]:
    """Return the stamps of messages that have a header, ns, (n,)."""
    seconds, nanoseconds = (columns[f"header.stamp.{unit}"] for unit in ("sec", "nanosec"))
    return np.asarray(seconds.astype(np.int64) * 10**9 + nanoseconds.astype(np.int64))


def _flat(path: Path, schema: Schema, type_name: str, prefix: str = "") -> Iterator[SchemaField]:
    """Yield the fields of a type, those of nested messages with their paths as names."""
    for field in schema[type_name]:
        if field.type in schema and field.length is None:
            yield from _flat(path, schema, field.type, f"{prefix}{field.name}.")
            continue
        if field.type in schema and field.length:
            for i in range(field.length):
                yield from _flat(path, schema, field.type, f"{prefix}{field.name}[{i}].")
            continue
        if field.type not in _CODES and (field.type != _TEXT or field.length is not None):
            name = f"{path}: field {prefix}{field.name} of {type_name}"
            problem = f"{name} is not a number, text or list of numbers"
            raise BagError(f"{problem}; read this topic with another tool.")
        yield replace(field, name=prefix + field.name)


class _Table:
    """The columns of a topic, allocated for the number of messages that the log states."""

    def __init__(
        self, type_name: str, fields: list[SchemaField], unused: Collection[str], stated: int
    ) -> None:
        self._fields = fields
        self._layouts = Layouts(type_name, self._places)
        self._stated, self._count = stated, 0
        self._columns: Columns = {
            field.name: np.empty(
                0 if field.length is None else (0, 0),
                object if field.type == _TEXT else _CODES[field.type],
            )
            for field in [*fields, *(SchemaField(name, "int64") for name in (LOG_TIME, PLACE))]
            if field.name not in unused
        }

    def columns(self) -> Columns:
        """Return the columns, as far as they are filled."""
        return {name: column[: self._count] for name, column in self._columns.items()}

    def add(self, block: Block, rows: Integers, before: int) -> None:
        """Add messages of a block, before which so many messages of any topic were read."""
        for layout, alike, messages in self._layouts.groups(block, rows):
            at: slice | Integers = slice(self._count, self._count + len(rows))
            if len(alike) < len(rows):
                at = self._count + np.searchsorted(rows, alike)
            for field, (begin, count) in zip(self._fields, layout.places, strict=True):
                if field.name not in self._columns:
                    continue
                if field.type == _TEXT:
                    values = _decoded(messages[:, begin : begin + count])
                else:
                    values = layout.column(messages, begin, _CODES[field.type], count)
                    values = values[:, 0] if field.length is None else values
                self._put(field.name, at, values, self._count + len(rows))
            self._put(LOG_TIME, at, block.log_times[alike], self._count + len(rows))
            self._put(PLACE, at, before + alike, self._count + len(rows))
        self._count += len(rows)

    def _places(self, message: CdrMessage) -> list[tuple[int, int]]:
        """Return the first byte of each field of a message, and the number of its elements."""
        places = []
        for field in self._fields:
            size = int(_CODES.get(field.type, "u1")[1])
            listed = field.length == 0 or field.type == _TEXT
            count = message.count() if listed else field.length or 1
            if count:
                message.align(size)
            places.append((message.skip(count * size), count))
        return places

    def _put(self, name: str, at: slice | Integers, values: Column, needed: int) -> None:
        """Store values in a column of at least so many messages."""
        column, width = self._columns[name], values.shape[1:]
        if len(column) < needed or column.shape[1:] < width:
            length = self._stated if needed <= self._stated else 2 * needed
            larger = np.empty((length, *max(column.shape[1:], width)), column.dtype)
            _fill(larger, slice(0, len(column)), column)
            self._columns[name] = column = larger
        _fill(column, at, values)


def _fill(column: Column, at: slice | Integers, values: Column) -> None:
    """Store values in a column, with NaN (0 in a column of integers) after shorter lists."""
    if values.ndim == 1:
        column[at] = values
    else:
        width = values.shape[1]
        column[at, :width] = values
        column[at, width:] = np.nan if column.dtype.kind == "f" else 0


def _decoded(text: Bytes) -> Column:
    """Decode texts of one length, (n, length); each distinct one is decoded and kept once."""
    if not text.size:
        return np.full(len(text), "", object)
    values = np.ascontiguousarray(text).view(f"S{text.shape[1]}")[:, 0]
    if (values == values[0]).all():
        return np.full(len(values), values[0].decode(), object)
    distinct, which = np.unique(values, return_inverse=True)
    return np.array([each.decode() for each in distinct.tolist()], object)[which]
