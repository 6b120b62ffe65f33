# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of our messages, read from their ``.msg`` files.

This is the only list of fields: encoders, log schemas and the check of the installed message
classes are derived from it.
"""

from dataclasses import dataclass
from functools import cache

from linkage_vibration.messages.definitions import message_text

CODES = {"bool": "u1", "float32": "f4", "float64": "f8", "string": "u1"}
"""NumPy's codes of the types; a text is a sequence of bytes."""
CODES |= {f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4)}

# Our messages contain these two messages of other packages, and they never change.
_NESTED = {"std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id"}
_NESTED["builtin_interfaces/Time"] = "int32 sec\nuint32 nanosec"


@dataclass(frozen=True, slots=True)
class Field:
    """A number, a text, or a sequence of them.

    Attributes
    ----------
    name : str
        Such as ``header.stamp.sec`` for a field of a nested message.
    type : str
        ``string``, or the name of a number type such as ``float64``.
    is_sequence : bool
    """

    name: str
    type: str
    is_sequence: bool


@cache
def message_fields(type_name: str) -> tuple[Field, ...]:
    """Return the fields of one of our messages in their order, nested messages flattened."""
    return tuple(_parse(message_text(type_name), ""))


def _parse(text: str, prefix: str) -> list[Field]:
    """Return the fields that a ``.msg`` text defines; constants are left out."""
    fields: list[Field] = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if not words or "=" in words:
            continue
        kind, name = words[0].removesuffix("[]"), prefix + words[1]
        if kind in _NESTED:
            fields += _parse(_NESTED[kind], f"{name}.")
        else:
            fields.append(Field(name, kind, words[0].endswith("[]")))
    return fields
