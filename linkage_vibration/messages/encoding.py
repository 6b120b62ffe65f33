# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Encodes our messages as CDR, one at a time or many at once, without rclpy.

The same values always give the same bytes. A ROS 2 serializer does not promise that: it may leave
arbitrary bytes where CDR pads. `struct` and NumPy are also several times faster than rclpy.
"""

import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache, lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Bytes, Integers
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import CODES, message_fields

# The encapsulation header of plain CDR (OMG DDS-RTPS, 10.2) names the byte order that follows.
_ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
_WIDEST = {1: "B", 2: "H", 4: "I", 8: "d"}  # Characters of `struct` by the alignment that they have

# The arguments of an encoder that fill the header.
_HEADER = {
    "header.stamp.sec": "sec",
    "header.stamp.nanosec": "nanosec",
    "header.frame_id": "frame_id",
    "stamp.sec": "sec",
    "stamp.nanosec": "nanosec",
}


def encode_message(type_name: str, message: object, sec: int, nanosec: int, frame_id: str) -> bytes:
    """Encode one message with its encapsulation header, as DDS carries it and MCAP stores it.

    The object has the fields but for the header, whose stamp (s and ns) and frame are given.
    Sequences of 8-byte numbers are not empty, as CDR pads an empty one differently.
    """
    return _encoder(type_name)(message, sec, nanosec, frame_id)


def encode_columns(
    type_name: str,
    columns: MessageColumns,
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
    frame_id: str | NDArray[np.object_],
) -> Iterator[tuple[Integers, Bytes]]:
    """Yield indices, (m,), of messages of n with equal texts, and their bytes, (m, n_bytes)."""
    groups = [np.arange(len(sec))]
    texts = {
        field.name: frame_id if field.name in _HEADER else getattr(columns, field.name)
        for field in message_fields(type_name)
        if field.type == "string"
    }
    for text in texts.values():
        if not isinstance(text, str):
            groups = [rows[text[rows] == each] for rows in groups for each in np.unique(text[rows])]
    for rows in groups:
        if len(rows):
            alike = columns if len(rows) == len(sec) else columns.rows(rows)
            shared = {
                name: str(text if isinstance(text, str) else text[rows[0]])
                for name, text in texts.items()
            }
            yield rows, _encode_alike(type_name, alike, shared, sec[rows], nanosec[rows])


@cache
def _encoder(type_name: str) -> Callable[[object, int, int, str], bytes]:
    """Return an encoder, generated as source, since a loop over fields takes twice as long."""
    lines, formats, arguments = [], [], []
    scope: dict[str, Any] = {"encapsulation": _ENCAPSULATION, "pack": struct.pack}
    for i, field in enumerate(message_fields(type_name)):
        value, kind = _HEADER.get(field.name, f"message.{field.name}"), field.dtype
        if field.type == "string":
            lines.append(f"v{i} = {value}.encode() + b'\\0'")  # CDR ends a text with a zero
            formats.append(f"I{{len(v{i})}}s")
            arguments += [f"len(v{i})", f"v{i}"]
        elif field.is_sequence:
            scope |= {"array": np.asarray, f"kind{i}": kind}
            lines.append(f"v{i} = array({value}, kind{i}).tobytes()")
            formats.append(f"I0{kind.char}{{len(v{i})}}s")
            arguments += [f"len(v{i}) // {kind.itemsize}", f"v{i}"]
        elif field.count:
            scope |= {"array": np.asarray, f"kind{i}": kind}
            lines.append(f"v{i} = array({value}, kind{i}).tobytes()")
            formats.append(f"0{_WIDEST[kind.alignment]}{field.count * kind.itemsize}s")
            arguments.append(f"v{i}")
        else:
            formats.append(kind.char)
            arguments.append(value)
    # CDR aligns every number to its own size, as `struct` does in native mode.
    lines.append(f"return encapsulation + pack(f'{''.join(formats)}', {', '.join(arguments)})")
    source = "\n    ".join(["def encode(message, sec, nanosec, frame_id):", *lines])
    exec(source, scope)
    return cast(Callable[[object, int, int, str], bytes], scope["encode"])


@lru_cache(maxsize=256)
def _layout(type_name: str, *lengths: int) -> np.dtype[np.void]:
    """Return the data type of a whole message whose texts and sequences have these lengths."""
    columns: list[Any] = []
    remaining = iter(lengths)
    for field in message_fields(type_name):
        if field.type == "string" or field.is_sequence:
            columns.append((f"{field.name} length", "u4"))
            columns.append((field.name, CODES[field.type], (next(remaining),)))
        else:
            columns.append((field.name, field.dtype, (field.count,) if field.count else ()))
    # CDR aligns every number to its own size, as NumPy does, but has no padding at the end.
    aligned: Any = np.dtype(columns, align=True)
    names = list(aligned.names)
    formats, places = zip(*(aligned.fields[name][:2] for name in names), strict=True)
    offsets = [len(_ENCAPSULATION) + place for place in places]
    itemsize = offsets[-1] + formats[-1].itemsize
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})


def _encode_alike(
    type_name: str,
    columns: MessageColumns,
    texts: Mapping[str, str],
    sec: NDArray[np.int32],
    nanosec: NDArray[np.uint32],
) -> Bytes:
    """Encode messages that have the same texts."""
    header, values = {"sec": sec, "nanosec": nanosec}, dict[str, Any]()
    lengths: list[int] = []
    for field in message_fields(type_name):
        name = field.name
        if name in texts:
            values[name] = np.frombuffer(texts[name].encode() + b"\x00", np.uint8)
        else:
            values[name] = header[_HEADER[name]] if name in _HEADER else getattr(columns, name)
        if field.is_sequence or name in texts:
            lengths.append(values[name].shape[-1])
            values[f"{name} length"] = lengths[-1]
    layout = _layout(type_name, *lengths)
    rows = np.zeros((len(sec), layout.itemsize), np.uint8)  # CDR pads with zeros
    rows[:, : len(_ENCAPSULATION)] = np.frombuffer(_ENCAPSULATION, np.uint8)
    messages = rows.view(layout)[:, 0]
    for name, value in values.items():
        messages[name] = value
    return rows


def stamp_and_frame(message: MessageColumns) -> tuple[int, int, str]:
    """Return the stamp of one message, s and ns, and its frame."""
    return int(message.sec), int(message.nanosec), str(message.frame_id)
