# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that the installed message classes have the fields that this package encodes."""

from operator import attrgetter
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.definitions import OWN_PACKAGE, own_services
from linkage_vibration.messages.encoding import encode_prediction, encode_resonance
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import PREDICTION, RESONANCE, TABLE_INFO
from linkage_vibration.prediction.predictor import Prediction, Status
from linkage_vibration.prediction.resonance import Resonance, ResonanceState
from linkage_vibration.ros.endpoints import message_class
from linkage_vibration.support.version import VERSION


class InterfaceError(LinkageVibrationError):
    """The installed package of messages has another version than this package."""


def check_interfaces() -> None:
    """Compare the installed classes of messages and services with our definitions of them.

    One message of each kind that the node publishes is also decoded with rclpy, and compared with
    what was encoded.

    Raises
    ------
    InterfaceError
        If a message class has other fields, or reads other values.
    """
    one, two, three, four, five = np.arange(2.0, 12.0).reshape(5, 2)
    levels = np.arange(3.0, 11.0, dtype=np.float32).reshape(4, 2)
    near, warning = Status.NEAR_TOGGLE, ResonanceState.WARNING
    prediction = Prediction(1.0, near, one, two, three, four, 12.0, 13.0, 14.0, "table", five)
    about: Any = warning, "engine 1", 1.0, 2, 3.0, 4.0, 5.0, -1, 6.0, "table", 0.25, 0.5, 0.75
    about += np.array([1, 3], np.uint8), *levels, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0, 21.0
    resonance = Resonance(*about)
    _check_names(TABLE_INFO, message_class(TABLE_INFO))
    for name in own_services():
        service = message_class(name)
        _check_names(f"{name}_Request", service.Request)
        _check_names(f"{name}_Response", service.Response)
    _check_values(PREDICTION, prediction, encode_prediction(prediction, 1, 2, "frame"))
    _check_values(RESONANCE, resonance, encode_resonance(resonance, 1, 2, "frame"))


def _check_names(type_name: str, kind: Any) -> None:
    """Refuse a message class whose fields have other names."""
    expected = list(dict.fromkeys(f.name.split(".")[0] for f in message_fields(type_name)))
    found = list(kind.get_fields_and_field_types())
    if found != expected:
        differing = ", ".join(sorted({*found} ^ {*expected})) or "their order"
        raise _mismatch(type_name, f"has other fields ({differing})")


def _check_values(type_name: str, example: object, encoded: bytes) -> None:
    """Refuse a message class that reads other values than were encoded."""
    _check_names(type_name, message_class(type_name))
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
