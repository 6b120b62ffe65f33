# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of message types, and the paths to the numbers in them."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, TypeAlias

from linkage_vibration.errors import LinkageVibrationError

HEADER = "std_msgs/msg/Header"
NUMBERS = {"float64": "f8", "float32": "f4", "byte": "u1", "octet": "u1", "char": "u1"}
NUMBERS |= {f"int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)}
NUMBERS |= {f"uint{8 * size}": f"u{size}" for size in (1, 2, 4, 8)}
"""The kinds of numbers, and how NumPy names them."""

_LISTED = 40  # paths in an error
_DEEPEST = 8  # levels of messages in an error
_QUOTED = re.compile(r'"(.*)"')  # a name in quotes may be a number
_KEY = re.compile(r"\[.*?\]")
_STEP = re.compile(r"(?P<name>[A-Za-z]\w*)(?:\[(?P<key>.*?)\](?=\.|$))?(?:\.|$)")


class FieldError(LinkageVibrationError):
    """A type of messages has no such number."""


@dataclass(frozen=True, slots=True)
class SchemaField:
    """A field of a message."""

    name: str
    type: str  # of one element: "float64", "bool", "string" or "package/msg/Name"
    length: int | None = None  # 0: a sequence; None: one value


Schema: TypeAlias = Mapping[str, tuple[SchemaField, ...]]
"""The fields of a type and of all types that it contains, by their names."""

# CDR has no empty messages.
EMPTY = (SchemaField("structure_needs_at_least_one_member", "uint8"),)


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a path: a field, and which of its elements."""

    field: SchemaField
    index: int | None = None  # place, from 0; None for one value
    names: str = ""  # the list of names beside the field
    name: str = ""  # in that list, instead of a place


def schema_of_store(store: Any, type_name: str) -> Schema:
    """Return the fields of a type in a type store of rosbags, without types that it lacks."""
    known = store.fielddefs
    return schema_by(
        type_name,
        lambda name: [_field(*each) for each in known[name][1]] if name in known else None,
    )


def schema_by(
    type_name: str, fields_of: Callable[[str], Sequence[SchemaField] | None]
) -> dict[str, tuple[SchemaField, ...]]:
    """Return the fields of a type and of those that it contains; None for one not known."""
    schema: dict[str, tuple[SchemaField, ...]] = {}
    waiting = [type_name]
    while waiting:
        name = waiting.pop()
        if name not in schema and (listed := fields_of(name)) is not None:
            schema[name] = tuple(listed) or EMPTY
            waiting += [field.type for field in listed if "/" in field.type]
    return schema


def schema_of_text(text: str, type_name: str) -> Schema:
    """Return the fields of a type from its definition as an MCAP schema, which needs rosbags."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, type_name))
    return schema_of_store(store, type_name)


def _field(name: str, content: Any) -> SchemaField:
    """Return a field as rosbags describes it: its kind, and what it contains."""
    kind, inner = content
    if kind.name in ("BASE", "NAME"):
        return SchemaField(name, inner if isinstance(inner, str) else str(inner[0]))
    (_, element), length = inner
    element = element if isinstance(element, str) else str(element[0])
    return SchemaField(name, element, int(length) if kind.name == "ARRAY" else 0)


def has_header(schema: Schema, type_name: str) -> bool:
    """Return whether the messages of a type begin with a header."""
    return schema[type_name][0] == SchemaField("header", HEADER)


def find_path(schema: Schema, type_name: str, path: str) -> tuple[Step, ...]:
    """Return the steps of a path to a number, such as "twist.linear.x" or "position[boom]"."""
    steps: list[Step] = []
    at, inside = 0, type_name
    while at < len(path) or not steps:
        match = _STEP.match(path, at)
        if match is None or inside not in schema:
            raise _unknown(schema, type_name, path)
        at = match.end()
        step = _step(schema[inside], match["name"], match["key"])
        if step is None:
            raise _unknown(schema, type_name, path)
        steps.append(step)
        inside = step.field.type
    if inside not in NUMBERS or path.endswith("."):
        raise _unknown(schema, type_name, path)
    return tuple(steps)


def _step(fields: tuple[SchemaField, ...], name: str, key: str | None) -> Step | None:
    """Return a step to a field of a message; None if there is no such field or element."""
    field = next((field for field in fields if field.name == name), None)
    if field is None or (field.length is None) != (key is None):
        return None
    if key is None:
        return Step(field)
    names = _names_beside(fields, field)
    if names and key and not key.isdecimal():
        return Step(field, names=names, name=_QUOTED.sub(r"\1", key))
    if not key.isdecimal() or (field.length and int(key) >= field.length):
        return None
    return Step(field, index=int(key))


def _names_beside(fields: tuple[SchemaField, ...], field: SchemaField) -> str:
    """Return the only list of texts beside a list of its kind; empty if there is none."""
    names = [each.name for each in fields if each.type == "string" and each.length == field.length]
    return names[0] if len(names) == 1 and names[0] != field.name else ""


def _unknown(schema: Schema, type_name: str, path: str) -> FieldError:
    """Return the error that a type has no such number, with the numbers that it has."""
    paths = list(_paths(schema, type_name, _DEEPEST))
    shown = ", ".join(paths[:_LISTED]) + (", ..." if len(paths) > _LISTED else "")
    without = {_KEY.sub("", each): each for each in paths}
    similar = get_close_matches(_KEY.sub("", path), without, 1)
    asked = f"did you mean {without[similar[0]]}? " if similar else ""
    listing = f"its numbers are {shown}" if paths else "it has no numbers"
    return FieldError(f"{type_name} has no number {path!r}; {asked}{listing}.")


def _paths(schema: Schema, type_name: str, levels: int) -> Iterator[str]:
    """Yield the paths to all numbers of a type, with NAME and INDEX for elements of lists."""
    fields = schema[type_name]
    for field in fields:
        path = field.name
        if field.length is not None:
            last = f"0 to {field.length - 1}" if field.length else "INDEX"
            path += f"[NAME or {last}]" if _names_beside(fields, field) else f"[{last}]"
        if field.type in NUMBERS:
            yield path
        elif field.type in schema and levels:
            yield from (f"{path}.{rest}" for rest in _paths(schema, field.type, levels - 1))
