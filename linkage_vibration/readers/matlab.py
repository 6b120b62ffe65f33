# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads real matrices and text from MATLAB 5 files (``save -v6`` and ``-v7``).

Own code because `scipy.io.loadmat` crashed Python on 9 of 500 damaged files (`python -m
benchmark.libraries`), and reading in another process is slower. Full and sparse matrices, character
matrices and cell arrays are read; the layout is that of MathWorks' "MAT-File Format", level 5.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from linkage_vibration.readers.component_files import (
    MAX_BYTES,
    FileError,
    check_file,
    check_size,
    compressed_columns,
    file_errors,
)

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"}
_NUMBERS |= {7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _CHAR, _SPARSE = 1, 4, 5
_FULL = range(6, 16)  # double, single, and the integers
_COMPLEX = 0x800
_DAMAGE = (LookupError, RecursionError, StopIteration, ValueError, struct.error, zlib.error)


@dataclass(frozen=True, slots=True)
class _Element:
    """The type of an element, and its bytes."""

    kind: int
    data: bytes


def read_matlab(path: Path) -> dict[str, Any]:
    """Return the variables of a file by name.

    They are arrays of numbers, sparse arrays, or lists: the rows of a character matrix, or the
    cells of a cell array. Anything else is a ComponentFileError.
    """
    with file_errors(path, *_DAMAGE):
        check_file(path)
        content = path.read_bytes()
        order = _byte_order(content[:_HEADER])
        variables: dict[str, Any] = {}
        unpacked = 0
        for element in _elements(content[_HEADER:], order):
            if element.kind == _COMPRESSED:
                tag = zlib.decompressobj().decompress(element.data, 8)
                check_size(unpacked + struct.unpack(f"{order}II", tag)[1])
                data = zlib.decompressobj().decompress(element.data, MAX_BYTES + 1 - unpacked)
                unpacked += len(data)
                check_size(unpacked)
                element = next(_elements(data, order))
            if element.kind == _MATRIX:
                variables.update([_variable(element.data, order)])
        return variables


def _byte_order(header: bytes) -> str:
    if header[124:126] in (b"\x00\x02", b"\x02\x00"):
        raise FileError("is a MATLAB 7.3 file; save it with `save -v7`.")
    if header[124:] not in (b"\x00\x01IM", b"\x01\x00MI"):
        raise FileError("is not a MATLAB 5 file; save it with `save -v7`.")
    return "<" if header[126:] == b"IM" else ">"


def _elements(data: bytes, order: str) -> Iterator[_Element]:
    """Yield consecutive elements."""
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # a small element has its data where others have their size
            kind, size, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start, end = at + 8, at + 8 + size
            if kind != _COMPRESSED:
                end += -size % 8
        if start + size > min(end, len(data)):
            raise ValueError("an element is longer than the one around it")
        yield _Element(kind, data[start : start + size])
        at = end


def _variable(data: bytes, order: str) -> tuple[str, Any]:
    """Return the name and the value of a matrix element."""
    flags, dimensions, label, *rest = _elements(data, order)
    (bits,) = struct.unpack_from(f"{order}I", flags.data)
    kind = bits & 0xFF
    shape = tuple(int(n) for n in _numbers(dimensions, order))
    name = label.data.decode("ascii")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"{name} has the dimensions {shape}")
    if bits & _COMPLEX:
        raise FileError(
            f"has a complex {name}; write a real one, and damping as a matrix of its own."
        )
    if kind == _CELL:
        return name, [_variable(cell.data, order)[1] for cell in rest]
    if kind == _CHAR:
        return name, _rows(rest[0], shape, order)
    if kind == _SPARSE:
        return name, _sparse(rest, shape, order)
    if kind in _FULL:
        values = _numbers(rest[0], order)
        if values.size != math.prod(shape):
            raise ValueError(f"{name} holds {values.size} numbers for the dimensions {shape}")
        return name, values.reshape(shape, order="F")
    raise FileError(f"holds {name!r}, which is not a matrix, text or cell array; remove it.")


def _numbers(element: _Element, order: str) -> NDArray[Any]:
    if element.kind not in _NUMBERS:
        raise ValueError(f"data of type {element.kind} where numbers are expected")
    return np.frombuffer(element.data, dtype=order + _NUMBERS[element.kind])


def _rows(element: _Element, shape: tuple[int, ...], order: str) -> list[str]:
    """Return the rows of a character matrix without trailing blanks."""
    encoding = _TEXT.get(element.kind)
    if encoding is None:
        raise ValueError(f"data of type {element.kind} where text is expected")
    if encoding != "utf-8":
        encoding += "-le" if order == "<" else "-be"
    text = element.data.decode(encoding)
    if len(shape) != 2 or len(text) != math.prod(shape):
        raise ValueError(f"{len(text)} characters for the dimensions {shape}")
    return [text[row :: shape[0]].rstrip() for row in range(shape[0])] if text else []


def _sparse(parts: list[_Element], shape: tuple[int, ...], order: str) -> sparse.csc_array:
    rows, starts, values = (_numbers(part, order) for part in parts[:3])
    count = int(starts[-1]) if starts.size else 0
    if len(shape) != 2 or shape[1] + 1 != starts.size or count < 0:
        raise ValueError("the parts of a sparse matrix do not fit together")
    return compressed_columns(values[:count], rows[:count], starts, shape[0])
