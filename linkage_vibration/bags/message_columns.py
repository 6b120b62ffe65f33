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
            tables.append(_Table(type_name, fields, unused))
        for block in bags.blocks(names, as_written):
            for i, table in enumerate(tables):
                rows = np.flatnonzero(block.topics == i)
                try:
                    table.add(block, rows, done)
                except ValueError as error:
                    raise BagError(
                        f"{path}: a message on {names[i]} does not match its type: {error}; record "
                        "it again."
                    ) from None
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
            raise BagError(
                f"{path}: field {prefix}{field.name} of {type_name} is not a number, text or list "
                "of numbers; read this topic with another tool."
            )
        yield replace(field, name=prefix + field.name)


class _Table:
    """The columns of a topic, as parts of messages with the same layout."""

    def __init__(self, type_name: str, fields: list[SchemaField], unused: Collection[str]) -> None:
        self._fields = fields
        self._layouts = Layouts(type_name, self._places)
        self._parts: dict[str, list[Column]] = {
            field.name: [
                np.empty(
                    0 if field.length is None else (0, 0),
                    object if field.type == _TEXT else _CODES[field.type],
                )
            ]
            for field in [*fields, *(SchemaField(name, "int64") for name in (LOG_TIME, PLACE))]
            if field.name not in unused
        }

    def columns(self) -> Columns:
        """Return the columns in the order of the messages; the parts are gone then."""
        columns = {name: _stacked(self._parts.pop(name)) for name in list(self._parts)}
        places = columns[PLACE]
        if (np.diff(places) > 0).all():
            return columns
        order = np.argsort(places)
        return {name: column[order] for name, column in columns.items()}

    def add(self, block: Block, rows: Integers, before: int) -> None:
        """Add messages of a block, before which so many messages of any topic were read."""
        for layout, alike, messages in self._layouts.groups(block, rows):
            for field, (begin, count) in zip(self._fields, layout.places, strict=True):
                if field.name not in self._parts:
                    continue
                if field.type == _TEXT:
                    values = _decoded(messages[:, begin : begin + count])
                else:
                    values = layout.column(messages, begin, _CODES[field.type], count)
                    values = values[:, 0] if field.length is None else values
                self._parts[field.name].append(values)
            self._parts[LOG_TIME].append(block.log_times[alike])
            self._parts[PLACE].append(before + alike)

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


def _stacked(parts: list[Column]) -> Column:
    """Join the parts of a column, with NaN (0 in a column of integers) after shorter lists."""
    width, fill = max(part.shape[1:] for part in parts), np.nan if parts[0].dtype.kind == "f" else 0
    if width:
        parts = [
            np.pad(part, ((0, 0), (0, width[0] - part.shape[1])), constant_values=fill)
            for part in parts
        ]
    return np.concatenate(parts)


def _decoded(text: Bytes) -> Column:
    """Decode texts of one length, (n, length); each distinct one is decoded and kept once."""
    if not text.size:
        return np.full(len(text), "", object)
    values = np.ascontiguousarray(text).view(f"S{text.shape[1]}")[:, 0]
    if (values == values[0]).all():
        return np.full(len(values), values[0].decode(), object)
    distinct, which = np.unique(values, return_inverse=True)
    return np.array([each.decode() for each in distinct.tolist()], object)[which]
