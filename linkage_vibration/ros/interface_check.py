# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that the installed message classes have the fields that this package encodes."""

from operator import attrgetter
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.definitions import OWN_PACKAGE, own_services
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.fields import CODES, message_fields
from linkage_vibration.messages.topics import PREDICTION, RESONANCE, TABLE_INFO
from linkage_vibration.ros.endpoints import message_class
from linkage_vibration.support.version import VERSION


class InterfaceError(LinkageVibrationError):
    """The installed package of messages has another version than this package."""


def check_interfaces() -> None:
    """Compare the installed classes of messages and services with our definitions of them.

    One message of each kind that the node publishes is also decoded with rclpy, and compared with
    what was encoded. A difference raises an `InterfaceError`.
    """
    _check_names(TABLE_INFO, message_class(TABLE_INFO))
    for name in own_services():
        service = message_class(name)
        _check_names(f"{name}_Request", service.Request)
        _check_names(f"{name}_Response", service.Response)
    for name in (PREDICTION, RESONANCE):
        _check_values(name)


def _example(type_name: str) -> MessageColumns:
    """Return a message whose fields, except those of the header, have different values."""
    fields: dict[str, Any] = {}
    for i, field in enumerate(message_fields(type_name)):
        value = np.array([i, i + 100], CODES[field.type])
        number = value if field.is_sequence else value[0]
        fields[field.name] = f"text {i}" if field.type == "string" else number
    return MessageColumns(**fields)


def _check_names(type_name: str, kind: Any) -> None:
    """Refuse a message class whose fields have other names."""
    expected = list(dict.fromkeys(f.name.split(".")[0] for f in message_fields(type_name)))
    installed = list(kind.get_fields_and_field_types())
    if installed != expected:
        differing = ", ".join(sorted({*installed} ^ {*expected})) or "their order"
        raise _mismatch(type_name, f"has other fields ({differing})")


def _check_values(type_name: str) -> None:
    """Refuse a message class that reads other values than were encoded."""
    _check_names(type_name, message_class(type_name))
    example = _example(type_name)
    encoded = encode_message(type_name, example, 1, 2, "frame")
    try:
        decoded = deserialize_message(encoded, message_class(type_name))
    except RuntimeError as error:
        raise _mismatch(type_name, f"cannot read our messages ({error})") from None
    stamp: dict[str, Any] = {"header.stamp.sec": 1, "header.stamp.nanosec": 2}
    header = stamp | {"header.frame_id": "frame"}
    for field in message_fields(type_name):
        expected = header.get(field.name) or getattr(example, field.name)
        if not np.array_equal(attrgetter(field.name)(decoded), expected):
            raise _mismatch(type_name, f"reads other values of {field.name}")


def _mismatch(type_name: str, difference: str) -> InterfaceError:
    version = VERSION
    return InterfaceError(
        f"The installed {type_name} {difference}, so {OWN_PACKAGE} has another version than "
        f"linkage_vibration {version}; install {OWN_PACKAGE} {version}, or rebuild the workspace."
    )
