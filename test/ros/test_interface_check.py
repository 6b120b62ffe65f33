# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node refuses message classes of another version."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from linkage_vibration.bags.schemas import SchemaField
from linkage_vibration.ros import interface_check
from linkage_vibration.ros.interface_check import InterfaceError, check_interfaces
from linkage_vibration.ros.live_inputs import installed_schema

Fields = tuple[SchemaField, ...]


def install(
    monkeypatch: pytest.MonkeyPatch, type_name: str, change: Callable[[Fields], Fields]
) -> None:
    """Let the installed class of a type have other fields."""

    def changed(name: str) -> dict[str, Fields]:
        schema = dict(installed_schema(name))
        return schema | ({name: change(schema[name])} if name == type_name else {})

    monkeypatch.setattr(interface_check, "installed_schema", changed)


def without(name: str) -> Callable[[Fields], Fields]:
    """Return a change that leaves out a field."""
    return lambda fields: tuple(field for field in fields if field.name != name)


def test_installed_classes_fit() -> None:
    """The classes of this environment have the fields that this package encodes."""
    check_interfaces()


def test_class_with_other_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the class, the fields that differ, and the version to install."""
    install(monkeypatch, "linkage_vibration_interfaces/msg/Resonance", without("approach_rate"))
    match = r"msg/Resonance has other fields \(approach_rate\).* linkage_vibration_interfaces \d"
    with pytest.raises(InterfaceError, match=match):
        check_interfaces()


@pytest.mark.parametrize("change", [{"type": "float32"}, {"length": None}])
def test_class_with_another_type(monkeypatch: pytest.MonkeyPatch, change: dict[str, str]) -> None:
    """The same names are not enough: bytes of another type would be read as other values."""

    def changed(fields: Fields) -> Fields:
        named = {field.name: field for field in fields}
        named["frequency_stddevs"] = replace(named["frequency_stddevs"], **change)  # type: ignore[arg-type]
        return tuple(named.values())

    install(monkeypatch, "linkage_vibration_interfaces/msg/VibrationPrediction", changed)
    with pytest.raises(InterfaceError, match=r"other fields \(frequency_stddevs\)"):
        check_interfaces()


def test_class_with_another_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """CDR has no names, so the order counts."""
    prediction = "linkage_vibration_interfaces/msg/VibrationPrediction"
    install(monkeypatch, prediction, lambda fields: fields[::-1])
    with pytest.raises(InterfaceError, match=r"other fields \(their order\)"):
        check_interfaces()


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("srv/PredictVibration_Request", "shares"),
        ("action/SetImplement_Goal", "mass"),
        ("action/SetImplement_Result", "table_id"),
        ("action/SetImplement_Feedback", "progress"),
    ],
)
def test_part_with_other_fields(name: str, field: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part without one of our fields would fail at the first call, so it is refused before."""
    install(monkeypatch, f"linkage_vibration_interfaces/{name}", without(field))
    match = rf"{name} has other fields \({field}\).* install linkage"
    with pytest.raises(InterfaceError, match=match):
        check_interfaces()
