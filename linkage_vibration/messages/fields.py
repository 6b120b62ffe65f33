# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of our messages, read from their ``.msg`` files.

This is the only list of fields: encoders, log schemas and the check of the installed message
classes are derived from it.
"""

import re
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from linkage_vibration.messages.definitions import OWN_PACKAGE, message_text

CODES = {"bool": "u1", "float32": "f4", "float64": "f8", "string": "u1"}  # NumPy's, by types
CODES |= {f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4)}

# Our messages contain these two messages of other packages, and they never change.
_NESTED = {"std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id"}
_NESTED["builtin_interfaces/Time"] = "int32 sec\nuint32 nanosec"


@dataclass(frozen=True, slots=True)
class Field:
    """A number, a text, or a sequence of them."""

    name: str  # such as ``header.stamp.sec``
    type: str  # ``string``, or such as ``float64``
    is_sequence: bool
    limit: int = field(default=0, compare=False)
    count: int = 0  # of the elements of an array whose length never changes; 0: there is none
    comment: str = field(default="", compare=False)

    @property
    def dtype(self) -> "np.dtype[np.generic]":
        """The type of a number or, of an array of one of our messages, that of an element."""
        if self.type in CODES:
            return np.dtype(CODES[self.type])
        return np.dtype([(f.name, CODES[f.type]) for f in message_fields(self.type)], align=True)

    @property
    def unit(self) -> str:
        """The unit of a number, such as Hz or 1."""
        return re.split("[,;]", self.comment)[0]


@cache
def message_fields(type_name: str) -> tuple[Field, ...]:
    """Return the fields of one of our messages in their order, nested messages flattened."""
    return tuple(_parse(message_text(type_name), ""))


@cache
def message_constants(type_name: str) -> dict[str, int]:
    """Return the constants of one of our messages by their names."""
    lines = re.findall(r"^u?int8 (\w+) = (-?\d+)$", message_text(type_name), re.MULTILINE)
    return {name: int(value) for name, value in lines}


def _parse(text: str, prefix: str) -> list[Field]:
    """Return the fields that a ``.msg`` text defines; constants are left out."""
    fields: list[Field] = []
    for line in text.splitlines():
        code, _, comment = line.partition("#")
        words = code.split()
        if not words or "=" in words:
            continue
        kind, bracket, limit = words[0].partition("[")
        name = prefix + words[1]
        if kind in _NESTED:
            fields += _parse(_NESTED[kind], f"{name}.")
        elif kind not in CODES and not bracket:
            fields += _parse(message_text(f"{OWN_PACKAGE}/msg/{kind}"), f"{name}.")
        else:
            size, comment = int(limit.strip("<=]") or 0), comment.strip()
            if limit[:1].isdecimal():
                fields.append(Field(name, f"{OWN_PACKAGE}/msg/{kind}", False, 0, size, comment))
            else:
                fields.append(Field(name, kind, bool(bracket), size, 0, comment))
    return fields
