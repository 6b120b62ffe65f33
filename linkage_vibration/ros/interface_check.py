# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that the installed message classes have the fields that this package encodes."""

from collections.abc import Iterator

from linkage_vibration.bags.schemas import EMPTY, Schema
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.definitions import OWN_PACKAGE, own_types
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.ros.live_inputs import installed_schema
from linkage_vibration.support.version import VERSION


class InterfaceError(LinkageVibrationError):
    """The installed package of messages has another version than this package."""


def check_interfaces() -> None:
    """Raise an `InterfaceError` if installed messages, services or actions are not ours."""
    for name in own_types():
        expected = [
            (field.name, field.type.rpartition("/")[2], field.is_sequence or field.count > 0)
            for field in message_fields(name)
        ]
        installed = list(_flat(installed_schema(name), name))
        if installed != expected:
            names = sorted({field for field, *_ in {*installed} ^ {*expected}})
            raise InterfaceError(
                f"The installed {name} has other fields ({', '.join(names) or 'their order'}), so "
                f"{OWN_PACKAGE} has another version than linkage_vibration {VERSION}; install "
                f"{OWN_PACKAGE} {VERSION}, or rebuild the workspace."
            )


def _flat(schema: Schema, name: str, prefix: str = "") -> Iterator[tuple[str, str, bool]]:
    """Yield the fields of a type as `message_fields` lists them: names, types, and sequences."""
    for field in () if schema[name] == EMPTY else schema[name]:
        if field.type in schema and field.length is None:
            yield from _flat(schema, field.type, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, field.type.rpartition("/")[2], field.length is not None
