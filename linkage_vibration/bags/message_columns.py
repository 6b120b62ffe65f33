# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads messages of numbers and strings as columns, one for each field.

Own code because rosbags takes 6 times as long (`python -m benchmark.libraries`). The log itself
defines the fields, so that logs of older types can be read. Messages whose strings and sequences
have the same lengths are decoded together.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.bags.reading import BagError, open_bag
from linkage_vibration.bags.streams import Block, open_bags

Column: TypeAlias = NDArray[Any]
Columns: TypeAlias = dict[str, Column]
# Name, type and length: that of an array, 0 for a sequence (messages say it), None for one value.
_Field: TypeAlias = tuple[str, str, int | None]

LOG_TIME = "log_time"  # a column of every topic, ns
PLACE = "place"  # a column of every topic: the number of messages that are read before each

_MOST_STATED = 2**22  # messages; a damaged log may state any number
_ORIGIN = 4  # bytes of the encapsulation header, after which CDR aligns numbers to their sizes
_CODES = {"float64": "f8", "float32": "f4", "bool": "u1", "byte": "u1", "octet": "u1"}
_CODES |= {f"int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)}
_CODES |= {f"uint{8 * size}": f"u{size}" for size in (1, 2, 4, 8)}


def read_columns(
    path: Path, types: Mapping[str, str], as_written: bool = False, unused: Collection[str] = ()
) -> dict[str, Columns]:
    """Read topics of a log into memory.

    Parameters
    ----------
    path : Path
        An MCAP file, or another bag that defines its types.
    types : mapping of str to str
        The topics to read with their types; see `topic_types`.
    as_written : bool
        Whether messages of an MCAP file are in the order in which they were written.
    unused : collection of str
        Names of fields that are left out.

    Returns
    -------
    dict of str to columns
        The fields of each topic by name, such as ``data`` or ``header.stamp.sec``: ndarray (n,),
        or (n, longest) of an array or a sequence, with NaN after a shorter one. Texts are objects,
        so that equal ones are in memory once. Messages are in the
        order of log times, which are in the column ``log_time``, ns. The column ``place`` has the
        place of each among the messages of all topics.

    Raises
    ------
    BagError
        If the log cannot be read, or a message does not match its type.
    """
    fields = _fields(path, types)
    found: dict[str, Columns] = {name: {} for name in types}
    counts, names, done = dict.fromkeys(types, 0), list(types), 0
    with open_bags([path]) as bags:
        stated = {topic.name: min(topic.count, _MOST_STATED) for topic in bags.topics}
        for block in bags.blocks(names, as_written):
            for i, name in enumerate(names):
                rows = np.flatnonzero(block.topics == i)
                if len(rows):
                    part = _block_columns(path, name, fields[name], block, rows)
                    part[PLACE] = done + rows
                    for field in part.keys() - set(unused):
                        _append(found[name], field, part[field], counts[name], stated[name])
                    counts[name] += len(rows)
            done += len(block)
    kept = {name: [f for f in fields[name] if f[0] not in unused] for name in types}
    return {
        name: {field: column[: counts[name]] for field, column in found[name].items()}
        or _joined([], kept[name])
        for name in names
    }


def topic_types(path: Path) -> dict[str, str]:
    """Return the topics of a log with their types, in alphabetical order.

    Raises
    ------
    BagError
        If the log cannot be read.
    """
    with open_bag(path) as bag:
        return dict(sorted((c.topic, c.msgtype) for c in bag.connections))


def first_topic(types: Mapping[str, str], type_name: str) -> str:
    """Return the first topic of a type, or "" if there is no such topic.

    Parameters
    ----------
    types : mapping of str to str
        The topics of a log with their types; see `topic_types`.
    type_name : str
        The type, as in "std_msgs/msg/Float64".
    """
    return next((topic for topic, found in types.items() if found == type_name), "")


def header_stamps(columns: Columns) -> NDArray[np.int64]:
    """Return the stamps of messages that have a header, ns, (n,)."""
    seconds, nanoseconds = (columns[f"header.stamp.{unit}"] for unit in ("sec", "nanosec"))
    return np.asarray(seconds.astype(np.int64) * 10**9 + nanoseconds.astype(np.int64))


def _fields(path: Path, types: Mapping[str, str]) -> dict[str, list[_Field]]:
    """Return the fields of each topic, including those of nested messages, in their order."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    with open_bag(path) as bag:
        used = [c for c in bag.connections if c.topic in types]
        for text, type_name in sorted({(c.msgdef.data, c.msgtype) for c in used}):
            store.register(get_types_from_msg(text, type_name))

    def flat(type_name: str, prefix: str) -> Iterator[_Field]:
        for name, (kind, content) in store.fielddefs[type_name][1]:
            if kind.name == "NAME":
                yield from flat(str(content), f"{prefix}{name}.")
                continue
            base = content if kind.name == "BASE" else content[0][1]
            base = str(base[0]) if isinstance(base, tuple) else str(base)
            length = None if kind.name == "BASE" else int(content[1] or 0)
            if base not in _CODES and (base != "string" or length is not None):
                raise BagError(
                    f"{path}: field {prefix}{name} of {type_name} is not a number, text or list of "
                    "numbers; read this topic with another tool."
                )
            yield prefix + name, base, length

    return {topic: list(flat(type_name, "")) for topic, type_name in types.items()}


def _block_columns(
    path: Path, topic: str, fields: Sequence[_Field], block: Block, rows: NDArray[np.int64]
) -> Columns:
    """Return the columns of the messages of one topic in a block."""
    parts: list[tuple[NDArray[np.int64], Columns]] = []
    for size in np.unique(block.sizes[rows]):
        alike = rows[block.sizes[rows] == size]
        messages = sliding_window_view(block.buffer, int(size))[block.starts[alike]]
        try:
            parts += _columns(messages, alike, fields, _ORIGIN, {})
        except (IndexError, ValueError):
            raise BagError(
                f"{path}: a message of {int(size)} bytes on {topic} does not match its type; "
                "record it again."
            ) from None
    found = _joined([part for _, part in parts], fields)
    found[LOG_TIME] = block.log_times[np.concatenate([which for which, _ in parts])]
    order = np.argsort(np.concatenate([which for which, _ in parts]))
    return {name: column[order] for name, column in found.items()}


def _columns(
    messages: NDArray[np.uint8],
    rows: NDArray[np.int64],
    fields: Sequence[_Field],
    position: int,
    found: Columns,
) -> Iterator[tuple[NDArray[np.int64], Columns]]:
    """Yield the columns of messages of one size, with equal lengths together."""
    order = "<" if messages[0, 1] else ">"

    def numbers(at: int, code: str, count: int) -> Column:
        width = count * int(code[1:])
        if at + width > messages.shape[1]:
            raise ValueError
        values = np.ascontiguousarray(messages[:, at : at + width])
        return values.view(order + code).astype(code).reshape(len(rows), count)

    for k, (name, kind, length) in enumerate(fields):
        code = _CODES.get(kind, "u1")
        if length == 0 or kind == "string":
            position += -position % 4
            lengths = numbers(position, "u4", 1)[:, 0]
            if (lengths != lengths[0]).any():
                for each in np.unique(lengths):
                    same = lengths == each
                    known = {key: column[same] for key, column in found.items()}
                    yield from _columns(messages[same], rows[same], fields[k:], position, known)
                return
            position, count = position + 4, int(lengths[0])
        else:
            count = length or 1
        if count and kind != "string":
            position += -(position - _ORIGIN) % int(code[1:])
        values = numbers(position, code, count)
        position += count * int(code[1:])
        if kind == "string":
            text = np.ascontiguousarray(values).view(f"S{max(count, 1)}")[:, 0]
            found = {**found, name: _decoded(text)}
        else:
            found = {**found, name: values[:, 0] if length is None else values}
    yield rows, found


def _append(columns: Columns, name: str, values: Column, count: int, stated: int) -> None:
    """Put values after the first ones of a column, which are so many.

    The column is as long as the log states, and otherwise grows to twice its length, as thousands
    of small pieces would fragment the memory.
    """
    known, width, needed = columns.get(name, values[:0]), values.shape[1:], count + len(values)
    if len(known) < needed or known.shape[1:] < width:
        length = stated if needed <= stated else max(2 * count, needed)
        shape = length, *max(known.shape[1:], width)
        larger = np.empty(shape, values.dtype)
        columns[name] = larger
        _put(larger[:count], known[:count])
        known = larger
    _put(known[count:needed], values)


def _put(target: Column, values: Column) -> None:
    """Copy values into a target, with NaN after shorter sequences."""
    if values.shape == target.shape:
        target[:] = values
    else:
        target[:, : values.shape[1]] = values
        target[:, values.shape[1] :] = np.nan


def _decoded(text: NDArray[np.bytes_]) -> Column:
    """Decode texts, of which each distinct one is decoded once and kept once."""
    if (text == text[0]).all():
        return np.full(len(text), text[0].decode(), object)
    distinct, which = np.unique(text, return_inverse=True)
    return np.array([one.decode() for one in distinct.tolist()], object)[which]


def _joined(parts: Sequence[Columns], fields: Sequence[_Field]) -> Columns:
    """Concatenate columns, which are taken out of the parts to save memory.

    Sequences get the width of the longest.
    """
    joined: Columns = {}
    for name, kind, length in fields:
        columns = [part.pop(name) for part in parts]
        if length is not None and columns:
            width = max(column.shape[1] for column in columns)
            columns = [
                np.pad(column, ((0, 0), (0, width - column.shape[1])), constant_values=np.nan)
                if column.shape[1] < width
                else column
                for column in columns
            ]
        empty = np.empty(
            0 if length is None else (0, 0), object if kind == "string" else _CODES[kind]
        )
        joined[name] = np.concatenate(columns) if columns else empty
    for name in (LOG_TIME, PLACE):
        if all(name in part for part in parts):
            times = [part.pop(name) for part in parts]
            joined[name] = np.concatenate(times) if times else np.empty(0, np.int64)
    return joined
