# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node refuses message classes of another version."""

from typing import Any

import pytest

from linkage_vibration.ros import interface_check
from linkage_vibration.ros.interface_check import InterfaceError, check_interfaces
from linkage_vibration_interfaces.msg import Resonance, VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration


def test_installed_classes_fit() -> None:
    """The classes of this environment read what this package encodes."""
    check_interfaces()


def test_class_with_other_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the class, the fields that differ, and the version to install."""

    class Other(Resonance):
        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            fields = Resonance.get_fields_and_field_types()
            return {name: kind for name, kind in fields.items() if name != "approach"}

    original = interface_check.message_class
    monkeypatch.setattr(
        interface_check,
        "message_class",
        lambda kind: Other if kind.endswith("Resonance") else original(kind),
    )
    match = r"msg/Resonance has other fields \(approach\).* install linkage_vibration_interfaces \d"
    with pytest.raises(InterfaceError, match=match):
        check_interfaces()


def test_class_that_reads_other_values(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same names in the same order are not enough."""
    original = interface_check.deserialize_message

    def swapped(data: bytes, kind: type) -> Any:
        message = original(data, kind)
        if kind is VibrationPrediction:
            message.frequency_stddev = message.damping_ratios
        return message

    monkeypatch.setattr(interface_check, "deserialize_message", swapped)
    with pytest.raises(InterfaceError, match="VibrationPrediction reads other values of frequency"):
        check_interfaces()


def test_service_with_other_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    """A request without one of our fields would fail at the first call, so it is refused before."""

    class Stale(PredictVibration.Request):
        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            fields = PredictVibration.Request.get_fields_and_field_types()
            return {name: kind for name, kind in fields.items() if name != "shares"}

    class Service(PredictVibration):
        Request = Stale

    original = interface_check.message_class
    monkeypatch.setattr(
        interface_check,
        "message_class",
        lambda kind: Service if kind.endswith("PredictVibration") else original(kind),
    )
    match = r"srv/PredictVibration_Request has other fields \(shares\).* install linkage"
    with pytest.raises(InterfaceError, match=match):
        check_interfaces()
